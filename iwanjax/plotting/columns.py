"""Measured curves and the fitted model that explains them, put together for drawing."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.curves import ModalCurves
from iwanjax.quasistatic.modal import ModalOscillator
from iwanjax.types import compiled_for_one_call
from iwanjax.updating.solution import FitSolution, point

if TYPE_CHECKING:
    from iwanjax.updating.problem import AbstractProblem

# Amplitudes of a smooth line, and how far it goes beyond the measured ones.
_LEVELS, _BEYOND = 300, 1.15


@dataclass(frozen=True, eq=False)
class Column:
    """Curves that share their panels: all hits of an oscillator's mode, or one of a structure's.

    Attributes
    ----------
    measured, held_out : tuple of ModalCurves
        Hits that were fitted, and others.
    explained : tuple of ModalCurves
        The model at the amplitudes of both, in that order.
    model : ModalCurves
        The line to draw, with rising amplitudes and the fit's deviations.
    shift : bool
        Whether frequencies are compared up to an offset for each curve.
    """

    measured: tuple[ModalCurves, ...]
    held_out: tuple[ModalCurves, ...]
    explained: tuple[ModalCurves, ...]
    model: ModalCurves
    shift: bool

    @property
    def base(self) -> float:
        """Frequency that the axis counts from, Hz."""
        return float(np.asarray(self.model.frequency)[0]) if self.shift else 0.0

    def aligned(self, i: int) -> np.ndarray:
        """Frequency of hit i as it is compared with the model's, Hz."""
        hit = (*self.measured, *self.held_out)[i]
        frequency = np.asarray(hit.frequency)
        return frequency + offset(hit, self.explained[i].frequency) if self.shift else frequency


def columns_of(solution: FitSolution, held_out: Sequence[ModalCurves] = ()) -> list[Column]:
    """What is drawn together: everything for an oscillator, mode by mode for a structure."""
    shift = solution.problem.reference == "shift"
    if isinstance(solution.model, ModalOscillator):
        theirs = tuple(_at(solution.model, each) for each in held_out)
        line = _smooth(solution, (*solution.measured, *held_out))
        explained = (*solution.predicted, *theirs)
        return [Column(solution.measured, tuple(held_out), explained, line, shift)]
    deviations = _at_levels(solution)
    columns = []
    for curve, predicted, part in zip(
        solution.measured, solution.predicted, solution.problem.measured.slices, strict=True
    ):
        held = tuple(
            each for each in held_out if len(solution.measured) == 1 or each.name == curve.name
        )
        line = _ordered(predicted, *(std[part] for std in deviations))
        explained = (predicted, *(_between(line, each) for each in held))
        columns.append(Column((curve,), held, explained, line, shift))
    return columns


def offset(measured: ModalCurves, frequency: object) -> float:
    """Weighted mean of a model's frequency less the measured one, Hz."""
    difference = np.asarray(frequency) - np.asarray(measured.frequency)
    known = np.isfinite(difference)
    std = measured.frequency_std
    weight = np.ones_like(difference) if std is None else 1.0 / np.asarray(std) ** 2
    return float(np.average(difference[known], weights=weight[known])) if known.any() else 0.0


def _at(model: ModalOscillator, curve: ModalCurves) -> ModalCurves:
    """An oscillator at the amplitudes of a curve."""
    seen = curve.as_quantity("displacement")
    f, zeta = model.ringdown_frequency_and_damping(seen.amplitude, largest=seen.largest)
    return ModalCurves(
        curve.amplitude, f, zeta, quantity=curve.quantity, unit=curve.unit, name=curve.name
    )


def _smooth(solution: FitSolution, hits: Sequence[ModalCurves]) -> ModalCurves:
    """An oscillator's line over the range of the hits, against what they measure."""
    assert isinstance(solution.model, ModalOscillator)
    q = np.concatenate([np.asarray(hit.as_quantity("displacement").amplitude) for hit in hits])
    q = q[np.isfinite(q)]
    at = jnp.asarray(np.geomspace(q.min() / _BEYOND, q.max() * _BEYOND, _LEVELS))
    (f, zeta), (f_std, zeta_std) = _with_deviations(solution, at)
    line = ModalCurves(
        at, f, zeta, frequency_std=f_std, damping_std=zeta_std, quantity="displacement"
    )
    return line.as_quantity(hits[0].quantity, hits[0].unit)


def _at_levels(solution: FitSolution) -> tuple[np.ndarray, np.ndarray]:
    """Deviations of the prediction at the measured levels, from those of the parameters.

    By the derivatives that the fit itself has asked for: its kernel is there.
    """
    problem = solution.problem
    found = point(problem, jnp.asarray([p.value for p in solution.parameters]))
    # Of differences over the measured deviations, less what an offset takes up.
    f, zeta = np.split(np.asarray(found.slope), 2)
    measured = problem.measured
    return (
        _deviation(solution, f * np.asarray(measured.frequency_std)[:, None]),
        _deviation(solution, zeta * np.asarray(measured.damping_std)[:, None]),
    )


def _with_deviations(
    solution: FitSolution, q: Array
) -> tuple[tuple[Array, Array], tuple[np.ndarray, np.ndarray]]:
    """An oscillator's prediction, and its deviations from those of the parameters."""
    problem = solution.problem
    theta = jnp.asarray([p.value for p in solution.parameters])
    predicted, slopes = _prediction(problem, theta, q)
    f, zeta = (np.asarray(slope) for slope in slopes)
    if problem.reference == "shift":
        # What a parameter does to all measured frequencies alike, which an offset takes up.
        _, (at_levels, _) = _prediction(problem, theta, None)
        weight = 1.0 / np.asarray(problem.measured.frequency_std) ** 2
        f = f - np.average(np.asarray(at_levels), axis=0, weights=weight)
    return predicted, (_deviation(solution, f), _deviation(solution, zeta))


def _deviation(solution: FitSolution, slopes: np.ndarray) -> np.ndarray:
    """What the parameters' deviations make of a prediction, linearised, by its derivatives.

    Not by draws from the parameters' normal: along the curved ridges of what the data leave
    open these would leave the ridge, and the band would show what the data do exclude.
    """
    covariance = np.asarray(solution.covariance)
    return np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", slopes, covariance, slopes), 0.0))


@compiled_for_one_call
def _prediction(
    problem: "AbstractProblem", theta: Array, q: Array | None
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Frequency and damping at displacements or the measured amplitudes, and derivatives."""

    def predict(theta: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        if q is None:
            predicted = problem.predict(theta)
        else:
            model = problem.model(theta)
            assert isinstance(model, ModalOscillator)
            largest = jnp.max(problem.measured.largest)
            predicted = model.ringdown_frequency_and_damping(q, largest=largest)
        return predicted, predicted

    slopes, predicted = jax.jacfwd(predict, has_aux=True)(theta)
    return predicted, slopes


def _ordered(predicted: ModalCurves, f_std: np.ndarray, zeta_std: np.ndarray) -> ModalCurves:
    """The same points in order of amplitude."""
    rising = np.argsort(np.asarray(predicted.amplitude))
    return ModalCurves(
        np.asarray(predicted.amplitude)[rising],
        np.asarray(predicted.frequency)[rising],
        np.asarray(predicted.damping)[rising],
        frequency_std=f_std[rising],
        damping_std=zeta_std[rising],
        quantity=predicted.quantity,
        unit=predicted.unit,
        name=predicted.name,
    )


def _between(line: ModalCurves, curve: ModalCurves) -> ModalCurves:
    """A line at the amplitudes of a curve, NaN beyond its ends."""
    x, at = np.log(np.asarray(line.amplitude)), np.log(np.asarray(curve.amplitude))
    f, zeta = (
        np.interp(at, x, np.asarray(y), left=math.nan, right=math.nan)
        for y in (line.frequency, line.damping)
    )
    return ModalCurves(curve.amplitude, f, zeta, quantity=curve.quantity, unit=curve.unit)
