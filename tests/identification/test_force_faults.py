"""Faults of measured forces: another force than the measured one acted, by an exact simulation."""

import math

import linear_pair as pair
import numpy as np
import pytest

from iwanjax.discrepancy.histories.score_test import score_test
from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.effects.force_delay import DELAY
from iwanjax.effects.force_saturation import SATURATION
from iwanjax.identification.columns import columns, force_faults
from iwanjax.identification.estimates import estimates
from iwanjax.identification.hypotheses import channel
from iwanjax.identification.linearise import linearise, residuals_at
from iwanjax.identification.multistart import multistart
from iwanjax.identification.problem import Start
from iwanjax.signals.clipping import cut_off

INPUTS = ("m1", "m2")
PEAK, SHIFT, LIMIT = 80.0, 1.3, 60.0
NOISE = np.array([0.01, 0.01])


def shown(name: str, force: np.ndarray) -> np.ndarray:
    """What a faulty channel makes of the force on the first mass."""
    late = pair.measured_force(PEAK, at=pair.AT + SHIFT / pair.RATE)
    return {
        "force_gain": 1.2 * force,
        "force_polarity": -force,
        "force_delay": late,
        "force_saturation": np.minimum(force, LIMIT),
    }[name]


SIZES = {"force_gain": 0.2, "force_polarity": -2.0, "force_delay": SHIFT, "force_saturation": 1.0}
# What parabolas on the flanks of a bell make of its peak is no more than near it.
LEFT = {"force_saturation": 0.2, "force_delay": 3e-3, "force_gain": 3e-3, "force_polarity": 3e-3}


@pytest.fixture(scope="module")
def hits():
    """Responses to hits on either mass, of which the force on the first is measured wrongly."""
    true = [pair.measured_force(PEAK), pair.measured_force(0.5 * PEAK, struck=1)]
    responses = [pair.simulated(PEAK), pair.simulated(0.5 * PEAK, struck=1)]
    return true, responses


def searched(hits, name: str):
    true, responses = hits
    return pair.problem(responses, [shown(name, true[0]), true[1]], NOISE)


def begun(problem, name: str, size: float) -> tuple:
    start = channel(problem, CATALOGUE[name][0], 0, "m1", np.zeros(problem.parameters), size)
    return start.hypothesis, problem.still(start.theta)


@pytest.mark.parametrize("name", SIZES)
def test_the_force_that_acted_explains_the_response(hits, name):
    problem, _ = searched(hits, name)
    point = begun(problem, name, SIZES[name])
    nothing = problem.nothing(), problem.still(problem.map.given())
    (before,), (after,) = (residuals_at(problem, [each], math.inf) for each in (nothing, point))
    wave = np.linalg.norm(np.asarray(problem.data.weight * problem.data.response))
    assert np.linalg.norm(before) > 0.02 * wave
    assert np.linalg.norm(after) < LEFT[name] * np.linalg.norm(before) + 2e-3 * wave
    # The other mass's force is measured rightly.
    np.testing.assert_array_equal(before[1], after[1])


@pytest.mark.parametrize("name", [name for name in SIZES if name != "force_polarity"])
@pytest.mark.parametrize("time_constant", [2.0, math.inf])
def test_slopes_are_those_of_the_residuals(hits, name, time_constant):
    problem, _ = searched(hits, name)
    hypothesis, theta = begun(problem, name, 0.7)
    at, step = problem.map.size(0), 1e-3
    (seen,) = linearise(problem, [(hypothesis, theta)], time_constant)
    ends = []
    for sign in (1.0, -1.0):
        moved = theta.copy()
        moved[:, at] += sign * step
        ends.append(residuals_at(problem, [(hypothesis, moved)], time_constant)[0])
    slope = (ends[0] - ends[1]) / (2.0 * step)
    found = np.asarray(seen.slopes)[:, at]
    assert np.linalg.norm(slope - found) < 1e-4 * np.linalg.norm(slope) > 0.0


def test_a_little_of_a_fault_changes_what_the_score_test_says(hits):
    problem, _ = searched(hits, "force_saturation")
    base = multistart(problem, [Start(problem.nothing(), problem.map.given())], math.inf, 0)[0]
    kinds = tuple(CATALOGUE[name][0] for name in SIZES)
    effects = force_faults(problem, kinds, INPUTS, np.zeros(problem.parameters))
    assert {(each.kind.name, each.where) for each in effects} == {
        *((name, where) for name in ("force_gain", "force_delay") for where in INPUTS),
        # The other force is not cut.
        ("force_saturation", "m1"),
    }
    (before,) = residuals_at(problem, [(base.hypothesis, base.theta)], math.inf)
    for unit, column in zip(effects, columns(problem, base, effects), strict=True):
        start = unit.sized(1e-3)
        little = start.hypothesis, problem.still(start.theta)
        change = (residuals_at(problem, [little], math.inf)[0] - before) / 1e-3
        assert np.linalg.norm(change - column) < 0.05 * np.linalg.norm(change)


@pytest.mark.parametrize("name", SIZES)
def test_a_fault_of_a_force_is_found_with_its_size(hits, name):
    problem, places = searched(hits, name)
    z = np.zeros(problem.parameters)
    base = multistart(problem, [Start(problem.nothing(), problem.map.given(z))], 2.0, 3)[0]
    kinds = tuple(CATALOGUE[name][0] for name in (*SIZES, "sensor_gain", "sensor_delay"))
    scored = score_test(problem, base, kinds, places, ("a1", "a2"), ("J1",), inputs=INPUTS)
    own = [c.start for c in scored if c.start.hypothesis.label == f"{name}@m1"]
    (fit,) = multistart(problem, own, 8.0, 12)
    rivals = [c.start for c in scored if c.start.hypothesis.label != f"{name}@m1"]
    assert fit.cost < min(each.cost for each in multistart(problem, rivals, 8.0, 12))
    (found,) = estimates(problem, fit, 0)
    wanted = SHIFT / pair.RATE if name == "force_delay" else SIZES[name]
    assert found.value == pytest.approx(wanted, rel=0.15 if name == "force_saturation" else 0.01)


@pytest.mark.parametrize("late", [-3.0, -0.4, 0.0, 1.7])
@pytest.mark.parametrize("share", [0.02, 0.2, 0.35])
def test_a_late_force_is_shifted_back_at_all_frequencies_that_are_compared(late, share):
    n = np.arange(300.0)
    found = DELAY.acted(np.sin(2.0 * np.pi * share * n), late, 0.0 * n)
    expected = np.sin(2.0 * np.pi * share * (n + late))
    np.testing.assert_allclose(found[30:-30], expected[30:-30], rtol=0.0, atol=1e-3)


def test_peaks_that_were_cut_come_back_and_others_stay():
    n = np.arange(2000.0)
    wave = np.sin(0.002 * n * (1.0 + 0.02 * n))
    cut = np.clip(wave, -0.75, 0.75)
    back = SATURATION.acted(cut, 1.0, cut_off(cut))
    lost = np.abs(wave) > 0.75
    np.testing.assert_array_equal(back[~lost], wave[~lost])
    assert np.std((back - wave)[lost]) < 0.1 * np.std((cut - wave)[lost])
    np.testing.assert_array_equal(SATURATION.acted(wave, 1.0, cut_off(wave)), wave)
