"""A fit of curves or loops: the model alone, or with one effect beside its joints."""

import abc
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Generic, NamedTuple, Self, TypeAlias, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.correlation import correlation_time
from iwanjax.effects.estimate import Estimate
from iwanjax.effects.kinds import ForceKind, JointKind, NamedKind
from iwanjax.estimation.evidence import linearised
from iwanjax.estimation.least_squares import least_squares
from iwanjax.estimation.parameters import Chart
from iwanjax.estimation.problem import (
    AbstractLeastSquares,
    LeastSquaresSolution,
    residuals_and_slopes,
)
from iwanjax.estimation.settings import SEARCH
from iwanjax.joints import ParameterInfo
from iwanjax.joints.iwan import IWAN_PARAMETERS
from iwanjax.settings.stages import settings

JOINT_VALUES = len(IWAN_PARAMETERS)
"""Parameters of a joint left out."""
# Smallest size, over the largest that is plausible, that a search by its logarithm starts from.
_SMALLEST = 1e-6


class PlacedEffect(NamedTuple):
    """A force with its shape, an interacting mode or a joint left out, and where it acts.

    Attributes
    ----------
    kind : NamedKind
        Of the catalogue.
    shape : float
        Of a force that has one.
    where : str
        Place of a structure; empty beside the only joint.
    force : ForceKind or None
        Beside a joint left out, a force that acts with it; the shape is its.
    """

    kind: NamedKind
    shape: float = 1.0
    where: str = ""
    force: ForceKind | None = None

    @property
    def sizes(self) -> tuple[ParameterInfo, ...]:
        """What is fitted beside the shape."""
        own = self.kind.parameters if isinstance(self.kind, JointKind) else (self.kind.size,)
        return own if self.force is None else (*own, self.force.size)

    @property
    def shape_info(self) -> ParameterInfo | None:
        """Of a force, its shape parameter where it has one."""
        if self.force is not None:
            return self.force.shape
        return self.kind.shape if isinstance(self.kind, ForceKind) else None

    @property
    def names(self) -> tuple[str, ...]:
        """Of what acts, and where."""
        together = (self.kind.name,) if self.force is None else (self.kind.name, self.force.name)
        return (*together, self.where)


class AbstractEffectValues(eqx.Module):
    """Variables of what an effect is made of."""

    @property
    @abc.abstractmethod
    def count(self) -> int:
        """How many."""

    @abc.abstractmethod
    def to_values(self, z: Float[Array, " values"]) -> Float[Array, " values"]:
        """The values."""

    @abc.abstractmethod
    def to_variables(self, values: Float[Array, " values"]) -> Float[Array, " values"]:
        """The inverse of :meth:`to_values`."""


class Size(AbstractEffectValues):
    """Variable of a force's size: over a scale, by its logarithm if it is positive."""

    scale: Array
    positive: Array

    @property
    def count(self) -> int:
        """One."""
        return 1

    def to_values(self, z: Float[Array, " 1"]) -> Float[Array, " 1"]:
        """The size."""
        return self.scale * jnp.where(self.positive > 0, jnp.exp(z), z)

    def to_variables(self, values: Float[Array, " 1"]) -> Float[Array, " 1"]:
        """The inverse of :meth:`to_values`."""
        share = values / self.scale
        logarithm = jnp.log(jnp.maximum(jnp.abs(share), _SMALLEST))
        return jnp.where(self.positive > 0, logarithm, share)


class JointValues(AbstractEffectValues):
    """Variables of a joint left out: those of a fit that has it after so many values of others."""

    own: AbstractLeastSquares | Chart
    before: int = eqx.field(static=True)

    @property
    def count(self) -> int:
        """Parameters of a joint left out."""
        return JOINT_VALUES

    def to_values(self, z: Float[Array, " 4"]) -> Float[Array, " 4"]:
        """The joint's parameters."""
        return self.own.to_values(jnp.concatenate([jnp.zeros(self.before), z]))[self.before :]

    def to_variables(self, values: Float[Array, " 4"]) -> Float[Array, " 4"]:
        """The inverse of :meth:`to_values`."""
        every = jnp.concatenate([jnp.ones(self.before), values])
        return self.own.to_variables(every)[self.before :]


class AbstractSteadyProblem(AbstractLeastSquares):
    """A model and an effect of some size beside its joints, held against curves or loops.

    Parameters are those of the model, then the effect's values. What the effect does is data, so
    that all kinds and places share one compiled search.

    Attributes
    ----------
    base : AbstractLeastSquares or Chart
        The model's parameters.
    beside : AbstractEffectValues
        The effect's values.
    """

    base: eqx.AbstractVar[Any]
    beside: eqx.AbstractVar[AbstractEffectValues]

    @property
    @abc.abstractmethod
    def count(self) -> int:
        """Number of measured values."""

    @abc.abstractmethod
    def series(self, residuals: np.ndarray) -> tuple[np.ndarray, ...]:
        """Residuals in the order that they were measured in, (values, quantities) each."""

    @abc.abstractmethod
    def reshaped(self, effect: PlacedEffect) -> Self:
        """The same with a force of another shape."""

    @abc.abstractmethod
    def predicted(
        self, theta: Array, effect: PlacedEffect | None, measured: Any, which: int
    ) -> tuple[Any, ...]:
        """The model along what was measured, also what was held out."""

    def to_values(self, z: Float[Array, " free"]) -> Float[Array, " parameters"]:
        """The model's parameters, then the effect's values."""
        n = self.beside.count
        return jnp.concatenate([self.base.to_values(z[:-n]), self.beside.to_values(z[-n:])])

    def to_variables(self, theta: Float[Array, " parameters"]) -> Float[Array, " free"]:
        """The inverse of :meth:`to_values`."""
        n = self.beside.count
        own = self.beside.to_variables(theta[-n:])
        return jnp.concatenate([self.base.to_variables(theta[:-n]), own])

    @property
    def places(self) -> np.ndarray:
        """Where in theta the effect's values are."""
        return len(self.names) - self.beside.count + np.arange(self.beside.count)

    @property
    def given(self) -> np.ndarray:
        """Where in theta the parameters of the model are that was given."""
        return np.setdiff1d(np.arange(len(self.names) - self.beside.count), self.places)

    @property
    def unknowns(self) -> int:
        """Values that are adjusted beside the effect's."""
        return len(np.intersect1d(self.given, self.chart.free))


Problem = TypeVar("Problem", bound=AbstractSteadyProblem)


@dataclass(frozen=True, eq=False)
class SteadyFit(Generic[Problem]):
    """Curves or loops explained by a model and at most one effect.

    Attributes
    ----------
    effect : PlacedEffect or None
        None for the model alone.
    problem : AbstractSteadyProblem
        What was searched.
    theta : (parameters,) array
        Where it ended.
    left : float
        Sum of squared residuals over their deviations.
    cost : float
        What the same likelihood is worth with the deviations that the model alone is judged by.
    idle : tuple of int
        Where in theta values are that the measurements do not depend on: these count as not
        adjusted.
    alike : tuple of (parameters,) array
        Parameters that the measurements cannot tell from theta, and predictions beyond them can.
    """

    effect: PlacedEffect | None
    problem: Problem
    theta: np.ndarray
    left: float
    cost: float
    idle: tuple[int, ...] = ()
    alike: tuple[np.ndarray, ...] = ()

    @property
    def values(self) -> np.ndarray:
        """Of the effect."""
        return self.theta[self.problem.places]

    @property
    def unknowns(self) -> int:
        """Values that were adjusted."""
        effect = self.effect
        own = 0 if effect is None else len(effect.sizes) + (effect.shape_info is not None)
        return self.problem.unknowns + own - len(self.idle)

    @property
    def count(self) -> int:
        """Values that were measured."""
        return self.problem.count

    @cached_property
    def linear(self) -> tuple[np.ndarray, np.ndarray]:
        """Residuals, and their derivatives by the parameters, (residuals, parameters)."""
        r, J = residuals_and_slopes(self.problem, jnp.asarray(self.theta))
        return np.asarray(r), np.asarray(J)

    def residuals(self) -> tuple[np.ndarray, ...]:
        """Predicted less measured over deviations, of each curve or loop."""
        return self.problem.series(self.linear[0])

    def correlation(self) -> float:
        """Correlation time of the residuals in values, mean over curves or loops."""
        return float(np.mean([correlation_time(each[None]) for each in self.residuals()]))

    def std(self) -> np.ndarray:
        """Standard deviations of the effect's values, were its shape known.

        Whether there is an effect at all: a slider that slips from the first has a force, though
        neither its stiffness nor its slip is known.
        """
        slopes = self.linear[1].copy()
        slopes[:, list(self.idle)] = 0.0
        return linearised(slopes, self.left, self.correlation())[self.problem.places]

    def estimates(self) -> tuple[Estimate, ...]:
        """The effect's values and its shape, with standard deviations."""
        effect = self.effect
        assert effect is not None
        shape = effect.shape_info
        if shape is None:
            rows = zip(effect.sizes, self.values.tolist(), self.std().tolist(), strict=True)
            return tuple(Estimate(*row) for row in rows)
        both = np.column_stack([self.linear[1], self.by_shape()])
        both[:, list(self.idle)] = 0.0
        std = linearised(both, self.left, self.correlation())
        known = std[[*self.problem.places, -1]]
        values = (*self.values.tolist(), effect.shape)
        scaled = (*known[:-1].tolist(), effect.shape * float(known[-1]))
        rows = zip((*effect.sizes, shape), values, scaled, strict=True)
        return tuple(Estimate(*row) for row in rows)

    def by_shape(self) -> np.ndarray:
        """Derivatives of the residuals by the logarithm of the effect's shape."""
        assert self.effect is not None
        by = settings().steady.reshaped
        up, down = (self._reshaped(self.effect, math.exp(step)) for step in (by, -by))
        return (up - down) / (2.0 * by)

    def _reshaped(self, effect: PlacedEffect, factor: float) -> np.ndarray:
        """Residuals with a shape so many times as large, nothing fitted again."""
        problem = self.problem.reshaped(effect._replace(shape=effect.shape * factor))
        return replace(self, problem=problem).linear[0]

    def predicted(self, measured: Any, which: int = 0) -> tuple[Any, ...]:
        """The model along curves or loops, also those that were held out.

        Parameters
        ----------
        measured : sequence of ModalCurves, or LoopHistories
            What was measured; of one mode in the order of the fit, those held out last.
        which : int
            Of a structure's curves, the one whose mode they are of.
        """
        return self.problem.predicted(jnp.asarray(self.theta), self.effect, measured, which)


AnyFit: TypeAlias = SteadyFit[Any]
Fit = TypeVar("Fit", bound=AnyFit)


def searched(
    effect: PlacedEffect | None,
    problem: Problem,
    starts: np.ndarray,
    runs: int,
    at_once: int | None = None,
    tolerance: float = SEARCH.tolerance,
) -> SteadyFit[Problem]:
    """The fit at the best end of a multistart.

    Parameters
    ----------
    effect : PlacedEffect or None
        What acts beside the joints.
    problem : AbstractSteadyProblem
        What to search.
    starts : (starts, parameters) array
        The last batch is filled up with the first ones.
    runs, at_once : int
        Starts of a batch that are run to their minimum, of so many: all searches share one
        compiled kernel.
    tolerance : float
        Relative, of the search.
    """
    ends: list[LeastSquaresSolution] = []
    at_once = at_once or settings().steady.starts
    for first in range(0, len(starts), at_once):
        some = starts[np.arange(first, first + at_once) % len(starts)]
        ends += least_squares(problem, jnp.asarray(some), runs, tolerance=tolerance)
    best = min(ends, key=lambda each: each.cost)
    return SteadyFit(effect, problem, best.values, best.cost, best.cost)


def joints_to_begin_with(alone: AnyFit, draws: np.ndarray) -> np.ndarray:
    """Starts of a joint beside an effect: as it is alone, and some of its draws."""
    few = np.tile(alone.theta[:-1], (settings().steady.starts, 1))
    few[::2] = draws[np.linspace(0, len(draws) - 1, len(few[::2])).astype(int)]
    return few


def with_sizes(
    joints: np.ndarray, kind: ForceKind, largest: float, random: np.random.Generator
) -> np.ndarray:
    """Starts of a joint with sizes of a force beside it, up to some that is plausible."""
    sizes = settings().steady.spread * largest * random.standard_normal(len(joints))
    return np.column_stack([joints, np.abs(sizes) if kind.positive else sizes])


def best_of(fits: Sequence[Fit]) -> Fit:
    """Of least cost."""
    return min(fits, key=lambda each: each.cost)
