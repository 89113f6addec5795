"""Finding the parameters: many Levenberg-Marquardt runs in one batch, bounds where they matter."""

import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float

from iwanjax.errors import InputError
from iwanjax.estimation.least_squares import AbstractLeastSquares
from iwanjax.estimation.parameters import Chart, Parameter

_MOST_STEPS = 200
TOLERANCE = 1e-7
"""Of a search, relative."""
# Share of a range within which an estimate is taken to want to leave it.
_NEAR = 1e-2
# within which it is on its bound,
_ON_BOUND = 1e-5
# and sum of squared residuals that going there may cost.
_FREE = 1e-3


class Search(NamedTuple):
    """Ends of all runs.

    Attributes
    ----------
    theta : (runs, parameters) array
        Parameters.
    cost : (runs,) array
        Sum of squared residuals; infinite where a run has broken down.
    converged : (runs,) array
        Whether a run ended by its tolerance.
    """

    theta: Float[Array, "runs parameters"]
    cost: Float[Array, " runs"]
    converged: Bool[Array, " runs"]


def search(
    problem: AbstractLeastSquares,
    draws: Float[Array, "starts parameters"],
    runs: int,
    tolerance: float = TOLERANCE,
) -> Search:
    """Improve all starts, then run Levenberg-Marquardt from some of them.

    Every start gets what the problem can do for it at once. Then the best of each of
    ``runs`` groups of neighbours is run: the best of all may lie in one wide valley beside
    a narrow deeper one. Optimistix ignores bounds; the variables that it moves have none.
    """
    # As an array: a search to another tolerance is not compiled again.
    traced: Any = jnp.asarray(tolerance)
    return _search(problem, draws, runs, traced)


@eqx.filter_jit
def _search(
    problem: AbstractLeastSquares,
    draws: Float[Array, "starts parameters"],
    runs: int,
    tolerance: float,
) -> Search:
    solver = optx.LevenbergMarquardt(tolerance, tolerance)

    def residuals(z: Array, problem: AbstractLeastSquares) -> Array:
        return problem.residuals(problem.to_values(z))

    def cost(z: Array) -> Array:
        found = jnp.sum(residuals(z, problem) ** 2)
        return jnp.where(jnp.isfinite(found), found, jnp.inf)

    def run(z: Array) -> tuple[Array, Array, Array]:
        found = optx.least_squares(
            residuals, solver, z, args=problem, max_steps=_MOST_STEPS, throw=False
        )
        return (
            problem.to_values(found.value),
            # What its last accepted step has found: half the sum of squares.
            jnp.where(jnp.isfinite(ends := 2.0 * found.state.f_info.as_min()), ends, jnp.inf),
            found.result == optx.RESULTS.successful,
        )

    z = jax.vmap(lambda theta: problem.to_variables(problem.improved(theta)))(draws)
    costs = jax.vmap(cost)(z)
    groups = np.array_split(np.arange(len(draws)), runs)
    chosen = jnp.stack([z[group[0] + jnp.argmin(costs[group])] for group in groups])
    # One after the other: on few cores as quick as side by side, and compiled in a third of
    # the time.
    return Search(*jax.lax.map(run, chosen))


def within_bounds(
    problem: AbstractLeastSquares, parameters: Sequence[Parameter], theta: np.ndarray
) -> tuple[np.ndarray, dict[str, float]]:
    """An estimate after a bounded search where it is near to bounds, and those it rests on."""
    if near_bounds(problem.chart, theta):
        theta = bounded(problem, theta)
    return theta, resting(parameters, theta)


def resting(parameters: Sequence[Parameter], theta: np.ndarray) -> dict[str, float]:
    """Free parameters that rest on a bound, and the bound."""
    return {
        p.name: bound
        for p, value in zip(parameters, theta, strict=True)
        for bound in (p.lower, p.upper)
        if not p.fixed
        and np.isfinite(p.upper - p.lower)
        and abs(value - bound) <= _ON_BOUND * (p.upper - p.lower)
    }


def near_bounds(chart: Chart, theta: np.ndarray) -> bool:
    """Whether a free parameter between two bounds has come close to one."""
    lower, upper = np.asarray(chart.lower), np.asarray(chart.upper)
    boxed = [i for i in chart.free if chart.transforms[i] == "logit"]
    share = (theta[boxed] - lower[boxed]) / (upper[boxed] - lower[boxed])
    return bool(np.any((share < _NEAR) | (share > 1.0 - _NEAR)))


def bounded(problem: AbstractLeastSquares, theta: np.ndarray) -> np.ndarray:
    """Least squares within the bounds themselves, from a point near them.

    The variables of the search only approach a bound; here the parameters between two
    bounds move as they are, and an estimate may lie on a bound (jaxopt, over SciPy's trust
    region reflective).

    Parameters
    ----------
    problem : AbstractLeastSquares
        What to fit.
    theta : (parameters,) array
        Where the search has ended.

    Returns
    -------
    (parameters,) array
    """
    with warnings.catch_warnings():
        # jaxopt is no longer maintained and says so on import; this is its one place, and
        # here because it takes most of a second, which few fits need.
        warnings.simplefilter("ignore", DeprecationWarning)
        import jaxopt
    boxed = _boxed(problem.chart)
    start = _to_box(problem.chart, jnp.asarray(theta))
    solver = jaxopt.ScipyBoundedLeastSquares(
        method="trf",
        fun=_box_residuals,
        jit=False,
        use_jacrev=False,
        options={"xtol": 1e-12, "ftol": 1e-12, "x_scale": "jac"},
    )
    box = (np.where(boxed, 0.0, -np.inf), np.where(boxed, 1.0, np.inf))
    found = solver.run(start, box, problem)
    inside = np.array(_from_box(problem.chart, found.params))
    # SciPy stays strictly inside; a bound is the estimate if it costs nothing to go there.
    lower, upper = np.asarray(problem.chart.lower), np.asarray(problem.chart.upper)
    best, least = min(((t, _cost(problem, t)) for t in (theta, inside)), key=lambda pair: pair[1])
    for i in np.array(problem.chart.free)[boxed]:
        nearer = lower[i] if best[i] - lower[i] < upper[i] - best[i] else upper[i]
        moved = best.copy()
        moved[i] = nearer
        if _cost(problem, moved) < least + _FREE:
            best, least = moved, _cost(problem, moved)
    return best


def _cost(problem: AbstractLeastSquares, theta: np.ndarray) -> float:
    """Sum of squared residuals; infinite on a bound that has no model, as chi = -1."""
    try:
        return float(np.sum(np.asarray(_residuals(problem, jnp.asarray(theta))) ** 2))
    except InputError:
        return np.inf


@eqx.filter_jit
def _residuals(problem: AbstractLeastSquares, theta: Array) -> Array:
    return problem.residuals(theta)


def _boxed(chart: Chart) -> np.ndarray:
    return np.array([chart.transforms[i] == "logit" for i in chart.free])


def _to_box(chart: Chart, theta: Array) -> Array:
    """Free variables, those between two bounds as shares of their range."""
    free = np.array(chart.free)
    lower = chart.lower[free]
    share = (theta[free] - lower) / jnp.where(_boxed(chart), chart.upper[free] - lower, 1.0)
    return jnp.where(_boxed(chart), jnp.clip(share, 1e-6, 1.0 - 1e-6), chart.to_variables(theta))


def _from_box(chart: Chart, y: Array) -> Array:
    free, boxed = np.array(chart.free), _boxed(chart)
    theta = chart.to_values(jnp.where(boxed, 0.0, y))
    lower, upper = chart.lower[free[boxed]], chart.upper[free[boxed]]
    return theta.at[free[boxed]].set(lower + y[boxed] * (upper - lower))


@eqx.filter_jit
def _box_residuals(y: Array, problem: AbstractLeastSquares) -> Array:
    return problem.residuals(_from_box(problem.chart, y))
