"""The score test against refits by brute force, and its distribution where nothing is missing."""

import math
from dataclasses import replace
from typing import NamedTuple

import jax
import numpy as np
import pytest
import scipy.optimize
import scipy.stats
from linear_pair import JOINT, NAMES, ROWS, C, K, M, measured_force, problem, simulated

from iwanjax.discrepancy.histories.ranking import Scope, scored, scored_by_all
from iwanjax.discrepancy.histories.score_test import Candidate, places_of, score_test
from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.identification.columns import columns, unit_effects
from iwanjax.identification.linearise import linearise, residuals_at
from iwanjax.identification.multistart import HypothesisFit, multistart
from iwanjax.identification.places import Place
from iwanjax.identification.problem import HistoryProblem, Hypothesis, Start
from iwanjax.signals.comparison_band import END, in_band

FORCES = ("stiffness_error", "viscous_damping", "mass_error")
SENSORS = ("a1", "a2")
HITS = ((60.0, 0), (25.0, 1))
NOISE = np.array([0.3, 0.2])


class Pair(NamedTuple):
    """Recordings of two masses that lack an effect, and the nominal fit to them."""

    problem: HistoryProblem
    places: tuple[Place, ...]
    base: HypothesisFit

    def scores(self, kinds: tuple[str, ...]) -> dict[str, Candidate]:
        tried = tuple(kind for name in kinds for kind in CATALOGUE[name])
        found = score_test(self.problem, self.base, tried, self.places, SENSORS, ("J1",))
        return {each.start.hypothesis.label: each for each in found}


def recorded(name: str, size: float, where: str = "m2", noisy: bool = True) -> Pair:
    """Two hits of masses with so much of an effect more than the model."""
    random = np.random.default_rng(11)
    more = size * np.outer(ROWS[where], ROWS[where])
    changed = {
        "stiffness_error": {"stiffness": K + JOINT * np.outer(ROWS["J1"], ROWS["J1"]) + more},
        "viscous_damping": {"damping": C + more},
        "mass_error": {"mass": M + more},
    }[name]
    clean = [simulated(peak, struck=struck, **changed) for peak, struck in HITS]
    seen = [y + noisy * NOISE * random.standard_normal(y.shape) for y in clean]
    forces = [measured_force(peak, struck) for peak, struck in HITS]
    made, places = problem(seen, forces, NOISE, names=NAMES)
    return Pair(made, places, at_its_best(made))


def at_its_best(made: HistoryProblem) -> HypothesisFit:
    """The model with its joint refitted until no step gains anything."""
    start = Start(made.nothing(), made.map.given())
    return multistart(made, [start], math.inf, 12, tolerance=1e-9)[0]


def lowest_cost(made: HistoryProblem, start: Start, free: list[int]) -> float:
    """Least sum of squares over some values of theta, by SciPy and finite differences.

    Joints have a prior of deviation 1 in theta; sizes have none.
    """
    given = np.array(start.common)

    def residual(x: np.ndarray) -> np.ndarray:
        theta = given.copy()
        theta[free] = x
        (e,) = residuals_at(made, [(start.hypothesis, made.still(theta))], math.inf)
        return np.concatenate([e.ravel(), theta[: made.parameters]])

    found = scipy.optimize.least_squares(
        residual, given[free], x_scale="jac", xtol=1e-10, ftol=1e-12, diff_step=1e-5
    )
    return float(2.0 * found.cost)


def sized(made: HistoryProblem, hypothesis: Hypothesis) -> int:
    """Place in theta of the only size."""
    assert hypothesis.sizes == (True,)
    return made.map.size(0)


def falls(pair: Pair, kinds: tuple[str, ...]) -> dict[str, tuple[float, float]]:
    """Of each candidate what the score test predicts the cost to fall by, and what it does."""
    made = pair.problem
    joint = list(range(made.parameters))
    nominal = lowest_cost(made, pair.base.start, joint)
    # The search weighs the prior by what is left, where that is more than the noise.
    assert pair.base.cost == pytest.approx(nominal, rel=0.01)
    return {
        label: (
            each.drop * nominal,
            nominal - lowest_cost(made, each.start, [*joint, sized(made, each.start.hypothesis)]),
        )
        for label, each in pair.scores(kinds).items()
    }


@pytest.mark.parametrize(
    ("name", "size"), [("stiffness_error", 60.0), ("viscous_damping", 0.2), ("mass_error", 1e-3)]
)
def test_the_fall_of_the_cost_is_that_of_refits(name, size):
    """Of all that was tried, the joint refitted beside each; not of the true effect alone."""
    found = falls(recorded(name, size), (*FORCES, "sensor_gain"))
    assert len(found) == len(FORCES) * len(ROWS) + len(SENSORS)
    predicted, actual = np.array(list(found.values())).T
    np.testing.assert_allclose(predicted, actual, rtol=0.02, atol=1e-3)
    assert np.argmax(predicted) == np.argmax(actual)
    assert actual.max() > 50.0
    # A spring in the joint's place is the joint itself, which has explained all that it can.
    assert found["stiffness_error@J1"][0] < 1e-3


@pytest.mark.parametrize(
    ("name", "size"), [("stiffness_error", 1200.0), ("viscous_damping", 1.6), ("mass_error", 0.03)]
)
def test_what_it_is_off_by_is_of_second_order(name, size):
    """With half of the effect a quarter of the share that the prediction is off by."""
    off = []
    for times in (1.0, 0.5, 0.25):
        made = recorded(name, times * size, noisy=False)
        predicted, actual = falls(made, (name,))[f"{name}@m2"]
        off.append(abs(predicted / actual - 1.0))
    assert off[2] < 0.01
    assert off[0] > 3.0 * off[1] > 9.0 * off[2]


@pytest.mark.parametrize(
    ("name", "size"), [("stiffness_error", 60.0), ("viscous_damping", 0.02), ("mass_error", 1e-3)]
)
def test_the_size_that_it_asks_for_is_that_of_the_effect(name, size):
    made = recorded(name, size, noisy=False)
    start = made.scores((name,))[f"{name}@m2"].start
    assert start.hypothesis.physical(start.common, made.problem.map, 0)[0] == pytest.approx(
        size, rel=0.02
    )


DRAWS = 250


@pytest.fixture(scope="module")
def empty() -> Pair:
    """Recordings of the model itself, without noise."""
    return recorded("viscous_damping", 0.0, noisy=False)


compared = jax.jit(jax.vmap(in_band))
"""What of residuals, (recordings, N, sensors), is in the band that is compared."""


@pytest.mark.long
def test_without_an_effect_falls_are_chi_square(empty):
    """One degree of freedom, in units of what noise leaves along the column of the effect."""
    made = empty.problem
    weight, random = np.asarray(made.data.weight), np.random.default_rng(2)
    (seen,) = linearise(made, [(empty.base.hypothesis, empty.base.theta)], math.inf)
    slope = np.append(np.asarray(seen.slopes)[:, 0].ravel(), 1.0)
    z = float(empty.base.theta[0, 0])
    found: dict[str, list[float]] = {}
    for _ in range(DRAWS):
        residual = np.asarray(compared(NOISE * random.standard_normal(weight.shape))) * weight
        solution = empty.base.solution
        groups = solution.groups._replace(residual=residual)
        fitted = replace(empty.base, solution=replace(solution, groups=groups))
        whole = np.append(residual.ravel(), z)
        left = whole - slope * (slope @ whole) / (slope @ slope)
        for label, each in empty._replace(base=fitted).scores(("viscous_damping",)).items():
            found.setdefault(label, []).append(each.drop * float(left @ left))
    (kind,) = CATALOGUE["viscous_damping"]
    units = unit_effects(made, empty.base, (kind,), empty.places)
    for unit, column in zip(units, columns(made, empty.base, units), strict=True):
        h = np.append(column.ravel(), 0.0)
        h = h - slope * (slope @ h) / (slope @ slope)
        # The band's filter is the same forwards and backwards.
        felt = NOISE * np.asarray(compared(weight * h[:-1].reshape(weight.shape)))
        scale = float(np.sum(felt**2)) / float(h @ h)
        # What is compared lies in the band: its noise is as much stronger as the band is narrower.
        assert scale == pytest.approx(1.0 / (2.0 * END), rel=0.03)
        falls = np.array(found[f"viscous_damping@{unit.where}"]) / scale
        assert scipy.stats.kstest(falls, "chi2", args=(1,)).pvalue > 0.01
        # Three deviations of a mean; taken for white, noise would leave 0.43 more.
        assert np.mean(falls) == pytest.approx(1.0, abs=3.0 * math.sqrt(2.0 / DRAWS))


@pytest.mark.parametrize("where", ["m1", "m2"])
def test_where_something_acts_is_seen_though_its_kind_is_not_suspected(where):
    lacking, kinds = recorded("viscous_damping", 60.0, where), CATALOGUE["cubic_stiffness"]
    # Of no other kind the problem has so much as a kernel, neither forces nor faults of sensors.
    few = lacking.problem.of_kinds(kinds)
    base = at_its_best(few)
    scope = Scope(kinds, lacking.places, SENSORS, (), lambda: True, print)
    assert places_of(scored(few, base, scope))[0].reduction < 0.2
    for test in scored_by_all(few, base, scope):
        first, second, *_ = places_of(test)
        assert first.where == where
        assert first.reduction > 0.9
        assert first.log_evidence > second.log_evidence + 10.0
