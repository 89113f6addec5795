"""Loops of a joint on its own, with a force beside it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.discrepancy.effects import ForceKind, PlaceMotion, Scales
from iwanjax.discrepancy.evidence import correlation_time
from iwanjax.discrepancy.steady.one_joint import (
    Deviations,
    PlacedForce,
    best_of,
    deviations_of,
    over_shapes,
    to_size,
    to_variable,
)
from iwanjax.discrepancy.steady.starts import least_cost, slopes
from iwanjax.joints import AbstractJoint
from iwanjax.joints.hysteresis import hysteresis
from iwanjax.signals.force_loop import ForceLoop
from iwanjax.updating.parameters import Chart, Parameter
from iwanjax.updating.problem import AbstractLeastSquares

# Starts of one search and those of them that are run, and the spread of the sizes to start from
# over the largest that is plausible.
_STARTS, _RUNS, _SPREAD = 16, 3, 0.5
# No force is taken to be known better than to this share of its root mean square.
_BEST = 1e-3
# Values of each loop that are fitted: its turns, and as many between them as draw it.
_VALUES = 300
# Change of a force by a step twice as long, over the largest, from which on it depends on rate.
_BY_RATE = 1e-6


class LoopHistories(eqx.Module):
    """Loops side by side, each after what leads to it from rest.

    Attributes
    ----------
    d, force : (loops, N) array
        Deflections and forces; where a loop has none, the last deflection again.
    weight : (loops, N) array
        One over the force's deviation; zero where it was not measured, or held out.
    """

    d: Float[Array, "loops N"]
    force: Float[Array, "loops N"]
    weight: Float[Array, "loops N"]

    @property
    def largest(self) -> float:
        """Largest deflection."""
        return float(jnp.max(jnp.abs(self.d)))


def noise_of(loops: Sequence[ForceLoop], known: float | None) -> tuple[float, ...]:
    """Deviation of each loop's force."""
    return tuple(
        max(
            loop.noise if known is None else known, _BEST * math.sqrt(float(np.mean(loop.force**2)))
        )
        for loop in loops
    )


def driven(
    loops: Sequence[ForceLoop],
    noise: Sequence[float],
    fitted: int,
    at_rest: bool,
    most: float = _VALUES,
) -> LoopHistories:
    """Loops, of which the first ones are to be fitted, each by so many values at most.

    Those that may begin at rest do so, or on the outermost loop like the others.
    """
    chosen = [_drawing(loop.d, most) for loop in loops]
    length = max(map(len, chosen)) + 2
    d, force, weight = np.zeros((3, len(loops), length))
    for i, (loop, deviation, at) in enumerate(zip(loops, noise, chosen, strict=True)):
        end = len(at) + 2
        d[i] = loop.d[-1]
        d[i, :2], d[i, 2:end], force[i, 2:end] = loop.before(at_rest), loop.d[at], loop.force[at]
        weight[i, 2:end] = 1.0 / deviation if i < fitted else 0.0
    return LoopHistories(jnp.asarray(d), jnp.asarray(force), jnp.asarray(weight))


def _drawing(d: np.ndarray, most: float) -> np.ndarray:
    """Values that draw a path: the outermost ones of equal parts, in their order."""
    every = np.arange(d.size)
    if d.size <= most:
        return every
    parts = np.array_split(every, int(most) // 2 - 1)
    ends = [part[each(d[part])] for part in parts for each in (np.argmin, np.argmax)]
    return np.unique([0, *ends, d.size - 1])


class JointAndForce(AbstractLeastSquares):
    """A joint and a force of some size beside it, held against loops.

    Parameters are the joint's and the size. The force itself is data, so that all kinds share
    one compiled search. Every loop has an offset of its own, for a load cell's zero.
    """

    chart: Chart
    names: tuple[str, ...] = eqx.field(static=True)
    joint: AbstractJoint
    loops: LoopHistories
    unit: Float[Array, "loops N"]
    scale: Array
    positive: Array

    def to_values(self, z: Float[Array, " free"]) -> Float[Array, " parameters"]:
        """The chart's, and the size."""
        size = to_size(z[-1], self.scale, self.positive)
        return jnp.append(self.chart.to_values(z[:-1]), size)

    def to_variables(self, theta: Float[Array, " parameters"]) -> Float[Array, " free"]:
        """The inverse of :meth:`to_values`."""
        variable = to_variable(theta[-1], self.scale, self.positive)
        return jnp.append(self.chart.to_variables(theta[:-1]), variable)

    def predict(self, theta: Float[Array, " parameters"]) -> Float[Array, "loops N"]:
        """Forces, without offsets."""
        joint = type(self.joint)(**dict(zip(self.names[:-1], theta[:-1], strict=True)))
        return hysteresis(joint, self.loops.d, sliders=None) + theta[-1] * self.unit

    def residuals(self, theta: Float[Array, " parameters"]) -> Float[Array, " residuals"]:
        """Predicted less measured over deviations, each loop without its mean."""
        off, weight = self.predict(theta) - self.loops.force, self.loops.weight
        count = jnp.maximum(jnp.sum(weight > 0, axis=1, keepdims=True), 1)
        mean = jnp.sum(jnp.where(weight > 0, off, 0.0), axis=1, keepdims=True) / count
        return jnp.ravel((off - mean) * weight)


@dataclass(frozen=True, eq=False)
class LoopFit:
    """Loops explained by a joint and at most one force.

    Attributes
    ----------
    force : PlacedForce or None
        None for the joint alone.
    problem : JointAndForce
        What was searched.
    theta : (parameters,) array
        Where it ended; the last is the force's size.
    cost : float
        Sum of squared residuals over their deviations.
    """

    force: PlacedForce | None
    problem: JointAndForce
    theta: np.ndarray
    cost: float

    @property
    def unknowns(self) -> int:
        """Values that were adjusted."""
        own = 0 if self.force is None else 1 + (self.force.kind.shape is not None)
        return len(self.problem.chart.free) + own

    @property
    def count(self) -> int:
        """Values that were measured."""
        return int(np.count_nonzero(np.asarray(self.problem.loops.weight)))

    def forces(self, loops: LoopHistories) -> np.ndarray:
        """Predicted, without offsets, (loops, N)."""
        unit = (
            0.0 * loops.d
            if self.force is None
            else unit_of(self.force.kind, self.force.shape, loops.d)
        )
        along = eqx.tree_at(lambda p: (p.loops, p.unit), self.problem, (loops, unit))
        return np.asarray(_predicted(along, jnp.asarray(self.theta)))

    def correlation(self) -> float:
        """Correlation time of the residuals in values, mean over the loops."""
        loops = self.problem.loops
        weight = np.asarray(loops.weight)
        off = (self.forces(loops) - np.asarray(loops.force)) * weight
        used = [row[w > 0][None, :, None] for row, w in zip(off, weight, strict=True) if w.any()]
        return float(np.mean([correlation_time(row - row.mean()) for row in used]))

    def deviations(self) -> Deviations:
        """Of the force's size and shape, linearised; NaN without one."""
        theta = jnp.asarray(self.theta)
        return deviations_of(
            self.force,
            lambda: np.asarray(slopes(self.problem, theta)),
            lambda factor: np.asarray(_residuals(self._reshaped(factor), theta)),
            self.cost,
            self.correlation(),
        )

    def _reshaped(self, factor: float) -> JointAndForce:
        assert self.force is not None
        unit = unit_of(self.force.kind, self.force.shape * factor, self.problem.loops.d)
        return eqx.tree_at(lambda p: p.unit, self.problem, unit)


def unit_of(kind: ForceKind, shape: float, d: Float[Array, "loops N"]) -> Float[Array, "loops N"]:
    """A force of unit size along deflections that are run through slowly."""
    return _along(kind, jnp.asarray(shape), d, jnp.ones(()))


def quasi_static(kind: ForceKind, d: Float[Array, "loops N"]) -> bool:
    """Whether a force depends on deflections alone, so that loops without time show it."""
    if kind.inertial:
        return False
    shape = jnp.asarray(kind.shapes(Scales(float(jnp.max(jnp.abs(d))), 1.0))[0])
    slow, slower = (np.asarray(_along(kind, shape, d, jnp.asarray(dt))) for dt in (1.0, 2.0))
    return bool(np.max(np.abs(slow - slower)) <= _BY_RATE * np.max(np.abs(slow)))


@partial(jax.jit, static_argnums=0)
def _along(kind: ForceKind, shape: Array, d: Array, dt: Array) -> Array:
    def step(memory: Array, motion: tuple[Array, Array]) -> tuple[Array, Array]:
        to, moved = motion
        there = PlaceMotion(to, moved / dt, jnp.zeros_like(to), moved, dt)
        force, memory = kind.unit_force(there, shape, memory)
        return memory, jnp.broadcast_to(force, to.shape)

    moved = jnp.diff(d, axis=1, prepend=0.0)
    return jax.lax.scan(step, jnp.zeros(d.shape[0]), (d.T, moved.T))[1].T


def loops_alone(
    joint: AbstractJoint, parameters: Sequence[Parameter], loops: LoopHistories, draws: np.ndarray
) -> LoopFit:
    """The joint alone, from draws of its parameters (starts, parameters)."""
    names = (*(p.name.rpartition(".")[2] for p in parameters), "size")
    problem = JointAndForce(
        Chart(parameters), names, joint, loops, 0.0 * loops.d, jnp.ones(()), jnp.zeros(())
    )
    return _searched(None, problem, np.column_stack([draws, np.zeros(len(draws))]))


def loops_beside(
    alone: LoopFit, kind: ForceKind, draws: np.ndarray, random: np.random.Generator
) -> LoopFit | None:
    """The joint and a force; None where loops cannot show the force."""
    loops = alone.problem.loops
    if not quasi_static(kind, loops.d):
        return None
    few = np.tile(alone.theta[:-1], (_STARTS, 1))
    few[::2] = draws[np.linspace(0, len(draws) - 1, _STARTS // 2).astype(int)]

    def at(shape: float) -> LoopFit | None:
        unit = unit_of(kind, shape, loops.d)
        most = float(jnp.max(jnp.abs(unit)))
        if most == 0.0:
            return None
        largest = float(jnp.max(jnp.abs(loops.force))) / most
        sizes = _SPREAD * largest * random.standard_normal(_STARTS)
        problem = eqx.tree_at(
            lambda p: (p.unit, p.scale, p.positive),
            alone.problem,
            (unit, jnp.asarray(largest), jnp.asarray(float(kind.positive))),
        )
        sizes = np.abs(sizes) if kind.positive else sizes
        return _searched(PlacedForce(kind, shape), problem, np.column_stack([few, sizes]))

    begin = kind.shapes(Scales(loops.largest, 1.0))
    if kind.shape is not None:
        found = over_shapes(begin, at)
        return best_of(found) if found else None
    return at(begin[0])


def _searched(force: PlacedForce | None, problem: JointAndForce, starts: np.ndarray) -> LoopFit:
    cost, theta = least_cost(problem, starts, _STARTS, _RUNS)
    return LoopFit(force, problem, theta, cost)


@eqx.filter_jit
def _predicted(problem: JointAndForce, theta: Array) -> Array:
    return problem.predict(theta)


@eqx.filter_jit
def _residuals(problem: JointAndForce, theta: Array) -> Array:
    return problem.residuals(theta)
