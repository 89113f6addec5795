"""Which parts of a file are recordings."""

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from iwanjax.errors import InputError
from iwanjax.files import Node, Unreadable, nearest
from iwanjax.signals.file_record import FileRecord
from iwanjax.signals.formats import is_container, read_file
from iwanjax.signals.selection import (
    RawRecording,
    Selection,
    has_time,
    held,
    is_series,
    listed,
    select,
    told_node,
)
from iwanjax.signals.tabular import table_record
from iwanjax.signals.testlab import testlab_records


@dataclass(frozen=True, eq=False)
class Record:
    """A part of a file that should be one recording.

    Attributes
    ----------
    path : Path
        The file's, with the record's number where the file holds several.
    content : dict of str to Node, or (k,) array of Nodes
        Named arrays, or a row of a MATLAB cell: time, response, scalars.
    cell : str
        For a row, the cell's name.
    row : int
        For a row, which one, counted from 0.
    said : FileRecord or None
        What else the file says of the arrays.
    """

    path: Path
    content: Mapping[str, Node] | np.ndarray
    cell: str = ""
    row: int = 0
    said: FileRecord | None = None

    def select(self, selection: Selection) -> RawRecording:
        """The arrays that are selected, in float64 and with time along the first axis.

        Raises
        ------
        InputError
            One line naming the file and the array.
        """
        with blamed(self.path):
            content = self.content
            if isinstance(content, np.ndarray):
                content = _row_fields(content, self.cell, self.row + 1)
            return select(self.path, self.said or FileRecord(content), selection)


def records(path: Any, variable: str | None, selection: Selection) -> list[Record]:
    """The records of a file.

    Parameters
    ----------
    path : str, Path or table
        A file of any kind that is read, or a table of pandas or xarray.
    variable : str or None
        The struct, group or cell that holds them; found where None.
    selection : Selection
        What will be taken.

    Raises
    ------
    InputError
        When the file cannot be read, or it is not clear where in it the recordings are.
    """
    if not isinstance(path, str | Path):
        return [_of(Path(type(path).__name__), table_record(path))]
    path, found = read_file(path)
    nodes = dict(found[0].arrays) if is_container(path) else {}
    with blamed(path):
        if is_container(path):
            found = testlab_records(nodes)
        if found:
            return _numbered_records(path, found, variable)
        return _records(path, *_holder(nodes, variable, selection))


def _of(path: Path, record: FileRecord) -> Record:
    return Record(path, record.arrays, said=record)


def _numbered_records(path: Path, found: list[FileRecord], variable: str | None) -> list[Record]:
    """Records of a file, or that group of it which is asked for."""
    if variable is not None:
        names = [each.name for each in found if each.name]
        if variable not in names:
            what = f"groups {', '.join(names)}" if names else "columns only"
            raise InputError(
                f"variable {variable!r} is asked for, but the file has {what}; name channels by "
                f"response={nearest(variable, names)}"
            )
        found = [each for each in found if each.name == variable]
    return [_of(_numbered(path, i, len(found)), each) for i, each in enumerate(found)]


@contextlib.contextmanager
def blamed(path: Path) -> Iterator[None]:
    """Faults in the block are told with the place."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _holder(
    nodes: dict[str, Node], variable: str | None, selection: Selection
) -> tuple[str, Mapping[str, Node] | np.ndarray]:
    """The struct, group or cell with the recordings, and its name; the file itself has none."""
    if variable is not None:
        if variable not in nodes:
            raise InputError(f"no variable {variable!r}; {held(nodes)}{nearest(variable, nodes)}")
        node = nodes[variable]
        if isinstance(node, Unreadable):
            raise InputError(f"{variable} {node.reason}")
        if isinstance(node, np.ndarray) and node.dtype.kind != "O":
            raise InputError(
                f"variable {variable!r} is {told_node(node)}; expected a struct, a group or a "
                f"cell; take an array by response={variable!r}"
            )
        return variable, node
    if _is_record(nodes, selection):
        return "", nodes
    found = {
        name: node
        for name, node in nodes.items()
        if (isinstance(node, dict) and _is_record(node, selection))
        or (isinstance(node, np.ndarray) and _is_cell_of_records(node, selection))
    }
    if len(found) > 1:
        raise InputError(
            f"{len(found)} variables may be recordings: {', '.join(found)}; choose one by variable="
        )
    if found:
        return next(iter(found.items()))
    if any(map(is_series, nodes.values())):
        return "", nodes
    raise InputError(
        f"no recording; {held(nodes)}; expected arrays time, response and force, or a struct or "
        "cell of such"
    )


def _is_record(fields: Mapping[str, Node], selection: Selection) -> bool:
    names = listed(selection.response) or ["response"]
    several = sum(map(is_series, fields.values())) > 1
    return fields.keys() >= set(names) or (several and has_time(fields, selection.time))


def _is_cell_of_records(node: np.ndarray, selection: Selection) -> bool:
    if node.dtype.kind != "O" or not node.size:
        return False
    if all(isinstance(entry, dict) for entry in node.flat):
        return any(_is_record(entry, selection) for entry in node.flat)
    return node.ndim == 2 and any(all(map(is_series, row[:2])) for row in node)


def _records(path: Path, name: str, node: Mapping[str, Node] | np.ndarray) -> list[Record]:
    if not isinstance(node, np.ndarray):
        return [Record(path, node)]
    if not node.size:
        raise InputError(f"{name} is an empty cell; expected one row per recording")
    if all(isinstance(entry, dict) for entry in node.flat):
        return [Record(_numbered(path, i, node.size), entry) for i, entry in enumerate(node.flat)]
    if node.ndim != 2:
        raise InputError(f"{name} is a {told_node(node)}; expected one row per recording")
    return [Record(_numbered(path, i, len(node)), row, name, i) for i, row in enumerate(node)]


def _numbered(path: Path, i: int, count: int) -> Path:
    return path if count == 1 else path.with_name(f"{path.name}[{i}]")


def _row_fields(entries: np.ndarray, cell: str, row: int) -> dict[str, Node]:
    """Time and response from a row of a cell; a single column is the response alone."""
    names = ["time", "response"] if len(entries) > 1 else ["response"]
    for column, node in enumerate(entries, start=1):
        place = f"{cell}{{{row}, {column}}}"  # as MATLAB writes it
        if column > len(names):
            if is_series(node):
                raise InputError(
                    f"{place} is {told_node(node)}; expected a number after time and response; put "
                    "forces in a struct with fields time, response and force"
                )
        elif isinstance(node, np.ndarray) and not node.size:
            raise InputError(
                f"{place} is empty (row {row}, column {column}, counted from 1); expected the "
                f"{names[column - 1]}; fill it or delete the row"
            )
        elif not is_series(node):
            raise InputError(f"{place} is {told_node(node)}; expected the {names[column - 1]}")
    return dict(zip(names, entries, strict=False))
