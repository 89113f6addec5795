"""Curves of one mode, with a force beside its joint."""

import math
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.curves import ModalCurves
from iwanjax.discrepancy.effects import ForceKind, Scales
from iwanjax.discrepancy.evidence import correlation_time
from iwanjax.discrepancy.steady.cycle import beside, shows
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
from iwanjax.quasistatic.modal import Beside, about
from iwanjax.updating.modal import ModalProblem
from iwanjax.updating.parameters import Chart
from iwanjax.updating.problem import AbstractProblem, Measured, Reference

# Starts of one search and those of them that are run: all searches share one compiled kernel.
STARTS = 16
"""Starts are searched so many at a time."""
_RUNS = 4
# Deviation of the sizes that searches start from, over the largest that is plausible.
_SPREAD = 0.5
# Loss over the energy that a force turns over, below which it is rounding.
_LOSSLESS = 1e-9


class WithForce(AbstractProblem):
    """A mode's joint and a force of some size beside it, held against measured curves.

    Parameters are those of ``base`` and the size. The force itself is data, so that all kinds
    share one compiled search.
    """

    measured: Measured
    chart: Chart
    names: tuple[str, ...] = eqx.field(static=True)
    reference: Reference = eqx.field(static=True)
    base: ModalProblem
    unit: Beside
    scale: Array
    positive: Array

    def to_values(self, z: Float[Array, " free"]) -> Float[Array, " parameters"]:
        """The base's parameters; a size that must be positive moves by its logarithm."""
        size = to_size(z[-1], self.scale, self.positive)
        return jnp.append(self.base.to_values(z[:-1]), size)

    def to_variables(self, theta: Float[Array, " parameters"]) -> Float[Array, " free"]:
        """The inverse of :meth:`to_values`."""
        variable = to_variable(theta[-1], self.scale, self.positive)
        return jnp.append(self.base.to_variables(theta[:-1]), variable)

    def improved(self, theta: Float[Array, " parameters"]) -> Float[Array, " parameters"]:
        """The base's."""
        return jnp.append(self.base.improved(theta[:-1]), theta[-1])

    def model(self, theta: Float[Array, " parameters"]) -> eqx.Module:
        """The oscillator without the force."""
        return self.base.model(theta[:-1])

    def predict(self, theta: Float[Array, " parameters"]) -> tuple[Array, Array]:
        """What a ring-down shows at the measured amplitudes."""
        return self.at(theta, self.measured.q, self.unit, self.measured.largest)

    def at(
        self,
        theta: Float[Array, " parameters"],
        q: Float[Array, " levels"],
        unit: Beside,
        largest: Array | None,
    ) -> tuple[Array, Array]:
        """What it shows at others, where the force of unit size does what ``unit`` says."""
        oscillator = self.base.model(theta[:-1])
        further = jax.tree.map(lambda each: theta[-1] * each, unit)
        f, zeta = oscillator.ringdown_frequency_and_damping(q, further, largest=largest)
        return jnp.where(oscillator.K_inf > 0, f, jnp.nan), zeta


@dataclass(frozen=True, eq=False)
class CurveFit:
    """A mode's curves explained by its joint and at most one force.

    Attributes
    ----------
    force : PlacedForce or None
        None for the joint alone.
    problem : WithForce
        What was searched.
    theta : (parameters,) array
        Where it ended; the last is the force's size.
    cost : float
        Sum of squared residuals over their deviations.
    """

    force: PlacedForce | None
    problem: WithForce
    theta: np.ndarray
    cost: float

    @property
    def unknowns(self) -> int:
        """Values that were adjusted."""
        own = 0 if self.force is None else 1 + (self.force.kind.shape is not None)
        return len(self.problem.base.chart.free) + own

    @property
    def count(self) -> int:
        """Values that were measured."""
        return 2 * self.problem.measured.q.size

    @property
    def omega(self) -> float:
        """Circular frequency of the cycles that forces were worked out for, rad/s."""
        return _omega(self.problem.measured)

    @property
    def gives_energy(self) -> bool:
        """Whether the force works on the mode instead of taking from it."""
        loss, q = np.asarray(self.problem.unit.loss), np.asarray(self.problem.measured.q)
        turned = np.abs(np.asarray(self.problem.unit.stiffness)[1]) * q**2
        work = float(np.sign(self.theta[-1]) * loss.sum())
        return work < -_LOSSLESS * float(turned.sum())

    def predicted(self, curves: ModalCurves, which: int = 0) -> ModalCurves:
        """The model at the amplitudes of other curves of the mode, whichever it is."""
        seen = curves.as_quantity("displacement")
        q = seen.amplitude
        unit = _nothing(len(q))
        if self.force is not None:
            unit = beside(self.force.kind, self.force.shape, np.asarray(about(q)), self.omega)
        f, zeta = self.problem.at(jnp.asarray(self.theta), q, unit, seen.largest)
        return ModalCurves(
            curves.amplitude, f, zeta, quantity=curves.quantity, unit=curves.unit, name=curves.name
        )

    def residuals(self) -> tuple[np.ndarray, ...]:
        """Of each curve over its deviations, frequency and damping side by side."""
        f, zeta = (np.asarray(x) for x in self.problem.differences(jnp.asarray(self.theta)))
        both = np.stack([f, zeta], axis=1)
        return tuple(both[part] for part in self.problem.measured.slices)

    def correlation(self) -> float:
        """Correlation time of the residuals in levels, mean over the curves."""
        return float(np.mean([correlation_time(each[None]) for each in self.residuals()]))

    def deviations(self) -> Deviations:
        """Of the force's size and shape, linearised; NaN without one."""
        return deviations_of(
            self.force,
            lambda: np.asarray(slopes(self.problem, jnp.asarray(self.theta))),
            lambda factor: np.concatenate(replaced_shape(self, factor).residuals()).T.ravel(),
            self.cost,
            self.correlation(),
        )


def replaced_shape(fit: CurveFit, factor: float) -> CurveFit:
    """The same parameters with another shape of the force, not fitted again."""
    assert fit.force is not None
    force = fit.force._replace(shape=fit.force.shape * factor)
    q = np.asarray(about(fit.problem.measured.q))
    unit = beside(force.kind, force.shape, q, fit.omega)
    problem = eqx.tree_at(lambda p: p.unit, fit.problem, unit)
    return CurveFit(force, problem, fit.theta, fit.cost)


def fit_alone(base: ModalProblem, draws: np.ndarray) -> CurveFit:
    """The joint alone, from draws of its parameters (starts, parameters)."""
    nothing = _nothing(base.measured.q.size)
    return _fit(base, None, nothing, 1.0, np.column_stack([draws, np.zeros(len(draws))]))


def fit_beside(
    alone: CurveFit, kind: ForceKind, draws: np.ndarray, random: np.random.Generator
) -> CurveFit | None:
    """The joint and a force; None where curves cannot show the force.

    Shapes are tried on a grid about those that the catalogue begins with, then nearer to the
    best, from the joint as it is alone and from some of the draws; the best then from all.
    """
    base, measured = alone.problem.base, alone.problem.measured
    q = np.asarray(about(measured.q))
    begin = kind.shapes(Scales(float(q.max()), 2.0 * math.pi / alone.omega))
    few = np.tile(alone.theta[:-1], (STARTS, 1))
    few[::2] = draws[np.linspace(0, len(draws) - 1, STARTS // 2).astype(int)]

    def at(shape: float, joints: np.ndarray) -> CurveFit | None:
        unit = beside(kind, shape, q, alone.omega)
        if not shows(unit, q):
            return None
        largest = _largest(measured, unit)
        sizes = _SPREAD * largest * random.standard_normal(len(joints))
        sizes = np.abs(sizes) if kind.positive else sizes
        return _fit(base, PlacedForce(kind, shape), unit, largest, np.column_stack([joints, sizes]))

    if kind.shape is None:
        first = at(begin[0], few)
        found = [first] if first is not None else []
    else:
        found = over_shapes(begin, lambda shape: at(shape, few))
    if not found:
        return None
    best = best_of(found).force
    assert best is not None
    again = at(best.shape, draws)
    return best_of([*found, *([again] if again is not None else [])])


def _fit(
    base: ModalProblem, force: PlacedForce | None, unit: Beside, scale: float, starts: np.ndarray
) -> CurveFit:
    positive = force is not None and force.kind.positive
    problem = WithForce(
        measured=base.measured,
        chart=base.chart,
        names=(*base.names, "size"),
        reference=base.reference,
        base=base,
        unit=unit,
        scale=jnp.asarray(scale),
        positive=jnp.asarray(float(positive)),
    )
    cost, theta = least_cost(problem, starts, STARTS, _RUNS)
    return CurveFit(force, problem, theta, cost)


def _largest(measured: Measured, unit: Beside) -> float:
    """Size at which a force alone would make the changes that were measured."""
    q, f, zeta = (np.asarray(x) for x in (measured.q, measured.frequency, measured.damping))
    omega2 = (2.0 * math.pi * f) ** 2
    k, loss = np.asarray(unit.stiffness)[1], np.asarray(unit.loss) / (2.0 * math.pi * q**2)
    each = [
        float(change / largest)
        for change, largest in ((np.ptp(omega2), np.ptp(k)), (np.ptp(zeta * omega2), np.ptp(loss)))
        if largest > 0 and change > 0
    ]
    return min(each)


def _nothing(levels: int) -> Beside:
    return Beside(jnp.zeros((3, levels)), jnp.zeros(levels), jnp.zeros(levels))


def _omega(measured: Measured) -> float:
    return 2.0 * math.pi * float(np.mean(np.asarray(measured.frequency)))
