"""Physics that no name fits: where it acts, what it is like, and the law that models it."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from two_masses import FINE, PLACES, RATE, Law, diagnosed

import iwanjax as ij
from iwanjax.discrepancy.findings import PlaceEvidence
from iwanjax.discrepancy.histories import unnamed
from iwanjax.discrepancy.histories.place_test import Block
from iwanjax.discrepancy.histories.score_test import by_evidence, left_likely
from iwanjax.discrepancy.judgement import Misfit, acting, beside_general_law, judged
from iwanjax.effects.catalogue import kinds_in_time
from iwanjax.identification.places import Place
from iwanjax.joints import UnnamedLaw
from iwanjax.joints.duhem import NODES
from iwanjax.joints.force_law import Scales
from iwanjax.plotting import plot_unnamed
from iwanjax.settings.histories import HISTORIES
from iwanjax.studies.verdicts import as_json

C = 4.0
NAMES = ("viscous_damping",)


def root_damper() -> Law:
    return lambda d, v, moved: C * math.copysign(math.sqrt(abs(v)), v)


@pytest.fixture(scope="module")
def found():
    """The verdict on masses that lack a damper that grows with the root of the rate."""
    return diagnosed(root_damper, NAMES)


@pytest.mark.long
def test_the_place_comes_first_and_no_name_is_believed(found):
    first, *others = found.what
    assert first.label == "unnamed_law@m1-m2"
    assert first.probability > 0.9
    assert found.verdict.name == "undecided"
    assert found.detected
    assert all(each.probability < 0.5 for each in others)
    assert found.probability_something_else > 0.9
    assert found.after.hold_out < 1.3 * found.noise_floor.hold_out
    assert found.before.hold_out > 100.0 * found.noise_floor.hold_out


def microslip() -> Law:
    """Sliders that give way one after the other; the hits reach the first few."""
    slips = 0.02 * (np.arange(24) + 0.5) / 24
    stretch = np.zeros(len(slips))

    def force(d: float, v: float, moved: float) -> float:
        np.clip(stretch + moved, -slips, slips, out=stretch)
        return 500.0 * float(np.mean(stretch))

    return force


@pytest.mark.long
def test_a_joint_that_hardly_slips_is_no_spring():
    """Nor far from one: with the spring alone the squares are 1.4 times those of the noise."""
    found = diagnosed(microslip, ("stiffness_error", "viscous_damping"))
    first, spring, *_ = found.what
    assert first.label == "unnamed_law@m1-m2"
    assert (spring.label, spring.probability < 0.05) == ("stiffness_error@m1-m2", True)
    assert found.unnamed.description == "elastic, linear, rate-independent hysteresis"
    assert found.after.hold_out < 1.1 * found.noise_floor.hold_out
    # One of which no slider ever gives way is a spring.
    stuck = diagnosed(lambda: lambda d, v, moved: 500.0 * d, ("stiffness_error",))
    assert stuck.what[0].label == "stiffness_error@m1-m2"
    assert stuck.verdict.found


def relaxing() -> Law:
    """Two Maxwell elements, one that relaxes within a cycle and one over several."""
    k, tau, dt = np.array([8e3, 8e3]), np.array([1e-3, 2e-2]), 1.0 / (RATE * FINE)
    stretch = np.zeros(2)

    def force(d: float, v: float, moved: float) -> float:
        stretch[:] = (stretch + moved) * np.exp(-dt / tau)
        return float(k @ stretch)

    return force


@pytest.mark.long
def test_two_relaxation_times_are_a_spectrum_and_no_name():
    """Two elements would explain all, and so would many: one alone is not what is missing."""
    found = diagnosed(relaxing, ("viscoelastic", "viscous_damping", "stiffness_error"))
    assert found.what[0].label == "unnamed_law@m1-m2"
    assert all(each.probability < 0.5 for each in found.what[1:])
    assert found.unnamed.description.endswith("a force that relaxes with time")
    assert found.after.hold_out < 1.3 * found.noise_floor.hold_out
    assert found.before.hold_out > 10.0 * found.noise_floor.hold_out


K_PINCHED, SLIP = 4e4, 4e-5


def pinching(share: float) -> float:
    """Bouc and Wen's with the exponent 1, pinched where it grows again (Baber and Noori 1985)."""
    open_to = 1.0 - 0.85 * math.exp(-(((share - 0.15) / 0.2) ** 2))
    return open_to * (1.0 - max(share, 0.0))


def pinched() -> Law:
    z = 0.0

    def force(d: float, v: float, moved: float) -> float:
        nonlocal z
        z += moved * pinching(math.copysign(z, z * moved) / SLIP)
        return K_PINCHED * z

    return force


@pytest.mark.long
def test_pinched_hysteresis_yields_along_a_curve_of_its_own():
    found = diagnosed(pinched, (*NAMES, "coulomb_friction", "iwan_joint"))
    assert found.what[0].label == "unnamed_law@m1-m2"
    assert all(each.probability < 0.5 for each in found.what[1:])
    assert found.after.hold_out < 1.3 * found.noise_floor.hold_out
    assert found.before.hold_out > 20.0 * found.noise_floor.hold_out
    assert found.unnamed.description == "rate-independent hysteresis, pinched"
    duhem = found.unnamed.law.duhem
    assert float(duhem.force) == pytest.approx(K_PINCHED * SLIP, rel=0.02)
    # How fast the force grows with the deflection, wherever it does; by the noise, and neighbours
    # that make up for each other, single nodes were up to 0.16 off.
    expected = np.array([pinching(w) for w in NODES])
    np.testing.assert_allclose(SLIP * np.asarray(duhem.f), expected, atol=0.25)
    closed = np.argmin(np.where(NODES < 0.7, duhem.f, np.inf))
    assert NODES[closed] == pytest.approx(0.15, abs=0.05)


@pytest.mark.long
def test_a_general_law_that_fails_costs_no_verdict(monkeypatch):
    def failing(*arguments):
        raise ValueError("singular")

    for module in ("selection", "unnamed"):
        monkeypatch.setattr(f"iwanjax.discrepancy.histories.{module}.general_law", failing)
    found = diagnosed(root_damper, NAMES)
    assert found.what[0].label == "viscous_damping@m1-m2"
    assert found.unnamed is None
    assert found.failures == ("looking for a law that has no name failed (ValueError: singular)",)


@pytest.mark.long
def test_it_is_said_what_it_is_like(found):
    told = found.unnamed.description
    assert told.startswith("damping that grows with the rate to the power 0.5")
    assert told.endswith("no memory")
    assert "elastic" not in told
    assert found.statement().startswith("A force that no name fits is missing between m1 and m2")
    (entry, *_) = as_json({"masses": found}, {"masses": "law.npz"})["what"]
    assert entry["description"] == told
    assert entry["file"] == "law.npz"
    assert {each["kind"] for each in entry["nearest"]} <= set(NAMES)
    assert plot_unnamed(found).axes


@pytest.mark.long
def test_its_force_is_that_of_the_root_and_the_model_moves_by_it(found, tmp_path):
    law = UnnamedLaw.load(found.unnamed.law.save(tmp_path / "law.npz"))
    d, force = found.unnamed.path
    # Fitted on the scale of its own motion, not of a model's without it.
    assert float(law.deflection) == pytest.approx(np.max(np.abs(d)), rel=0.06)
    v = np.gradient(d)
    assert np.corrcoef(force, np.sign(v) * np.sqrt(np.abs(v)))[0, 1] > 0.99
    assert found.model.labels == ("unnamed_law@m1-m2",)
    push = np.zeros((200, 2))
    push[10:20, 0] = 60.0
    moved = ij.simulate(found.model, push, 1.0 / 1024.0, sensors=[PLACES["m1-m2"]])
    assert bool(moved.balanced)
    rate = np.ravel(moved.velocity)
    fast = np.abs(rate) > 0.1 * np.max(np.abs(rate))
    expected = C * np.sign(rate) * np.sqrt(np.abs(rate))
    reach = np.max(np.abs(expected))
    np.testing.assert_allclose(np.ravel(moved.joint_force)[fast], expected[fast], atol=0.05 * reach)
    assert float(law.dissipation(1e-3)) > 0.0


def test_names_are_believed_as_far_as_a_general_law_leaves_them_their_misfit():
    names, before = (-0.1, -40.0), Misfit(50.0, 60.0)
    held = Misfit(4.0, 5.0)
    verdict = judged(-2000.0, names, before, held)
    assert verdict.found
    # A law that leaves half of what the names do is no reason to doubt them.
    assert beside_general_law(verdict, held, Misfit(2.0, 3.0)).found
    # A twelfth is: Bouc and Wen's hysteresis for dry friction and an Iwan joint.
    fewer = beside_general_law(verdict, Misfit(11.9, 0.7), Misfit(1.42, 0.2))
    assert fewer.detected
    assert not fewer.found
    # One that leaves no more than noise is.
    alone = beside_general_law(verdict, held, Misfit(1.0, 1.0))
    assert (alone.name, alone.detected) == ("undecided", True)
    assert max(alone.named) < 0.01
    assert acting(alone, before, Misfit(1.0, 1.0), 0.9) == pytest.approx(0.9, abs=1e-3)
    # One that leaves a fifth, a twenty-fifth of the squares, acts there none the less.
    assert acting(alone, before, Misfit(10.0, 12.0), 0.9) == pytest.approx(0.864, abs=1e-3)
    # One that takes nothing away does not.
    assert acting(alone, before, before, 0.9) == 0.0


def test_names_at_two_places_are_believed_as_far_as_one_law_at_one_leaves_more():
    """A fractional damper at the tip was named Maxwell at w2 and viscous at the tip, 1.00."""
    verdict = judged(-2000.0, (-0.1, -40.0), Misfit(50.0, 60.0), Misfit(1.0, 1.0))
    assert verdict.found

    def kept(named, general):
        now = beside_general_law(verdict, Misfit(*named), Misfit(*general), elsewhere=1.0)
        return sum(now.named) / sum(verdict.named)

    assert kept((1.0, 1.0), (0.9, 1.0)) == pytest.approx(0.5)
    assert kept((1.2, 1.3), (1.2, 1.3)) == pytest.approx(0.5)
    assert kept((1.0, 1.0), (1.1, 1.0)) == 1.0
    assert kept((1.1, 1.0), (1.0, 1.0)) == 0.0
    assert kept((1.2, 1.0), (1.3, 1.0)) == pytest.approx(0.69**2 / (0.69**2 + 0.44**2))
    # Whatever breaks down explains nothing.
    assert kept((1.2, 1.0), (math.inf, 1.0)) == 1.0
    assert kept((math.inf, 1.0), (1.2, 1.0)) == 0.0
    # Damping at w3 that was left out was a spring and a Maxwell element at the tip, 0.98; a law was
    # tried there, too, and acts at w3 with 0.91.
    names, law = Misfit(2.72, 0.58), Misfit(1.07, 0.19)
    assert sum(beside_general_law(verdict, names, law).named) > 0.8
    assert sum(beside_general_law(verdict, names, law, elsewhere=0.91).named) < 0.1
    # Of names at the law's own place as much is asked as of any.
    assert sum(beside_general_law(verdict, Misfit(1.2, 1.3), Misfit(1.2, 1.3)).named) > 0.99


def test_names_that_leave_more_than_noise_are_none_where_a_law_leaves_no_more():
    """A fractional damper at the tip was named an oscillator beside it, 1.00."""
    verdict = judged(-2000.0, (-0.1, -40.0), Misfit(5.0, 30.0), Misfit(1.26, 0.98))
    assert verdict.found

    def kept(named, general):
        now = beside_general_law(verdict, Misfit(*named), Misfit(*general))
        return sum(now.named) / sum(verdict.named)

    # Half where the law leaves what may be wrong with any model.
    assert kept((1.26, 0.98), (math.sqrt(1.06), 0.35)) == pytest.approx(0.5, abs=0.01)
    assert kept((1.26, 0.98), (1.02, 0.35)) < 0.4
    # Where neither is right the law is nothing but richer.
    assert kept((1.5, 1.0), (1.3, 1.0)) > 0.98


ANYWHERE, NOWHERE = "", None


@pytest.mark.parametrize(
    ("name", "where", "left", "by_others", "there"),
    [
        ("stiffness_error", "a", 1.01, 0.5, NOWHERE),
        ("stiffness_error", "a", 1.1, 0.01, NOWHERE),
        ("stiffness_error", "a", 1.1, 0.05, "a"),
        # Where more is left the place is not known either.
        ("stiffness_error", "a", 1.3, 0.0, ANYWHERE),
        # Two names at two places may be one law at one of them, where a rival is, or anywhere.
        ("stiffness_error", "ab", 1.01, 0.0, "abed"),
        ("stiffness_error", "ab", 1.3, 0.0, ANYWHERE),
        # At a channel there is no law.
        ("stiffness_error", "ac", 1.3, 0.0, NOWHERE),
        # A joint left out may be any hysteresis; one that is there and changes is none.
        ("iwan_joint", "a", 1.3, 0.0, ANYWHERE),
        ("bouc_wen", "a", 1.3, 0.0, ANYWHERE),
        ("joint_drift", "a", 1.3, 0.0, NOWHERE),
    ],
)
def test_a_general_law_is_tried_where_a_name_leaves_more_than_noise(
    monkeypatch, name, where, left, by_others, there
):
    """Little more, and other laws do that; or much more, of which slopes tell nothing."""
    places = [Place(label, np.eye(4)[i], Scales(1e-3, 0.1)) for i, label in enumerate("abde")]
    problem = SimpleNamespace(settings=HISTORIES)
    kinds = [next(each for each in kinds_in_time() if each.name == name)] * len(where)
    hypothesis = SimpleNamespace(kinds=kinds, where=tuple(where), label="named")
    fitted = SimpleNamespace(hypothesis=hypothesis, cost=1000.0 * left, time_constant=math.inf)
    best = SimpleNamespace(problem=problem, fitted=fitted)
    asked = []

    def law(table, problem, scope, there):
        asked.append(there)
        raise ZeroDivisionError

    monkeypatch.setattr(unnamed, "unnamed_law", law)
    more = Block(np.ones(1), np.array([1000.0 * by_others]))
    monkeypatch.setattr(unnamed, "more_there", lambda *args: more)
    monkeypatch.setattr(unnamed, "left_by_noise", lambda problem: 1000.0)
    monkeypatch.setattr(unnamed, "misfit", lambda *args: Misfit(1.2, 1.0))
    run = SimpleNamespace(relative=1e-3, floor=1e-3, floor_95=1.1e-3), None
    verdict = judged(-1e4, (0.0,), Misfit(50.0, 60.0), Misfit(1.2, 1.0))
    ended = unnamed.Ended(verdict, run, run, 2e-3)
    other = SimpleNamespace(kinds=kinds[:1], where=("e",))
    rival = SimpleNamespace(hypothesis=other, cost=2000.0 * left, time_constant=math.inf)
    entries = [best, SimpleNamespace(problem=problem, fitted=rival)]
    table = SimpleNamespace(best=best, nominal=best, entries=entries)
    scope = SimpleNamespace(in_time=lambda: True, progress=lambda line: None, places=places)
    known = table, problem, scope, ended, None
    if there is NOWHERE:
        assert unnamed.beyond_names(*known) is None
        assert not asked
        return
    with pytest.raises(ZeroDivisionError):
        unnamed.beyond_names(*known)
    assert ["".join(each.label for each in tried) for tried in asked] == [there]


def test_a_law_is_tried_first_where_all_laws_together_explain_most():
    """By the best single name that of a clearance that rubs was none of the first three."""
    places = [
        Place(name, np.eye(3)[i], Scales(1e-3, 0.1)) for i, name in enumerate(("a", "b", "c"))
    ]
    tested = [PlaceEvidence("b", 0.9, 0.8, 16, 19.0), PlaceEvidence("a", 0.1, 0.9, 1, 13.0)]
    assert [each.label for each in by_evidence(tested, places)] == ["b", "a", "c"]
    # One that is untested may be the right one, one that the likeliest excludes is not; a sensor
    # excludes no place.
    assert [each.label for each in left_likely(tested, places)] == ["b", "a", "c"]
    far = [tested[0], tested[1]._replace(log_evidence=6.0), PlaceEvidence("a1", 1, 1, 3, 99.0)]
    assert [each.label for each in left_likely(far, places)] == ["b", "c"]
    assert left_likely([], places) == places
