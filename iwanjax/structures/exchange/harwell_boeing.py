"""Harwell-Boeing files, as ANSYS writes them with HBMAT.

Duff, Grimes and Lewis, Users' Guide for the Harwell-Boeing Sparse Matrix Collection,
TR/PA/92/86 (1992); Mechanical APDL Command Reference, HBMAT. SciPy's reader refuses symmetric
matrices and files with a right-hand side, which is what HBMAT writes by default.
"""

import re
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from iwanjax.errors import InputError
from iwanjax.structures.exchange.contents import Contents
from iwanjax.structures.exchange.map_files import beside, read_mapping
from iwanjax.structures.exchange.text import text_lines

# (10I8), (1P,4E20.12), (3D25.16): how many fields a line, how wide each.
_FORMAT = re.compile(r"\((?:\d+P,?)?(\d*)[IEDFG](\d+)(?:\.\d+)?(?:E\d+)?\)")
_STRUCTURES = {"S": "symmetric", "U": "unsymmetric"}


def read_harwell_boeing(path: Path) -> Contents:
    """The one matrix of a real assembled Harwell-Boeing file (RSA or RUA), text.

    A symmetric matrix is stored by one triangle; ANSYS before version 11 wrote both, which
    is read as well. A right-hand side is passed over. The ``.mapping`` file beside it
    says what the rows stand for.

    Raises
    ------
    InputError
        For other kinds, damaged headers, files cut short and indices beyond the size.
    """
    lines = text_lines(path)
    counts, (rows, columns, entries) = _header(lines)
    if rows != columns:
        raise InputError(f"holds a {rows} by {columns} matrix; expected a square one")
    formats = re.findall(r"\([^()]*\)", lines[3].upper().replace(" ", ""))
    if len(formats) < 3:
        raise InputError(f"line 4 holds {lines[3].strip()!r}; expected three Fortran formats")
    # A right-hand side adds a line to the header.
    start = 4 + (counts[4] > 0 if len(counts) > 4 else 0)
    blocks = []
    what = ("column pointers", "row indices", "values")
    for name, lines_there, form, count in zip(
        what, counts[1:4], formats, (columns + 1, entries, entries), strict=False
    ):
        block = lines[start : start + lines_there]
        blocks.append(_numbers(block, form, count, name, start + 1))
        start += lines_there
    pointers, indices = (_indices(block) for block in blocks[:2])
    if pointers[0] != 0 or pointers[-1] != entries or np.any(np.diff(pointers) < 0):
        raise InputError(
            f"the column pointers run from {pointers[0] + 1} to {pointers[-1] + 1}; expected them "
            f"to rise from 1 to {entries + 1}"
        )
    if np.any((indices < 0) | (indices >= rows)):
        wrong = indices[(indices < 0) | (indices >= rows)][0] + 1
        raise InputError(f"a row index is {wrong}; expected 1 to {rows}, the size of the matrix")
    matrix = sp.csc_array((blocks[2], indices, pointers), shape=(rows, columns))
    listing = beside(path, ".mapping")
    return Contents({"": sp.csr_array(matrix)}, None if listing is None else read_mapping(listing))


def _header(lines: list[str]) -> tuple[list[int], tuple[int, int, int]]:
    """Lines of each part; rows, columns and entries."""
    if len(lines) < 5:
        raise InputError("holds fewer lines than the four of a Harwell-Boeing header")
    try:
        counts = [int(field) for field in lines[1].split()]
        kind, *sizes = lines[2].upper().split()
        rows, columns, entries = (int(field) for field in sizes[:3])
        parts = counts[1:4]
        if len(parts) < 3:
            raise ValueError
    except ValueError:
        raise InputError(
            "lines 2 and 3 are no Harwell-Boeing header (line counts; type and sizes); is it "
            "binary? write it with HBMAT, , , , ASCII"
        ) from None
    if len(kind) != 3 or kind[0] != "R" or kind[1] not in _STRUCTURES or kind[2] != "A":
        raise InputError(
            f"is of type {kind}; expected RSA or RUA: real, symmetric or unsymmetric, assembled"
        )
    return counts, (rows, columns, entries)


def _numbers(block: list[str], form: str, count: int, name: str, start: int) -> np.ndarray:
    """Numbers of a Fortran format: by blanks, for not all writers keep to it, or by its widths."""
    match = _FORMAT.fullmatch(form)
    if match is None:
        raise InputError(f"format {form} of the {name} is unknown; expected such as (10I8)")
    each, width = int(match[1] or 1), int(match[2])
    fields = " ".join(block).split()
    if len(fields) != count:
        fields = [
            line[i : i + width]
            for line in block
            for i in range(0, min(len(line.rstrip()), each * width), width)
        ]
    if len(fields) != count:
        raise InputError(
            f"holds {len(fields)} {name} of {count} from line {start} on; is the file cut short?"
        )
    try:
        values = np.array([field.replace("D", "E").replace("d", "e") for field in fields], float)
    except ValueError as error:
        raise InputError(f"the {name} from line {start} on: {error}") from None
    if not np.all(np.isfinite(values)):
        raise InputError(f"the {name} from line {start} on hold NaN or infinity")
    return values


def _indices(values: np.ndarray) -> np.ndarray:
    """Whole numbers from 1, counted from 0."""
    return values.astype(np.int64) - 1
