"""Fits of a study's model to its measured modes, and what they predict of recordings held out."""

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from iwanjax.config import StudySetup
from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.quasistatic.modal import ModalOscillator
from iwanjax.results import AbstractResult
from iwanjax.structures import JointedStructure, oscillator
from iwanjax.studies.beside import amplitudes_beside, hit_beside
from iwanjax.studies.measured import MeasuredMode
from iwanjax.studies.results import StudyResults, under_name
from iwanjax.tables import Block
from iwanjax.updating import (
    Exponents,
    FitSolution,
    Posterior,
    fit,
    free_exponents,
    modal_parameters,
    structural_parameters,
)
from iwanjax.updating.model_error import model_error_of, with_model_error


class HeldOut(NamedTuple):
    """How well a fit predicts a hit that it has not seen.

    Attributes
    ----------
    name : str
        Of the hit.
    frequency_error : float
        Root mean square, Hz.
    damping_error : float
        Root mean square relative to the measured damping, per cent.
    frequency_repeatability, damping_repeatability : float or None
        How far one hit is from the next, in the same units; None where not known.
    curves : ModalCurves, optional
        The hit, for the figure of the fit.
    """

    name: str
    frequency_error: float
    damping_error: float
    frequency_repeatability: float | None = None
    damping_repeatability: float | None = None
    curves: ModalCurves | None = None


@dataclass(frozen=True, eq=False)
class StudyFit(AbstractResult):
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

    @property
    def structure(self) -> JointedStructure:
        """The fitted model, ready for :func:`iwanjax.simulate`; a mode is one of unit mass."""
        model = self.solution.model
        if isinstance(model, JointedStructure):
            return model
        # What is fitted is this or a structure.
        assert isinstance(model, ModalOscillator)
        return oscillator(stiffness=float(model.K_inf), joint=model.joint, zeta=float(model.zeta_0))

    def _blocks(self) -> tuple[Block, ...]:
        """The fit, the power laws of its curves, and how recordings held out are predicted."""
        lines = []
        if self.exponents is not None:
            lines += [self.exponents.statement() + ".", self.exponents.law() + "."]
        for row in self.held_out:
            line = (
                f"held out {row.name}: predicted within {row.frequency_error:.2g} Hz and "
                f"{row.damping_error:.2g} % of its damping (rms)"
            )
            if row.frequency_repeatability is not None and row.damping_repeatability is not None:
                line += (
                    f"; recordings repeat within {row.frequency_repeatability:.2g} Hz and "
                    f"{row.damping_repeatability:.2g} %"
                )
            lines.append(line)
        lines.append(f"fitted in {self.seconds:.1f} s, compilation included")
        return *under_name(self.name, self.solution._blocks()), "\n".join(lines)


def fits_of(study: StudySetup, modes: Sequence[MeasuredMode]) -> tuple[StudyFit, ...]:
    """Fit the study's structure to all modes, or a joint to each.

    Raises
    ------
    InputError
        As :func:`iwanjax.fit`.
    """
    if study.structure is not None:
        return (_structure(study, modes),)
    return tuple(_modal(study, mode) for mode in modes)


def posteriors_of(
    study: StudySetup,
    fits: StudyResults[StudyFit],
    chains: Mapping[str, Path] | None,
    progress: bool,
) -> StudyResults[Posterior]:
    """Posteriors sampled from the fits on, each with the file that its chain is kept in, if any.

    Raises
    ------
    InputError
        As :func:`iwanjax.sample_posterior`.
    """
    from iwanjax.updating.sampling import sample_posterior

    options, kept = study.posterior.model_dump() | {"progress": progress}, chains or {}
    return StudyResults(
        {
            name: sample_posterior(fit.solution, **options, file=kept.get(name))
            for name, fit in fits.items()
        }
    )


def _modal(study: StudySetup, mode: MeasuredMode) -> StudyFit:
    if study.fit.coupled:
        raise InputError(
            f"{study.label}: fit: coupled needs a model of the structure, whose joints the modes "
            "share; a mode on its own has no others beside it"
        )
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
            most_probable=settings.most_probable,
            starts=settings.starts,
            seed=settings.seed,
            method=settings.method,
        )
    seconds = time.perf_counter() - start
    predictions = _predictions(solution, mode)
    return StudyFit(mode.name, (mode,), solution, exponents.result(), predictions, seconds)


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


def _structure(study: StudySetup, modes: Sequence[MeasuredMode]) -> StudyFit:
    assert study.structure is not None
    start = time.perf_counter()
    coupled = study.fit.coupled
    taken = [hit_beside(mode).curves if coupled else mode.curves for mode in modes]
    curves = [each.as_quantity("modal displacement") for each in taken]
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
        beside=amplitudes_beside(study, modes) if coupled else None,
        reference=settings.reference,
        model_error=settings.error,
        most_probable=settings.most_probable,
        starts=settings.starts,
        seed=settings.seed,
        method=settings.method,
    )
    return StudyFit(study.name, tuple(modes), solution, None, (), time.perf_counter() - start)


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
        repeatability: tuple[float | None, float | None] = (None, None)
        if mode.merged is not None:
            spread = (mode.merged.frequency_spread, mode.merged.damping_spread)
            level = np.asarray(mode.merged.curves.damping)
            repeatability = (_rms(spread[0]), 100.0 * _rms(spread[1] / level))
        found.append(
            HeldOut(
                hit.name,
                *curve_errors(measured, f, zeta),
                *repeatability,
                measured,
            )
        )
    return tuple(found)


def curve_errors(measured: ModalCurves, f: np.ndarray, zeta: np.ndarray) -> tuple[float, float]:
    """Root mean squares of a prediction's errors: Hz, and per cent of the measured damping.

    Over the levels that are predicted, NaN where none is. Where the damping itself is hardly known
    an error of it means nothing.
    """
    known, std = np.asarray(measured.damping), np.asarray(measured.damping_std)
    told = np.isfinite(f) & np.isfinite(zeta)
    if not told.any():
        return float("nan"), float("nan")
    trusted = told & (std < 0.1 * known)
    trusted = trusted if trusted.any() else told
    frequency, relative = f - np.asarray(measured.frequency), zeta / known - 1.0
    return _rms(frequency[trusted]), 100.0 * _rms(relative[trusted])


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
