"""What a reader hands over: the matrices of one file as they stand there."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from iwanjax.errors import InputError
from iwanjax.structures.exchange.node_map import Dof, NodeMap

# SciPy does not say the types of its sparse arrays, so a checker could only mistake them.
Matrix: TypeAlias = Any
"""A dense ``numpy.ndarray`` or a sparse ``scipy.sparse.csr_array``, (n, n)."""


@dataclass(frozen=True)
class Contents:
    """The matrices of one file.

    Attributes
    ----------
    matrices : mapping of str to matrix
        By the name in the file; ``""`` where a file holds one without a name.
    nodes : NodeMap or None
        What the rows stand for, where the file or one beside it says so.
    fixed : frozenset of (int, str)
        DOFs that the program holds, to be left out of every matrix.
    """

    matrices: Mapping[str, Matrix]
    nodes: NodeMap | None = None
    fixed: frozenset[Dof] = field(default_factory=frozenset)


def full(matrix: Matrix) -> np.ndarray:
    """A matrix with its zeros."""
    return matrix.toarray() if sp.issparse(matrix) else matrix


def sparse_matrix(
    rows: np.ndarray, columns: np.ndarray, values: np.ndarray, size: int
) -> sp.csr_array:
    """A matrix from entries that each stand once.

    Parameters
    ----------
    rows, columns : (entries,) array
        Indices from 0.
    values : (entries,) array
        Entries.
    size : int
        Number of rows and columns n.

    Raises
    ------
    InputError
        For an entry that is there twice.
    """
    places = rows * size + columns
    unique, counts = np.unique(places, return_counts=True)
    if len(unique) < len(places):
        i, j = divmod(int(unique[np.argmax(counts > 1)]), size)
        raise InputError(
            f"entry ({i + 1}, {j + 1}) stands {counts.max()} times; was the file appended to?"
        )
    return sp.csr_array((values, (rows, columns)), shape=(size, size))
