"""Diagnoses of a study: of its structure by hits or curves, of joints by loops, of modes."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from iwanjax.config import RecordingEntry, StudySetup
from iwanjax.config.reading import part_of, read_force_loop, recordings_of
from iwanjax.curves import QUANTITIES, ModalCurves
from iwanjax.discrepancy import Diagnosis, StudyRecording, diagnose_histories
from iwanjax.discrepancy.steady.diagnose_joint import diagnose_curves
from iwanjax.discrepancy.steady.diagnose_loops import diagnose_loops
from iwanjax.discrepancy.steady.diagnose_modes import diagnose_modes, modes_parameters
from iwanjax.errors import InputError
from iwanjax.identification.recordings import force_noise_of
from iwanjax.identification.resampling import at_one_rate
from iwanjax.identification.steady.cycle import InteractingMode
from iwanjax.settings.conditioning import CONDITIONING
from iwanjax.signals import Channel, ForceLoop, Recording
from iwanjax.signals.force_loop import common_channels
from iwanjax.structures import JointedStructure
from iwanjax.studies.fits import of_one_quantity
from iwanjax.studies.measured import MeasuredMode, forces_of, measured_modes
from iwanjax.updating import modal_parameters
from iwanjax.updating.joint_groups import joint_parameters

Progress = Callable[[str], None]

# Kinds of recordings of a structure, and samples after the peak when a hammer has let go.
_HISTORIES, _PEAK_ENDS = ("transient", "free_decay"), 8


def diagnosed(study: StudySetup, budget: float | None, progress: Progress) -> dict[str, Diagnosis]:
    """What a study's model lacks: a verdict on its structure and each joint, or on each mode.

    Raises
    ------
    InputError
        As :func:`iwanjax.diagnose`.
    """
    seconds = study.budget if budget is None else budget
    if study.modal:
        return _modes(study, seconds, progress)
    looped = dict.fromkeys(entry.joint for entry in study.recordings if entry.kind == "loop")
    transient = any(entry.kind in _HISTORIES for entry in study.recordings)
    curves = any(entry.kind == "curves" for entry in study.recordings)
    share = seconds / (len(looped) + transient + curves or 1)
    verdicts = {
        label: _joint(study, label, share, progress) for label in looped if label is not None
    }
    if curves:
        verdicts[f"{study.name}, its modes" if transient else study.name] = _by_curves(
            study, share, progress
        )
    if transient or not verdicts:
        verdicts[study.name] = _structure(study, share, progress)
    return verdicts


def _modes(study: StudySetup, budget: float, progress: Progress) -> dict[str, Diagnosis]:
    """Each mode by the curves of its recordings."""
    verdicts = {}
    modes = measured_modes(study)
    names = [modal.name for modal in study.modal]
    for mode in modes:
        kind = study.modal[names.index(mode.name)].kind
        curves = of_one_quantity(mode.weighted)
        others = [hit.curves for hit in mode.held_out]
        if mode.merged is not None:
            others = [mode.merged.weighted(each) for each in others]
        verdicts[mode.name] = diagnose_curves(
            kind,
            curves,
            of_one_quantity([curves[0], *others])[1:],
            study.parameters(mode.name, modal_parameters(kind, curves)),
            name=mode.name,
            mode=names.index(mode.name),
            interacting_modes=[_interacting(mode, other) for other in modes if other is not mode],
            estimator_curves=of_one_quantity(
                [curves[0], *(hit.curves for hit in (*mode.hits, *mode.held_out))]
            )[1:],
            hypotheses=study.hypotheses,
            starts=study.fit.starts,
            seed=study.seed,
            budget=budget / len(modes),
            progress=progress,
        )
    return verdicts


def _interacting(mode: MeasuredMode, other: MeasuredMode) -> InteractingMode:
    """What another mode did in the recordings of one; nothing where that was not measured."""
    there = {hit.name: hit for hit in (*other.hits, *other.held_out)}
    f = float(np.mean(np.concatenate([np.asarray(hit.curves.frequency) for hit in other.hits])))
    amplitudes = []
    for hit in (*mode.hits, *mode.held_out):
        with_it = there.get(hit.name)
        if hit.ringdown is None or with_it is None or with_it.ringdown is None:
            amplitudes.append(np.zeros(hit.curves.amplitude.size))
            continue
        known = with_it.ringdown
        envelope = np.interp(hit.ringdown.time, known.signal_time, known.envelope)
        amplitudes.append(envelope / (2.0 * math.pi * f) ** QUANTITIES[known.curves.quantity])
    return InteractingMode(other.name, f, tuple(amplitudes))


def _joint(study: StudySetup, label: str, budget: float, progress: Progress) -> Diagnosis:
    """A joint by its loops."""
    structure = study.structure
    # Loops of joints are refused without.
    assert structure is not None
    if label not in structure.joints:
        raise InputError(
            f"{study.label}: {label!r} is no joint of the structure: {', '.join(structure.joints)}"
        )
    read: dict[str, list[ForceLoop]] = {"fit": [], "hold_out": []}
    entries = [each for each in study.recordings if each.kind == "loop" and each.joint == label]
    for entry in entries:
        read[entry.use].append(read_force_loop(entry))
    if not read["fit"]:
        raise InputError(f"{study.label}: all loops of {label} are held out; expected some to fit")
    common_channels(
        [loop for use in read for loop in read[use]],
        [f"{each.place} ({each.name})" for use in read for each in entries if each.use == use],
    )
    parameters = study.parameters(None, joint_parameters(label, structure.joints[label]))
    return diagnose_loops(
        structure.joints[label],
        read["fit"],
        read["hold_out"],
        parameters,
        name=label,
        hypotheses=study.hypotheses,
        starts=study.fit.starts,
        seed=study.seed,
        budget=budget,
        progress=progress,
    )


def _by_curves(study: StudySetup, budget: float, progress: Progress) -> Diagnosis:
    """The structure by the curves of its modes."""
    model, structure = study.model, study.structure
    # A study has these or single modes.
    assert model is not None
    assert structure is not None
    if not model.rows:
        raise InputError(f"{study.label}: diagnose needs a model with named rows")
    entries = tuple(entry for entry in study.recordings if entry.kind == "curves")
    curves: dict[int, ModalCurves] = {}
    held_out: dict[int, list[ModalCurves]] = {}
    for mode in measured_modes(replace(study, recordings=entries)):
        assert isinstance(mode.key, int)
        others = [hit.curves for hit in mode.held_out]
        if mode.merged is not None:
            others = [mode.merged.weighted(each) for each in others]
        curves[mode.key] = mode.curves
        held_out[mode.key] = others
    groups = study.fit.groups or None
    # The modes of a diagnosis come lowest first.
    modes = sorted(curves)
    known = modes_parameters(structure, [curves[mode] for mode in modes], modes, groups)
    return diagnose_modes(
        structure,
        curves,
        held_out,
        study.parameters(None, known),
        rows=model.rows,
        groups=groups,
        reference=study.fit.reference or "absolute",
        hypotheses=study.hypotheses,
        starts=study.fit.starts,
        seed=study.seed,
        budget=budget,
        progress=progress,
    )


def _structure(study: StudySetup, budget: float, progress: Progress) -> Diagnosis:
    """The structure by its time histories."""
    known = histories_of(study, "diagnose")
    verdict = diagnose_histories(
        known.structure,
        known.recordings,
        known.sampling_rate,
        **known.about,
        budget=budget,
        seed=study.seed,
        progress=progress,
    )
    warnings = (*verdict.warnings, *known.resampled)
    return replace(verdict, warnings=warnings, sensors=known.sensors)


class Histories(NamedTuple):
    """Time histories of a study's structure, all at one rate.

    Attributes
    ----------
    structure : JointedStructure
        Of the study.
    recordings : list of StudyRecording
        As measured.
    sampling_rate : float
        Hz.
    about : dict
        What else a comparison is told, by the names of its arguments.
    resampled : tuple of str
        What was changed for that rate.
    sensors : tuple of Channel
        In the order of the responses' columns, as the first recording has them.
    """

    structure: JointedStructure
    recordings: list[StudyRecording]
    sampling_rate: float
    about: dict[str, Any]
    resampled: tuple[str, ...]
    sensors: tuple[Channel, ...]


def histories_of(study: StudySetup, verb: str) -> Histories:
    """Time histories of a study's structure, read and brought to one rate.

    Parameters
    ----------
    study : StudySetup
        That holds them.
    verb : str
        What they are for, as messages call it.

    Raises
    ------
    InputError
        For a study without them, and what its model does not know.
    """
    model, structure = study.model, study.structure
    # A study has these or single modes.
    assert model is not None
    assert structure is not None
    if not model.rows or not model.sensors or not model.inputs:
        raise InputError(f"{study.label}: {verb} needs a model with named rows, sensors and inputs")
    measured = [
        (entry, name, _part(entry, recording))
        for entry in study.recordings
        if entry.kind in _HISTORIES
        for name, recording in recordings_of(entry)
    ]
    if not measured:
        raise InputError(
            f"{study.label}: no recordings of kind transient, free_decay, curves or loop; diagnose "
            "needs time histories, curves of modes, or loops of joints"
        )
    channels, quantity = _common(study, [recording for _, _, recording in measured])
    sensors = [channel.name for channel in channels]
    transients = [
        StudyRecording(
            name,
            _responses(recording, sensors),
            None
            if entry.kind == "free_decay"
            else forces_of(study, recording, entry.place, "diagnose"),
            entry.use,
            entry.initial,
        )
        for entry, name, recording in measured
    ]
    rates = [recording.sampling_rate for _, _, recording in measured]
    given = np.array([study.noise.get(name, math.nan) for name in sensors])
    # A modal test knows nothing above its band.
    highest = math.inf if study.test is None else float(study.test.responses.frequency[-1])
    transients, rate, resampled = at_one_rate(transients, rates, given, highest)
    # A name that a sensor has too is the sensor's.
    of_forces = np.array(
        [math.nan if name in sensors else study.noise.get(name, math.nan) for name in model.inputs]
    )
    if np.any(np.isfinite(of_forces)):
        # Of the same density at the rate of the comparison.
        transients = [
            replace(each, force_noise=force_noise_of(each, of_forces * math.sqrt(rate / own)))
            for each, own in zip(transients, rates, strict=True)
        ]
    about = {
        "rows": model.rows,
        "sensors": {name: model.sensors[name] for name in sensors},
        "inputs": model.inputs,
        "quantity": quantity,
        "hypotheses": study.hypotheses,
        "noise": study.noise,
        "trust": study.trust,
    }
    return Histories(structure, transients, rate, about, tuple(resampled), channels)


def _common(study: StudySetup, recordings: list[Recording]) -> tuple[tuple[Channel, ...], Any]:
    """Sensors of all recordings, and the quantity that they have in common."""
    assert study.model is not None
    channels = [channel for recording in recordings for channel in recording.channels]
    by_name = {channel.name: channel for channel in reversed(channels)}
    names = list(dict.fromkeys(channel.name for channel in channels))
    quantities = {channel.quantity for channel in channels}
    unknown = [name for name in names if name not in study.model.sensors]
    if unknown:
        raise InputError(
            f"{study.label}: sensor {unknown[0]!r} is not in the model; it has "
            f"{', '.join(study.model.sensors)}"
        )
    if len(quantities) != 1 or not quantities <= {"acceleration", "velocity", "displacement"}:
        raise InputError(
            f"{study.label}: sensors measure {', '.join(sorted(map(str, quantities)))}; expected "
            "all acceleration, velocity or displacement"
        )
    return tuple(by_name[name] for name in names), quantities.pop()


def _part(entry: RecordingEntry, recording: Recording) -> Recording:
    """What an entry leaves of a recording; of a free decay what follows its peak, at least."""
    part = part_of(entry, recording)
    if entry.kind == "free_decay" and entry.start is None:
        peak = int(np.argmax(np.max(np.abs(part.response), axis=1)))
        begin = part.time[min(peak + _PEAK_ENDS, part.size - 1)]
        part = part_of(replace(entry, start=begin, places={"from": entry.place}), part)
    if part.size < CONDITIONING.least and (entry.start is not None or entry.end is not None):
        key = "from" if entry.start is not None else "to"
        raise InputError(
            f"{entry.places[key]}: leaves {part.size} samples; diagnose needs "
            f"{CONDITIONING.least} at least"
        )
    return part


def _responses(recording: Recording, sensors: list[str]) -> np.ndarray:
    """Responses of all sensors of the study, NaN where this recording has none."""
    response = np.full((recording.size, len(sensors)), np.nan)
    at = [sensors.index(channel.name) for channel in recording.channels]
    response[:, at] = recording.response
    return response
