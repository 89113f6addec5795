"""From a study's recordings to the measured curves of its modes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from iwanjax.config import RecordingEntry, Study
from iwanjax.curves import QUANTITIES, ModalCurves
from iwanjax.errors import InputError
from iwanjax.signals import (
    MergedCurves,
    Recording,
    RingDown,
    merge_curves,
    modal_filter,
    read_curves,
    read_force_control,
    read_recordings,
    read_response_control,
    ringdown,
)

# Where a mode of a structure is looked for, as share of its frequency, unless neighbours are
# nearer; and how far a force has fallen, as share of its peak, when the contact is over.
_REACH = 0.25
_FORCE_ENDS = 0.01
# Stepped sines, by what is held.
_STEPPED = {"response_control": read_response_control, "force_control": read_force_control}
# Recordings that give curves of a mode.
_GIVING = ("free_decay", "transient", "curves", *_STEPPED)


@dataclass(frozen=True, eq=False)
class Hit:
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
class MeasuredMode:
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


def measured_modes(study: Study) -> tuple[MeasuredMode, ...]:
    """Curves of every mode that a study's recordings are of.

    Raises
    ------
    InputError
        With the study's line, for a recording that cannot be read or analysed, and where
        nothing is left to fit.
    """
    if not study.recordings:
        raise InputError(
            f"{study.path}: there are no recordings; add for instance recordings: [{{file: "
            "hit1.npz, kind: free_decay, response: {array: response, quantity: velocity}}]"
        )
    bands = _bands(study)
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
            f"{study.path}: no recording with use: fit gives curves"
            + (
                f": {reasons}"
                if reasons
                else f"; kinds {', '.join(_GIVING[:-1])} and {_GIVING[-1]} do"
            )
        )
    return tuple(mode for mode in modes if mode.hits)


def _mode(
    study: Study,
    key: str | int,
    band: tuple[float, float],
    hits: dict[str, list[Hit]],
    skipped: Sequence[str],
) -> MeasuredMode:
    if study.modal and not hits["fit"]:
        raise InputError(
            f"{study.path}: no recording with use: fit is of mode {key!r}; add one, or take the "
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


def _bands(study: Study) -> dict[str | int, tuple[float, float]]:
    """Where each mode is looked for, Hz."""
    if study.modal:
        return {mode.name: mode.band for mode in study.modal}
    assert study.structure is not None  # a study has one or the other
    f = np.sqrt(np.asarray(study.structure.basis.omega2)) / (2.0 * np.pi)
    wanted = range(f.size) if study.modes is None else study.modes
    bands: dict[str | int, tuple[float, float]] = {}
    for mode in wanted:
        low, high = (1.0 - _REACH) * f[mode], (1.0 + _REACH) * f[mode]
        if mode > 0:
            low = max(low, 0.5 * (f[mode - 1] + f[mode]))
        if mode + 1 < f.size:
            high = min(high, 0.5 * (f[mode] + f[mode + 1]))
        bands[mode] = study.bands.get(mode, (float(low), float(high)))
    return bands


def _hits(
    study: Study, entry: RecordingEntry, bands: dict[str | int, tuple[float, float]]
) -> Iterator[tuple[str | int, Hit | str]]:
    """Curves of each mode that an entry is of, or why a recording shows nothing of it."""
    if entry.kind == "curves":
        curves = _blamed(entry, lambda: read_curves(entry.path, name=entry.name))
        yield entry.modes[0], Hit(entry.name, curves)
        return
    if entry.kind in _STEPPED:
        if not study.modal:
            raise InputError(
                f"{entry.place}: {entry.kind} tells the amplitude of one sensor, not of a "
                "structure's mode; give its curves (kind: curves), or model: {modal: ...}"
            )
        # Levels to fit and levels held out are often in one file.
        labels = ", ".join(f"{level:g}" for level in entry.levels or ())
        name = f"{entry.name}[{labels}]" if labels else entry.name
        curves = _blamed(entry, lambda: _STEPPED[entry.kind](entry.path, entry.levels, name=name))
        yield entry.modes[0], Hit(name, curves)
        return
    if entry.kind not in ("free_decay", "transient"):
        return
    recordings = _blamed(entry, lambda: _recordings(entry))
    for i, recording in recordings:
        name = entry.name if len(recordings) == 1 else f"{entry.name}[{i}]"
        start = entry.start if entry.start is not None else _contact_ends(recording)
        for key in (key for key in bands if key in entry.modes):
            try:
                signal, quantity, unit = _signal(study, entry, recording, key)
            except InputError as error:
                raise InputError(f"{entry.place}: {name}: {error}") from None
            try:
                found = ringdown(
                    signal,
                    recording.sampling_rate,
                    bands[key],
                    quantity,
                    unit=unit,
                    name=name,
                    start=start,
                    end=entry.end,
                    precision=study.ringdown.precision,
                    order=study.ringdown.order,
                )
            except InputError as error:
                if study.modal:
                    raise InputError(f"{entry.place}: {name}: {error}") from None
                yield key, f"{name}: {error}"
            else:
                yield key, Hit(name, found.curves, found)


def recordings_of(entry: RecordingEntry) -> list[Recording]:
    """All recordings of an entry, faults told with its place in the study."""
    return [recording for _, recording in _blamed(entry, lambda: _recordings(entry))]


def _recordings(entry: RecordingEntry) -> list[tuple[int, Recording]]:
    response = entry.response
    options: dict = {
        "variable": entry.variable,
        "sampling_rate": entry.sampling_rate,
        "quantity": response.quantity or "",
        "unit": response.unit,
    }
    if entry.kind == "free_decay":
        options["force"] = []
    elif entry.force is not None:
        options |= {"force": entry.force.array, "inputs": entry.force.inputs or None}
    labels = response.channels or response.sensors or None
    if response.array is not None or not response.channels:
        found = read_recordings(entry.path, response=response.array, channels=labels, **options)
    else:
        try:
            found = read_recordings(entry.path, response=list(response.channels), **options)
        except InputError:
            # A file without names for its channels: the study names them.
            found = read_recordings(entry.path, channels=labels, **options)
    indices = range(len(found)) if entry.index is None else entry.index
    for i in indices:
        if i >= len(found):
            raise InputError(f"index {i}: the file holds {len(found)} recording(s), counted from 0")
    return [(i, found[i]) for i in indices]


def _contact_ends(recording: Recording) -> float | None:
    """When the last force has died down, s; None without force."""
    if recording.force is None or not np.any(recording.force):
        return None
    size = np.max(np.abs(recording.force), axis=1)
    last = int(np.flatnonzero(size > _FORCE_ENDS * size.max())[-1])
    return (last + 1) / recording.sampling_rate


def _signal(
    study: Study, entry: RecordingEntry, recording: Recording, key: str | int
) -> tuple[np.ndarray, str, str]:
    """The mode's signal, what it is, and its unit."""
    kinds = sorted({channel.quantity for channel in recording.channels})
    if len(kinds) != 1 or kinds[0] not in QUANTITIES:
        raise InputError(
            f"the channels measure {' and '.join(kind or 'nothing known' for kind in kinds)}; "
            f"expected one of {', '.join(QUANTITIES)}: say response: {{quantity: ...}}"
        )
    if study.modal:
        if recording.response.shape[1] != 1:
            names = ", ".join(channel.name for channel in recording.channels)
            raise InputError(
                f"holds channels {names}; a single mode is measured by one: say response: "
                f"{{channel: {recording.channels[-1].name}}}"
            )
        return recording.response[:, 0], kinds[0], recording.channels[0].unit
    assert study.model is not None
    assert study.structure is not None
    sensors = entry.response.sensors or tuple(study.model.sensors)
    if len(sensors) != recording.response.shape[1]:
        raise InputError(
            f"holds {recording.response.shape[1]} channel(s) for {len(sensors)} sensor(s); say "
            "response: {sensors: [...]}, one for each channel"
        )
    rows = np.stack([study.model.sensors[sensor] for sensor in sensors])
    Phi = np.asarray(study.structure.basis.Phi)
    # As many modes as there are sensors to tell them apart, the wanted one among them.
    count = min(len(sensors), Phi.shape[1])
    assert isinstance(key, int)
    first = max(0, min(key - count + 1, Phi.shape[1] - count)) if key >= count else 0
    modal = modal_filter(recording.response, rows @ Phi[:, first : first + count])
    return modal[:, key - first], kinds[0], ""


def _blamed(entry: RecordingEntry, read):
    """What reading gives, its faults told with the study's line."""
    try:
        return read()
    except InputError as error:
        raise InputError(f"{entry.place}: {error}") from None
