"""Fits of a study's model to its measured modes."""

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from iwanjax.config import Study
from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.quasistatic.modal import ModalOscillator
from iwanjax.report.fit import HeldOut
from iwanjax.updating import (
    Exponents,
    FitSolution,
    fit,
    free_exponents,
    modal_parameters,
    structural_parameters,
)
from iwanjax.updating.model_error import model_error_of, with_model_error
from iwanjax.verbs.curves import common_curve
from iwanjax.verbs.measured import MeasuredMode


@dataclass(frozen=True, eq=False)
class Fitted:
    """One fit of a study: of one mode, or of a structure to all its modes.

    Attributes
    ----------
    name : str
        Of the mode, or of the study for a structure.
    modes : tuple of MeasuredMode
        What was fitted.
    solution : FitSolution
        The fit.
    exponents : Exponents or None
        Free power laws through the same curves, for a single mode.
    held_out : tuple of HeldOut
        How well recordings that the fit has not seen are predicted.
    seconds : float
        Compilation included.
    """

    name: str
    modes: tuple[MeasuredMode, ...]
    solution: FitSolution
    exponents: Exponents | None
    held_out: tuple[HeldOut, ...]
    seconds: float


def fits(study: Study, modes: Sequence[MeasuredMode]) -> tuple[Fitted, ...]:
    """Fit the study's model.

    Raises
    ------
    InputError
        As :func:`iwanjax.fit`.
    """
    if study.structure is not None:
        return (_structure(study, modes),)
    return tuple(_modal(study, mode) for mode in modes)


def _modal(study: Study, mode: MeasuredMode) -> Fitted:
    kind = next(modal.kind for modal in study.modal if modal.name == mode.name)
    start = time.perf_counter()
    curves = of_one_quantity(mode.weighted)
    settings = study.fit
    weighed = with_model_error(curves, model_error_of(curves, settings.error))
    parameters = study.parameters(mode.name, modal_parameters(kind, weighed))
    with ThreadPoolExecutor(1) as other:
        exponents = other.submit(_exponents, weighed)
        solution = fit(
            kind,
            curves,
            parameters,
            reference=settings.reference,
            model_error=settings.error,
            starts=settings.starts,
            seed=settings.seed,
        )
    seconds = time.perf_counter() - start
    predictions = _predictions(solution, mode)
    return Fitted(mode.name, (mode,), solution, exponents.result(), predictions, seconds)


def _exponents(curves: tuple[ModalCurves, ...]) -> Exponents | None:
    try:
        return free_exponents(curves)
    except InputError:
        return None


def of_one_quantity(curves: Sequence[ModalCurves]) -> tuple[ModalCurves, ...]:
    """Curves against the quantity of the first; files of curves may be against others."""
    first, *others = curves
    return (
        first,
        *(c if c.quantity == first.quantity else c.as_quantity(first.quantity) for c in others),
    )


def _structure(study: Study, modes: Sequence[MeasuredMode]) -> Fitted:
    assert study.structure is not None
    start = time.perf_counter()
    curves = [common_curve(mode).as_quantity("modal displacement") for mode in modes]
    keys = [mode.key for mode in modes if isinstance(mode.key, int)]
    settings = study.fit
    groups = settings.groups or None
    weighed = with_model_error(curves, model_error_of(curves, settings.error))
    known = structural_parameters(study.structure, groups, weighed, keys)
    for name, change in study.changes.items():
        if name not in known:
            raise InputError(f"{change.place}: no recording is of this mode; remove {name}")
    solution = fit(
        study.structure,
        curves,
        study.parameters(None, known),
        modes=keys,
        groups=groups,
        reference=settings.reference,
        model_error=settings.error,
        starts=settings.starts,
        seed=settings.seed,
    )
    return Fitted(study.name, tuple(modes), solution, None, (), time.perf_counter() - start)


def _predictions(solution: FitSolution, mode: MeasuredMode) -> tuple[HeldOut, ...]:
    """Errors of the model on the recordings it has not seen."""
    model = solution.model
    assert isinstance(model, ModalOscillator)
    found = []
    for hit in mode.held_out:
        measured = hit.curves
        seen = measured.as_quantity("displacement")
        predicted = model.ringdown_frequency_and_damping(seen.amplitude, largest=seen.largest)
        f, zeta = (np.asarray(x) for x in predicted)
        known, std = np.asarray(measured.damping), np.asarray(measured.damping_std)
        # Where the damping itself is hardly known an error of it means nothing.
        trusted = std < 0.1 * known
        trusted = trusted if trusted.any() else np.ones_like(trusted)
        frequency = f - np.asarray(measured.frequency)
        relative = zeta / known - 1.0
        repeatability: tuple[float | None, float | None] = (None, None)
        if mode.merged is not None:
            spread = (mode.merged.frequency_spread, mode.merged.damping_spread)
            level = np.asarray(mode.merged.curves.damping)
            repeatability = (_rms(spread[0]), 100.0 * _rms(spread[1] / level))
        found.append(
            HeldOut(
                hit.name,
                _rms(frequency[trusted]),
                100.0 * _rms(relative[trusted]),
                *repeatability,
                measured,
            )
        )
    return tuple(found)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
