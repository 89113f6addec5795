"""From a study's recordings to the measured curves of its modes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from iwanjax.config import RecordingEntry, StudySetup
from iwanjax.config.reading import STEPPED, blamed, part_of, read_modal_curves, recordings_of
from iwanjax.curves import QUANTITIES, ModalCurves
from iwanjax.errors import InputError
from iwanjax.results import AbstractResult
from iwanjax.signals import (
    MergedCurves,
    Recording,
    RingDown,
    merge_curves,
    modal_filter,
    ringdown,
)
from iwanjax.signals.proposal import REACH
from iwanjax.tables import Block

# How far a force has fallen, as share of its peak, when the contact is over.
_FORCE_ENDS = 0.01
# Recordings that give curves of a mode.
_GIVING = ("free_decay", "transient", "curves", *STEPPED)


@dataclass(frozen=True, eq=False)
class Hit(AbstractResult):
    """One recording's curves of one mode.

    Attributes
    ----------
    name : str
        Of the recording.
    curves : ModalCurves
        Named like the hit.
    ringdown : RingDown or None
        Where they come from a time history.
    """

    name: str
    curves: ModalCurves
    ringdown: RingDown | None = None


@dataclass(frozen=True, eq=False)
class MeasuredMode(AbstractResult):
    """All that the recordings say of one mode.

    Attributes
    ----------
    name : str
        The study's name, or "mode 0" for a structure's.
    key : str or int
        What the study calls it: a modal mode's name or an elastic mode's index.
    band : (float, float) or None
        Hz.
    hits, held_out : tuple of Hit
        Recordings to fit, and those that no fit sees.
    skipped : tuple of str
        Recordings that show nothing of the mode, and why.
    """

    name: str
    key: str | int
    band: tuple[float, float] | None
    hits: tuple[Hit, ...]
    held_out: tuple[Hit, ...]
    skipped: tuple[str, ...] = ()
    merged: MergedCurves | None = field(default=None, repr=False)

    @property
    def weighted(self) -> tuple[ModalCurves, ...]:
        """The hits' curves, weighed by repeatability where there are several."""
        if self.merged is not None:
            return self.merged.weighted_hits
        return tuple(hit.curves for hit in self.hits)

    @property
    def curves(self) -> ModalCurves:
        """The mode's one curve: of the only hit, the merged one, or that with most levels."""
        if self.merged is not None:
            return self.merged.curves
        return max((hit.curves for hit in self.hits), key=lambda curves: curves.amplitude.size)

    def _blocks(self) -> tuple[Block, ...]:
        """Amplitudes, frequency and damping, repeatability and what was left out, in lines."""
        common = self.curves
        a, f, z = (np.asarray(x) for x in (common.amplitude, common.frequency, common.damping))
        order = np.argsort(a)
        low, high = order[0], order[-1]
        unit = f" {common.unit}" if common.unit else ""
        lines = [
            f"{self.name}: {len(self.hits)} recording(s) to fit, {len(self.held_out)} held out; "
            f"{common.quantity} {a[low]:.3g} to {a[high]:.3g}{unit}: {f[low]:.6g} to "
            f"{f[high]:.6g} Hz, damping {100 * z[low]:.3g} to {100 * z[high]:.3g} %"
        ]
        if self.merged is not None:
            f_rms, z_rms = (
                float(np.sqrt(np.mean(np.square(x))))
                for x in (self.merged.frequency_spread, self.merged.damping_spread)
            )
            lines.append(
                f"{self.name}: at equal amplitude the recordings lie {f_rms:.2g} Hz and "
                f"{100 * z_rms:.2g} % damping (rms) about their mean"
            )
        for hit in (*self.hits, *self.held_out):
            if hit.ringdown is not None:
                lines += [f"{self.name}: {hit.name}: {told}" for told in hit.ringdown.remarks]
        return ("\n".join([*lines, *(f"{self.name}: left out {why}" for why in self.skipped)]),)


def measured_modes(study: StudySetup) -> tuple[MeasuredMode, ...]:
    """Curves of every mode that a study's recordings are of.

    Raises
    ------
    InputError
        With the study's line, for a recording that cannot be read or analysed, and where
        nothing is left to fit.
    """
    if not study.recordings:
        raise InputError(
            f"{study.label}: there are no recordings; add for instance recordings: [{{file: "
            "hit1.npz, kind: free_decay, response: {array: response, quantity: velocity}}]"
        )
    bands = bands_of(study)
    found: dict[str | int, dict[str, list[Hit]]] = {
        key: {"fit": [], "hold_out": []} for key in bands
    }
    skipped: dict[str | int, list[str]] = {key: [] for key in bands}
    for entry in study.recordings:
        for key, hit in _hits(study, entry, bands):
            if isinstance(hit, Hit):
                found[key][entry.use].append(hit)
            else:
                skipped[key].append(hit)
    modes = [
        _mode(study, key, band, found[key], skipped[key])
        for key, band in bands.items()
        if found[key]["fit"] or skipped[key] or study.modal
    ]
    if not any(mode.hits for mode in modes):
        reasons = "; ".join(dict.fromkeys(reason for mode in modes for reason in mode.skipped))
        raise InputError(
            f"{study.label}: no recording with use: fit gives curves"
            + (
                f": {reasons}"
                if reasons
                else f"; kinds {', '.join(_GIVING[:-1])} and {_GIVING[-1]} do"
            )
        )
    return tuple(mode for mode in modes if mode.hits)


def _mode(
    study: StudySetup,
    key: str | int,
    band: tuple[float, float],
    hits: dict[str, list[Hit]],
    skipped: Sequence[str],
) -> MeasuredMode:
    if study.modal and not hits["fit"]:
        if skipped:
            raise InputError(skipped[0])
        raise InputError(
            f"{study.label}: no recording with use: fit is of mode {key!r}; add one, or take the "
            "mode out"
        )
    merged = None
    if len(hits["fit"]) > 1:
        try:
            merged = merge_curves([hit.curves for hit in hits["fit"]])
        except InputError:
            # Hits that share no amplitude complement each other, but tell no repeatability.
            merged = None
    return MeasuredMode(
        name=key if isinstance(key, str) else f"mode {key}",
        key=key,
        band=band,
        hits=tuple(hits["fit"]),
        held_out=tuple(hits["hold_out"]),
        skipped=tuple(skipped),
        merged=merged,
    )


def bands_of(study: StudySetup) -> dict[str | int, tuple[float, float]]:
    """Where each mode is looked for, Hz."""
    if study.modal:
        return {mode.name: mode.band for mode in study.modal}
    assert study.structure is not None  # a study has one or the other
    f = np.sqrt(np.asarray(study.structure.basis.omega2)) / (2.0 * np.pi)
    wanted = range(f.size) if study.modes is None else study.modes
    bands: dict[str | int, tuple[float, float]] = {}
    for mode in wanted:
        low, high = (1.0 - REACH) * f[mode], (1.0 + REACH) * f[mode]
        if mode > 0:
            low = max(low, 0.5 * (f[mode - 1] + f[mode]))
        if mode + 1 < f.size:
            high = min(high, 0.5 * (f[mode] + f[mode + 1]))
        bands[mode] = study.bands.get(mode, (float(low), float(high)))
    return bands


def _hits(
    study: StudySetup, entry: RecordingEntry, bands: dict[str | int, tuple[float, float]]
) -> Iterator[tuple[str | int, Hit | str]]:
    """Curves of each mode that an entry is of, or why a recording shows nothing of it."""
    if entry.kind == "curves":
        yield entry.modes[0], Hit(entry.name, read_modal_curves(entry))
        return
    if entry.kind in STEPPED:
        if not study.modal:
            raise InputError(
                f"{entry.place}: {entry.kind} tells the amplitude of one sensor, not of a "
                "structure's mode; give its curves (kind: curves), or model: {modal: ...}"
            )
        # Levels to fit and levels held out are often in one file.
        labels = ", ".join(f"{level:g}" for level in entry.levels or ())
        name = f"{entry.name}[{labels}]" if labels else entry.name
        yield entry.modes[0], Hit(name, read_modal_curves(entry, name))
        return
    if entry.kind not in ("free_decay", "transient"):
        return
    for name, recording in recordings_of(entry):
        for key in (key for key in bands if key in entry.modes):
            yield key, hit_of(study, entry, name, recording, key, bands[key])


def hit_of(
    study: StudySetup,
    entry: RecordingEntry,
    name: str,
    recording: Recording,
    key: str | int,
    band: tuple[float, float],
) -> Hit | str:
    """Curves of a mode by a time history of an entry, or why it shows nothing of it."""
    start, end = _span(entry, recording)
    with blamed(f"{entry.place}: {name}"):
        signal, quantity, unit = _signal(study, entry, recording, key)
    try:
        found = ringdown(
            signal,
            recording.sampling_rate,
            band,
            quantity,
            unit=unit,
            name=name,
            start=start,
            end=end,
            precision=study.ringdown.precision,
            order=study.ringdown.order,
            estimator=study.ringdown.estimator,
        )
    except InputError as error:
        return f"{entry.place if study.modal else ''}: {name}: {error}".lstrip(": ")
    return Hit(name, found.curves, found)


def _span(entry: RecordingEntry, recording: Recording) -> tuple[float | None, float | None]:
    """Where a decay is looked for, s from the recording's first sample.

    The recording itself stays whole: joints with memory go by the largest amplitude so far.
    """
    part = part_of(entry, recording)
    begin = part.time[0] - recording.time[0]
    released = _contact_ends(part)
    start = None if entry.start is None else begin
    if released is not None:
        start = begin + released
    return start, None if entry.end is None else begin + part.duration


def _contact_ends(recording: Recording) -> float | None:
    """When the last force has died down, s; None without force."""
    if recording.force is None or not np.any(recording.force):
        return None
    size = np.max(np.abs(recording.force), axis=1)
    last = int(np.flatnonzero(size > _FORCE_ENDS * size.max())[-1])
    return (last + 1) / recording.sampling_rate


def _signal(
    study: StudySetup, entry: RecordingEntry, recording: Recording, key: str | int
) -> tuple[np.ndarray, str, str]:
    """The mode's signal, what it is, and its unit."""
    quantity = quantity_of(recording)
    if study.modal:
        if recording.response.shape[1] != 1:
            names = ", ".join(channel.name for channel in recording.channels)
            raise InputError(
                f"holds channels {names}; a single mode is measured by one: say response: "
                f"{{channel: {recording.channels[-1].name}}}"
            )
        return recording.response[:, 0], quantity, recording.channels[0].unit
    assert study.structure is not None
    assert isinstance(key, int)
    rows = np.stack([*sensors_of(study, entry, recording).values()])
    shapes = rows @ np.asarray(study.structure.basis.Phi)
    told_apart = modes_apart(shapes, key)
    modal = modal_filter(recording.response, shapes[:, told_apart])
    return modal[:, told_apart.index(key)], quantity, ""


def quantity_of(recording: Recording) -> str:
    """What all channels of a recording measure.

    Raises
    ------
    InputError
        Where they differ, or nothing is known.
    """
    kinds = sorted({channel.quantity for channel in recording.channels})
    if len(kinds) != 1 or kinds[0] not in QUANTITIES:
        raise InputError(
            f"the channels measure {' and '.join(kind or 'nothing known' for kind in kinds)}; "
            f"expected one of {', '.join(QUANTITIES)}: say response: {{quantity: ...}}"
        )
    return kinds[0]


def sensors_of(
    study: StudySetup, entry: RecordingEntry, recording: Recording
) -> dict[str, np.ndarray]:
    """Row (n,) of the model for each channel of a recording, by the sensor's name.

    Raises
    ------
    InputError
        Where channels and sensors differ in number, and for a sensor that the model lacks.
    """
    assert study.model is not None
    sensors = entry.response.sensors or tuple(study.model.sensors)
    if len(sensors) != recording.response.shape[1]:
        raise InputError(
            f"holds {recording.response.shape[1]} channel(s) for {len(sensors)} sensor(s); say "
            "response: {sensors: [...]}, one for each channel"
        )
    for sensor in sensors:
        if sensor not in study.model.sensors:
            known = ", ".join(study.model.sensors) or "none"
            raise InputError(f"sensor {sensor!r} is not in the model; it has {known}")
    return {sensor: study.model.sensors[sensor] for sensor in sensors}


def modes_apart(shapes: np.ndarray, key: int) -> list[int]:
    """As many elastic modes as there are sensors to tell them apart, the wanted one among them.

    Of shapes at the sensors (sensors, modes); modes in which no sensor moves are passed over.
    """
    size = np.linalg.norm(shapes, axis=0)
    nothing = np.sqrt(np.finfo(float).eps) * size.max()
    seen = [mode for mode in range(size.size) if mode == key or size[mode] > nothing]
    count, at = min(len(shapes), len(seen)), seen.index(key)
    first = max(0, min(at - count + 1, len(seen) - count))
    return seen[first : first + count]


def forces_of(study: StudySetup, recording: Recording, place: str, what: str) -> np.ndarray:
    """Forces at all inputs of the model, (N, inputs), zero where none was measured.

    Raises
    ------
    InputError
        Without a force, which ``what`` needs, and for an input that is not in the model.
    """
    assert study.model is not None
    inputs = list(study.model.inputs)
    if recording.force is None:
        raise InputError(f"{place}: has no force; {what} needs it")
    force = np.zeros((recording.force.shape[0], len(inputs)))
    names = [channel.name for channel in recording.inputs]
    for name, column in zip(names, np.asarray(recording.force).T, strict=True):
        if name not in inputs:
            raise InputError(f"{place}: input {name!r} is not in the model: {', '.join(inputs)}")
        force[:, inputs.index(name)] = column
    return force
