"""MATLAB exports of Simcenter (LMS) Test.Lab: structs of x_values, y_values, function_record."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from iwanjax.errors import InputError
from iwanjax.files import Node
from iwanjax.signals.file_record import FileRecord, numbered, quantity_of
from iwanjax.signals.recording import Channel

_FIELDS = {"x_values", "y_values"}


def testlab_records(nodes: Mapping[str, Node]) -> list[FileRecord]:
    """The exported signals, those on one time axis as one recording; empty where there are none.

    Raises
    ------
    InputError
        For a signal that is no time history, not naming the file.
    """
    runs: dict[tuple[float, ...], dict[str, tuple[np.ndarray, Channel]]] = {}
    for label, signal in _signals(nodes):
        time, columns = _signal(label, signal)
        run = runs.setdefault(time, {})
        names = numbered([*run, *(channel.name for _, channel in columns)])[len(run) :]
        for name, (values, channel) in zip(names, columns, strict=True):
            run[name] = values, Channel(name, channel.quantity, channel.unit)
    return [
        FileRecord(
            {
                "time": start + step * np.arange(int(count)),
                **{name: values for name, (values, _) in run.items()},
            },
            {name: channel for name, (_, channel) in run.items()},
        )
        for (start, step, count), run in runs.items()
    ]


def _signals(nodes: Mapping[str, Node]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    for name, node in nodes.items():
        entries = node.flat if isinstance(node, np.ndarray) and node.dtype.kind == "O" else [node]
        for entry in entries:
            if isinstance(entry, dict) and entry.keys() >= _FIELDS:
                yield name, entry


def _signal(
    label: str, signal: Mapping[str, Any]
) -> tuple[tuple[float, float, float], list[tuple[np.ndarray, Channel]]]:
    """Start, step and number of the samples, and the columns with what they are."""
    x, y = signal["x_values"], signal["y_values"]
    start, step, count = (
        _number(x, key, label) for key in ("start_value", "increment", "number_of_values")
    )
    unit = _text(x, "quantity", "label")
    if unit not in ("s", ""):
        raise InputError(f"{label} is against {unit}; expected a time history, against s")
    values = y.get("values") if isinstance(y, dict) else None
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "biuf":
        raise InputError(f"{label}.y_values.values is missing; expected real numbers")
    columns = values.reshape(values.shape[0], -1)
    columns = columns if len(columns) == count else columns.T
    if len(columns) != count:
        raise InputError(
            f"{label}.y_values.values has shape {values.shape}; expected {count:.0f} values, as "
            "x_values says"
        )
    record = signal.get("function_record")
    names = [_text(each, "name") for each in _structs(record)]
    if len(names) != columns.shape[1] or not all(names):
        names = [label] if columns.shape[1] == 1 else _counted(label, columns.shape[1])
    unit = _text(y, "quantity", "label")
    return (start, step, count), [
        (column, Channel(name, quantity_of(unit), unit))
        for column, name in zip(columns.T, names, strict=True)
    ]


def _counted(label: str, count: int) -> list[str]:
    return [f"{label}[{i}]" for i in range(count)]


def _structs(node: Any) -> list[Any]:
    return list(node.flat) if isinstance(node, np.ndarray) else [node]


def _number(struct: Any, key: str, label: str) -> float:
    node = struct.get(key) if isinstance(struct, dict) else None
    if not isinstance(node, np.ndarray) or node.size != 1 or node.dtype.kind not in "biuf":
        raise InputError(f"{label}.x_values.{key} is missing; expected a number")
    return float(node.ravel()[0])


def _text(struct: Any, *keys: str) -> str:
    """Text at the end of a chain of fields; empty where there is none."""
    for key in keys:
        struct = struct.get(key) if isinstance(struct, dict) else None
    if isinstance(struct, np.ndarray) and struct.dtype.kind == "U" and struct.size:
        return str(struct.ravel()[0]).strip()
    return ""
