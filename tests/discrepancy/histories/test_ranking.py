from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from iwanjax.correlation import correlation_time
from iwanjax.discrepancy.findings import PlaceEvidence
from iwanjax.discrepancy.histories import unnamed
from iwanjax.discrepancy.histories.ranking import (
    TIME_CONSTANT,
    RankedFit,
    containing,
    distinct,
    doubted,
    finalists,
    missing,
    ranked,
)
from iwanjax.discrepancy.histories.selection import ModelSelection
from iwanjax.discrepancy.histories.validation import compared
from iwanjax.effects.catalogue import kinds_of
from iwanjax.effects.kinds import ForceKind
from iwanjax.identification.likelihood import covariance, left_by_noise
from iwanjax.identification.suspects import ParameterMap
from iwanjax.joints import PlaceMotion
from iwanjax.settings.histories import HISTORIES
from iwanjax.signals.comparison_band import OF_NOISE

N = 4000
KINDS = {kind.name: kind for kind in reversed(kinds_of())}
SEARCH = SimpleNamespace(
    data=SimpleNamespace(weight=np.ones((1, N, 1))),
    noise=np.array([np.sqrt(0.9)]),
    driven=0.0,
    settings=HISTORIES,
    predictor=SimpleNamespace(kept=5),
    map=ParameterMap(4),
    recordings=2,
    parameters=4,
)
WHITE = np.random.default_rng(5).standard_normal((1, N, 1))


def entry(cost: float, *parts: str, time_constant: float = TIME_CONSTANT) -> RankedFit:
    """A fit that leaves so many times the number of samples; parts are kind@where."""
    pairs = [part.split("@") for part in parts]
    hypothesis = SimpleNamespace(
        kinds=tuple(KINDS[name] for name, _ in pairs),
        where=tuple(where for _, where in pairs),
        variant=frozenset(parts),
        label=" + ".join(parts),
        drifting=None,
        sizes=(bool(pairs),),
        shapes=(False,),
    )
    fitted = SimpleNamespace(
        hypothesis=hypothesis,
        cost=cost * N,
        misfit=np.array([cost * N]),
        residual=np.sqrt(cost) * WHITE,
        precision=np.zeros(2),
        parts=np.zeros((2, 2, 2)),
        scores=np.zeros((2, 2)),
        time_constant=time_constant,
        start=SimpleNamespace(hypothesis=hypothesis),
    )
    return RankedFit(SEARCH, fitted)


def order(base: RankedFit, *entries: RankedFit) -> list[tuple[str, ...]]:
    _, found = ranked(base, entries)
    return [tuple(k.name for k in e.fitted.hypothesis.kinds) for e in found]


def test_the_noise_leaves_the_share_that_weights_give_it():
    assert left_by_noise(SEARCH) == pytest.approx(0.9 * OF_NOISE**2 * N)


@pytest.mark.parametrize("broken", [np.inf, np.nan])
def test_of_a_model_that_broke_down_no_deviation_is_known(broken):
    normal = np.diag([2.0, broken])
    known = covariance(SEARCH, SimpleNamespace(**vars(entry(1.0).fitted), normal=normal))
    assert known.shape == (2, 2)
    assert np.all(np.isnan(known))
    # Half the number of samples is what noise leaves here.
    known = covariance(SEARCH, SimpleNamespace(**vars(entry(0.5).fitted), normal=np.eye(2)))
    np.testing.assert_allclose(known, 0.5 * np.eye(2), rtol=0.1)


def misfitting(**changed) -> SimpleNamespace:
    """Nearly five times the noise's square beyond it, with two values free."""
    return SimpleNamespace(**vars(entry(5.0).fitted) | {"normal": np.diag([50.0, 2.0])} | changed)


def test_deviations_count_an_error_of_the_models_own_as_the_few_ways_it_goes():
    """2 x 5 x 2 ways less four that the joints have taken up, not N samples."""
    known = covariance(SEARCH, misfitting(precision=np.array([0.0, 1.0])))
    error = 5.0 * N - 0.95 * left_by_noise(SEARCH)
    assert known[0, 0] == pytest.approx((1.0 + error / 16.0) / 50.0)
    # What recordings leave open the prior closes, however poor the fit.
    assert known[1, 1] == pytest.approx(1.0, rel=0.01)
    assert known[1, 1] < 1.0


def test_recordings_that_pull_different_ways_widen_the_deviations():
    """Two recordings, each of which alone wants its own value."""
    parts, scores = np.stack([np.diag([25.0, 1.0])] * 2), np.array([[75.0, 0.0], [-75.0, 0.0]])
    agreed = covariance(SEARCH, misfitting())
    known = covariance(SEARCH, misfitting(parts=parts, scores=scores))
    # Without one of them the value moves by 75 / 25: half of the sum of its squares.
    assert known[0, 0] - agreed[0, 0] == pytest.approx(0.5 * 2 * 3.0**2)
    assert known[1, 1] == pytest.approx(agreed[1, 1])
    # What fits to the noise has no such error.
    good = vars(entry(0.5).fitted) | {"normal": np.eye(2), "parts": parts, "scores": scores}
    assert covariance(SEARCH, SimpleNamespace(**good))[0, 0] < 1.0


def test_a_recording_that_alone_tells_of_a_value_is_not_held_against_it():
    """A loud one and a faint one, which disagree by as much as chance lets the faint one."""
    loud, faint = 50.0 - 1e-4, 1e-4
    parts, score = np.stack([np.diag([loud, 1.0]), np.diag([faint, 1.0])]), np.sqrt(faint)
    scores = np.array([[-score, 0.0], [score, 0.0]])
    agreed = covariance(SEARCH, misfitting())
    known = covariance(SEARCH, misfitting(parts=parts, scores=scores))
    # As uncertain as white noise of deviation 1 leaves it; by the faint one alone it were 100.
    assert known[0, 0] - agreed[0, 0] == pytest.approx(1.0 / 50.0, rel=1e-3)


def test_what_all_recordings_pull_alike_is_no_disagreement():
    """The prior holds a value back from where both of them want it."""
    parts, scores = np.stack([np.diag([25.0, 1.0])] * 2), np.array([[75.0, 0.0], [75.0, 0.0]])
    precision = np.array([50.0, 1.0])
    agreed = covariance(SEARCH, misfitting(precision=precision))
    known = covariance(SEARCH, misfitting(precision=precision, parts=parts, scores=scores))
    np.testing.assert_allclose(known, agreed)


@pytest.mark.parametrize(("cost", "found"), [(0.90, True), (0.96, False)])
def test_nothing_is_missing_where_the_models_own_errors_may_be_it(cost, found):
    """6 per cent of the residual are indulged; 10 % of 4000 samples are worth 200."""
    base, (best,) = ranked(entry(1.0), [entry(cost, "mass_error@a")])
    assert missing(base, best) == found


def test_a_poor_fit_does_not_raise_the_bar_for_its_own_detection():
    """A tenth off a residual of 100 times the noise that is correlated over a hundred samples."""
    slow = np.convolve(WHITE[0, :, 0], np.ones(100) / 10.0, "same")[None, :, None]
    poor = [entry(cost, *parts) for cost, parts in ((100.0, ()), (88.0, ("mass_error@a",)))]
    base, best = (
        replace(e, fitted=SimpleNamespace(**vars(e.fitted) | {"residual": slow})) for e in poor
    )
    found, (first,) = ranked(base, [best])
    assert missing(found, first)
    # What noise of the forces leaves is no poor fit.
    driven = SimpleNamespace(**vars(SEARCH) | {"driven": 88.0 * N})
    found, (first,) = ranked(replace(base, problem=driven), [replace(best, problem=driven)])
    assert not missing(found, first)


def test_a_joint_that_is_hardly_better_than_a_slider_comes_after_it():
    base = entry(3.0)
    joint, slider = entry(0.97, "iwan_joint@a"), entry(1.0, "coulomb_friction@a")
    assert order(base, joint, slider)[0] == ("coulomb_friction",)
    much_better = entry(0.8, "iwan_joint@a")
    assert order(base, much_better, slider)[0] == ("iwan_joint",)


def test_a_joint_owes_nothing_to_what_it_cannot_look_like():
    base, joint = entry(3.0), entry(0.97, "iwan_joint@a")
    assert order(base, joint, entry(1.0, "viscoelastic@a"))[0] == ("iwan_joint",)
    # Nor to a slider elsewhere.
    assert order(base, joint, entry(1.0, "coulomb_friction@b"))[0] == ("iwan_joint",)


@pytest.mark.parametrize(
    ("whole", "limit"),
    [
        ("viscoelastic", "stiffness_error"),
        ("viscoelastic", "viscous_damping"),
        ("coulomb_friction", "stiffness_error"),
        ("gap_contact", "stiffness_error"),
        ("sensor_gain", "sensor_polarity"),
    ],
)
def test_whatever_has_a_limit_that_does_as_well_comes_after_it(whole, limit):
    base, simple = entry(3.0), entry(1.0, f"{limit}@a")
    assert order(base, entry(0.97, f"{whole}@a"), simple)[0] == (limit,)
    assert order(base, entry(0.8, f"{whole}@a"), simple)[0] == (whole,)
    assert containing(simple, [entry(0.99, f"{whole}@a")]) == ((f"{limit}@a", f"{whole}@a"),)


def test_beside_another_suspect_the_same_holds():
    base, other = entry(3.0), "mass_error@b"
    joint = entry(0.97, "iwan_joint@a", other)
    slider = entry(1.0, other, "coulomb_friction@a")
    assert order(base, joint, slider)[0] == ("mass_error", "coulomb_friction")
    assert order(base, joint, entry(1.0, "coulomb_friction@a"))[0] == ("iwan_joint", "mass_error")


def test_two_at_once_have_to_explain_more_than_either():
    base, alone = entry(3.0), entry(1.0, "iwan_joint@a")
    little, much = (entry(cost, "iwan_joint@a", "mass_error@b") for cost in (0.97, 0.9))
    assert order(base, little, alone)[0] == ("iwan_joint",)
    assert order(base, much, alone)[0] == ("iwan_joint", "mass_error")


def test_what_fits_best_goes_on_though_others_are_ahead():
    entries = [entry(1.0 + 0.005 * i, "viscoelastic@a") for i in range(5)]
    fittest = entry(0.97, "iwan_joint@b")
    early = entry(0.5, "gap_contact@a", time_constant=2.0)
    chosen = finalists(entry(3.0), [*entries, fittest, early])
    assert chosen == [*entries[:3], fittest]
    hopeless = entry(20.0, "mass_error@a")
    assert finalists(entry(30.0), [entries[0], hopeless]) == [entries[0]]
    # A limit is ahead by what it is granted: what fits as well goes on whatever speaks against it.
    granted = replace(fittest, behind=-800.0)
    assert granted in finalists(entry(3.0), [entries[0], granted])


def test_a_limit_of_the_best_is_polished_with_it():
    """A short memory may hold the model's own errors against it, however long the recordings."""
    best, limit = entry(1.0, "viscoelastic@a"), entry(1.2, "viscous_damping@a")
    elsewhere, far = entry(1.2, "viscous_damping@b"), entry(3.0, "stiffness_error@a")
    assert finalists(entry(30.0), [best, elsewhere, far, limit]) == [best, limit]


def test_of_fits_of_a_hypothesis_the_best_with_the_longest_memory_stays():
    gap, mass = "gap_contact@a", "mass_error@b"
    poor, good, other = entry(1.3, gap, mass), entry(1.1, mass, gap), entry(1.2, gap)
    early = entry(0.9, gap, time_constant=2.0)
    assert distinct([poor, good, other, early]) == [good, other]


def test_rivals_are_doubted_by_what_the_best_leaves_beyond_the_noise():
    """1000 squares beyond the noise in 2 x 5 x 2 ways: 51 squares are what 1.2 were."""
    best, rival = entry(1.15, "cubic_stiffness@a"), entry(1.2, "gap_contact@a")
    _, entries = ranked(entry(3.0), [best, rival])
    error = 1.15 * N - 0.95 * left_by_noise(SEARCH)
    expected = 1.15 * correlation_time(best.fitted.residual) / (1.0 + error / 20.0)
    assert expected < 0.05
    for before, after in zip(entries, doubted(SEARCH, entries), strict=True):
        assert after.behind == pytest.approx(expected * before.behind)


def test_what_leaves_no_more_than_noise_doubts_no_rival():
    _, entries = ranked(entry(3.0), [entry(0.5, "cubic_stiffness@a"), entry(0.6, "mass_error@a")])
    others = doubted(SEARCH, entries)
    assert [e.behind for e in others] == [e.behind for e in entries]


def test_a_joint_that_its_limit_stands_for_is_told():
    spring = entry(1.0, "stiffness_error@a")
    never_slips, other_place = entry(0.99, "iwan_joint@a"), entry(0.99, "iwan_joint@b")
    alike = (("stiffness_error@a", "iwan_joint@a"),)
    assert containing(spring, [spring, other_place, never_slips]) == alike
    # One that was not fitted as far, or that explains less, is not as good.
    assert containing(spring, [entry(0.99, "iwan_joint@a", time_constant=2.0)]) == ()
    assert containing(spring, [entry(1.1, "iwan_joint@a")]) == ()


def test_of_a_pair_the_one_that_is_a_limit_is_told():
    pair = entry(1.0, "mass_error@b", "coulomb_friction@a")
    joint = entry(1.0, "iwan_joint@a", "mass_error@b")
    assert containing(pair, [pair, joint]) == (("coulomb_friction@a", "iwan_joint@a"),)


def driven(kind: ForceKind, shape: float) -> np.ndarray:
    """Force of unit size along a decaying sine, as one row of unit length."""
    dt, memory, force = 0.01, np.zeros(()), []
    t = dt * np.arange(1, 400)
    d, v = np.exp(-0.2 * t) * np.sin(3.0 * t), np.gradient(np.exp(-0.2 * t) * np.sin(3.0 * t), dt)
    for here, rate, moved in zip(d, v, np.diff(d, prepend=0.0), strict=True):
        motion = PlaceMotion(*(np.asarray(x) for x in (here, rate, 0.0, moved, dt)))
        now, memory = kind.unit_force(motion, np.asarray(shape), memory)
        force.append(float(now))
    # A gap that never closes has no force at all.
    return np.array(force) / max(float(np.linalg.norm(force)), 1e-300)


LIMITS = [
    pytest.param(kind, limit.name, id=f"{kind.name} {kind.variant} {limit.name}")
    for kind in kinds_of()
    if isinstance(kind, ForceKind)
    for limit in kind.limits
]


@pytest.mark.parametrize(("kind", "limit"), LIMITS)
def test_a_limit_is_what_the_force_becomes_at_an_end_of_its_shape(kind, limit):
    # What K holds already and gives way is less stiffness.
    wanted = driven(KINDS[limit], 1.0) * (-1.0 if kind.within else 1.0)
    assert driven(kind, 0.3) @ wanted < 0.999
    # Rates are central differences here, half a step before the element's own.
    assert max(driven(kind, shape) @ wanted for shape in (1e-3, 1e3)) > 0.999


def free(error: float) -> SimpleNamespace:
    return SimpleNamespace(relative=error, floor_95=0.01)


LIKELY = (PlaceEvidence("m0", 0.9, 0.8, 16, 19.0),)
FAILED = ("looking for a law that has no name failed (ValueError)",)


def held_against(*errors: float):
    """Suspects in order of evidence, by their held-out errors; the first is the nominal model's."""
    base = entry(9.0)
    suspects = [entry(1.0 + 0.01 * i, f"mass_error@m{i}") for i in range(len(errors) - 1)]
    base, entries = ranked(base, suspects)
    by = dict(zip([(), *(tuple(e.fitted.hypothesis.where) for e in entries)], errors, strict=True))
    return compared(
        ModelSelection(True, base, tuple(entries), (), LIKELY, failures=FAILED),
        lambda e, _: (free(0.01), free(by[tuple(e.fitted.hypothesis.where)])),
    )


def test_what_predicts_held_out_recordings_better_stays():
    found = held_against(0.5, 0.1, 0.05)
    assert found.table.best.fitted.hypothesis.where == ("m0",)
    assert found.after[1].relative == 0.1
    assert found.refused == ()


@pytest.mark.parametrize("error", [0.53, 28559.0, np.inf])
def test_what_predicts_them_worse_is_refused_and_the_next_is_compared(error):
    found = held_against(0.5, error, 0.4)
    assert found.table.best.fitted.hypothesis.where == ("m1",)
    assert found.after[1].relative == 0.4
    assert found.refused == (("mass_error@m0", 0.5, error),)


def test_where_all_are_refused_nothing_is_left():
    found = held_against(0.5, 0.6, 0.7)
    assert not found.table.detected
    assert found.after is found.before
    assert [each.label for each in found.refused] == ["mass_error@m0", "mass_error@m1"]
    # Where something acts was seen before, and is looked at after.
    assert (found.table.places, found.table.failures) == (LIKELY, FAILED)


def test_chance_within_the_noise_refuses_nothing():
    assert held_against(0.0098, 0.0099).refused == ()


def first(entries: list[RankedFit]) -> str:
    return entries[0].fitted.hypothesis.label


@pytest.mark.parametrize(
    ("limit", "law", "granted"),
    [
        ("stiffness_error@a", ("iwan_joint@a",), False),
        ("stiffness_error@a", ("stiffness_error@a", "coulomb_friction@a"), False),
        # A slider is no error of a linear model, and two of these are no other law.
        ("coulomb_friction@a", ("iwan_joint@a",), True),
        ("stiffness_error@a", ("stiffness_error@a", "mass_error@b"), True),
    ],
)
def test_a_linear_limit_may_be_granted_nothing(limit, law, granted):
    """Four hundredths more are explained, less than what the model's own errors are granted."""
    base, entries = entry(3.0), [entry(1.0, limit), entry(0.96, *law)]
    assert first(ranked(base, entries)[1]) == limit
    _, found = ranked(base, entries, beside_linear=False)
    assert (first(found) == limit) is granted


def beside(monkeypatch, table: ModelSelection, linear: float) -> tuple[ModelSelection, list[str]]:
    """What becomes of a table where errors of the linear model would leave so much."""
    seen = []

    def like_none(problem, fitted, places, cost):
        seen.append(fitted.hypothesis.label)
        return cost < N * (linear - 0.02)

    monkeypatch.setattr(unnamed, "like_no_linear_error", like_none)
    scope = SimpleNamespace(in_time=lambda: True, progress=lambda line: None, places=())
    return unnamed.beside_linear(table, scope), seen


@pytest.mark.parametrize(
    ("best", "rival", "linear", "asked", "named"),
    [
        ("stiffness_error@a", 0.96, 0.99, True, "iwan_joint@a"),
        ("stiffness_error@a", 0.96, 0.97, True, "stiffness_error@a"),
        ("stiffness_error@a", 1.01, 0.99, False, "stiffness_error@a"),
        ("stiffness_error@b", 1.01, 0.99, False, "stiffness_error@b"),
        ("coulomb_friction@a", 0.96, 0.99, False, "coulomb_friction@a"),
    ],
)
def test_what_does_more_than_any_linear_error_is_no_spring(
    monkeypatch, best, rival, linear, asked, named
):
    """Two hundredths of these squares are the evidence that is asked for."""
    base, entries = ranked(entry(3.0), [entry(1.0, best), entry(rival, "iwan_joint@a")])
    assert first(entries) == best
    table = ModelSelection(True, base, tuple(entries), ())
    found, seen = beside(monkeypatch, table, linear)
    assert first(list(found.entries)) == named
    assert seen == [best] * asked


@pytest.mark.parametrize(
    ("law", "cost", "linear", "detected"),
    [
        ("stiction@a", 0.96, 0.99, True),
        ("stiction@a", 0.96, 0.97, False),
        # An error of the linear model is granted what all of them are.
        ("stiffness_error@a", 0.96, 0.99, False),
    ],
)
def test_what_does_more_than_any_linear_error_is_not_nothing(
    monkeypatch, law, cost, linear, detected
):
    base, entries = ranked(entry(1.0), [entry(cost, law)])
    assert not missing(base, entries[0])
    table = ModelSelection(False, base, tuple(entries), ())
    found, _ = beside(monkeypatch, table, linear)
    assert found.detected is detected
    assert missing(found.nominal, found.entries[0]) is detected
