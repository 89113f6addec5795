"""Loops of a joint on its own, with a force or another joint beside it."""

import itertools
import math
from collections.abc import Sequence
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.effects.kinds import ForceKind, NamedKind
from iwanjax.estimation.parameters import Chart, Parameter
from iwanjax.identification.steady.fit import (
    AbstractEffectValues,
    AbstractSteadyProblem,
    JointValues,
    PlacedEffect,
    Size,
    SteadyFit,
    as_joint,
    best_of,
    joints_to_begin_with,
    searched,
    with_sizes,
)
from iwanjax.identification.steady.shapes import best_shape, from_within
from iwanjax.joints import AbstractJoint, Iwan4
from iwanjax.joints.force_law import PlaceMotion, Scales
from iwanjax.joints.hysteresis import hysteresis
from iwanjax.joints.iwan import IWAN_PARAMETERS
from iwanjax.settings.stages import settings
from iwanjax.signals.force_loop import ForceLoop
from iwanjax.updating.joint_groups import joint_parameters


class LoopHistories(eqx.Module):
    """Loops side by side, each after what leads to it from rest.

    Attributes
    ----------
    d, force : (loops, N) array
        Deflections and forces; where a loop has none, the last deflection again.
    weight : (loops, N) array
        One over the force's deviation; zero where it was not measured, or held out.
    dt : (loops, N) array or None
        Time from the value before to each, s; None where a loop has no time.
    """

    d: Float[Array, "loops N"]
    force: Float[Array, "loops N"]
    weight: Float[Array, "loops N"]
    dt: Float[Array, "loops N"] | None = None

    @property
    def largest(self) -> float:
        """Largest deflection."""
        return float(jnp.max(jnp.abs(self.d)))


def noise_of(loops: Sequence[ForceLoop], known: float | None) -> tuple[float, ...]:
    """Deviation of each loop's force: of its noise, and of the scatter between its cycles."""
    best = settings().steady.best_force
    return tuple(
        max(
            np.fmax(loop.noise, loop.scatter) if known is None else known,
            best * math.sqrt(float(np.mean(loop.force**2))),
        )
        for loop in loops
    )


def driven(
    loops: Sequence[ForceLoop],
    noise: Sequence[float],
    fitted: int,
    at_rest: bool,
    most: float | None = None,
) -> LoopHistories:
    """Loops, of which the first ones are to be fitted, each by so many values at most.

    Those that may begin at rest do so, or on the outermost loop like the others.
    """
    most = settings().steady.values if most is None else most
    chosen = [_drawing(loop.d, most) for loop in loops]
    length = max(map(len, chosen)) + 2
    d, force, weight, dt = np.zeros((4, len(loops), length))
    for i, (loop, deviation, at) in enumerate(zip(loops, noise, chosen, strict=True)):
        end = len(at) + 2
        d[i] = loop.d[-1]
        d[i, :2], d[i, 2:end], force[i, 2:end] = loop.before(at_rest), loop.d[at], loop.force[at]
        weight[i, 2:end] = 1.0 / deviation if i < fitted else 0.0
        step = loop.dt or 1.0
        # What leads to a loop is run through slowly, and so is what follows it.
        dt[i] = loop.d.size * step
        dt[i, 3:end] = np.diff(at) * step
    timed = all(loop.dt is not None for loop in loops)
    return LoopHistories(
        jnp.asarray(d), jnp.asarray(force), jnp.asarray(weight), jnp.asarray(dt) if timed else None
    )


def _drawing(d: np.ndarray, most: float) -> np.ndarray:
    """Values that draw a path: the outermost ones of equal parts, in their order."""
    every = np.arange(d.size)
    if d.size <= most:
        return every
    parts = np.array_split(every, int(most) // 2 - 1)
    ends = [part[each(d[part])] for part in parts for each in (np.argmin, np.argmax)]
    return np.unique([0, *ends, d.size - 1])


class LoopProblem(AbstractSteadyProblem):
    """A joint and what acts beside it, held against loops.

    Parameters are the joint's and the effect's values. Every loop has an offset of its own, for a
    load cell's zero.

    Attributes
    ----------
    unit : (loops, N) array
        A force of unit size; zero where another joint acts.
    """

    chart: Chart
    names: tuple[str, ...] = eqx.field(static=True)
    base: Chart
    beside: AbstractEffectValues
    joint: AbstractJoint
    loops: LoopHistories
    unit: Float[Array, "loops N"]

    @property
    def count(self) -> int:
        """Forces."""
        return int(np.count_nonzero(np.asarray(self.loops.weight)))

    def forces(self, theta: Float[Array, " parameters"]) -> Float[Array, "loops N"]:
        """Predicted, without offsets."""
        n, d = self.beside.count, self.loops.d
        joint = self.joint.with_parameters(**dict(zip(self.names[:-n], theta[:-n], strict=True)))
        own = hysteresis(joint, d, sliders=None, dt=self.loops.dt)
        if isinstance(self.beside, JointValues):
            return own + hysteresis(Iwan4(*theta[-n:]), d, sliders=None)
        return own + theta[-1] * self.unit

    def residuals(self, theta: Float[Array, " parameters"]) -> Float[Array, " residuals"]:
        """Predicted less measured over deviations, each loop without its mean."""
        off, weight = self.forces(theta) - self.loops.force, self.loops.weight
        count = jnp.maximum(jnp.sum(weight > 0, axis=1, keepdims=True), 1)
        mean = jnp.sum(jnp.where(weight > 0, off, 0.0), axis=1, keepdims=True) / count
        return jnp.ravel((off - mean) * weight)

    def series(self, residuals: np.ndarray) -> tuple[np.ndarray, ...]:
        """Of each loop that was fitted."""
        weight = np.asarray(self.loops.weight)
        rows = zip(residuals.reshape(weight.shape), weight, strict=True)
        return tuple(row[w > 0][:, None] for row, w in rows if w.any())

    def reshaped(self, effect: PlacedEffect) -> "LoopProblem":
        """The same with a force of another shape."""
        return eqx.tree_at(lambda p: p.unit, self, unit_of(effect, self.loops))

    def predicted(
        self, theta: Array, effect: PlacedEffect | None, measured: LoopHistories, which: int
    ) -> tuple[np.ndarray, ...]:
        """Forces along other deflections, without offsets."""
        both = (measured, unit_of(effect, measured))
        along = eqx.tree_at(lambda p: (p.loops, p.unit), self, both)
        return tuple(np.asarray(_forces(along, theta)))


LoopFit = SteadyFit[LoopProblem]


def unit_of(effect: PlacedEffect | None, loops: LoopHistories) -> Float[Array, "loops N"]:
    """A force of unit size along deflections; zero without one."""
    if effect is None or not isinstance(effect.kind, ForceKind):
        return jnp.zeros_like(loops.d)
    dt = jnp.ones_like(loops.d) if loops.dt is None else loops.dt
    return _along(effect.kind, jnp.asarray(effect.shape), loops.d, dt)


def is_seen(kind: ForceKind, loops: LoopHistories) -> bool:
    """Whether loops show a force: one that depends on deflections alone, or on rate with time."""
    if kind.inertial:
        return False
    if loops.dt is not None:
        return True
    d = loops.d
    shape = jnp.asarray(kind.shapes(Scales(float(jnp.max(jnp.abs(d))), 1.0))[0])
    negligible = settings().steady.negligible
    slow, slower = (np.asarray(_along(kind, shape, d, jnp.full(d.shape, dt))) for dt in (1.0, 2.0))
    return bool(np.max(np.abs(slow - slower)) <= negligible * np.max(np.abs(slow)))


@partial(jax.jit, static_argnums=0)
def _along(kind: ForceKind, shape: Array, d: Array, dt: Array) -> Array:
    def step(memory: Array, motion: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        to, moved, dt = motion
        there = PlaceMotion(to, moved / dt, jnp.zeros_like(to), moved, dt)
        force, memory = kind.unit_force(there, shape, memory)
        return memory, jnp.broadcast_to(force, to.shape)

    moved = jnp.diff(d, axis=1, prepend=0.0)
    return jax.lax.scan(step, jnp.zeros(d.shape[0]), (d.T, moved.T, dt.T))[1].T


def loops_alone(
    joint: AbstractJoint, parameters: Sequence[Parameter], loops: LoopHistories, draws: np.ndarray
) -> LoopFit:
    """The joint alone, from draws of its parameters (starts, parameters)."""
    problem = LoopProblem(
        chart=Chart(parameters),
        names=(*(p.name.rpartition(".")[2] for p in parameters), "size"),
        base=Chart(parameters),
        beside=Size(jnp.ones(()), jnp.zeros(())),
        joint=joint,
        loops=loops,
        unit=jnp.zeros_like(loops.d),
    )
    return searched(
        None, problem, np.column_stack([draws, np.zeros(len(draws))]), settings().steady.loop_runs
    )


def loops_beside(
    alone: LoopFit, kind: ForceKind, draws: np.ndarray, random: np.random.Generator
) -> LoopFit | None:
    """The joint and a force; None where loops cannot show the force."""
    loops = alone.problem.loops
    if not is_seen(kind, loops):
        return None
    few = joints_to_begin_with(alone, draws)
    ended: list[LoopFit] = []

    def at(shape: float) -> LoopFit | None:
        effect = PlacedEffect(kind, shape)
        found = _with_force(alone.problem, effect)
        if found is None:
            return None
        problem, largest = found
        starts = with_sizes(few, kind, largest, random)
        if ended:
            # From the best of the other shapes as well, or each may end in a minimum of its own.
            starts[0] = best_of(ended).theta
        ended.append(searched(effect, problem, starts, settings().steady.loop_runs))
        return ended[-1]

    return best_shape(kind, kind.shapes(Scales(loops.largest, 1.0)), at)


def loops_from_within(simpler: LoopFit, kind: ForceKind) -> LoopFit | None:
    """The joint and a force, from a fit of a simpler one that the force contains."""

    def at(shape: float, start: np.ndarray) -> LoopFit | None:
        effect = PlacedEffect(kind, shape)
        found = _with_force(simpler.problem, effect)
        if found is None:
            return None
        return searched(effect, found[0], start[None], settings().steady.loop_runs)

    return from_within(simpler, kind, simpler.problem.loops.largest, at)


def _with_force(base: LoopProblem, effect: PlacedEffect) -> tuple[LoopProblem, float] | None:
    """The joint and a force of some shape, and its largest size; None where it does nothing."""
    unit = unit_of(effect, base.loops)
    most = float(jnp.max(jnp.abs(unit)))
    if most == 0.0:
        return None
    largest = float(jnp.max(jnp.abs(base.loops.force))) / most
    positive = isinstance(effect.kind, ForceKind) and effect.kind.positive
    size = Size(jnp.asarray(largest), jnp.asarray(float(positive)))
    return eqx.tree_at(lambda p: (p.unit, p.beside), base, (unit, size)), largest


def loops_with_joint(alone: LoopFit, kind: NamedKind, limits: Sequence[LoopFit]) -> LoopFit:
    """The joint and another one.

    From other joints of some strengths and slips, and from the sliders and springs that were
    found beside the joint: what a joint has for its limit never fits better than it.

    Parameters
    ----------
    alone : SteadyFit
        The joint alone.
    kind : NamedKind
        What another one is called.
    limits : sequence of SteadyFit
        Those beside the joint, the best first.
    """
    base, known = alone.problem, settings().steady
    force, deflection = float(jnp.ptp(base.loops.force)) / 2.0, base.loops.largest
    given = joint_parameters("other", Iwan4(*_joint(0.5 * force, deflection)))
    problem = LoopProblem(
        chart=base.chart,
        names=(*base.names[:-1], *(info.name for info in IWAN_PARAMETERS)),
        base=base.base,
        beside=JointValues(Chart(tuple(given.values())), 0),
        joint=base.joint,
        loops=base.loops,
        unit=jnp.zeros_like(base.loops.d),
    )
    others = [
        _joint(share * force, slip * deflection)
        for share, slip in itertools.product(known.loop_shares, known.loop_slips)
    ]
    starts = [np.append(alone.theta[:-1], other) for other in others]
    for fit in limits[: known.loop_joint_runs - 1]:
        starts.insert(0, np.append(fit.theta[:-1], as_joint(kind, fit, deflection)))
    rows = np.resize(np.array(starts), (known.starts, len(starts[0])))
    return searched(PlacedEffect(kind), problem, rows, known.loop_joint_runs)


def _joint(F_S: float, slip: float) -> np.ndarray:
    """Parameters of a joint of some strength, whose mean slider slips at a deflection."""
    return np.array([F_S, F_S / slip, -0.5, 1.0])


@eqx.filter_jit
def _forces(problem: LoopProblem, theta: Array) -> Array:
    return problem.forces(theta)
