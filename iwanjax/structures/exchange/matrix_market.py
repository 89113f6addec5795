"""Matrix Market files.

Boisvert, Pozo and Remington, The Matrix Market Exchange Formats: Initial Design, NISTIR 5935
(1996). SciPy's own reader crashes the interpreter on some damaged files.
"""

from pathlib import Path

import numpy as np

from iwanjax.errors import InputError
from iwanjax.structures.exchange.contents import Contents, Matrix, sparse_matrix
from iwanjax.structures.exchange.coordinates import places
from iwanjax.structures.exchange.matrices import mirrored
from iwanjax.structures.exchange.text import NumberTable, number_table, text_lines

_BANNER = "%%matrixmarket"
_FIELDS = ("real", "double", "integer")
_SYMMETRIES = ("general", "symmetric")


def is_matrix_market(path: Path) -> bool:
    """Whether a file starts with the banner of the format; Abaqus uses ``.mtx`` too."""
    with path.open("rb") as file:
        return file.read(len(_BANNER)).lower() == _BANNER.encode()


def read_matrix_market(path: Path) -> Contents:
    """The one matrix of a Matrix Market file, coordinate or array, symmetric or general.

    Raises
    ------
    InputError
        For entries that are not real, for other symmetries, files cut short, and indices
        beyond the size.
    """
    lines = text_lines(path)
    kind, symmetry = _banner(lines[0])
    lines = ["" if line.startswith("%") else line for line in lines]
    start = next((i for i, line in enumerate(lines) if line.strip()), len(lines))
    size = number_table(lines[start : start + 1], (3,) if kind == "coordinate" else (2,), start + 1)
    rows, columns, *counts = (size.integers(i, "size", 1)[0] for i in range(size.values.shape[1]))
    if rows != columns:
        raise InputError(f"holds a {rows} by {columns} matrix; expected a square one")
    width, triangle = (3 if counts else 1), symmetry == "symmetric"
    stored = counts[0] if counts else rows * (rows + 1) // 2 if triangle else rows * columns
    table = number_table(lines[start + 1 :], (width,), start + 2)
    if len(table.values) != stored:
        raise InputError(
            f"holds {len(table.values)} entries; line {start + 1} says {stored}; is the file cut "
            "short?"
        )
    matrix = _coordinates(table, rows) if counts else _array(table.values[:, 0], rows, triangle)
    return Contents({"": mirrored(matrix) if triangle else matrix})


def _banner(line: str) -> tuple[str, str]:
    """Format and symmetry of the first line."""
    words = line.lower().split()[1:]
    if len(words) != 4 or words[0] != "matrix" or words[1] not in ("coordinate", "array"):
        raise InputError(f"line 1 is {line.strip()!r}; expected a coordinate or array matrix")
    if words[2] not in _FIELDS:
        raise InputError(f"holds {words[2]} entries; expected real ones")
    if words[3] not in _SYMMETRIES:
        raise InputError(f"is {words[3]}; expected a general or symmetric matrix")
    return words[1], words[3]


def _coordinates(table: NumberTable, size: int) -> Matrix:
    rows, columns, largest = places(table)
    if largest > size:
        raise InputError(f"an entry is in row or column {largest}; expected up to {size}, the size")
    return sparse_matrix(rows, columns, table.values[:, 2], size)


def _array(values: np.ndarray, size: int, triangle: bool) -> Matrix:
    """Columns one after the other, from the diagonal on where symmetric."""
    if not triangle:
        return values.reshape(size, size).T
    upper = np.zeros((size, size))
    upper[np.triu_indices(size)] = values
    return upper.T
