"""Every law that loops may show beside a joint, by a rig of finer steps."""

import numpy as np
import pytest
from discrepancy.steady.slow_rig import A_CYCLE, FINE, finer, measured, sines, slider

import iwanjax as ij
from iwanjax.discrepancy.steady.diagnose_loops import diagnose_loops
from iwanjax.discrepancy.steady.trials import forces_of, late_laws
from iwanjax.effects.catalogue import catalogue
from iwanjax.joints import JOINTS

GUESS = ij.Jenkins(F_S=7.0, K_T=1.2)
LEVELS, RATES = ((8.0, 20.0), (30.0,), (14.0, 25.0)), (1.0, 0.5, 0.7)
"""Amplitudes of the loops over a slip of 10, and cycles over a period; the last one held out."""
PERIOD = 0.02
"""Of the shortest cycle, s: nothing says that cycles take a second."""


def yielding(d, h, F_S=3.0, K_T=0.8, n=2.0):
    """Bouc-Wen's equation by midpoints."""
    z, force = 0.0, []
    for moved in np.diff(d, prepend=0.0):
        for part, at in ((0.5, z), (1.0, None)):
            at = middle if at is None else at
            rate = 1.0 - np.abs(at * K_T / F_S) ** n * (1.0 + np.sign(moved * at)) / 2.0
            middle = z + part * moved * rate
        z = middle
        force.append(K_T * z)
    return np.array(force)


def with_clearance(d, h, F_S=3.0, K_T=0.8, gap=6.0):
    x, force = 0.0, []
    for moved in np.diff(d, prepend=0.0):
        x = float(np.clip(x + moved, -gap - F_S / K_T, gap + F_S / K_T))
        force.append(K_T * np.sign(x) * max(abs(x) - gap, 0.0))
    return np.array(force)


def relaxing(d, h, k=0.2, tau=0.3 * PERIOD):
    """Implicit Euler."""
    force = [0.0]
    for moved in np.diff(d):
        force.append((force[-1] + k * moved) / (1.0 + h / tau))
    return np.array(force)


def softening(d, h, k=0.3, width=8.0):
    return k * width * np.tanh(d / width)


def loosening(d, h, rate=-0.1 / PERIOD, tau=1.5 * PERIOD):
    t = h * np.arange(d.size)
    return rate * tau * (1.0 - np.exp(-t / tau)) * d


LAWS = {
    "bouc_wen": (yielding, {"F_S": 3.0, "K_T": 0.8, "n": 2.0}),
    "backlash": (with_clearance, {"F_S": 3.0, "K_T": 0.8, "gap": 6.0}),
    "viscoelastic": (relaxing, {"k": 0.2, "tau": 0.3 * PERIOD}),
    "tanh_spring": (softening, {"k": 0.3, "width": 8.0}),
    "changing_stiffness": (loosening, {"rate": -0.1 / PERIOD, "tau": 1.5 * PERIOD}),
}


def loops(beside, timed=True):
    random, found = np.random.default_rng(1), []
    for i, (levels, rate) in enumerate(zip(LEVELS, RATES, strict=True)):
        d, dt = sines(levels), PERIOD / A_CYCLE / rate
        rig = finer(d)
        force = slider(rig, 10.0, 1.0) + beside(rig, dt / FINE)
        held = measured(force, random)
        found.append(ij.ForceLoop(d, held, f"loop{i}", dt if timed else None))
    return found


def verdict(beside, hypotheses, timed=True):
    several = loops(beside, timed)
    return diagnose_loops(
        GUESS, several[:2], several[2], name="J1", hypotheses=hypotheses, starts=8
    )


@pytest.mark.parametrize(
    "name",
    [
        "backlash",
        "changing_stiffness",
        *(
            pytest.param(x, marks=pytest.mark.long)
            for x in ("bouc_wen", "viscoelastic", "tanh_spring")
        ),
    ],
)
def test_a_law_beside_the_joint_is_found_with_all_of_its_parameters(name):
    law, truth = LAWS[name]
    told = verdict(law, (name, "stiffness_error"))
    first = told.what[0]
    assert (first.label, told.verdict.name) == (f"{name}@J1", "something_missing")
    assert first.probability > 0.95
    values = {each.info.name: each for each in first.parameters}
    assert set(values) == set(truth)
    # The rig's own steps are off by less than the noise lets parameters be.
    for key, wanted in truth.items():
        assert values[key].value == pytest.approx(wanted, abs=4.0 * values[key].std)
        assert values[key].std < 0.1 * abs(wanted)
    assert told.after.hold_out < 1.2 * told.noise_floor.hold_out
    assert told.before.hold_out > 3.0 * told.after.hold_out


@pytest.mark.long
@pytest.mark.parametrize("name", list(LAWS))
def test_it_is_found_among_all(name):
    """Laws that come in late do so by themselves."""
    told = verdict(LAWS[name][0], ())
    assert told.what[0].label == f"{name}@J1"
    assert told.what[0].probability > 0.95


@pytest.mark.long
def test_nothing_is_found_among_all_where_nothing_is():
    told = verdict(lambda d, h: 0.0 * d, ())
    assert (told.verdict.name, told.what) == ("nothing_missing", ())
    assert told.probability_nothing_missing > 0.95


def test_what_depends_on_time_is_not_tried_without():
    told = verdict(softening, ("changing_stiffness",), timed=False)
    assert not told.what
    assert any("cannot show changing_stiffness at J1" in line for line in told.warnings)


class Unexplained:
    """A fit that leaves much."""

    effect, cost, count = None, 9.0, 1


class Explained:
    """One that leaves noise."""

    effect, cost, count = None, 1.0, 1


def test_every_law_is_tried_but_for_those_that_no_loop_shows():
    tried = {kind.name for kind in forces_of((), variants=True)}
    late = {kind.name for kind in late_laws((), Unexplained())}
    assert late == {"bouc_wen", "backlash", "tanh_spring", "changing_stiffness"}
    assert not late_laws((), Explained())
    laws = {kind.law for each in catalogue().values() for kind in each if kind.name in tried | late}
    # A joint left out is one of four parameters, what resonates answers accelerations, and a law
    # of any shape is none to begin with. Masses are tried, and told to be hidden.
    assert {name for name, law in JOINTS.items() if law not in laws} == {
        *("iwan4", "iwan5", "attached_oscillator", "unnamed_law"),
    }
