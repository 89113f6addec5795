"""Curves of a structure's modes, with a force at one of its places beside the joints."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.curves import ModalCurves
from iwanjax.discrepancy.effects import ForceKind, Scales
from iwanjax.discrepancy.evidence import correlation_time
from iwanjax.discrepancy.steady.cycle import beside
from iwanjax.discrepancy.steady.force_at_place import WithForceAt
from iwanjax.discrepancy.steady.left_out import VALUES, AddedJoint
from iwanjax.discrepancy.steady.one_joint import (
    Deviations,
    PlacedForce,
    best_of,
    deviations_of,
    linearised,
    over_shapes,
    shapes_near,
)
from iwanjax.discrepancy.steady.starts import least_cost, slopes
from iwanjax.quasistatic.modal import Beside, about
from iwanjax.quasistatic.single_harmonic import Backbones
from iwanjax.updating.problem import Measured
from iwanjax.updating.structural import StructuralProblem

# Deflections that a force is worked out for, and how far they reach beyond what the joints alone
# let happen.
_DEFLECTIONS, _REACH = 64, 3.0
# Starts of one search and those that are run: all searches share one compiled kernel.
STARTS, _RUNS = 8, 2
# Largest change that a force may make at first: of a frequency's square, and of damping over the
# largest measured. Sizes tried at a glance: decades below it, each so often.
_SOFTEST, _DAMPED, _DECADES, _EACH = 0.5, 2.0, 4, 3
# Sizes of the starts of a refit, over the one that a glance likes best.
_SIZES = (1.0, 0.5, 2.0, 0.1)


@dataclass(frozen=True, eq=False)
class ModesFit:
    """A structure's curves explained by its joints and at most one force.

    Attributes
    ----------
    force : PlacedForce, AddedJoint or None
        None for the joints alone; a joint left out is one of the structure's own.
    problem : WithForceAt
        What was searched.
    theta : (parameters,) array
        Where it ended; the last is the force's size.
    cost : float
        Sum of squared residuals over their deviations.
    """

    force: PlacedForce | AddedJoint | None
    problem: WithForceAt
    theta: np.ndarray
    cost: float

    @property
    def unknowns(self) -> int:
        """Values that were adjusted."""
        own = 1 + (self.force.kind.shape is not None) if isinstance(self.force, PlacedForce) else 0
        shifts = len(self.problem.base.modes) * (self.problem.reference == "shift")
        return len(self.problem.base.chart.free) + shifts + own

    @property
    def count(self) -> int:
        """Values that were measured."""
        return 2 * self.problem.measured.q.size

    def residuals(self) -> tuple[np.ndarray, ...]:
        """Of each curve over its deviations, frequency and damping side by side."""
        both = np.stack([np.asarray(x) for x in self.problem.compared(*self._prediction())], axis=1)
        return tuple(both[part] for part in self.problem.measured.slices)

    def _prediction(self) -> tuple[Array, Array]:
        return _at_levels(self.problem, self.theta)

    def correlation(self) -> float:
        """Correlation time of the residuals in levels, mean over the curves."""
        return float(np.mean([correlation_time(each[None]) for each in self.residuals()]))

    def deviations(self) -> Deviations:
        """Of the force's size and shape, linearised; NaN without one."""
        force = self.force if isinstance(self.force, PlacedForce) else None

        def reshaped(factor: float) -> np.ndarray:
            assert isinstance(self.force, PlacedForce)
            force = self.force._replace(shape=self.force.shape * factor)
            unit = _unit(force, self.problem.level, self.problem.measured)
            changed = eqx.tree_at(lambda p: p.unit, self.problem, unit)
            moved = replace(self, force=force, problem=changed)
            return np.concatenate(moved.residuals()).T.ravel()

        return deviations_of(
            force,
            lambda: np.asarray(slopes(self.problem, jnp.asarray(self.theta))),
            reshaped,
            self.cost,
            self.correlation(),
        )

    def added(self) -> tuple[np.ndarray, np.ndarray]:
        """Parameters of the joint left out, and their deviations, linearised."""
        found = np.asarray(slopes(self.problem, jnp.asarray(self.theta)))
        std = linearised(found, self.cost, self.correlation())
        own = np.setdiff1d(np.arange(len(self.theta) - 1), self.given)
        return self.theta[own], std[own]

    @property
    def given(self) -> np.ndarray:
        """Places of the parameters of the structure that was given: no joint left out, no force."""
        ratios = len(self.theta) - 1 - len(self.problem.base.modes)
        places = np.arange(len(self.theta) - 1)
        if isinstance(self.force, AddedJoint):
            # Its own are the last of the joints', before the modes' damping.
            return np.delete(places, np.arange(ratios - VALUES, ratios))
        return places

    def predicted(self, curve: int, measured: Sequence[ModalCurves]) -> tuple[ModalCurves, ...]:
        """The model at the amplitudes of curves of a mode."""
        q = np.concatenate([np.asarray(each.amplitude) for each in measured])
        f, zeta = self._at(curve, q)
        ends = np.cumsum([each.amplitude.size for each in measured])[:-1]
        return tuple(
            ModalCurves(
                each.amplitude, *own, quantity=each.quantity, unit=each.unit, name=each.name
            )
            for each, *own in zip(measured, np.split(f, ends), np.split(zeta, ends), strict=True)
        )

    def _at(self, curve: int, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Frequency and damping of a curve's mode at other amplitudes."""
        theta, shape = jnp.asarray(self.theta), self.problem.base.levels.shape
        # As many at once as were fitted, for one kernel.
        rows = np.resize(q, (-(-q.size // shape[1]), shape[1]))
        found = [_cycles(self.problem, theta, jnp.broadcast_to(row, shape)) for row in rows]
        f, zeta = (
            np.concatenate([np.asarray(x[curve]) for x in each])[: q.size]
            for each in zip(*((x.frequency, x.damping) for x in found), strict=True)
        )
        own, _ = self._prediction()
        shown, _ = self.problem.shifted(own, own)
        part = self.problem.measured.slices[curve]
        # What a shift leaves out.
        return f - float(jnp.mean((own - shown)[part])), zeta


def modes_alone(base: StructuralProblem, draws: np.ndarray) -> ModesFit:
    """The joints alone, from draws of their parameters (starts, parameters)."""
    curves, modes = len(base.modes), base.structure.basis.omega2.size
    nothing = jnp.zeros((curves, _DEFLECTIONS))
    level = jnp.broadcast_to(jnp.linspace(0.0, 1.0, _DEFLECTIONS), nothing.shape)
    unit = Beside(nothing, nothing, nothing)
    starts = np.column_stack([draws, np.zeros(len(draws))])
    return _fit(_problem(base, jnp.zeros(modes), level, unit, 1.0, False), None, starts)


class Looked(NamedTuple):
    """What can be asked of the joints' own fit again and again.

    Attributes
    ----------
    alone : ModesFit
        The joints alone.
    span : (residuals, free) array
        Orthonormal: where the residuals go when the joints' parameters move.
    """

    alone: ModesFit
    span: np.ndarray

    @classmethod
    def at(cls, alone: ModesFit) -> "Looked":
        """Of a fit of the joints alone."""
        J = np.asarray(slopes(alone.problem, jnp.asarray(alone.theta)))[:, :-1]
        return cls(alone, np.linalg.qr(J / np.maximum(np.linalg.norm(J, axis=0), 1e-300))[0])


def glanced(looked: Looked, kind: ForceKind, where: str, row: np.ndarray) -> ModesFit | None:
    """The best shape and size of a force at a place, the joints moving linearly with it.

    None where it would do nothing. Parameters but the size are those of the joints alone.
    """
    alone = looked.alone
    base, theta = alone.problem.base, jnp.asarray(alone.theta)
    inside = jnp.asarray(row @ np.asarray(base.structure.basis.Phi))
    there = eqx.tree_at(lambda p: p.row, alone.problem, inside)
    d = np.abs(np.asarray(_cycles(there, theta, base.levels).d[-1]))
    if not float(d.max()) > 0.0:
        return None
    level, omega = jnp.log(_deflections(d)), np.asarray(_omega(base.measured))
    signs = np.array([1.0] if kind.positive else [1.0, -1.0])
    shares = np.outer(signs, np.geomspace(1.0, 10.0**-_DECADES, _DECADES * _EACH + 1)).ravel()

    def at(shape: float) -> ModesFit | None:
        force = PlacedForce(kind, shape, where)
        unit = _unit(force, level, base.measured)
        largest = _largest(unit, level, d, base)
        if largest is None:
            return None
        problem = _problem(base, inside, level, unit, largest, kind.positive)
        # As many for all kinds, for one kernel.
        sizes = np.resize(largest * shares, 2 * (_DECADES * _EACH + 1))
        costs = np.asarray(_left(problem, theta[:-1], jnp.asarray(sizes), jnp.asarray(looked.span)))
        costs = np.where(np.isfinite(costs), costs, math.inf)
        i = int(np.argmin(costs))
        return ModesFit(force, problem, np.append(alone.theta[:-1], sizes[i]), float(costs[i]))

    begin = kind.shapes(Scales(float(d.max()), 2.0 * math.pi / float(omega.min())))
    found = [at(begin[0])] if kind.shape is None else over_shapes(begin, at)
    fits = [each for each in found if each is not None]
    return best_of(fits) if fits else None


def modes_beside(alone: ModesFit, glance: ModesFit, draws: np.ndarray) -> ModesFit:
    """The joints and a force at a place, from a glance and from some draws of the joints."""
    looked, start = glance.force, glance.theta[-1]
    assert isinstance(looked, PlacedForce)

    def at(force: PlacedForce) -> ModesFit:
        problem = glance.problem
        if force.shape != looked.shape:
            unit = _unit(force, problem.level, problem.measured)
            problem = eqx.tree_at(lambda p: p.unit, problem, unit)
        sizes = start * np.resize(_SIZES, STARTS)
        joints = np.tile(alone.theta[:-1], (STARTS, 1))
        # In either group of starts that a search compares there is one far away.
        joints[len(_SIZES) - 1 :: len(_SIZES)] = draws[1:3]
        return _fit(problem, force, np.column_stack([joints, sizes]))

    first = at(looked)
    if looked.kind.shape is None:
        return first
    return best_of(shapes_near(first, lambda shape: at(looked._replace(shape=shape))))


def _problem(
    base: StructuralProblem, row: Array, level: Array, unit: Beside, scale: float, positive: bool
) -> WithForceAt:
    return WithForceAt(
        measured=base.measured,
        chart=base.chart,
        names=(*base.names, "size"),
        reference=base.reference,
        base=base,
        row=row,
        level=level,
        unit=unit,
        scale=jnp.asarray(scale),
        positive=jnp.asarray(float(positive)),
    )


def _fit(problem: WithForceAt, force: PlacedForce | None, starts: np.ndarray) -> ModesFit:
    if force is None and not problem.base.chart.free:
        # A structure without joints is what it is.
        left = np.concatenate([*problem.compared(*_at_levels(problem, starts[0]))])
        return ModesFit(None, problem, starts[0], float(left @ left))
    cost, theta = least_cost(problem, starts, STARTS, _RUNS)
    return ModesFit(force, problem, theta, cost)


def _at_levels(problem: WithForceAt, theta: np.ndarray) -> tuple[Array, Array]:
    """Frequency and damping at the measured levels."""
    base = problem.base
    found = _cycles(problem, jnp.asarray(theta), base.levels)
    return found.frequency[base.curve, base.level], found.damping[base.curve, base.level]


def _deflections(d: np.ndarray) -> np.ndarray:
    """Amplitudes that a force is worked out for, (curves, deflections)."""
    # A mode that hardly moves the place still has a row of its own.
    floor = 1e-6 * d.max()
    low, high = np.maximum(d.min(axis=1), floor), np.maximum(d.max(axis=1), 10.0 * floor)
    return np.geomspace(low / _REACH, high * _REACH, _DEFLECTIONS, axis=1)


def _unit(force: PlacedForce, level: Array, measured: Measured) -> Beside:
    """What a force of unit size does, (curves, deflections); its loss over d^2."""
    d = np.exp(np.asarray(level))
    unit = beside(
        force.kind, force.shape, np.asarray(about(d)), np.asarray(_omega(measured))[:, None]
    )
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
    shares = []
    for c, part in enumerate(base.measured.slices):
        zeta = 2.0 * math.pi * float(np.max(np.asarray(base.measured.damping)[part]))
        at, x = np.log(np.maximum(d[c], 1e-300)), np.asarray(level)[c]
        for told, most in ((unit.stiffness, _SOFTEST), (unit.loss, _DAMPED * zeta)):
            change = np.abs(np.interp(at, x, np.asarray(told)[c])) * moved[c]
            shares.append(float(change.max()) / most)
    return 1.0 / max(shares) if max(shares) > 0.0 else None


@eqx.filter_jit
def _cycles(problem: WithForceAt, theta: Array, q: Array) -> Backbones:
    return problem.cycles(theta, q)


@eqx.filter_jit
def _left(problem: WithForceAt, theta: Array, sizes: Array, span: Array) -> Float[Array, " sizes"]:
    """Squared residual for each size that the joints' parameters cannot take up."""
    r = jax.vmap(lambda size: problem.residuals(jnp.append(theta, size)))(sizes)
    return jnp.sum((r - (r @ span) @ span.T) ** 2, axis=1)
