"""Curves of a structure's modes, with a force or a joint left out at one of its places."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.curves import ModalCurves
from iwanjax.effects.kinds import ForceKind, NamedKind
from iwanjax.errors import InputError
from iwanjax.estimation.parameters import Chart, Parameter
from iwanjax.identification.steady.curves import AbstractCurvesProblem, as_measured
from iwanjax.identification.steady.cycle import CyclicForce, beside
from iwanjax.identification.steady.fit import (
    JOINT_VALUES,
    AbstractEffectValues,
    PlacedEffect,
    Size,
    SteadyFit,
    searched,
)
from iwanjax.identification.steady.shapes import as_joint, best_shape, best_shape_near, from_within
from iwanjax.joints import AbstractJoint, Iwan4
from iwanjax.joints.force_law import Scales
from iwanjax.joints.iwan import strength_of
from iwanjax.quasistatic.modal import Beside, about
from iwanjax.quasistatic.single_harmonic import Backbones, OfJoint, backbones
from iwanjax.settings.stages import settings
from iwanjax.structures import JointedStructure
from iwanjax.updating.background import as_damped_in
from iwanjax.updating.joint_groups import joint_parameters
from iwanjax.updating.problem import Measured, Reference
from iwanjax.updating.structural import StructuralProblem, structural_problem

# What a joint left out is called within the structure: one name, for one kernel.
_LABEL = "left out"


class ModesProblem(AbstractCurvesProblem):
    """A structure's joints and a force of some size at one place, against its modes' curves.

    Each mode moves on its own, as :func:`~iwanjax.quasistatic.single_harmonic.backbones` says.
    A joint left out is one of the structure's own.

    Attributes
    ----------
    row : (modes,) array
        Deflection of the force's place per unit modal displacement.
    level, unit : as of :class:`~iwanjax.identification.steady.cycle.CyclicForce`
    added : tuple of int
        Where in theta the values of a joint left out are.
    """

    measured: Measured
    chart: Chart
    names: tuple[str, ...] = eqx.field(static=True)
    reference: Reference = eqx.field(static=True)
    base: StructuralProblem
    beside: AbstractEffectValues
    row: Float[Array, " modes"]
    level: Float[Array, "curves deflections"]
    unit: Beside
    added: tuple[int, ...] = eqx.field(static=True, default=())

    @property
    def places(self) -> np.ndarray:
        """Where in theta the effect's values are."""
        return np.array(self.added or (len(self.names) - 1,))

    def predict(self, theta: Float[Array, " parameters"]) -> tuple[Array, Array]:
        """What ring-downs show at the measured amplitudes."""
        return self.at_levels(self.cycles(theta, self.base.levels))

    def at_levels(self, found: Backbones) -> tuple[Array, Array]:
        """Frequency and damping at the measured levels, of all levels of all modes."""
        there = (self.base.curve, self.base.level)
        return found.frequency[there], found.damping[there]

    def cycles(self, theta: Float[Array, " parameters"], q: Array) -> Backbones:
        """Frequency and damping at modal displacements (curves, levels)."""
        base = self.base
        structure = base.jointed(theta[:-1])
        basis, modes = structure.basis, jnp.asarray(base.modes)
        force = CyclicForce(self.level, self.unit, theta[-1])
        return backbones(
            basis,
            jnp.concatenate([basis.P, self.row[None]]),
            jnp.append(basis.stiffness, 0.0),
            [*map(OfJoint, structure.elements), force],
            modes,
            q,
            2.0 * base.background(theta[:-1]) * jnp.sqrt(basis.omega2[modes]),
        )

    def reshaped(self, effect: PlacedEffect) -> "ModesProblem":
        """The same with a force of another shape."""
        return eqx.tree_at(lambda p: p.unit, self, _unit(effect, self.level, self.measured))

    def predicted(
        self, theta: Array, effect: PlacedEffect | None, measured: Sequence[ModalCurves], which: int
    ) -> tuple[ModalCurves, ...]:
        """The model at the amplitudes of curves of the mode that the curve of this number has."""
        q = np.concatenate([np.asarray(each.amplitude) for each in measured])
        shape = self.base.levels.shape
        # As many at once as were fitted, for one kernel.
        rows = np.resize(q, (-(-q.size // shape[1]), shape[1]))
        found = [_cycles(self, theta, jnp.broadcast_to(row, shape)) for row in rows]
        f, zeta = (
            np.concatenate([np.asarray(x[which]) for x in each])[: q.size]
            for each in zip(*((x.frequency, x.damping) for x in found), strict=True)
        )
        own, _ = self.at_levels(_cycles(self, theta, self.base.levels))
        shown, _ = self.shifted(own, own)
        # What a shift leaves out.
        f = f - float(jnp.mean((own - shown)[self.measured.slices[which]]))
        ends = np.cumsum([each.amplitude.size for each in measured])[:-1]
        rows = zip(measured, np.split(f, ends), np.split(zeta, ends), strict=True)
        return tuple(as_measured(*row) for row in rows)


ModesFit = SteadyFit[ModesProblem]


def _searched(effect: PlacedEffect | None, problem: ModesProblem, starts: np.ndarray) -> ModesFit:
    known = settings().steady
    return searched(effect, problem, starts, known.mode_runs, known.mode_starts)


def modes_alone(
    base: StructuralProblem, draws: np.ndarray, added: tuple[int, ...] = ()
) -> ModesFit:
    """The joints alone, from draws of their parameters (starts, parameters)."""
    curves, modes = len(base.modes), base.structure.basis.omega2.size
    nothing = jnp.zeros((curves, settings().steady.deflections))
    level = jnp.broadcast_to(jnp.linspace(0.0, 1.0, nothing.shape[1]), nothing.shape)
    problem = ModesProblem(
        measured=base.measured,
        chart=base.chart,
        names=(*base.names, "size"),
        reference=base.reference,
        base=base,
        beside=Size(jnp.ones(()), jnp.zeros(())),
        row=jnp.zeros(modes),
        level=level,
        unit=Beside(nothing, nothing, nothing),
        added=added,
    )
    starts = np.column_stack([draws, np.zeros(len(draws))])
    if base.chart.free:
        return _searched(None, problem, starts)
    # A structure without joints is what it is.
    left = np.concatenate(SteadyFit(None, problem, starts[0], math.nan, math.nan).residuals())
    cost = float(np.sum(left**2))
    return SteadyFit(None, problem, starts[0], cost, cost)


class JointsAlone(NamedTuple):
    """The joints' own fit, and what a score asks of it again and again.

    Attributes
    ----------
    fit : SteadyFit
        The joints alone.
    span : (residuals, free) array
        Orthonormal: where the residuals go when the joints' parameters move.
    """

    fit: ModesFit
    span: np.ndarray

    @classmethod
    def of(cls, fit: ModesFit) -> "JointsAlone":
        """Of a fit of the joints alone."""
        J = fit.linear[1][:, :-1]
        return cls(fit, np.linalg.qr(J / np.maximum(np.linalg.norm(J, axis=0), 1e-300))[0])


def scored(alone: JointsAlone, kind: ForceKind, where: str, row: np.ndarray) -> ModesFit | None:
    """The best shape and size of a force at a place, the joints moving linearly with it.

    None where it would do nothing. Parameters but the size are those of the joints alone.
    """
    joints = alone.fit.theta[:-1]
    base, theta = alone.fit.problem.base, jnp.asarray(alone.fit.theta)
    inside = jnp.asarray(row @ np.asarray(base.structure.basis.Phi))
    there = eqx.tree_at(lambda p: p.row, alone.fit.problem, inside)
    d = np.abs(np.asarray(_cycles(there, theta, base.levels).d[-1]))
    if not float(d.max()) > 0.0:
        return None
    level, omega = jnp.log(_deflections(d)), np.asarray(_omega(base.measured))
    signs = np.array([1.0] if kind.positive else [1.0, -1.0])
    known = settings().steady
    count = known.decades * known.each + 1
    shares = np.outer(signs, np.geomspace(1.0, 10.0**-known.decades, count)).ravel()

    def at(shape: float) -> ModesFit | None:
        effect = PlacedEffect(kind, shape, where)
        unit = _unit(effect, level, base.measured)
        largest = _largest(unit, level, d, base)
        if largest is None:
            return None
        size = Size(jnp.asarray(largest), jnp.asarray(float(kind.positive)))
        problem = eqx.tree_at(lambda p: (p.level, p.unit, p.beside), there, (level, unit, size))
        # As many for all kinds, for one kernel.
        sizes = np.resize(largest * shares, 2 * count)
        costs = np.asarray(_left(problem, theta[:-1], jnp.asarray(sizes), jnp.asarray(alone.span)))
        costs = np.where(np.isfinite(costs), costs, math.inf)
        i = int(np.argmin(costs))
        cost = float(costs[i])
        return SteadyFit(effect, problem, np.append(joints, sizes[i]), cost, cost)

    begin = kind.shapes(Scales(float(d.max()), 2.0 * math.pi / float(omega.min())))
    return best_shape(kind, begin, at)


def modes_beside(alone: ModesFit, score: ModesFit, draws: np.ndarray) -> ModesFit:
    """The joints and a force at a place, from its score and from some draws of the joints."""
    effect = score.effect
    assert effect is not None
    known = settings().steady
    sizes = score.theta[-1] * np.resize(known.sizes, known.mode_starts)
    joints = np.tile(alone.theta[:-1], (known.mode_starts, 1))
    # In each group of starts that a search compares there is one far away.
    far = joints[len(known.sizes) - 1 :: len(known.sizes)]
    far[:] = draws[1 : 1 + len(far)]
    starts = np.column_stack([joints, sizes])

    def at(shape: float) -> ModesFit:
        other = effect._replace(shape=shape)
        problem = score.problem if shape == effect.shape else score.problem.reshaped(other)
        return _searched(other, problem, starts)

    first = at(effect.shape)
    return first if effect.shape_info is None else best_shape_near(first, at)


def modes_from_within(simpler: ModesFit, kind: ForceKind) -> ModesFit | None:
    """The joints and a force, from a fit of a simpler one at its place that the force contains."""
    effect, problem = simpler.effect, simpler.problem
    assert effect is not None

    def at(shape: float, start: np.ndarray) -> ModesFit:
        other = PlacedEffect(kind, shape, effect.where)
        size = Size(jnp.asarray(abs(start[-1])), jnp.asarray(float(kind.positive)))
        there = eqx.tree_at(lambda p: p.beside, problem.reshaped(other), size)
        return _searched(other, there, start[None])

    return from_within(simpler, kind, float(jnp.exp(jnp.max(problem.level))), at)


def modes_with_joint(
    alone: ModesFit,
    kind: NamedKind,
    place: tuple[str, np.ndarray],
    curves: Sequence[ModalCurves],
    parameters: Sequence[Parameter],
    groups: Mapping[str, Sequence[str]] | None,
    limits: Sequence[ModesFit],
) -> ModesFit | None:
    """The structure with another joint at a place; None where its modes do not move it.

    From joints of some strengths and slips, and from the sliders and springs that were found
    there: what a joint has for its limit never fits better than it.

    Parameters
    ----------
    alone : SteadyFit
        The structure's own joints.
    kind : NamedKind
        What another one is called.
    place : (str, (n,) array)
        Label and row.
    curves : sequence of ModalCurves
        One for each mode.
    parameters : sequence of Parameter
        Of the structure's own joints.
    groups : mapping, optional
        Joints that share their parameters.
    limits : sequence of SteadyFit
        Those at the place, the best first.
    """
    label, row = place
    base, known = alone.problem.base, settings().steady
    structure = base.structure
    inside = np.abs(row @ np.asarray(structure.basis.Phi))[list(base.modes)]
    largest = [float(np.max(q)) * each for q, each in zip(base.levels, inside, strict=True)]
    stiffness = _stiffness(curves, inside)
    if not max(largest) > 0.0 or not 0.0 < stiffness < math.inf:
        return None
    guesses = [
        _joint(stiffness * k, max(largest) * slip)
        for k, slip in itertools.product(known.stiffnesses, known.slips)
    ]
    known_ones = [as_joint(kind, fit, max(largest)) for fit in limits[:2]]
    starts = np.array([*known_ones, *guesses][: known.mode_starts])
    # Its parameters are the last of the joints', before the modes' damping.
    first = len(parameters) - len(base.modes)
    others = np.tile(alone.theta[:-1], (len(starts), 1))
    own = np.insert(others, [first] * JOINT_VALUES, starts, axis=1)
    given = Iwan4(*_joint(stiffness, max(largest)))

    def fitted(given: Iwan4, starts: np.ndarray) -> ModesFit:
        more = JointedStructure(structure.structure, {**_joints(structure), _LABEL: (row, given)})
        others = joint_parameters(_LABEL, given).values()
        damping = as_damped_in(more, structure, base.modes, parameters[first:])
        both = (*parameters[:first], *others, *damping)
        base_more = structural_problem(more, curves, both, base.modes, None, groups, base.reference)
        return modes_alone(base_more, starts, tuple(range(first, first + JOINT_VALUES)))

    rough = fitted(given, own)
    # About the joint that was found: modes' own damping is worked out where that is stuck.
    again = np.tile(rough.theta[:-1], (len(known.again), 1))
    again[:, [first, first + JOINT_VALUES - 1]] *= known.again
    try:
        fit = fitted(Iwan4(*rough.theta[first : first + JOINT_VALUES]), again)
    except InputError:
        # So stiff that the structure's own stiffness, and its modes, are lost to rounding.
        fit = rough
    return replace(fit, effect=PlacedEffect(kind, where=label))


def _joints(structure: JointedStructure) -> dict[str, tuple[np.ndarray, AbstractJoint]]:
    """Rows and elements by label."""
    rows = zip(np.asarray(structure.rows), structure.elements, strict=True)
    return dict(zip(structure.labels, rows, strict=True))


def _joint(stiffness: float, phi_max: float) -> np.ndarray:
    """Parameters of a joint that slips altogether at a deflection, in the middle of the others."""
    return np.array([strength_of(phi_max, stiffness, -0.5, 1.0), stiffness, -0.5, 1.0])


def _stiffness(curves: Sequence[ModalCurves], inside: np.ndarray) -> float:
    """At which a spring at a place would change a mode as much as amplitude changes it."""
    needed = []
    for each, shape in zip(curves, inside, strict=True):
        f, zeta = np.asarray(each.frequency), np.asarray(each.damping)
        change = 2.0 * max(np.ptp(f) / f.max(), np.ptp(zeta)) * (2.0 * math.pi * f.max()) ** 2
        needed.append(change / shape**2 if shape > 0.0 else math.inf)
    return float(min(needed))


def _deflections(d: np.ndarray) -> np.ndarray:
    """Amplitudes that a force is worked out for, (curves, deflections)."""
    # A mode that hardly moves the place still has a row of its own.
    known, floor = settings().steady, 1e-6 * d.max()
    low, high = np.maximum(d.min(axis=1), floor), np.maximum(d.max(axis=1), 10.0 * floor)
    return np.geomspace(low / known.reach, high * known.reach, known.deflections, axis=1)


def _unit(effect: PlacedEffect, level: Array, measured: Measured) -> Beside:
    """What a force of unit size does, (curves, deflections); its loss over d^2."""
    assert isinstance(effect.kind, ForceKind)
    d = np.exp(np.asarray(level))
    omega = np.asarray(_omega(measured))[:, None]
    unit = beside(effect.kind, effect.shape, np.asarray(about(d)), omega)
    return unit._replace(stiffness=unit.stiffness[1], loss=unit.loss / d**2)


def _omega(measured: Measured) -> Array:
    """Circular frequency of each curve, rad/s, (curves,)."""
    means = [jnp.mean(measured.frequency[part]) for part in measured.slices]
    return 2.0 * math.pi * jnp.stack(means)


def _largest(unit: Beside, level: Array, d: np.ndarray, base: StructuralProblem) -> float | None:
    """Size at which a force alone would change frequency or damping by more than is plausible.

    None for one that has neither first harmonic nor loss.
    """
    omega2 = np.asarray(_omega(base.measured)) ** 2
    moved = (d / np.asarray(base.levels)) ** 2 / omega2[:, None]
    shares, known = [], settings().steady
    for c, part in enumerate(base.measured.slices):
        zeta = 2.0 * math.pi * float(np.max(np.asarray(base.measured.damping)[part]))
        at, x = np.log(np.maximum(d[c], 1e-300)), np.asarray(level)[c]
        for told, most in ((unit.stiffness, known.softest), (unit.loss, known.damped * zeta)):
            change = np.abs(np.interp(at, x, np.asarray(told)[c])) * moved[c]
            shares.append(float(change.max()) / most)
    return 1.0 / max(shares) if max(shares) > 0.0 else None


@eqx.filter_jit
def _cycles(problem: ModesProblem, theta: Array, q: Array) -> Backbones:
    return problem.cycles(theta, q)


@eqx.filter_jit
def _left(problem: ModesProblem, theta: Array, sizes: Array, span: Array) -> Float[Array, " sizes"]:
    """Squared residual for each size that the joints' parameters cannot take up."""
    r = jax.vmap(lambda size: problem.residuals(jnp.append(theta, size)))(sizes)
    return jnp.sum((r - (r @ span) @ span.T) ** 2, axis=1)
