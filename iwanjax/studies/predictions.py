"""The updated model under forces that it was not fitted to (thesis Sec. 3.4.4)."""

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import cast

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from iwanjax.config import RecordingEntry, StudySetup
from iwanjax.config.cases import carried
from iwanjax.config.reading import blamed, part_of, recordings_of
from iwanjax.curves import ModalCurves
from iwanjax.dynamics import component_rows, simulate
from iwanjax.dynamics.integration import Quantity
from iwanjax.dynamics.transient import ACCURACY
from iwanjax.errors import AccuracyError, InputError
from iwanjax.identification.initial_state import initial_state
from iwanjax.identification.recordings import StudyRecording, cleaned, noise_of
from iwanjax.settings.memory import MEMORY
from iwanjax.signals import Recording, measured_components
from iwanjax.structures import JointedStructure, modal_assurance
from iwanjax.studies.fits import StudyFit, curve_errors
from iwanjax.studies.measured import (
    Hit,
    MeasuredMode,
    forces_of,
    hit_of,
    modes_apart,
    quantity_of,
    sensors_of,
)
from iwanjax.studies.predicted import (
    PredictedCurves,
    PredictedMode,
    PredictedRecording,
    Windows,
    compared,
    covered,
)
from iwanjax.studies.results import StudyResults
from iwanjax.updating import Posterior
from iwanjax.updating.structural import StructuralProblem

Progress = Callable[[str], None]

# Error of the integration over that which the noise of the sensors leaves, and the least one that
# is asked for: as it falls with the square of the step, some five times the steps of the usual one.
_BELOW_NOISE, _FINEST = 0.5, 5e-4

_NO_STRUCTURE = (
    "predict needs a structure, which measured forces drive; this study has modal, of which fit "
    "tells how well it predicts frequency and damping of recordings held out"
)
_NOTHING = (
    "predict needs a recording that no fit sees and whose forces were measured; say use: hold_out "
    "of one of kind transient"
)


def held_out(
    study: StudySetup, draws: int, probability: float, progress: Progress
) -> list[RecordingEntry]:
    """Entries that can be predicted; what else is held out is told.

    Raises
    ------
    InputError
        For a study of single modes, where there is none, and bands that cannot be.
    """
    if study.structure is None:
        raise InputError(f"{study.label}: {_NO_STRUCTURE}")
    if draws < 1 or not 0.0 < probability < 1.0:
        raise InputError(
            f"predict: draws = {draws!r}, probability = {probability!r}; expected at least 1, and "
            "a share between 0 and 1"
        )
    kept = [each for each in study.recordings if each.use == "hold_out"]
    for entry in kept:
        if entry.kind != "transient":
            progress(f"{entry.name} is left out: {entry.kind} has no force to drive the model by")
    found = [each for each in kept if each.kind == "transient"]
    if not found:
        raise InputError(f"{study.label}: {_NOTHING}")
    return found


def predictions(
    study: StudySetup,
    entries: Sequence[RecordingEntry],
    fits: StudyResults[StudyFit],
    posteriors: StudyResults[Posterior] | None,
    draws: int,
    probability: float,
    progress: Progress,
) -> StudyResults[PredictedRecording]:
    """Each recording of these entries, predicted by the fit of a study's structure.

    Raises
    ------
    InputError
        With the recording's place, for one that does not begin at rest, has no force, or whose
        channels are not the model's sensors.
    AccuracyError
        As :func:`iwanjax.simulate`.
    """
    fit, posterior = fits.only, None if posteriors is None else posteriors.only
    problem = fit.solution.problem
    # Studies without structure have nothing to predict.
    assert isinstance(problem, StructuralProblem)
    theta = (fit.solution if posterior is None else posterior).draws(draws, study.seed)
    model = _Model(problem, fit.structure, theta)
    found: dict[str, PredictedRecording] = {}
    for entry in entries:
        for name, recording in recordings_of(entry):
            progress(f"{name}: {recording.size} samples, {draws} parameter sets")
            modes = [mode for mode in fit.modes if mode.key in entry.modes]
            try:
                with blamed(f"{entry.place}: {name}"):
                    test = _test(study, entry, name, recording)
                    each = _predicted(study, model, test, modes, probability)
            except AccuracyError as error:
                raise AccuracyError(f"{entry.place}: {name}: {error}") from None
            # Files of one name in several folders stay apart.
            while name in found:
                name += "_"
            source = "fit" if posterior is None else "posterior"
            found[name] = replace(each, name=name, source=source)
    return StudyResults(found)


@dataclass(frozen=True)
class _Test:
    """A recording to be predicted.

    ``driven`` are the samples from rest to the end, ``compared`` those of them that count.
    """

    entry: RecordingEntry
    name: str
    recording: Recording
    quantity: Quantity
    sensors: dict[str, np.ndarray]
    inputs: dict[str, np.ndarray]
    force: Float[np.ndarray, "driven inputs"]
    noise: Float[np.ndarray, " sensors"]
    driven: slice
    compared: slice


def _test(study: StudySetup, entry: RecordingEntry, name: str, recording: Recording) -> _Test:
    assert study.model is not None
    part = part_of(entry, recording)
    first = int(np.searchsorted(recording.time, part.time[0]))
    compared = slice(first, first + part.size)
    force = forces_of(study, recording, entry.place, "predict")
    told = StudyRecording(name, recording.response, force, "hold_out")
    # What is said of the beginning is said of the part; else what went before it drives, too.
    said, rests = entry.initial is not None and entry.start is None, entry.initial == "rest"
    if not rests and (said or initial_state(told) != "rest"):
        raise InputError(
            "does not begin at rest, from where it is predicted; hold out one that does, or say "
            "initial: rest where its data mislead"
        )
    driven = slice(first if rests else 0, compared.stop)
    sensors = sensors_of(study, entry, recording)
    given = np.array([study.noise.get(sensor, np.nan) for sensor in sensors])
    return _Test(
        entry,
        name,
        recording,
        cast(Quantity, quantity_of(recording)),
        sensors,
        study.model.inputs,
        # Without its noise beside pulses, which did not move the structure.
        cleaned(force).clean[driven],
        np.where(np.isfinite(given), given, noise_of(told).deviation),
        driven,
        compared,
    )


class _Model:
    """The updated model, its modes at low amplitude, and parameters drawn about its own."""

    def __init__(self, problem: StructuralProblem, best: JointedStructure, theta: np.ndarray):
        self.problem, self.best, self.theta = problem, best, theta
        self.low = best.modes("low")

    def places(self, modes: Sequence[MeasuredMode]) -> list[int]:
        """Indices of modes among those of the updated model, which joints may have reordered."""
        alike = modal_assurance(self.low.Phi, self.best.basis.Phi, self.best.structure.M)
        now = np.argmax(np.asarray(alike), axis=0)
        return [int(now[mode.key]) for mode in modes if isinstance(mode.key, int)]

    def driven(self, test: _Test, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Best prediction (N, rows), those of the draws (draws, N, rows), and the first's error."""
        self._check_room(8 * len(test.force) * len(rows))
        kept, dt = test.quantity, 1.0 / test.recording.sampling_rate
        force, inputs = test.force, np.stack([*test.inputs.values()])
        run = partial(simulate, force=force, dt=dt, inputs=inputs, sensors=rows, keep=(kept,))
        found = run(self.best)
        rough, steps = np.array(getattr(found, kept)), found.substeps
        # One by one: what is known of a structure's damping and modes when it is no tracer makes
        # a step of the beam with 84 of them a tenth of the work.
        drawn = np.empty((len(self.theta), *rough.shape))
        for i, own in enumerate(self.theta):
            drawn[i] = getattr(run(self.problem.model(jnp.asarray(own)), substeps=steps), kept)
        # Steps as short as the noise asks for, where there are any; what they change is much the
        # same for all draws.
        floor = float(np.min(test.noise / _rms(test.recording.response[test.compared])))
        accuracy = float(np.clip(_BELOW_NOISE * floor, _FINEST, ACCURACY))
        with contextlib.suppress(AccuracyError):
            found = run(self.best, accuracy=accuracy)
        best = np.array(getattr(found, kept))
        drawn += best - rough
        if kept == "acceleration":
            moved = force @ carried(self.best, test.inputs, rows)
            best, drawn = best + moved, drawn + moved
        return best, drawn, float(found.error)

    def _check_room(self, held: int) -> None:
        """Draws whose responses, so many bytes each, leave room for others.

        Raises
        ------
        InputError
        """
        draws, room = len(self.theta), MEMORY.kernels
        if held * draws > room:
            raise InputError(
                f"responses of {draws} draws take {held * draws / 2**30:.1f} GB; expected "
                f"{room / 2**30:g} at most: take fewer draws, or a part of the recording (from, to)"
            )


def _predicted(
    study: StudySetup,
    model: _Model,
    test: _Test,
    modes: Sequence[MeasuredMode],
    probability: float,
) -> PredictedRecording:
    rows = np.stack([*test.sensors.values()])
    measured = test.recording.response[test.compared]
    shown, at = int(np.argmax(np.mean(measured**2, axis=0))), model.places(modes)
    whole, drawn, error = model.driven(
        test, np.vstack([rows, component_rows(model.best, rows[shown], at)])
    )
    S, lead = len(rows), test.compared.start - test.driven.start
    best, draws = whole[lead:], drawn[:, lead:]
    lowest = np.min(np.asarray(model.low.frequency)[at or slice(None)])
    windows = Windows.of(test.recording.time[test.compared], float(lowest))
    response, amplitude = windows.compared(
        measured, best[:, :S], draws[..., :S], test.noise, probability
    )
    Phi = rows @ np.asarray(model.low.Phi)

    def filtered(x: np.ndarray) -> np.ndarray:
        parts = [_component(x, Phi, mode, shown) for mode in at]
        return np.array(parts).reshape(len(at), len(x)).T

    # Noise of sensors that know nothing of each other, through the same filter.
    noise = np.linalg.norm(filtered(np.diag(test.noise)), axis=0)
    parts, levels = windows.compared(
        filtered(measured), best[:, S:], draws[..., S:], noise, probability
    )
    alike = filtered(best[:, :S])
    leaks = _rms(alike - best[:, S:]) / _rms(best[:, S:])
    errors = _rms(alike - parts.measured) / _rms(parts.measured)
    told = []
    for i, mode in enumerate(modes):
        curves = _curves(study, test, mode, whole[:, :S], drawn[..., :S], probability)
        part, level = parts.column(i), levels.column(i)
        shares = float(leaks[i]), float(errors[i])
        told.append(PredictedMode(mode.name, part, level, *shares, *curves))
    return PredictedRecording(
        name=test.name,
        sensors=tuple(test.sensors),
        quantity=test.quantity,
        unit=test.recording.channels[shown].unit,
        time=test.recording.time[test.compared],
        response=response,
        noise=test.noise,
        covered=covered(measured, draws[..., :S], test.noise, probability),
        spread=_rms(_rms(draws[..., :S] - best[:, :S])) / _rms(measured),
        window_time=windows.middle,
        amplitude=amplitude,
        modes=tuple(told),
        shown=[*test.sensors][shown],
        probability=probability,
        draws=len(draws),
        source="fit",
        shifted=model.problem.reference == "shift",
        error_estimated=error,
        structure=model.best,
    )


def _component(response: np.ndarray, Phi: np.ndarray, mode: int, sensor: int) -> np.ndarray:
    """A mode's part of a sensor's response, (N,), told apart by the shapes (sensors, modes)."""
    apart = modes_apart(Phi, mode)
    return measured_components(response, Phi[:, apart], sensor)[:, apart.index(mode)]


def _rms(x: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(x**2, axis=0))


def _curves(
    study: StudySetup,
    test: _Test,
    mode: MeasuredMode,
    best: np.ndarray,
    drawn: np.ndarray,
    probability: float,
) -> tuple[PredictedCurves | None, str]:
    """Frequency and damping of best and draws by the estimator that the recording went through.

    And why they, or those of the prediction, are not known.
    """
    hit = next((each for each in mode.held_out if each.name == test.name), None)
    if hit is None or hit.ringdown is None:
        ends = [why for why in mode.skipped if test.name in why]
        return None, f"no curves: {ends[0] if ends else 'the recording shows no decay of it'}"
    measured = hit.curves.as_quantity("modal displacement")
    amplitude = np.asarray(measured.amplitude)

    def seen(response: np.ndarray) -> np.ndarray | str:
        assert mode.band is not None
        whole = np.zeros_like(test.recording.response)
        whole[test.driven] = response
        predicted = replace(test.recording, response=whole)
        found = hit_of(study, test.entry, test.name, predicted, mode.key, mode.band)
        if not isinstance(found, Hit):
            return found
        return _at(found.curves.as_quantity("modal displacement"), amplitude)

    own, unknown = seen(best), np.full((2, amplitude.size), np.nan)
    reason = f"no predicted curves: {own}" if isinstance(own, str) else ""
    others = drawn[:0] if reason else drawn
    f, zeta = unknown if isinstance(own, str) else own
    found = [seen(each) for each in others]
    draws = np.stack([unknown, *(each for each in found if not isinstance(each, str))])
    curves = PredictedCurves(
        amplitude,
        compared(np.asarray(measured.frequency), f, draws[:, 0], probability),
        compared(np.asarray(measured.damping), zeta, draws[:, 1], probability),
        np.asarray(measured.frequency_std),
        np.asarray(measured.damping_std),
        *curve_errors(measured, f, zeta),
    )
    return curves, reason


def _at(curves: ModalCurves, amplitude: np.ndarray) -> np.ndarray:
    """Frequency and damping at some amplitudes, (2, levels), NaN beyond those of the curves."""
    own = np.log(np.asarray(curves.amplitude))
    order, wanted = np.argsort(own), np.log(amplitude)
    return np.stack(
        [
            np.interp(wanted, own[order], np.asarray(y)[order], np.nan, np.nan)
            for y in (curves.frequency, curves.damping)
        ]
    )
