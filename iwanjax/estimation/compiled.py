"""Many Levenberg-Marquardt runs of residuals that are compiled whole, by optimistix."""

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.estimation.problem import AbstractLeastSquares, residuals_and_slopes_in_variables
from iwanjax.threads import available_threads

_Found = TypeVar("_Found")

# What one run finds: values, variables, cost, whether it converged, steps.
_End = tuple[Array, Array, Array, Array, Array]


def best_of_neighbours(
    problem: AbstractLeastSquares, draws: Float[Array, "starts parameters"], runs: int
) -> Float[np.ndarray, "runs free"]:
    """Variables of the best start in each of so many groups of neighbours.

    Every start gets what the problem can do for it at once. The best of all may lie in one wide
    valley beside a narrow deeper one, so that each group has one.
    """
    seen = _side_by_side(lambda theta: _improved(problem, theta), draws)
    z, costs = (np.stack(each) for each in zip(*seen, strict=True))
    groups = np.array_split(np.arange(len(z)), runs)
    return np.stack([z[group[np.argmin(costs[group])]] for group in groups])


def run_all(
    problem: AbstractLeastSquares,
    draws: Float[Array, "starts parameters"],
    runs: int,
    tolerance: float,
    most_steps: int,
) -> list[_End]:
    """Ends of runs from the best starts."""
    # As an array: a search to another tolerance is not compiled again.
    precision = jnp.asarray(tolerance)
    begin = best_of_neighbours(problem, draws, runs)
    return _side_by_side(lambda z: _run(problem, z, precision, most_steps), begin)


def _side_by_side(of: Callable[[Any], _Found], each: Iterable[Any]) -> list[_Found]:
    """Results for all, by a compiled function of one: on all cores, and compiled once.

    A batch of all of them would go through as many steps as its slowest takes, on one core, and a
    batch of another size, as a single run from where the last ones ended, would be compiled again.
    """
    first, *others = each
    found = [jax.block_until_ready(of(first))]
    with ThreadPoolExecutor(available_threads()) as pool:
        found += pool.map(lambda one: jax.block_until_ready(of(one)), others)
    return found


@eqx.filter_jit
def _improved(
    problem: AbstractLeastSquares, theta: Float[Array, " parameters"]
) -> tuple[Array, Array]:
    """Variables of a start with what the problem can do for it at once, and its cost."""
    z = problem.to_variables(problem.improved(theta))
    cost = jnp.sum(problem.residuals(problem.to_values(z)) ** 2)
    return z, jnp.where(jnp.isfinite(cost), cost, jnp.inf)


@eqx.filter_jit
def _run(
    problem: AbstractLeastSquares,
    z: Float[Array, " free"],
    tolerance: Float[Array, ""],
    most_steps: int,
) -> _End:
    """One run's end."""
    import optimistix as optx  # here, because few need it and it is slow to import

    solver = optx.LevenbergMarquardt(tolerance, tolerance)  # type: ignore[arg-type]

    @jax.custom_jvp
    def residuals(z: Array) -> Array:
        return problem.residuals(problem.to_values(z))

    # The derivatives as a matrix, in one piece with the residuals: a solver that linearises them
    # itself keeps, and compiles, every step on the way.
    @residuals.defjvp
    def _(z: tuple[Array], way: tuple[Array]) -> tuple[Array, Array]:
        found, slopes = residuals_and_slopes_in_variables(problem, *z)
        return found, slopes @ way[0]

    found = optx.least_squares(
        lambda z, _: residuals(z), solver, z, max_steps=most_steps, throw=False
    )
    return (
        problem.to_values(found.value),
        found.value,
        # What its last accepted step has found: half the sum of squares.
        jnp.where(jnp.isfinite(ends := 2.0 * found.state.f_info.as_min()), ends, jnp.inf),
        found.result == optx.RESULTS.successful,
        jnp.asarray(found.stats["num_steps"]),
    )
