r"""Static equilibrium of a structure condensed to its joints, for a whole batch of levels.

Linear statics is linear: eliminating everything but the joints' deflections leaves

.. math:: C e + T^T f(T e) = \alpha\,c

with C the structure's stiffness as the joints see it (their own excluded), e the
independent deflections and d = T e those of the joints. For a rising f this is the
minimum of a convex energy, so a Newton step can only fail by overshooting, and one
secant step back along the line mends that. All arrays keep the batch on the last axes.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.joints import AbstractJoint
from iwanjax.quasistatic.alike import of_each
from iwanjax.structures.small import dot, product, solve_spd

# A Newton step of this relative size leaves an error of about its square.
TOLERANCE = 1e-10
_NOISE = 1e-7
_MAX_ITERATIONS = 60
_COARSE_STRIDE = 7
# A step of this size leaves less error than the interpolation between coarse levels.
_COARSE_TOLERANCE = 1e-2
# Newton steps on all lanes before those that need more are searched on their own.
_SWEEPS = 3
_STRAYED = 0.1
# The lanes searched together: a fraction of all, but no fewer than pay for the overhead.
_FRACTION, _FEWEST = 64, 64


class Condensed(NamedTuple):
    """The condensed structure and its loads.

    Attributes
    ----------
    C : r rows of r arrays
        Stiffness at the independent deflections without the nonlinear joints.
    c : r arrays
        Load per unit alpha.
    T : m rows of r arrays, or None
        Joint deflections d = T e; None when they are the independent ones themselves.
    """

    C: list[list[Array]]
    c: list[Array]
    T: list[list[Array]] | None


class _Search(NamedTuple):
    """State of the iteration: base point, step, how far along it, and slope at the base."""

    base: list[Array]
    step: list[Array]
    fraction: Array
    slope: Array
    error: Array
    iteration: Array


def joint_deflections(system: Condensed, e: Sequence[Array]) -> list[Array]:
    """Deflections of all joints, d = T e."""
    return list(e) if system.T is None else product(system.T, e)


def residual(
    joints: Sequence[AbstractJoint], system: Condensed, alpha: Array, e: Sequence[Array]
) -> tuple[list[Array], list[list[Array]]]:
    """Unbalanced load alpha c - C e - T^T f(T e), and the tangent C + T^T f' T.

    Parameters
    ----------
    joints : m joints
    system : Condensed
    alpha : array
        Load level(s).
    e : r arrays
        Independent deflections.
    """
    pairs = of_each(lambda joint, d: joint.law()(d), joints, joint_deflections(system, e))
    forces, tangents = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    J = [list(row) for row in system.C]
    r = [alpha * c - elastic for c, elastic in zip(system.c, product(system.C, e), strict=True)]
    if system.T is None:
        for i, (force, tangent) in enumerate(zip(forces, tangents, strict=True)):
            J[i][i] = J[i][i] + tangent
            r[i] = r[i] - force
    else:
        T = system.T
        for i in range(len(e)):
            r[i] = r[i] - dot([row[i] for row in T], forces)
            for j in range(i + 1):
                J[i][j] = J[i][j] + sum(
                    (row[i] * row[j] * t for row, t in zip(T, tangents, strict=True)),
                    jnp.zeros(()),
                )
    return r, J


@jax.custom_jvp
def equilibrium(
    joints: tuple[AbstractJoint, ...], system: Condensed, alpha: Float[Array, "levels *lanes"]
) -> tuple[list[Array], Array]:
    """Independent deflections e in equilibrium at every level, and how well they are known.

    Derivatives are implicit: one linear solve with the tangent at the solution.

    Parameters
    ----------
    joints : m joints
        Parameters broadcast against ``lanes``.
    system : Condensed
        Entries broadcast against ``lanes``.
    alpha : (levels, *lanes) array
        Load levels, increasing along the first axis.

    Returns
    -------
    e : r arrays (levels, *lanes)
    error : (levels, *lanes) array
        Size of the last Newton step relative to e, which bounds the error that is left;
        above ``TOLERANCE`` the level is not solved.
    """
    levels = alpha.shape[0]
    lanes = jnp.broadcast_shapes(
        alpha.shape[1:],
        *(jnp.shape(leaf) for leaf in jax.tree.leaves((joints, system))),
    )
    coarse = np.unique(np.append(np.arange(0, levels, _COARSE_STRIDE), levels - 1))
    stuck = [jnp.zeros((1, *lanes), alpha.dtype)] * len(system.c)
    _, J = residual(joints, system, alpha[:1], stuck)
    linear = solve_spd(J, [c * jnp.ones((1, *lanes), alpha.dtype) for c in system.c])
    stuck_e = [alpha * u for u in linear]
    if levels <= 3 * _COARSE_STRIDE:
        return _search(joints, system, alpha, stuck_e, TOLERANCE)
    few_alpha = alpha[coarse]
    few_stuck = [few_alpha * u for u in linear]
    few, error = _search(joints, system, few_alpha, few_stuck, _COARSE_TOLERANCE)
    # A coarse level that was not solved must not spoil its neighbours.
    few = [jnp.where(error <= _COARSE_TOLERANCE, x, y) for x, y in zip(few, few_stuck, strict=True)]
    guess = _interpolated(alpha, coarse, [e / few_alpha for e in few])
    return _solve(joints, system, alpha, [alpha * u for u in guess], stuck_e)


@equilibrium.defjvp
def _equilibrium_jvp(primals, tangents):
    joints, system, alpha = primals
    e, error = equilibrium(joints, system, alpha)

    def unbalanced(joints, system, alpha):
        return residual(joints, system, alpha, e)[0]

    _, r_dot = jax.jvp(unbalanced, primals, tangents)
    _, J = residual(joints, system, alpha, e)
    return (e, error), (solve_spd(J, r_dot), jnp.zeros_like(error))


def _relative(step: Sequence[Array], e: Sequence[Array]) -> Array:
    size, whole = jnp.abs(step[0]), jnp.abs(e[0])
    for s, x in zip(step[1:], e[1:], strict=True):
        size, whole = jnp.maximum(size, jnp.abs(s)), jnp.maximum(whole, jnp.abs(x))
    return size / jnp.where(whole > 0, whole, 1.0)


def _solve(
    joints: Sequence[AbstractJoint],
    system: Condensed,
    alpha: Array,
    guess: Sequence[Array],
    stuck: Sequence[Array],
) -> tuple[list[Array], Array]:
    """Plain Newton on every lane, then a safeguarded search on the few that need more."""

    def sweep(_: int, state: tuple[list[Array], Array]) -> tuple[list[Array], Array]:
        e = state[0]
        r, J = residual(joints, system, alpha, e)
        step = solve_spd(J, r)
        return [x + s for x, s in zip(e, step, strict=True)], _relative(step, e)

    # A loop rather than copies of the body: the same speed at a fifth of the compile time.
    e, error = jax.lax.fori_loop(0, _SWEEPS, sweep, (list(guess), jnp.ones_like(guess[0])))
    # What strayed (or is NaN, from a singular tangent) starts again with the joints stuck.
    strayed = ~(error < _STRAYED)
    e = [jnp.where(strayed, x, y) for x, y in zip(stuck, e, strict=True)]
    error = jnp.where(strayed, 1.0, error)
    shape, lanes = error.shape, error.size
    few = min(lanes, max(_FEWEST, lanes // _FRACTION))

    def proceed(state: tuple[list[Array], Array, Array]) -> Array:
        return jnp.any(state[2] > TOLERANCE)

    def advance(state: tuple[list[Array], Array, Array]) -> tuple[list[Array], Array, Array]:
        e, error, due = state
        index = jax.lax.top_k(due.ravel().astype(jnp.float32), few)[1]
        where = jnp.unravel_index(index, shape)

        def pick(x: Array) -> Array:
            x = jnp.reshape(x, (1,) * (len(shape) - jnp.ndim(x)) + jnp.shape(x))
            return x[tuple(i if n > 1 else 0 for i, n in zip(where, x.shape, strict=True))]

        those, there = jax.tree.map(pick, (joints, system))
        found, reached = _search(those, there, pick(alpha), [pick(x) for x in e], TOLERANCE)
        e = [x.at[where].set(y) for x, y in zip(e, found, strict=True)]
        # Found or given up, none is tried twice.
        return e, error.at[where].set(reached), due.at[where].set(0.0)

    e, error, _ = jax.lax.while_loop(proceed, advance, (e, error, error))
    return e, error


def _search(
    joints: Sequence[AbstractJoint],
    system: Condensed,
    alpha: Array,
    guess: Sequence[Array],
    tolerance: float,
) -> tuple[list[Array], Array]:
    """Newton with a secant step back wherever it overshot; stops when every lane is done."""

    def proceed(state: _Search) -> Array:
        return jnp.any(state.error > tolerance) & (state.iteration < _MAX_ITERATIONS)

    def advance(state: _Search) -> _Search:
        e = [x + state.fraction * s for x, s in zip(state.base, state.step, strict=True)]
        r, J = residual(joints, system, alpha, e)
        slope = dot(r, state.step)
        # The energy falls along the step while slope > 0; well below zero is too far. Of a
        # step near round-off the slope is noise.
        overshot = (slope < -0.5 * state.slope) & (state.error > _NOISE)
        step = solve_spd(J, r)
        back = state.fraction * state.slope / jnp.where(overshot, state.slope - slope, 1.0)

        def choose(kept: Sequence[Array], new: Sequence[Array]) -> list[Array]:
            return [jnp.where(overshot, a, b) for a, b in zip(kept, new, strict=True)]

        return _Search(
            choose(state.base, e),
            choose(state.step, step),
            jnp.where(overshot, back, 1.0),
            jnp.where(overshot, state.slope, dot(r, step)),
            jnp.where(overshot, 1.0, _relative(step, e)),
            state.iteration + 1,
        )

    zero = jnp.zeros_like(guess[0])
    start = _Search(
        list(guess), [zero] * len(guess), zero, zero, jnp.ones_like(zero), jnp.zeros((), jnp.int32)
    )
    end = jax.lax.while_loop(proceed, advance, start)
    return [x + s for x, s in zip(end.base, end.step, strict=True)], end.error


def _interpolated(alpha: Array, coarse: np.ndarray, values: Sequence[Array]) -> list[Array]:
    """Cubic interpolation in ln(alpha) from the coarse levels to all of them."""
    levels, nodes = alpha.shape[0], len(coarse)
    first = np.clip(np.searchsorted(coarse, np.arange(levels)) - 2, 0, nodes - 4)
    x = jnp.log(alpha)
    at = [x[coarse[first + t]] for t in range(4)]
    weights = [jnp.zeros(())] * nodes
    for t in range(4):
        weight = jnp.ones_like(x)
        for s in range(4):
            if s != t:
                weight = weight * (x - at[s]) / (at[t] - at[s])
        for c in range(nodes):
            here = (first + t == c).reshape(-1, *(1,) * (x.ndim - 1))
            weights[c] = weights[c] + jnp.where(here, weight, 0.0)
    # A sum over all nodes, most weights zero, is quicker than gathering each level's four.
    return [dot(weights, list(value)) for value in values]
