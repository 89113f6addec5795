"""Searches from many starts, so many at a time that all share one compiled kernel."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.updating.problem import AbstractLeastSquares
from iwanjax.updating.search import TOLERANCE, search


def least_cost(
    problem: AbstractLeastSquares,
    starts: np.ndarray,
    at_once: int,
    runs: int,
    tolerance: float = TOLERANCE,
) -> tuple[float, np.ndarray]:
    """Sum of squared residuals and parameters of the best end.

    Parameters
    ----------
    problem : AbstractLeastSquares
        What to search.
    starts : (starts, parameters) array
        The last batch is filled up with the first ones.
    at_once, runs : int
        Starts of a batch, and those of them that are run to their minimum.
    tolerance : float
        Relative, of the search.
    """
    ends = []
    for first in range(0, len(starts), at_once):
        some = starts[np.arange(first, first + at_once) % len(starts)]
        found = search(problem, jnp.asarray(some), runs, tolerance)
        i = int(np.argmin(np.asarray(found.cost)))
        ends.append((float(found.cost[i]), np.asarray(found.theta[i])))
    return min(ends, key=lambda each: each[0])


@eqx.filter_jit
def slopes(
    problem: AbstractLeastSquares, theta: Float[Array, " parameters"]
) -> Float[Array, "residuals parameters"]:
    """Derivatives of the residuals by the parameters themselves."""
    return jax.jacfwd(problem.residuals)(theta)
