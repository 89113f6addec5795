"""Sparse matrices from lines of row, column and value."""

import numpy as np

from iwanjax.errors import InputError
from iwanjax.structures.exchange.contents import Matrix, sparse_matrix
from iwanjax.structures.exchange.text import NumberTable


def places(table: NumberTable) -> tuple[np.ndarray, np.ndarray, int]:
    """Rows and columns of the entries, from 0, and the size that they reach.

    Raises
    ------
    InputError
        Naming the line with an index that is no whole number from 1.
    """
    rows, columns = (table.integers(i, ("row", "column")[i], 1) - 1 for i in range(2))
    return rows, columns, int(max(rows.max(), columns.max())) + 1


def coordinate_matrix(table: NumberTable) -> Matrix:
    """A stiffness or mass of the size that its entries reach.

    Raises
    ------
    InputError
        As :func:`places`, for an entry that stands twice, and for a row without its
        diagonal entry, as a file cut short has it.
    """
    rows, columns, size = places(table)
    matrix = sparse_matrix(rows, columns, table.values[:, 2], size)
    cut = without_diagonal(matrix)
    if len(cut):
        raise InputError(f"row {cut[0] + 1} has no diagonal entry; is the file cut short?")
    return matrix


def without_diagonal(matrix: Matrix) -> np.ndarray:
    """Rows with entries but none on the diagonal: no whole mass or stiffness has such."""
    size = abs(matrix)
    return np.flatnonzero((size.sum(axis=0) + size.sum(axis=1) > 0) & (matrix.diagonal() == 0))
