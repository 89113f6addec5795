"""Columns of numbers under names, from a CSV file."""

import csv
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

from iwanjax.errors import InputError


def read_columns(path: Path) -> dict[str, np.ndarray]:
    """Read a CSV file whose first line names its columns.

    Cells are separated by commas, semicolons or tabs, whichever the first line has most of;
    numbers have decimal points. The first line may begin with ``#``.

    Parameters
    ----------
    path : Path
        An existing file in UTF-8.

    Returns
    -------
    dict of str to (N,) array
        In the order of the file.

    Raises
    ------
    InputError
        One line naming the file, its line and the column: no header, names that are empty
        or repeated, cells that are empty or no numbers, rows of another length, no rows.
    """
    try:
        names, delimiter, line = _header(path)
        try:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", "loadtxt: input contained no data")
                values = np.loadtxt(
                    path,
                    delimiter=delimiter,
                    comments=None,
                    quotechar='"',
                    skiprows=line,
                    ndmin=2,
                    encoding="utf-8-sig",
                )
        except ValueError as error:
            if isinstance(error, UnicodeDecodeError):
                raise
            raise _culprit(path, names, delimiter, line, str(error)) from None
        if values.size == 0:
            raise InputError(f"{path}: no rows below the header; is the file cut short?")
        if values.shape[1] != len(names):
            raise _culprit(path, names, delimiter, line, "rows and header differ in length")
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not CSV in UTF-8 ({error}); export it again as text") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    return dict(zip(names, np.ascontiguousarray(values.T), strict=True))


def _header(path: Path) -> tuple[list[str], str, int]:
    """Names of the columns, what separates them, and the number of the line they are on."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        lines = ((number, text) for number, text in enumerate(file, start=1) if text.strip())
        number, text = next(lines, (0, ""))
    if not text:
        raise InputError(f"{path}: the file is empty; expected a header row and numbers")
    text = text.strip("\r\n").lstrip("# ")
    delimiter = max(",;\t", key=text.count)
    names = [name.strip() for name in next(csv.reader([text], delimiter=delimiter))]
    if all(_is_number(name) for name in names):
        raise InputError(
            f"{path}:{number}: the first row holds numbers only; expected names of the columns, "
            "for instance time,acc1,acc2"
        )
    if "" in names:
        raise InputError(f"{path}:{number}: column {names.index('') + 1} has no name")
    if repeated := [name for name, n in Counter(names).items() if n > 1]:
        raise InputError(f"{path}:{number}: two columns are named {repeated[0]!r}; rename one")
    return names, delimiter, number


def _culprit(path: Path, names: list[str], delimiter: str, header: int, told: str) -> InputError:
    """The first row that is not one number for each name; ``told`` if none is found."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = csv.reader(file, delimiter=delimiter)
        for row in rows:
            if rows.line_num <= header or not row:
                continue
            place = f"{path}:{rows.line_num}"
            if len(row) != len(names):
                return InputError(
                    f"{place}: the row has {len(row)} cells; expected {len(names)}, one for each "
                    f"of {', '.join(names)}; is the file cut short?"
                )
            for name, cell in zip(names, row, strict=True):
                if not cell.strip():
                    return InputError(f"{place}: column {name!r} is empty; expected a number")
                if not _is_number(cell):
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
