"""What a study's recordings hold: from memory, or read from their files."""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from iwanjax.config.recordings import RecordingEntry
from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.signals import (
    ForceLoop,
    Recording,
    read_curves,
    read_force_control,
    read_loop,
    read_recordings,
    read_response_control,
)
from iwanjax.signals.recording import FEWEST_SAMPLES, JITTER

STEPPED: dict[str, Callable[..., ModalCurves]] = {
    "response_control": read_response_control,
    "force_control": read_force_control,
}
"""Readers of stepped sines, by what is held."""


@contextlib.contextmanager
def blamed(place: str) -> Iterator[None]:
    """What the library refuses in the block, as a fault of the place in the study."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{place}: {error}") from None


def recordings_of(entry: RecordingEntry) -> list[tuple[str, Recording]]:
    """All time histories of an entry by name, each from its beginning to its end, less its offsets.

    Faults name the entry's place in the study.
    """
    if isinstance(entry.data, Recording):
        return [(entry.name, entry.data)]
    with blamed(entry.place):
        read = _read(entry)
    found = [(i, _without_offsets(entry, recording)) for i, recording in read]
    if len(found) == 1:
        return [(entry.name, found[0][1])]
    return [(f"{entry.name}[{i}]", recording) for i, recording in found]


def part_of(entry: RecordingEntry, recording: Recording) -> Recording:
    """What an entry's ``from`` and ``to`` leave of a recording, responses and forces alike.

    Raises
    ------
    InputError
        For a time that the recording does not reach, and a part that is too short for one.
    """
    time, step = recording.time, 1.0 / recording.sampling_rate
    given = {"from": entry.start, "to": entry.end}
    for key, value in given.items():
        # The last sample lasts one step.
        if value is not None and not time[0] - step <= value <= time[-1] + step:
            raise InputError(
                f"{entry.places[key]}: got {value:g} s; the recording lasts from {time[0]:g} to "
                f"{time[-1]:g} s"
            )
    # Rounded times are as good as those on the samples.
    first = 0 if entry.start is None else np.searchsorted(time, entry.start - JITTER * step)
    last = None if entry.end is None else np.searchsorted(time, entry.end + JITTER * step)
    kept = slice(first, last)
    if (count := len(time[kept])) < FEWEST_SAMPLES:
        raise InputError(
            f"{entry.places['from' if entry.start is not None else 'to']}: leaves {count} "
            f"sample(s); expected at least {FEWEST_SAMPLES}"
        )
    if count == len(time):
        return recording
    with blamed(entry.place):
        return replace(
            recording,
            time=time[kept],
            response=recording.response[kept],
            force=None if recording.force is None else recording.force[kept],
        )


def _without_offsets(entry: RecordingEntry, recording: Recording) -> Recording:
    """A recording whose channels show nothing where nothing moves or acts."""
    of_response = entry.response.offset
    of_force = entry.force.offset if entry.force else ()
    if not of_response and not of_force:
        return recording
    part = part_of(entry, recording)
    response = recording.response - _shown_at_rest(entry, "response", of_response, part.response)
    force = recording.force
    if force is not None and part.force is not None:
        force = force - _shown_at_rest(entry, "force", of_force, part.force)
    return replace(recording, response=response, force=force)


def _shown_at_rest(
    entry: RecordingEntry, key: str, given: Literal["mean"] | tuple[float, ...], part: np.ndarray
) -> np.ndarray:
    """Offsets of the channels, (channels,)."""
    if given == "mean":
        return part.mean(axis=0)
    count = part.shape[1]
    if given and len(given) != count:
        raise InputError(
            f"{entry.place}: {key}: offset: got {len(given)} number(s) for {count} channel(s); "
            "expected one each, or mean"
        )
    return np.array(given or [0.0] * count)


def read_modal_curves(entry: RecordingEntry, name: str = "") -> ModalCurves:
    """Curves of a mode, or what stepped sines say of it; faults likewise."""
    if isinstance(entry.data, ModalCurves):
        return entry.data
    with blamed(entry.place):
        if entry.kind in STEPPED:
            return STEPPED[entry.kind](_file(entry), entry.levels, name=name)
        return read_curves(_file(entry), name=entry.name)


def read_force_loop(entry: RecordingEntry) -> ForceLoop:
    """A joint's loop; faults likewise."""
    if isinstance(entry.data, ForceLoop):
        return entry.data
    with blamed(entry.place):
        return read_loop(
            _file(entry),
            name=entry.name,
            displacement=entry.response.channels[0] if entry.response.channels else "displacement",
            force=(entry.force.array if entry.force else None) or "force",
            sampling_rate=entry.sampling_rate,
            unit=entry.response.unit,
            force_unit=entry.force.unit if entry.force else "",
            channels=entry.channels,
        )


def _file(entry: RecordingEntry) -> Path:
    # An entry has a file or data of its kind.
    assert entry.path is not None
    return entry.path


def _read(entry: RecordingEntry) -> list[tuple[int, Recording]]:
    path, response = _file(entry), entry.response
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
        found = read_recordings(path, response=response.array, channels=labels, **options)
    else:
        try:
            found = read_recordings(path, response=list(response.channels), **options)
        except InputError:
            # A file without names for its channels: the study names them.
            found = read_recordings(path, channels=labels, **options)
    indices = range(len(found)) if entry.index is None else entry.index
    for i in indices:
        if i >= len(found):
            raise InputError(f"index {i}: the file holds {len(found)} recording(s), counted from 0")
    return [(i, found[i]) for i in indices]
