"""What a matrix must be before it is believed."""

from typing import TypeVar

import numpy as np

from iwanjax.errors import InputError

# Matrices exported with 8 digits are symmetric to about 1e-8 of their size.
_SYMMETRY = 1e-7


def square_matrix(value: object, name: str, n: int | None = None) -> np.ndarray:
    """A finite, real, symmetric (n, n) float64 matrix.

    Raises
    ------
    InputError
        Naming the matrix and what is wrong with it: kind, shape, NaN, asymmetry.
    """
    matrix = finite_array(value, name)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or matrix.shape[0] == 0:
        raise InputError(f"{name} has shape {matrix.shape}; expected a square matrix (n, n)")
    if n is not None and matrix.shape[0] != n:
        raise InputError(f"{name} has shape {matrix.shape}; expected ({n}, {n}) like M")
    difference = np.abs(matrix - matrix.T)
    size = np.max(np.abs(matrix))
    if np.max(difference) > _SYMMETRY * size:
        i, j = np.unravel_index(np.argmax(difference), difference.shape)
        raise InputError(
            f"{name} is not symmetric: {name}[{i}, {j}] = {matrix[i, j]:.6g} but "
            f"{name}[{j}, {i}] = {matrix[j, i]:.6g}; check the export (a triangle only?)"
        )
    return 0.5 * (matrix + matrix.T)


def finite_array(value: object, name: str) -> np.ndarray:
    """A finite, real float64 array.

    Raises
    ------
    InputError
        When it is sparse, ragged, not numeric, complex, or holds NaN or infinity.
    """
    if hasattr(value, "toarray"):
        raise InputError(f"{name} is a sparse matrix; pass {name}.toarray(), or reduce it first")
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError(f"{name}: {error}; expected a rectangular array of numbers") from None
    if array.dtype.kind == "c":
        raise InputError(f"{name} is complex; expected real numbers (hysteretic damping goes in C)")
    if array.dtype.kind not in "biuf":
        raise InputError(f"{name} is of type {array.dtype}; expected real numbers")
    array = array.astype(np.float64)
    if not np.all(np.isfinite(array)):
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InputError(
            f"{name} holds {np.sum(~np.isfinite(array))} NaN or infinite value(s), the first at "
            f"index {where}"
        )
    return array


_Kind = TypeVar("_Kind")


def instance_of(value: object, kind: type[_Kind], name: str) -> _Kind:
    """The value, when it is of a class.

    Raises
    ------
    InputError
        Naming what arrived and what was expected.
    """
    if not isinstance(value, kind):
        raise InputError(f"{name} is a {type(value).__name__}; expected a {kind.__name__}")
    return value


def positive_number(value: object, name: str) -> float:
    """A number above zero.

    Raises
    ------
    InputError
        For anything else, naming it.
    """
    number = finite_array(value, name)
    if number.ndim or number <= 0:
        raise InputError(f"{name} = {value!r} must be a positive number")
    return float(number)


def positive_definite(matrix: np.ndarray, name: str) -> None:
    """Refuse a matrix without a Cholesky factor.

    Raises
    ------
    InputError
        With the smallest eigenvalue and the degree of freedom it sits on.
    """
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(matrix)
        dof = int(np.argmax(np.abs(vectors[:, 0])))
        raise InputError(
            f"{name} is not positive definite: smallest eigenvalue {values[0]:.3g}, mostly at "
            f"DOF {dof}; condense out or give mass to DOFs without any"
        ) from None
