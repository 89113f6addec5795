"""Least squares within bounds that an estimate may lie on, by jaxopt: its only import."""

import warnings

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.estimation.parameters import Chart
from iwanjax.estimation.problem import AbstractLeastSquares, LeastSquaresSolution
from iwanjax.estimation.settings import SEARCH, SearchSettings
from iwanjax.estimation.transforms import share_of


def resting(
    problem: AbstractLeastSquares, theta: np.ndarray, settings: SearchSettings = SEARCH
) -> dict[str, float]:
    """Free parameters that rest on one of their two bounds, and the bound."""
    chart = problem.chart
    lower, upper = np.asarray(chart.lower), np.asarray(chart.upper)
    return {
        problem.names[i]: float(bound)
        for i in chart.free
        for bound in (lower[i], upper[i])
        if np.isfinite(upper[i] - lower[i])
        and abs(theta[i] - bound) <= settings.on_bound * (upper[i] - lower[i])
    }


def near_bounds(chart: Chart, theta: np.ndarray, settings: SearchSettings = SEARCH) -> bool:
    """Whether a free parameter between two bounds has come close to one."""
    lower, upper = np.asarray(chart.lower), np.asarray(chart.upper)
    boxed = [i for i in chart.free if chart.transforms[i] == "logit"]
    share = (theta[boxed] - lower[boxed]) / (upper[boxed] - lower[boxed])
    near = settings.near_bound
    return bool(np.any((share < near) | (share > 1.0 - near)))


def within_bounds(
    problem: AbstractLeastSquares,
    found: LeastSquaresSolution,
    settings: SearchSettings = SEARCH,
) -> LeastSquaresSolution:
    """A solution after a bounded search where it is near to bounds."""
    if near_bounds(problem.chart, found.values, settings):
        return bounded(problem, found.values, settings=settings)
    return found


def bounded(
    problem: AbstractLeastSquares,
    theta: np.ndarray,
    tolerance: float | None = None,
    settings: SearchSettings = SEARCH,
) -> LeastSquaresSolution:
    """Least squares within the bounds themselves, from a point near them.

    The variables of other searches only approach a bound; here the parameters between two
    bounds move as they are, and an estimate may lie on a bound (jaxopt, over SciPy's trust
    region reflective).

    Parameters
    ----------
    problem : AbstractLeastSquares
        What to fit, of parameters that are all in its chart.
    theta : (parameters,) array
        Where to begin.
    tolerance : float, optional
        Relative, in place of that of the settings.
    settings : SearchSettings
        What going to a bound may cost.

    Returns
    -------
    LeastSquaresSolution
        With an infinite cost from a point without finite residuals.

    Raises
    ------
    InputError
        For a problem with values beside those that its chart has bounds of.
    """
    chart = problem.chart
    tolerance = settings.tolerance if tolerance is None else tolerance
    if len(chart.transforms) != len(problem.names):
        raise InputError(
            f"bounded least squares: bounds of {len(chart.transforms)} parameters for "
            f"{len(problem.names)} values; expected bounds of all"
        )
    if not np.isfinite(_cost(problem, theta)):
        # SciPy asks for a point to begin with that the residuals are known at.
        return LeastSquaresSolution(
            values=theta,
            x=np.asarray(problem.to_variables(jnp.asarray(theta))),
            cost=np.inf,
            converged=False,
            iterations=0,
            method="jaxopt",
            at_bounds=resting(problem, theta, settings),
        )
    with warnings.catch_warnings():
        # jaxopt is no longer maintained and says so on import; here because it takes most of
        # a second, which few fits need.
        warnings.simplefilter("ignore", DeprecationWarning)
        import jaxopt
    boxed = _boxed(chart)
    solver = jaxopt.ScipyBoundedLeastSquares(
        method="trf",
        fun=_box_residuals,
        jit=False,
        use_jacrev=False,
        options={
            "xtol": tolerance,
            "ftol": tolerance,
            "x_scale": "jac",
        },
    )
    box = (np.where(boxed, 0.0, -np.inf), np.where(boxed, 1.0, np.inf))
    begin = _to_box(chart, jnp.asarray(theta))
    try:
        found = solver.run(begin, box, problem)
        params, success, evaluations = found.params, found.state.success, found.state.num_fun_eval
    except ValueError as error:
        # Where slopes overflow SciPy knows no step, and says so by this alone.
        if "infs or NaNs" not in str(error):
            raise
        params, success, evaluations = begin, False, 1
    inside = np.array(_from_box(chart, params))
    # SciPy stays strictly inside; a bound is the estimate if it costs nothing to go there.
    lower, upper = np.asarray(chart.lower), np.asarray(chart.upper)
    best, least = min(((t, _cost(problem, t)) for t in (theta, inside)), key=lambda pair: pair[1])
    for i in np.array(chart.free)[boxed]:
        nearer = lower[i] if best[i] - lower[i] < upper[i] - best[i] else upper[i]
        moved = best.copy()
        moved[i] = nearer
        if (cost := _cost(problem, moved)) < least + settings.bound_cost:
            best, least = moved, cost
    return LeastSquaresSolution(
        values=best,
        x=np.asarray(problem.to_variables(jnp.asarray(best))),
        cost=least,
        converged=bool(success),
        iterations=int(evaluations),
        method="jaxopt",
        at_bounds=resting(problem, best, settings),
    )


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


def _to_box(chart: Chart, theta: Float[Array, " parameters"]) -> Float[Array, " free"]:
    """Free variables, those between two bounds as shares of their range."""
    free = np.array(chart.free)
    lower = chart.lower[free]
    upper = jnp.where(_boxed(chart), chart.upper[free], lower + 1.0)
    share = share_of(theta[free], lower, upper)
    return jnp.where(_boxed(chart), share, chart.to_variables(theta))


def _from_box(chart: Chart, y: Float[Array, " free"]) -> Float[Array, " parameters"]:
    free, boxed = np.array(chart.free), _boxed(chart)
    theta = chart.to_values(jnp.where(boxed, 0.0, y))
    lower, upper = chart.lower[free[boxed]], chart.upper[free[boxed]]
    return theta.at[free[boxed]].set(lower + y[boxed] * (upper - lower))


@eqx.filter_jit
def _box_residuals(y: Array, problem: AbstractLeastSquares) -> Array:
    return problem.residuals(_from_box(problem.chart, y))
