"""Mass, stiffness and damping matrices that came from another program."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from iwanjax.errors import InputError
from iwanjax.structures.checks import finite_array
from iwanjax.structures.exchange.contents import Matrix
from iwanjax.structures.exchange.node_map import Dof, NodeMap

# Matrices exported with 8 digits are symmetric to about 1e-8 of their size.
_SYMMETRY = 1e-7


@dataclass(frozen=True, eq=False)
class ImportedMatrices:
    r"""M u'' + C u' + K u = f as another program wrote it, whole and symmetric.

    A matrix of which only one triangle is given is completed, and ``notes`` says so.

    Parameters
    ----------
    M : (n, n) array or sparse array
        Mass.
    K : (n, n) array or sparse array
        Stiffness without the joints.
    C : (n, n) array or sparse array, optional
        Viscous damping.
    T : (p, n) array or sparse array, optional
        Recovery of a reduced basis: p physical motions u = T q of the n coordinates q.
    nodes : NodeMap, optional
        What the n rows stand for; with T, its p rows.
    sources : tuple of str
        Files it came from.
    notes : tuple of str
        What was changed on reading, in sentences.

    Raises
    ------
    InputError
        For matrices that are not square, of one size, finite, real and symmetric, and for
        a node map or T of another size.
    """

    M: Matrix
    K: Matrix
    C: Matrix | None = None
    T: Matrix | None = None
    nodes: NodeMap | None = None
    sources: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        given = {"K": self.K, "M": self.M, "C": self.C}
        matrices = {
            name: real_matrix(value, name) for name, value in given.items() if value is not None
        }
        n = matrices["K"].shape[0]
        for name, matrix in matrices.items():
            if matrix.shape != (n, n) or n == 0:
                raise InputError(
                    f"{name} has shape {matrix.shape}; expected "
                    + ("a square matrix (n, n)" if name == "K" else f"({n}, {n}) like K")
                )
        T = None if self.T is None else real_matrix(self.T, "T")
        if T is not None and T.shape[-1:] != (n,):
            raise InputError(f"T has shape {T.shape}; expected (p, {n}): physical motions u = T q")
        mapped = n if T is None else T.shape[0]
        if self.nodes is not None and self.nodes.size != mapped:
            raise InputError(
                f"node map has {self.nodes.size} rows; expected {mapped} like "
                f"{'K' if T is None else 'T'}"
            )
        notes = list(self.notes)
        for name, matrix in matrices.items():
            whole, note = completed(matrix, name)
            notes += [note] if note else []
            object.__setattr__(self, name, self._symmetric(whole, name))
        object.__setattr__(self, "T", T)
        object.__setattr__(self, "notes", tuple(notes))

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return self.K.shape[0]

    def label(self, row: int) -> str:
        """A row of M and K in words: its node and motion, or its number from 0."""
        return f"row {row}" if self.nodes is None or self.T is not None else self.nodes.label(row)

    def row(self, dof: Dof, relative_to: Dof | None = None) -> np.ndarray:
        """The (n,) row of a deflection d = row @ u, or row @ q of a reduced basis.

        Parameters
        ----------
        dof : (int, str)
            Node and motion, for instance ``(12, "ux")``.
        relative_to : (int, str), optional
            A second DOF whose motion is subtracted; the ground when not given.

        Raises
        ------
        InputError
            For nodes and motions that are not there, and without a node map.
        """
        if self.nodes is None:
            raise InputError(
                f"no node map came with {', '.join(self.sources) or 'these matrices'}, so node "
                f"{dof[0]} cannot be found; pass nodes= to read_matrices"
            )
        row = self.nodes.row(dof, relative_to)
        return row if self.T is None else np.asarray(self.T.T @ row)

    def _symmetric(self, matrix: Matrix, name: str) -> Matrix:
        difference = abs(matrix - matrix.T)
        if difference.max() > _SYMMETRY * abs(matrix).max():
            i, j = map(int, np.unravel_index(difference.argmax(), matrix.shape))
            raise InputError(
                f"{name} is not symmetric: {matrix[i, j]:.6g} at ({self.label(i)}, "
                f"{self.label(j)}) but {matrix[j, i]:.6g} at its mirror place; check the export"
            )
        whole = 0.5 * (matrix + matrix.T)
        return whole.tocsr() if sp.issparse(whole) else whole


def completed(matrix: Matrix, name: str) -> tuple[Matrix, str]:
    """A matrix with both triangles, and a sentence if one of them was missing."""
    triangle = _triangle(matrix)
    if not triangle:
        return matrix, ""
    return mirrored(matrix), f"{name} holds its {triangle} triangle only; the other was completed."


def mirrored(matrix: Matrix) -> Matrix:
    """A symmetric matrix from entries that stand on one side of the diagonal each."""
    diagonal = matrix.diagonal()
    return (
        matrix + matrix.T - (sp.diags_array(diagonal) if sp.issparse(matrix) else np.diag(diagonal))
    )


def one_sided(matrix: Matrix) -> bool:
    """Whether no entry off the diagonal has one at its mirror place, and there are some."""
    off = matrix - sp.diags_array(matrix.diagonal())
    pattern = abs(off).tocsr()
    return pattern.max() > 0 and pattern.multiply(pattern.T).max() == 0


def _triangle(matrix: Matrix) -> str:
    """Which triangle alone is filled; empty for both and for a diagonal matrix."""
    lower, upper = (sp.tril, sp.triu) if sp.issparse(matrix) else (np.tril, np.triu)
    below, above = (abs(part(matrix, k)).max() for part, k in ((lower, -1), (upper, 1)))
    return "" if bool(below) == bool(above) else "lower" if below else "upper"


def real_matrix(value: object, name: str) -> Matrix:
    """A finite float64 matrix, dense as it is or sparse by rows.

    Raises
    ------
    InputError
        When it is no matrix, or holds text, complex numbers, NaN or infinity.
    """
    if not sp.issparse(value):
        matrix = finite_array(value, name)
        if matrix.ndim != 2:
            raise InputError(f"{name} has shape {matrix.shape}; expected a matrix")
        return matrix
    sparse = sp.csr_array(value)
    sparse.sum_duplicates()
    return sp.csr_array(
        (finite_array(sparse.data, name), sparse.indices, sparse.indptr), sparse.shape
    )
