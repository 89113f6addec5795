"""Deviations where a search has found several minima: they hold the truth, whichever it is."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

import iwanjax as ij
from iwanjax.estimation import LogNormal, Normal, Parameter
from iwanjax.estimation.parameters import Chart
from iwanjax.updating.estimate import solve
from iwanjax.updating.problem import AbstractProblem, Measured, Reference

LEVELS = 12
STD = 0.01
FALL = np.linspace(0.0, 1.0, LEVELS)


class TwoValleys(AbstractProblem):
    """Frequencies that see x through (x - a)(x - b) times a stretch: as good at a as at b.

    Between the valleys, and as wide as their slopes there say; damping sees nothing of x.
    """

    measured: Measured
    chart: Chart
    bend: Array
    a: float
    b: float
    names: tuple[str, ...] = eqx.field(static=True)
    reference: Reference = eqx.field(static=True)

    def predict(self, theta):
        x = jnp.log(theta[0]) if self.chart.transforms[0] == "log" else theta[0]
        seen = (x - self.a) * (x - self.b) * (1.0 + self.bend * (x - self.a)) + theta[1]
        return 100.0 - jnp.asarray(FALL) + seen, jnp.full(LEVELS, 1e-3)

    def model(self, theta):
        return self

    def derived(self, theta):
        return {"square": theta[0] ** 2}


def found(prior, transform="identity", a=-1.0, b=1.0, bend=0.0, error=0.0, starts=24):
    curves = ij.ModalCurves(
        np.arange(1.0, LEVELS + 1),
        100.0 - FALL + error,
        np.full(LEVELS, 1e-3),
        frequency_std=np.full(LEVELS, STD),
        damping_std=np.full(LEVELS, 1e-5),
        quantity="displacement",
    )
    lower = 0.0 if transform == "log" else -np.inf
    parameters = (
        Parameter("x", 0.9, prior, transform=transform, lower=lower),
        Parameter("y", 0.0, Normal(0.0, 1e-9), fixed=True),
    )
    problem = TwoValleys(
        measured=Measured.of([curves]),
        chart=Chart(parameters),
        bend=jnp.asarray(bend),
        a=a,
        b=b,
        names=("x", "y"),
        reference="absolute",
    )
    return solve(problem, parameters, [curves], starts, 0)


def test_two_minima_that_are_as_good_are_both_within_the_deviation():
    """The prior leaves thirty times as much open as lies between them."""
    solution = found(Normal(0.0, 10.0))
    x, std = solution.values["x"], solution.std["x"]
    assert abs(abs(x) - 1.0) < 1e-3
    # Half of the odds at a distance of two.
    assert std == pytest.approx(np.sqrt(2.0), rel=0.02)
    assert not solution.determined["x"]
    assert solution.rivals["x"] == pytest.approx((-1.0, 1.0), abs=1e-3)
    assert "x from -1 to 1" in solution.summary()
    # What is the same in both is as well known as before.
    value, deviation = solution.derived["square"]
    assert value == pytest.approx(1.0, abs=1e-3)
    assert deviation == pytest.approx(STD / np.sqrt(LEVELS), rel=0.05)


@pytest.mark.parametrize("bend", [0.3, -0.4, 2.0])
@pytest.mark.parametrize("error", [0.0, 5e-3])
def test_the_deviation_is_that_of_the_density_itself(bend, error):
    """By quadrature over x: the narrower valley holds less of what the curves allow."""
    prior = Normal(0.3, 2.0)
    solution = found(prior, bend=bend, error=error)
    # The cubic has a third valley at -1 - 1/bend.
    x = np.linspace(-10.0, 10.0, 1_000_001)
    seen = (x + 1.0) * (x - 1.0) * (1.0 + bend * (x + 1.0)) - error
    log = -0.5 * LEVELS * (seen / STD) ** 2 - 0.5 * ((x - 0.3) / 2.0) ** 2
    density = np.exp(log - log.max())
    second = np.sum(density * (x - solution.values["x"]) ** 2) / np.sum(density)
    assert solution.std["x"] == pytest.approx(np.sqrt(second), rel=0.05)


def test_a_strength_that_may_be_two_is_one_in_its_logarithm():
    """96 or 127, say, each to a per cent: closer than a third of the prior, and not known."""
    a, b = np.log(96.0), np.log(127.0)
    solution = found(LogNormal(100.0, 1.0), "log", a=a, b=b)
    assert not solution.determined["x"]
    value, std = solution.values["x"], solution.std["x"]
    other = 96.0 if value > 110.0 else 127.0
    assert abs(value - other) < 2.0 * std
    assert std < 0.3 * value


def test_ends_in_one_minimum_count_once():
    """All starts in one valley: what is stated is what its slope says."""
    solution = found(Normal(1.0, 0.1))
    assert solution.runs == 16
    assert solution.determined["x"]
    assert not solution.rivals
    assert solution.std["x"] == pytest.approx(STD / np.sqrt(LEVELS) / 2.0, rel=0.01)
