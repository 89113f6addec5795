"""Loops of a joint on its own, with a force or another joint beside it."""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.effects.kinds import ChannelKind, ForceKind, JointKind, NamedKind
from iwanjax.estimation.parameters import Chart, Parameter
from iwanjax.estimation.priors import Uniform
from iwanjax.identification.steady.fit import (
    AbstractEffectValues,
    AbstractSteadyProblem,
    PlacedEffect,
    Size,
    SteadyFit,
    best_of,
    joints_to_begin_with,
    searched,
    with_sizes,
)
from iwanjax.identification.steady.shapes import as_joint, best_shape, from_within
from iwanjax.joints import AbstractJoint, Iwan4
from iwanjax.joints.force_law import PlaceMotion, Scales
from iwanjax.joints.hysteresis import hysteresis
from iwanjax.settings.stages import settings
from iwanjax.signals.loop_histories import LoopHistories
from iwanjax.updating.joint_groups import joint_parameters


def scales_of(loops: LoopHistories) -> Scales:
    """What the joint has seen, to choose starting values by; in cycles without a time."""
    stiffness = 0.5 * float(jnp.ptp(loops.force)) / loops.largest
    if loops.times is None:
        return Scales(loops.largest, 1.0, 1.0, stiffness=stiffness)
    return Scales(loops.largest, *np.max(loops.times, axis=1).tolist(), stiffness=stiffness)


# Parameters of a joint that may depend on a channel; last comes its whole force.
_MOVED = ("F_S", "K_T", "")


class LawValues(AbstractEffectValues):
    """Variables of what is charted one by one: another joint's parameters, a share."""

    own: Chart

    @property
    def count(self) -> int:
        """Values."""
        return len(self.own.transforms)

    def to_values(self, z: Float[Array, " values"]) -> Float[Array, " values"]:
        """The parameters."""
        return self.own.to_values(z)

    def to_variables(self, values: Float[Array, " values"]) -> Float[Array, " values"]:
        """The inverse of :meth:`to_values`."""
        return self.own.to_variables(values)


class LoopProblem(AbstractSteadyProblem):
    """A joint and what acts beside it, held against loops.

    Parameters are the joint's and the effect's values. Every loop has an offset of its own, for a
    load cell's zero.

    Attributes
    ----------
    unit : (loops, N) array
        A force of unit size, or a channel from its middle on where the joint depends on one; zero
        where another joint acts.
    other : joint or None
        Another joint that acts.
    moved : (3,) array or None
        1 for what depends on the channel, of the slip force, the stiffness and the whole force;
        0 for the others.
    """

    chart: Chart
    names: tuple[str, ...] = eqx.field(static=True)
    base: Chart
    beside: AbstractEffectValues
    joint: AbstractJoint
    loops: LoopHistories
    unit: Float[Array, "loops N"]
    other: AbstractJoint | None = None
    moved: Float[Array, " 3"] | None = None

    @property
    def count(self) -> int:
        """Forces."""
        return int(np.count_nonzero(np.asarray(self.loops.weight)))

    def forces(self, theta: Float[Array, " parameters"]) -> Float[Array, "loops N"]:
        """Predicted, without offsets."""
        n, d, dt = self.beside.count, self.loops.d, self.loops.dt
        values = dict(zip(self.names, theta, strict=True))
        own = {name: values.pop(name) for name in self.names[:-n]}
        joint = self.joint.with_parameters(**own)
        if self.moved is not None:
            return self._by_channel(joint, own, theta[-1], self.moved)
        force = hysteresis(joint, d, sliders=None, dt=dt)
        if self.other is None:
            return force + theta[-1] * self.unit
        other = {_own(name): value for name, value in values.items()}
        acting = self.other.with_parameters(**other)
        return force + hysteresis(acting, d, sliders=None, dt=dt, lead=self.loops.lead)

    def _by_channel(
        self, joint: AbstractJoint, own: dict[str, Array], change: Array, moved: Array
    ) -> Float[Array, "loops N"]:
        """Of a joint some of whose strengths follow the channel; beyond none of it they stay."""
        factor = jnp.maximum(1.0 + change * self.unit, settings().steady.negligible)
        varying = {
            name: own[name] * factor**share
            for name, share in zip(_MOVED, moved, strict=True)
            if name in own
        }
        loops = self.loops
        force = hysteresis(joint, loops.d, sliders=None, dt=loops.dt, varying=varying)
        return factor ** moved[-1] * force

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
    """A force of unit size along deflections, or a channel from its middle on; zero without."""
    if effect is not None and isinstance(effect.kind, ChannelKind):
        return loops.channels[effect.kind.channel] - effect.kind.middle
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
    shape = jnp.asarray(kind.shapes(scales_of(loops))[0])
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
        names=(*(_own(p.name) for p in parameters), "size"),
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

    return best_shape(kind, kind.shapes(scales_of(loops)), at)


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
    loops, known = alone.problem.loops, settings().steady
    force, deflection = float(jnp.ptp(loops.force)) / 2.0, loops.largest
    others = [
        _joint(share * force, slip * deflection)
        for share, slip in itertools.product(known.loop_shares, known.loop_slips)
    ]
    starts = [np.append(alone.theta[:-1], other) for other in others]
    for fit in limits[: known.loop_joint_runs - 1]:
        starts.insert(0, np.append(fit.theta[:-1], as_joint(kind, fit, deflection)))
    rows = np.resize(np.array(starts), (known.starts, len(starts[0])))
    other = Iwan4(*_joint(0.5 * force, deflection))
    return searched(PlacedEffect(kind), _with_other(alone, other), rows, known.loop_joint_runs)


def loops_with_law(alone: LoopFit, kind: JointKind, draws: np.ndarray) -> LoopFit | None:
    """The joint and a law with all of its parameters; None where loops cannot show the law.

    From the law's own starting values, each beside the joint as it is alone and beside a draw.

    Parameters
    ----------
    alone, draws
        As for :func:`loops_by_channel`.
    kind : JointKind
        With its law.
    """
    loops = alone.problem.loops
    assert kind.law is not None
    begun = kind.law.begun(scales_of(loops), **dict(kind.held))
    if begun[0].discrete().rate_dependent and loops.dt is None:
        return None
    # Of two neighbours only the better one is run: each of the law's values once.
    joints = itertools.cycle(joints_to_begin_with(alone, draws))
    starts = [
        np.append(next(joints), [float(getattr(law, info.name)) for info in law.parameters])
        for law in begun
        for _ in range(2)
    ]
    problem = _with_other(alone, begun[0])
    return searched(PlacedEffect(kind), problem, np.array(starts), settings().steady.loop_runs)


def loops_by_channel(
    alone: LoopFit, kind: ChannelKind, draws: np.ndarray, random: np.random.Generator
) -> LoopFit:
    """The joint, some of whose strengths depend on a channel.

    Parameters
    ----------
    alone : SteadyFit
        The joint alone.
    kind : ChannelKind
        Of one channel, which has to vary.
    draws : (starts, parameters) array
        Of the joint's parameters.
    random : Generator
        Of changes to begin with.
    """
    base, known, effect = alone.problem, settings().steady, PlacedEffect(kind)
    _, half = base.loops.middle(kind.channel)
    # Up to where nothing of it is left at one end of what the channel goes through.
    own = Parameter(
        kind.size.name, 0.0, Uniform(-1.0 / half, 1.0 / half), lower=-1.0 / half, upper=1.0 / half
    )
    problem = replace(
        base,
        names=(*base.names[:-1], kind.size.name),
        beside=LawValues(Chart((own,))),
        unit=unit_of(effect, base.loops),
        moved=jnp.asarray([float(name == kind.moved) for name in _MOVED]),
    )
    few = joints_to_begin_with(alone, draws)
    changes = known.spread * random.uniform(-1.0, 1.0, len(few)) / half
    return searched(effect, problem, np.column_stack([few, changes]), known.loop_runs)


def _with_other(alone: LoopFit, other: AbstractJoint) -> LoopProblem:
    """What is searched where another joint acts, all of whose parameters are free."""
    base, given = alone.problem, joint_parameters("other", other)
    beside = LawValues(Chart(tuple(given.values())))
    return replace(base, names=(*base.names[:-1], *given), beside=beside, other=other)


def _own(name: str) -> str:
    """A parameter's name without its joint's."""
    return name.rpartition(".")[2]


def _joint(F_S: float, slip: float) -> np.ndarray:
    """Parameters of a joint of some strength, whose mean slider slips at a deflection."""
    return np.array([F_S, F_S / slip, -0.5, 1.0])


@eqx.filter_jit
def _forces(problem: LoopProblem, theta: Array) -> Array:
    return problem.forces(theta)
