"""Least squares by three methods behind one interface, against published and closed solutions."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from iwanjax.errors import InputError
from iwanjax.estimation import Normal, Parameter
from iwanjax.estimation.bounded import bounded, within_bounds
from iwanjax.estimation.evidence import linearised
from iwanjax.estimation.least_squares import least_squares
from iwanjax.estimation.parameters import Chart, drawn
from iwanjax.estimation.problem import AbstractLeastSquares, residuals_and_slopes
from iwanjax.estimation.settings import SEARCH

METHODS = ("optimistix", "jaxopt", "host")
PRIOR = Normal(1.0, 1.0)


class Given(AbstractLeastSquares):
    """Residuals by a function of theta."""

    chart: Chart
    names: tuple[str, ...] = eqx.field(static=True)
    law: object = eqx.field(static=True)
    x: Array
    y: Array

    def residuals(self, theta):
        return self.law(theta, self.x) - self.y


def problem(law, parameters, x, y):
    return Given(
        Chart(parameters), tuple(p.name for p in parameters), law, jnp.asarray(x), jnp.asarray(y)
    )


def rosenbrock(theta, _):
    return jnp.stack([1.0 - theta[0], 10.0 * (theta[1] - theta[0] ** 2)])


def test_the_host_comes_through_rosenbrocks_valley():
    """Rosenbrock (1960): from (-1.2, 1) to (1, 1), the only point without residuals."""
    row = [Parameter(name, 0.0, PRIOR) for name in ("a", "b")]
    asked = problem(rosenbrock, row, np.zeros(2), np.zeros(2))
    (found,) = least_squares(asked, jnp.asarray([[-1.2, 1.0]]), 1, method="host")
    np.testing.assert_allclose(found.values, 1.0, rtol=1e-6)
    assert found.cost < 1e-12
    assert found.method == "host"
    assert found.converged
    assert found.iterations < SEARCH.most_steps


MISRA = np.array(
    [
        (77.6, 10.07),
        (114.9, 14.73),
        (141.1, 17.94),
        (190.8, 23.93),
        (239.9, 29.61),
        (289.0, 35.18),
        (332.8, 40.02),
        (378.4, 44.82),
        (434.8, 50.76),
        (477.3, 55.05),
        (536.8, 61.01),
        (593.1, 66.40),
        (689.1, 75.47),
        (760.0, 81.78),
    ]
)
"""Volume against pressure: NIST's statistical reference data set Misra1a."""


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("start", [(500.0, 1e-4), (250.0, 5e-4)])
def test_certified_values_are_found(method, start):
    """Misra1a from both of its starts: values, squares and deviations certified by NIST."""
    row = [
        Parameter(n, v, PRIOR, lower=0.0, transform="log") for n, v in zip("ab", start, strict=True)
    ]
    asked = problem(lambda t, x: t[0] * (1.0 - jnp.exp(-t[1] * x)), row, *MISRA.T)
    (found,) = least_squares(asked, jnp.asarray([start]), 1, method=method)
    assert found.converged
    np.testing.assert_allclose(found.values, [2.3894212918e2, 5.5015643181e-4], rtol=1e-6)
    assert found.cost == pytest.approx(1.2455138894e-1, rel=1e-8)
    _, slopes = residuals_and_slopes(asked, jnp.asarray(found.values))
    # Certified deviations are in units of the residual's own: s^2 = squares / (14 - 2).
    std = linearised(np.asarray(slopes), 12.0, 1.0) * np.sqrt(found.cost / 12.0)
    np.testing.assert_allclose(std, [2.7070075241, 7.2668688436e-6], rtol=1e-5)


def bounded_problem(truth, seed=0):
    """A decaying force with a share that stays: positive, between two bounds, and any."""
    random = np.random.default_rng(seed)
    x = np.linspace(0.0, 4.0, 60)
    y = truth[0] * (truth[1] + (1.0 - truth[1]) * np.exp(-x)) + truth[2] * x
    row = [
        Parameter("size", 1.0, Normal(2.0, 1.0), lower=0.0, transform="log"),
        Parameter("share", 0.5, Normal(0.5, 0.2), lower=0.0, upper=1.0, transform="logit"),
        Parameter("drift", 0.0, Normal(0.0, 0.1)),
    ]

    def law(t, x):
        return t[0] * (t[1] + (1.0 - t[1]) * jnp.exp(-x)) + t[2] * x

    asked = problem(law, row, x, y + 0.01 * random.standard_normal(x.size))
    return asked, jnp.asarray(drawn(row, random, 6))


def test_all_methods_find_the_same_minimum():
    asked, draws = bounded_problem((3.0, 0.3, -0.05))
    ends = {name: least_squares(asked, draws, 3, method=name) for name in METHODS}
    best = {name: min(runs, key=lambda each: each.cost) for name, runs in ends.items()}
    for name, found in best.items():
        assert found.converged
        assert found.method == name
        assert len(ends[name]) == 3
        assert not found.at_bounds
        np.testing.assert_allclose(found.values, best["optimistix"].values, rtol=2e-5, err_msg=name)
        assert found.cost == pytest.approx(best["optimistix"].cost, rel=1e-9)
        np.testing.assert_allclose(asked.to_values(jnp.asarray(found.x)), found.values, rtol=1e-6)
    r, J = residuals_and_slopes(asked, jnp.asarray(best["optimistix"].values))
    assert np.linalg.norm(J.T @ r) < 1e-4 * np.linalg.norm(J) * np.linalg.norm(r)


def test_an_estimate_that_wants_beyond_a_bound_rests_on_it():
    """A share of -0.05: variables without bounds creep to 0, the bounded search lies on it."""
    asked, draws = bounded_problem((3.0, -0.05, -0.05))
    on_bound = least_squares(asked, draws, 1, method="jaxopt")[0]
    assert on_bound.at_bounds == {"share": 0.0}
    assert on_bound.values[1] == 0.0
    near = least_squares(asked, draws, 1)[0]
    assert 0.0 < near.values[1] < 1e-2
    moved = within_bounds(asked, near)
    assert moved.method == "jaxopt"
    assert moved.at_bounds == {"share": 0.0}
    np.testing.assert_allclose(moved.values, on_bound.values, rtol=1e-4)
    # The others are those of least squares with the share at 0: linear, in closed form.
    x = np.asarray(asked.x)
    other = np.linalg.lstsq(np.stack([np.exp(-x), x], axis=1), np.asarray(asked.y), rcond=None)[0]
    np.testing.assert_allclose(moved.values[[0, 2]], other, rtol=1e-4)


def test_an_estimate_far_from_bounds_is_left_as_it_is():
    asked, draws = bounded_problem((3.0, 0.3, -0.05))
    found = least_squares(asked, draws, 1)[0]
    assert within_bounds(asked, found) is found


def test_an_unknown_method_is_refused():
    asked, draws = bounded_problem((3.0, 0.3, -0.05))
    with pytest.raises(InputError, match="expected 'optimistix', 'jaxopt' or 'host'"):
        least_squares(asked, draws, 1, method="newton")  # type: ignore[arg-type]


def test_a_start_without_residuals_costs_a_bounded_search_nothing_but_itself():
    asked, draws = bounded_problem((3.0, 0.3, -0.05))
    nowhere = draws[:2].at[0, 0].set(jnp.nan)
    lost, found = least_squares(asked, nowhere, 2, method="jaxopt")
    assert lost.cost == np.inf
    assert not lost.converged
    assert found.converged


def test_slopes_that_overflow_leave_a_bounded_search_where_it_is():
    """The share is at its bound, and the other's slope is beyond what doubles hold."""
    row = [
        Parameter("share", 0.5, Normal(0.5, 0.2), lower=0.0, upper=1.0, transform="logit"),
        Parameter("power", 1.0, Normal(1.0, 1.0), lower=0.0, transform="log"),
    ]

    def law(t, _):
        # One to any power, by a slope that is infinite where the power is.
        grown = t[1] ** 2 * t[1] ** 2
        return jnp.stack([t[0] + 1.0, 1.0 + grown / (1.0 + grown)])

    asked = problem(law, row, np.zeros(2), np.zeros(2))
    begin = np.array([1e-7, 1e70])
    _, slopes = residuals_and_slopes(asked, jnp.asarray(begin))
    assert not np.all(np.isfinite(slopes))
    found = bounded(asked, begin)
    assert not found.converged
    assert found.cost == pytest.approx(5.0, rel=1e-6)
    assert found.at_bounds == {"share": 0.0}
