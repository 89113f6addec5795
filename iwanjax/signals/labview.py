"""Files of LabVIEW: text (.lvm) by lvm-read, binary (.tdms) by npTDMS (extra ``io``)."""

import math
import warnings
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from iwanjax.errors import InputError, missing_library
from iwanjax.signals.file_record import FileRecord, channel_of, numbered
from iwanjax.signals.text import decoded

_FIRST_LINE = "LabVIEW Measurement"
_X = "X_Value"


def read_lvm(path: Path) -> list[FileRecord]:
    """Segments of a LabVIEW measurement file, each a recording.

    Raises
    ------
    InputError
        Where lvm-read is not installed, and for a file that is cut short or none of LabVIEW's,
        not naming the file.
    """
    text = decoded(path)
    lines = text.splitlines(keepends=True)
    if not lines or not lines[0].startswith(_FIRST_LINE):
        raise InputError(f"does not begin with {_FIRST_LINE!r}; export it again from LabVIEW")
    if not text.endswith("\n"):
        raise InputError("the last row does not end; is the file cut short?")
    named = [line for line in lines[:20] if line.startswith("Separator")]
    comma = any(line.rstrip("\r\n").endswith("Comma") for line in named)
    held = _lvm_read().read_lines(lines, separator="," if comma else "\t")
    known = {
        str(key): value.strip() for key, value in held.items() if key and isinstance(value, str)
    }
    segments = [held[i] for i in range(held["Segments"])]
    return [_segment(each, known) for each in segments if "data" in each]


def _lvm_read() -> ModuleType:
    try:
        import lvm_read
    except ImportError:
        raise missing_library("LabVIEW's .lvm files", "lvm-read", "io") from None
    return lvm_read


def _segment(segment: dict[str, Any], known: dict[str, str]) -> FileRecord:
    """Columns of a segment; its header has one cell for each channel."""
    labels, data = segment["Channel names"], segment["data"]
    if data.ndim != 2 or not data.size:
        raise InputError("a segment has no rows below its header; is the file cut short?")
    count = len(labels) - (1 if labels[-1:] == ["Comment"] else 0)
    samples = [int(n) for n in segment.get("Samples", []) if n == n]
    if samples and len(data) < max(samples):
        raise InputError(
            f"a segment has {len(data)} of its {max(samples)} rows; is the file cut short?"
        )
    columns = [i for i in range(min(count, data.shape[1])) if labels[i] != _X]
    times = [i for i in range(count) if labels[i] == _X]
    names = numbered([labels[i].strip() or f"column {i + 1}" for i in columns])
    units = segment.get("Y_Unit_Label", [])
    arrays = {name: data[:, i] for name, i in zip(names, columns, strict=True)}
    steps = [step for step in segment.get("Delta_X", []) if step == step]
    rate = 1.0 / steps[0] if steps and steps[0] > 0.0 and len(set(steps)) == 1 else None
    first = next((x for x in segment.get("X0", []) if x == x), 0.0)
    if times and np.all(np.isfinite(data[:, times[0]])):
        if any(not np.array_equal(data[:, i], data[:, times[0]]) for i in times[1:]):
            raise InputError(
                "channels have times of their own, which differ; export them on one time axis"
            )
        arrays = {"time": _time(data[:, times[0]], rate), **arrays}
    elif rate is not None:
        arrays = {"time": first + np.arange(len(data)) / rate, **arrays}
    channels = {
        name: channel_of(name, units[i].strip() if i < len(units) else "")
        for i, name in enumerate(names)
    }
    return FileRecord(arrays, channels, metadata=known)


def _time(column: np.ndarray, rate: float | None) -> np.ndarray:
    """A column of times, exact where its values are those of the segment's step, rounded."""
    if rate is None:
        return column
    exact = column[0] + np.arange(column.size) / rate
    return exact if np.all(np.abs(column - exact) * rate < 0.5) else column


def read_tdms(path: Path) -> list[FileRecord]:
    """Groups of a TDMS file, each a recording.

    Raises
    ------
    InputError
        Where npTDMS is not installed, for a file that is cut short, and for channels of one
        group that differ in rate, not naming the file.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        file = _nptdms().TdmsFile.read(str(path))
    if file.file_status.incomplete_final_segment:
        raise InputError("the last segment is not complete; is the file cut short?")
    of_file = _told_properties(file.properties)
    groups = [each for each in file.groups() if any(len(c) for c in each.channels())]
    if not groups:
        raise InputError("no channel holds values")
    return [_group(group, of_file) for group in groups]


def _nptdms() -> ModuleType:
    try:
        import nptdms
    except ImportError:
        raise missing_library("LabVIEW's .tdms files", "npTDMS", "io") from None
    return nptdms


def _group(group: Any, of_file: dict[str, str]) -> FileRecord:
    arrays: dict[str, np.ndarray] = {}
    channels, grids = {}, {}
    for each in group.channels():
        values = np.asarray(each[:])
        if values.dtype.kind == "M":
            values = (values - values[0]) / np.timedelta64(1, "s") if values.size else values
        arrays[each.name] = values
        unit = each.properties.get("unit_string") or each.properties.get("NI_UnitDescription", "")
        channels[each.name] = channel_of(each.name, str(unit))
        if (step := each.properties.get("wf_increment")) is not None:
            grids[each.name] = (float(step), float(each.properties.get("wf_start_offset", 0.0)))
    if len(set(grids.values())) > 1:
        told = ", ".join(f"{name} every {step:g} s" for name, (step, _) in grids.items())
        raise InputError(
            f"group {group.name!r} has channels of several rates, {told}; export each rate in a "
            "group of its own"
        )
    metadata = of_file | _told_properties(group.properties)
    if not grids:
        return FileRecord(arrays, channels, metadata=metadata, name=group.name)
    step, first = next(iter(grids.values()))
    if not 0.0 < step < math.inf:
        raise InputError(f"group {group.name!r} has steps of {step:g} s; expected a positive one")
    count = len(arrays[next(iter(grids))])
    time = {} if "time" in arrays else {"time": first + step * np.arange(count)}
    return FileRecord({**time, **arrays}, channels, metadata=metadata, name=group.name)


def _told_properties(properties: dict[str, Any]) -> dict[str, str]:
    return {str(name): str(value) for name, value in properties.items()}
