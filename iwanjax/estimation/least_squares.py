"""Least squares from many starts, by whichever method suits the problem."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.estimation.bounded import bounded, resting
from iwanjax.estimation.compiled import best_of_neighbours, run_all
from iwanjax.estimation.levenberg_marquardt import Layout, SearchStart
from iwanjax.estimation.linearisation import Linearisation
from iwanjax.estimation.multistart import multistart
from iwanjax.estimation.problem import (
    AbstractLeastSquares,
    LeastSquaresSolution,
    residuals_and_slopes_in_variables,
)
from iwanjax.estimation.settings import SEARCH, Method, SearchSettings


def least_squares(
    problem: AbstractLeastSquares,
    draws: Float[Array, "starts parameters"],
    runs: int,
    *,
    method: Method = "optimistix",
    tolerance: float | None = None,
    settings: SearchSettings = SEARCH,
) -> tuple[LeastSquaresSolution, ...]:
    r"""Minimise :math:`\sum_i r_i(\theta)^2` from the best of some starts.

    Every start gets what the problem can do for it at once. Then the best of each of ``runs``
    groups of neighbours is run to its minimum.

    Parameters
    ----------
    problem : AbstractLeastSquares
        Residuals r of parameters :math:`\theta`, with their variables and bounds.
    draws : (starts, parameters) array
        Where to begin, in the parameters' units, neighbours beside each other.
    runs : int
        How many starts are run.
    method : {"optimistix", "jaxopt", "host"}
        Levenberg-Marquardt in the problem's variables, which have no bounds, compiled with the
        residuals; trust regions in the parameters' own bounds (SciPy's, by jaxopt), where an
        estimate may lie on one; or Levenberg-Marquardt of the host, for residuals that are dear.
    tolerance : float, optional
        Relative, in place of that of the settings.
    settings : SearchSettings
        How to search.

    Returns
    -------
    tuple of LeastSquaresSolution
        One for each run.

    Raises
    ------
    InputError
        For a method that there is not, and ``"jaxopt"`` for a problem without bounds of all
        its parameters.
    """
    tolerance = settings.tolerance if tolerance is None else tolerance
    if method == "optimistix":
        return tuple(
            LeastSquaresSolution(
                values=np.asarray(values),
                x=np.asarray(x),
                cost=float(cost),
                converged=bool(converged),
                iterations=int(steps),
                method=method,
                at_bounds=resting(problem, np.asarray(values), settings),
            )
            for values, x, cost, converged, steps in run_all(
                problem, draws, runs, tolerance, settings.most_steps
            )
        )
    if method == "jaxopt":
        begin = [np.asarray(problem.to_values(z)) for z in best_of_neighbours(problem, draws, runs)]
        return tuple(bounded(problem, theta, tolerance, settings) for theta in begin)
    if method == "host":
        return _by_the_host(problem, draws, runs, tolerance, settings)
    raise InputError(
        f"least_squares: method = {method!r}; expected 'optimistix', 'jaxopt' or 'host'"
    )


def _by_the_host(
    problem: AbstractLeastSquares,
    draws: Array,
    runs: int,
    tolerance: float,
    settings: SearchSettings,
) -> tuple[LeastSquaresSolution, ...]:
    """Runs of the host's search, in the problem's variables."""
    begin = best_of_neighbours(problem, draws, runs)
    size = begin.shape[1]
    layout = Layout(np.zeros((1, size)), np.eye(size)[None], np.zeros(size))
    measured, _ = residuals_and_slopes_in_variables(problem, begin[0])
    residuals = _InVariables(problem, measured.size)
    starts = [SearchStart(layout, z) for z in begin]
    ends = multistart(
        residuals, starts, settings.most_steps, tolerance=tolerance, settings=settings
    )
    found = []
    for each in ends:
        values = np.asarray(problem.to_values(jnp.asarray(each.x)))
        bounds = resting(problem, values, settings)
        cost = each.cost if np.isfinite(each.cost) else np.inf
        found.append(replace(each, values=values, cost=cost, at_bounds=bounds))
    return tuple(found)


@dataclass(frozen=True)
class _InVariables:
    """A compiled problem's residuals as those of one group, by one sensor."""

    problem: AbstractLeastSquares
    count: int

    def residuals(self, points: Sequence[tuple[Any, np.ndarray]]) -> list[np.ndarray]:
        return [each.residual for each in self.linearise(points)]

    def linearise(self, points: Sequence[tuple[Any, np.ndarray]]) -> list[Linearisation]:
        found = []
        for _, z in points:
            r, J = residuals_and_slopes_in_variables(self.problem, jnp.asarray(z[0]))
            found.append(
                Linearisation.of(np.asarray(r)[None, :, None], np.asarray(J).T[None, ..., None])
            )
        return found
