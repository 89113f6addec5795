"""Which of a record's arrays are time, response and force, and what they are called."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from pathlib import Path

import numpy as np

from iwanjax.errors import InputError
from iwanjax.files import Node, Unreadable, nearest
from iwanjax.signals.file_record import FileRecord, channel_of, quantity_of
from iwanjax.signals.labels import (
    CHANNEL_NAMES,
    INPUT_NAMES,
    UNITS,
    rate_beside,
    remarks,
    texts_beside,
)
from iwanjax.signals.recording import Channel, Recording, check_time, sampling_rate

# Names of a time axis besides the one that is asked for: t, Time, time_s, time (s), t [s].
_TIME = re.compile(
    r"(time|t)([ _]*[(\[]?(?P<unit>s|sec|seconds|ms|us|µs|min)[)\]]?)?", re.IGNORECASE
)
# What NumPy calls units of time that are no seconds.
_TIMES = {"ms": "ms", "us": "us", "µs": "us", "min": "m"}
_QUANTITIES = {
    "acceleration": re.compile(r"(?i:acc(el(eration)?)?)[xyz]?(?![a-z])"),
    "velocity": re.compile(r"(?i:vel(ocity)?)[xyz]?(?![a-z])"),
    "displacement": re.compile(r"(?i:disp(l(acement)?)?)[xyz]?(?![a-z])"),
}
# How far a given rate may be from that of the time axis.
_SAME_RATE = 1e-3
# Steps of a time axis that differ by less are one step, rounded when it was written.
_ROUNDED = 0.5
_MOST_TOLD = 12


@dataclass(frozen=True)
class Selection:
    """What to take from a file and how to call it; see :func:`iwanjax.signals.read_recordings`."""

    time: str = "time"
    response: str | Sequence[str] | None = None
    force: str | Sequence[str] | None = None
    sampling_rate: float | None = None
    channels: Sequence[str] | None = None
    inputs: Sequence[str] | None = None
    quantity: str = ""
    unit: str = ""

    def __post_init__(self):
        rate = self.sampling_rate
        if rate is not None and not (isinstance(rate, Real) and 0.0 < rate < np.inf):
            raise InputError(f"sampling_rate is {rate!r}; expected a positive number in Hz")


@dataclass(frozen=True, eq=False)
class RawRecording:
    """Arrays of one recording, before anything is said about their values.

    Attributes
    ----------
    path : Path
        The file's, with the recording's number: the place that messages name.
    time, response, force, channels, inputs, metadata
        As in :class:`iwanjax.signals.Recording`.
    """

    path: Path
    time: np.ndarray
    response: np.ndarray
    channels: tuple[Channel, ...]
    force: np.ndarray | None
    inputs: tuple[Channel, ...]
    metadata: Mapping[str, str]

    def recording(self) -> Recording:
        """The checked recording; its faults are told with the file's folder."""
        name = self.path.name
        try:
            return Recording(
                self.time,
                self.response,
                self.channels,
                self.force,
                self.inputs,
                name,
                self.metadata,
            )
        except InputError as error:
            raise InputError(f"{self.path}{str(error).removeprefix(name)}") from None


def select(path: Path, record: FileRecord, selection: Selection) -> RawRecording:
    """What is selected among named arrays, with time along the first axis.

    Parameters
    ----------
    path : Path
        For the result.
    record : FileRecord
        Arrays (N,), (N, k), (k, N); among them may be scalars, text and structs.
    selection : Selection

    Raises
    ------
    InputError
        One line naming the array; not the file.
    """
    fields = record.arrays
    time_name = _time_name(fields, selection.time)
    taken = {time_name, *listed(selection.response), *listed(selection.force)}
    forces = listed(selection.force)
    if selection.force is None:
        forces = [
            name
            for name, node in fields.items()
            if _is_force(name, record) and name not in taken and is_series(node)
        ]
    responses = listed(selection.response)
    if selection.response is None:
        responses = ["response"] if "response" in fields else _implied(fields, {*taken, *forces})
    if not responses:
        raise InputError(f"no response; {held(fields)}; name it by response=")
    arrays = {name: _array(fields, name) for name in (*responses, *forces)}
    time = _time(record, time_name, arrays[responses[0]], selection)
    response, names = _stacked(arrays, responses, time)
    beside = texts_beside(fields, CHANNEL_NAMES, len(names)) if len(responses) == 1 else None
    labels = _renamed(names, selection.channels or beside, "channels", "response")
    units = texts_beside(fields, UNITS, len(names)) if len(responses) == 1 else None
    if units is None or any("," in unit for unit in units):  # of all channels in one text
        units = [""] * len(names)
    channels = tuple(
        _channel(name, label, unit, record, selection)
        for name, label, unit in zip(names, labels, units, strict=True)
    )
    metadata = {**remarks(fields), **record.metadata}
    if not forces:
        if selection.inputs:
            raise InputError(f"inputs names {len(selection.inputs)} forces but none is there")
        return RawRecording(path, time, response, channels, None, (), metadata)
    force, names = _stacked(arrays, forces, time)
    beside = texts_beside(fields, INPUT_NAMES, len(names)) if len(forces) == 1 else None
    labels = _renamed(names, selection.inputs or beside, "inputs", "force")
    inputs = tuple(
        Channel(label, "force", said.unit, said.direction)
        for label, said in zip(labels, (_said(name, record) for name in names), strict=True)
    )
    return RawRecording(path, time, response, channels, force, inputs, metadata)


def _is_force(name: str, record: FileRecord) -> bool:
    said = record.channels.get(name)
    return name.lower().startswith("force") or (said is not None and said.quantity == "force")


def _said(name: str, record: FileRecord) -> Channel:
    """What the file says of a channel, by its name; a unit in brackets at its end counts."""
    return record.channels.get(name) or channel_of(name)


def _channel(name: str, label: str, unit: str, record: FileRecord, selection: Selection) -> Channel:
    """A response: what is asked for, else what the file says, else what its name tells."""
    said = _said(name, record)
    known = selection.quantity or said.quantity or _quantity(name) or _quantity(label)
    # A unit that is asked for is a label, that of the file says what was measured.
    return Channel(
        label, known or quantity_of(unit), selection.unit or unit or said.unit, said.direction
    )


def told_node(node: Node) -> str:
    """Kind and shape of what a name stands for, for messages."""
    if isinstance(node, Unreadable):
        return "unreadable"
    if isinstance(node, dict):
        return f"struct or group of {', '.join(node) or 'nothing'}"
    shape = " x ".join(map(str, node.shape)) or "one"
    if node.dtype.kind == "O":
        structs = node.size and all(isinstance(entry, dict) for entry in node.flat)
        return f"{shape} {'structs' if structs else 'cell'}"
    if node.dtype.kind == "U":
        return "text" if node.size == 1 else f"{shape} text"
    return f"{shape} {node.dtype}"


def held(fields: Mapping[str, Node]) -> str:
    """What was found instead, for messages."""
    told = [f"{name} ({told_node(node)})" for name, node in fields.items()]
    more = ", ..." if len(told) > _MOST_TOLD else ""
    return f"found {', '.join(told[:_MOST_TOLD]) or 'nothing'}{more}"


def is_series(node: Node) -> bool:
    """Whether it may be a time history: real numbers, more than one."""
    return isinstance(node, np.ndarray) and node.dtype.kind in "biuf" and node.size > 1


def listed(names: str | Sequence[str] | None) -> list[str]:
    """One name or several as a list."""
    return [names] if isinstance(names, str) else list(names or ())


def has_time(fields: Mapping[str, Node], wanted: str) -> bool:
    """Whether there is a time axis of the wanted name or a usual one."""
    return wanted in fields or _usual_time(fields) is not None


def _usual_time(fields: Mapping[str, Node]) -> str | None:
    # A struct may hold a scalar t beside its vectors.
    return next((n for n, v in fields.items() if _TIME.fullmatch(n) and is_series(v)), None)


def _time_name(fields: Mapping[str, Node], wanted: str) -> str | None:
    if wanted in fields:
        return wanted
    if wanted != Selection.time:
        raise InputError(f"no time {wanted!r}; {held(fields)}{nearest(wanted, fields)}")
    return _usual_time(fields)


def _implied(fields: Mapping[str, Node], taken: set[str | None]) -> list[str]:
    """Every series that is neither time nor force; scalars, text and structs are remarks."""
    found = []
    for name, node in fields.items():
        if name in taken or not isinstance(node, np.ndarray) or node.dtype.kind not in "biuf":
            continue
        if not node.size:
            raise InputError(f"{name} is empty; fill it, or name the channels by response=")
        if node.size > 1 and not _TIME.fullmatch(name):
            found.append(name)
    return found


def _array(fields: Mapping[str, Node], name: str) -> np.ndarray:
    """A named time history, with its own axes."""
    if name not in fields:
        raise InputError(f"no {name!r}; {held(fields)}{nearest(name, fields)}")
    node = fields[name]
    if isinstance(node, Unreadable):
        raise InputError(f"{name} {node.reason}")
    if not (isinstance(node, np.ndarray) and node.dtype.kind in "biuf" and 1 <= node.ndim <= 2):
        raise InputError(f"{name} is {told_node(node)}; expected numbers, (N,) or (N, channels)")
    if not node.size:
        raise InputError(f"{name} is empty; expected numbers")
    return node


def _time(
    record: FileRecord, name: str | None, response: np.ndarray, selection: Selection
) -> np.ndarray:
    fields = record.arrays
    rate = selection.sampling_rate or record.sampling_rate
    if name is None:
        rate = rate or rate_beside(fields)
        if rate is None:
            raise InputError(
                f"no array {selection.time!r}; {held(fields)}; name it by time=, or give "
                "sampling_rate= in Hz"
            )
        # Without a time axis, the longer one of the response is it.
        if response.ndim == 2 and response.shape[0] == response.shape[1]:
            raise InputError(
                f"response has shape {response.shape}, which leaves open along which axis time "
                "runs; add an array time"
            )
        return np.arange(max(response.shape)) / rate
    array = _array(fields, name)
    if max(array.shape) != array.size:
        raise InputError(f"{name} has shape {array.shape}; expected one axis, (N,)")
    time = array.ravel().astype(np.float64) * _seconds(name, record)
    return time if rate is None else _reconciled(time, rate)


def _seconds(name: str, record: FileRecord) -> float:
    """Seconds of the time axis's unit, which its name or the file may say."""
    in_name = _TIME.fullmatch(name)
    unit = (in_name["unit"] if in_name else None) or (
        record.channels[name].unit if name in record.channels else ""
    )
    return float(np.timedelta64(1, _TIMES.get(unit.lower(), "s")) / np.timedelta64(1, "s"))


def _reconciled(time: np.ndarray, rate: float) -> np.ndarray:
    """A time axis that has the given rate; if its values are only rounded, they are made exact."""
    if len(time) < 2 or not np.all(np.isfinite(time)) or time[-1] <= time[0]:
        return time  # a fault that the recording tells
    own = sampling_rate(time)
    if abs(own / rate - 1.0) > _SAME_RATE:
        raise InputError(
            f"time gives {own:.6g} Hz but sampling_rate is {rate:.6g} Hz; correct or leave out one"
        )
    try:
        check_time(time)
    except InputError:
        if np.all(np.abs(np.diff(time) * rate - 1.0) < _ROUNDED):
            return time[0] + np.arange(len(time)) / rate
    return time


def _stacked(
    arrays: Mapping[str, np.ndarray], names: Sequence[str], time: np.ndarray
) -> tuple[np.ndarray, list[str]]:
    """Arrays side by side, (N, columns), and the columns' names."""
    stacked, labels = [], []
    for name in names:
        array = arrays[name].astype(np.float64)
        if array.ndim == 1:
            array = array[:, None]
        elif len(array) != len(time):
            array = array.T
        if len(array) != len(time):
            raise InputError(
                f"{name} has shape {arrays[name].shape} but there are {len(time)} times; cut all "
                "to one length, or name what to take by response= and force="
            )
        count = array.shape[1]
        labels += [name] if count == 1 else [f"{name}[{i}]" for i in range(count)]
        stacked.append(array)
    return np.hstack(stacked), labels


def _renamed(names: list[str], given: Sequence[str] | None, key: str, what: str) -> Sequence[str]:
    if given is None:
        return names
    if isinstance(given, str) or len(given) != len(names):
        raise InputError(
            f"{key} is {given!r} but {what} has {len(names)} column(s): {', '.join(names)}; give a "
            "list with one name for each"
        )
    return given


def _quantity(name: str) -> str:
    """What an obvious name measures; empty for others."""
    return next((quantity for quantity, form in _QUANTITIES.items() if form.match(name)), "")
