"""High-pass filters, hum and drift of sensors, by an exact simulation."""

import math

import linear_pair as pair
import numpy as np
import pytest
from scipy.signal import bilinear, lfilter

from iwanjax.discrepancy.histories.score_test import score_test
from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.effects.sensor_drift import DRIFT
from iwanjax.effects.sensor_high_pass import HIGH_PASS
from iwanjax.effects.sensor_hum import HUM
from iwanjax.identification.estimates import determined, estimates
from iwanjax.identification.hypotheses import added, sensor
from iwanjax.identification.likelihood import left_by_noise, unknowns
from iwanjax.identification.linearise import linearise, residuals_at
from iwanjax.identification.multistart import multistart
from iwanjax.identification.problem import Start

PEAKS, CORNER, MAINS, HUMS = (40.0, 80.0), 3.0, 50.05, 2.0
NOISE = np.array([0.05, 0.05])
RNG = np.random.default_rng(7)


def drifting(i: int) -> np.ndarray:
    s = np.linspace(0.0, 1.0, pair.N)
    return 1.5 * (1.0 - i) * s + 0.7 * np.cos(2.0 * np.pi * s) + 0.3


def humming(i: int) -> np.ndarray:
    turn = 2.0 * np.pi * MAINS * np.arange(pair.N) / pair.RATE + 1.0 + 2.0 * i
    return HUMS * (np.sin(turn) + 0.2 * np.sin(3.0 * turn + 0.5))


def filtered(x: np.ndarray) -> np.ndarray:
    b, a = bilinear([1.0, 0.0], [1.0, 2.0 * np.pi * CORNER], pair.RATE)
    return np.asarray(lfilter(b, a, x))


@pytest.fixture(scope="module")
def clean():
    noise = NOISE * RNG.standard_normal((len(PEAKS), pair.N, 2))
    return [pair.simulated(peak) for peak in PEAKS], noise


def searched(clean, name: str):
    """The second sensor has the fault."""
    responses, noise = clean
    made = []
    for i, (response, own) in enumerate(zip(responses, noise, strict=True)):
        x = response.copy()
        if name == "sensor_high_pass":
            x[:, 1] = filtered(x[:, 1])
        x[:, 1] += {"sensor_hum": humming(i), "sensor_drift": drifting(i)}.get(name, 0.0)
        made.append(x + own)
    return pair.problem(made, [pair.measured_force(peak) for peak in PEAKS], NOISE)


FAULTS = ("sensor_high_pass", "sensor_hum", "sensor_drift")


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_of_a_sensor_is_found_with_its_size(clean, name):
    problem, places = searched(clean, name)
    z = np.zeros(problem.parameters)
    base = multistart(problem, [Start(problem.nothing(), problem.map.given(z))], 2.0, 3)[0]
    kinds = tuple(CATALOGUE[name][0] for name in (*FAULTS, "sensor_gain", "sensor_delay"))
    scored = score_test(problem, base, kinds, places, ("a1", "a2"), ("J1",))
    fits = multistart(problem, [each.start for each in scored], 8.0, 12)
    fits.sort(key=lambda each: each.cost)
    best = fits[0]
    assert best.hypothesis.label == f"{name}@a2"
    assert best.cost < 1.2 * left_by_noise(problem) < fits[1].cost
    assert determined(problem, best)
    size = estimates(problem, best, 0)[0]
    drift = np.concatenate([drifting(i)[16:-16] for i in range(len(PEAKS))])
    wanted = {
        "sensor_high_pass": CORNER,
        "sensor_hum": HUMS * math.hypot(1.0, 0.2),
        "sensor_drift": math.sqrt(np.mean(drift**2)),
    }[name]
    assert abs(size.value - wanted) < 4.0 * size.std
    assert size.std < 0.05 * size.value
    assert unknowns(best) == {"sensor_hum": 9, "sensor_drift": 12}.get(name, 1)
    if name == "sensor_hum":
        frequency = estimates(problem, best, 0)[1]
        assert abs(frequency.value - MAINS) < 4.0 * frequency.std < 0.2


@pytest.mark.parametrize("time_constant", [2.0, math.inf])
@pytest.mark.parametrize("kind", [HUM, DRIFT], ids=lambda kind: kind.name)
def test_what_is_added_is_as_if_it_had_not_been(clean, kind, time_constant):
    """With any size of it the residuals are those without, less what its columns explain."""
    left = []
    for name in ("", kind.name):
        problem, _ = searched(clean, name)
        residual = np.stack([humming(i) for i in range(2)])
        own = kind.tuned(residual, 1.0 / pair.RATE)
        start = added(problem, own, 1, "a2", np.zeros(problem.parameters))
        theta = problem.still(start.theta)
        left.append(residuals_at(problem, [(start.hypothesis, theta)], time_constant)[0])
        (seen,) = linearise(problem, [(start.hypothesis, theta)], time_constant)
        np.testing.assert_allclose(seen.residual, left[-1], atol=1e-9)
        # No column is left in the derivatives either.
        again = linearise(problem, [(problem.nothing(), theta)], time_constant)[0]
        assert np.linalg.norm(seen.slopes[:, 0]) <= np.linalg.norm(again.slopes[:, 0])
    # A line's frequency is known to a twentieth of a turn over the recording.
    off = {HUM.name: 0.03, DRIFT.name: 1e-3}[kind.name] * HUMS / NOISE[1] * math.sqrt(pair.N)
    assert np.linalg.norm(left[0] - left[1]) < off


def test_a_high_pass_filter_begins_with_an_integral(clean):
    problem, _ = searched(clean, "")
    z = np.zeros(problem.parameters)
    ends = [sensor(problem, HIGH_PASS, 1, "a2", z, size * 1e-4) for size in (1.0, 2.0)]
    seen = [
        residuals_at(problem, [(each.hypothesis, problem.still(each.theta))], math.inf)[0]
        for each in (Start(problem.nothing(), problem.map.given(z)), *ends)
    ]
    shown = np.stack(clean[0])
    slope = HIGH_PASS.slope(shown)
    assert slope is not None
    weight = np.asarray(problem.data.weight)
    change = 2.0 * (seen[1] - seen[0]) - 0.5 * (seen[2] - seen[0])
    on = weight[0, :, 1] > 0
    found = (change / 1e-4)[0, on, 1] / weight[0, on, 1]
    # As much less is shown; the residual is measured less predicted.
    np.testing.assert_allclose(found, -slope[0, on, 1], atol=0.02 * np.max(np.abs(slope[0, :, 1])))
