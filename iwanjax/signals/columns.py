"""Columns of numbers under names, from a text file."""

import csv
import warnings
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from iwanjax.errors import InputError
from iwanjax.signals.file_record import FileRecord, channel_of, quantity_of
from iwanjax.signals.text import decoded

_DELIMITERS = ",;\t"
# Units of a units row that are none of a motion or a force.
_OTHER_UNITS = {"s", "sec", "ms", "us", "µs", "min", "Hz", "V", "mV", "Pa", "kPa", "rad", "-", "%"}


class _Layout(NamedTuple):
    """How a file is laid out; lines are counted from 0.

    Attributes
    ----------
    header : int
        The line of the names.
    first : int
        The first line below names and units.
    delimiter : str
        Between cells.
    names, units : tuple of str
        Of the columns; units are empty where there is no row of them.
    spare : int
        Empty cells at the end of every row.
    comma : bool
        Whether numbers have decimal commas.
    """

    header: int
    first: int
    delimiter: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    spare: int
    comma: bool


def read_columns(path: Path) -> dict[str, np.ndarray]:
    """The columns alone of :func:`read_table`."""
    return dict(read_table(path).arrays)  # pyright: ignore[reportReturnType]


def read_table(path: Path) -> FileRecord:
    """Read a text file (.csv, .txt) with a row of names above its columns.

    Cells are separated by commas, semicolons or tabs; numbers have decimal points or, between
    semicolons or tabs, commas. A row of units may stand below the names, which may begin with
    ``#``, and lines with remarks above them (``key: value`` are kept). A last column without
    name is called by its number, and left out where it is empty.

    Parameters
    ----------
    path : Path
        An existing file in UTF-8, UTF-16 or Windows' Western European code page.

    Returns
    -------
    FileRecord
        Columns (N,) in the order of the file.

    Raises
    ------
    InputError
        One line naming the file, its line and the column: no header, names that are empty
        or repeated, cells that are empty or no numbers, rows of another length, no rows.
    """
    try:
        text = decoded(path)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    lines = text.splitlines()
    try:
        layout = _layout(path, lines)
        if not text.endswith(("\n", "\r")):
            _refuse_cut(path, lines, layout)
        values = _values(path, lines, layout)
    except csv.Error as error:
        raise InputError(f"{path}: not CSV ({error}); export it again as text") from None
    units = dict(zip(layout.names, layout.units, strict=True)) if layout.units else {}
    remarks = (line.strip("# ").partition(":") for line in lines[: layout.header])
    return FileRecord(
        dict(zip(layout.names, np.ascontiguousarray(values.T), strict=True)),
        {name: channel_of(name, units.get(name, "")) for name in layout.names},
        metadata={key.strip(): text.strip() for key, mark, text in remarks if mark and key},
    )


def _values(path: Path, lines: Sequence[str], layout: _Layout) -> np.ndarray:
    """Numbers, (N, columns)."""
    rows = lines[layout.first :]
    if layout.spare:
        empty = layout.spare * layout.delimiter
        ended = [row.rstrip(" ").endswith(empty) or not row.strip() for row in rows]
        if not all(ended):
            line = layout.first + ended.index(False) + 1
            raise InputError(
                f"{path}:{line}: the row does not end in {empty!r}, as the others do; is the file "
                "cut short?"
            )
        rows = [row.rstrip(" ").removesuffix(empty) for row in rows]
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "loadtxt: input contained no data")
            values = np.loadtxt(
                [row.replace(",", ".") for row in rows] if layout.comma else rows,
                delimiter=layout.delimiter,
                comments=None,
                quotechar='"',
                ndmin=2,
            )
    except ValueError as error:
        raise _culprit(path, rows, layout, str(error)) from None
    if values.size == 0:
        raise InputError(f"{path}: no rows below the header; is the file cut short?")
    if values.shape[1] != len(layout.names):
        raise _culprit(path, rows, layout, "rows and header differ in length")
    return values


def _refuse_cut(path: Path, lines: Sequence[str], layout: _Layout) -> None:
    """Refuse a last number, without an end of its line, that has fewer digits than all above it."""
    above = [line for line in lines[layout.first : -1] if line.strip()]
    if above:
        shortest = min(len(line.rpartition(layout.delimiter)[2]) for line in above)
        if len(lines[-1].rpartition(layout.delimiter)[2]) < shortest:
            raise InputError(
                f"{path}:{len(lines)}: the last row ends early; is the file cut short?"
            )


def _layout(path: Path, lines: Sequence[str]) -> _Layout:
    """Where names, units and numbers are, and what separates them."""
    filled = [i for i, text in enumerate(lines) if text.strip()]
    if not filled:
        raise InputError(f"{path}: the file is empty; expected a header row and numbers")
    rows = ((at, _row_of_numbers(lines[i])) for at, i in enumerate(filled))
    at, found = next((pair for pair in rows if pair[1] is not None), (1, None))
    if at == 0:
        raise InputError(
            f"{path}:{filled[0] + 1}: the first row holds numbers only; expected names of the "
            "columns, for instance time,acc1,acc2"
        )
    header, first, above = filled[0], filled[0] + 1, filled[at - 1]
    delimiter, row, comma = found or (_most(lines[header]), [], False)
    units: list[str] = []
    if found and not any(_is_number(cell) for cell in _cells(lines[above], delimiter)):
        header, first = above, filled[at]
        if at > 1 and (units := _units(lines[above], lines[filled[at - 2]], delimiter)):
            header = filled[at - 2]
    names = _cells(lines[header].lstrip("# "), delimiter)
    spare = _empty_at_end(row)
    if row and not names[-1] and len(names) == len(row) + 1:
        names.pop()  # a separator at the end of the header's line only
    elif row and spare and len(names) == len(row):
        names = names[:-spare]
    elif row and not names[-1] and len(names) == len(row):
        names[-1] = f"column {len(names)}"
    place = f"{path}:{header + 1}"
    if "" in names:
        raise InputError(f"{place}: column {names.index('') + 1} has no name")
    if repeated := [name for name, n in Counter(names).items() if n > 1]:
        raise InputError(f"{place}: two columns are named {repeated[0]!r}; rename one")
    units = [*units, *len(names) * [""]][: len(names)] if units else []
    return _Layout(header, first, delimiter, tuple(names), tuple(units), spare, comma)


def _row_of_numbers(line: str) -> tuple[str, list[str], bool] | None:
    """What separates the cells of a row of numbers, the cells, and whether commas are decimal."""
    best = None
    for delimiter in _DELIMITERS:
        cells = _cells(line, delimiter)
        filled = cells[: len(cells) - _empty_at_end(cells)]
        comma = delimiter != "," and "," in line
        if filled and all(_is_number(c.replace(",", ".") if comma else c) for c in filled):
            found = delimiter, cells, comma
            best = found if best is None or len(cells) > len(best[1]) else best
    return best


def _units(line: str, above: str, delimiter: str) -> list[str]:
    """Units in the row below the names; none where it is a row of names itself."""
    cells = [cell.strip("[]() ") for cell in _cells(line, delimiter)]
    names = _cells(above, delimiter)
    known = [cell in _OTHER_UNITS or bool(quantity_of(cell)) for cell in cells if cell]
    if len(names) != len(cells) or 2 * sum(known) < len(known) or not known:
        return []
    return ["" if cell == "-" else cell for cell in cells]


def _most(line: str) -> str:
    return max(_DELIMITERS, key=line.count)


def _cells(line: str, delimiter: str) -> list[str]:
    """Cells of one line, without spaces around them."""
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


def _empty_at_end(cells: Sequence[str]) -> int:
    count = 0
    while count < len(cells) and not cells[-1 - count]:
        count += 1
    return count


def _culprit(path: Path, rows: Sequence[str], layout: _Layout, told: str) -> InputError:
    """The first row that is not one number for each name; ``told`` if none is found."""
    names = layout.names
    for line, text in enumerate(rows, start=layout.first + 1):
        if not text.strip():
            continue
        place, row = f"{path}:{line}", _cells(text, layout.delimiter)
        if len(row) != len(names):
            return InputError(
                f"{place}: the row has {len(row)} cells; expected {len(names)}, one for each "
                f"of {', '.join(names)}; is the file cut short?"
            )
        for name, cell in zip(names, row, strict=True):
            if not cell:
                return InputError(f"{place}: column {name!r} is empty; expected a number")
            if not _is_number(cell.replace(",", ".") if layout.comma else cell):
                hint = "; write decimal points" if _is_number(cell.replace(",", ".")) else ""
                return InputError(
                    f"{place}: column {name!r} holds {cell!r}; expected a number{hint}"
                )
    return InputError(f"{path}: cannot be read as CSV ({' '.join(told.split())})")


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
