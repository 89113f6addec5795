"""Small systems solved, and matrices applied, for a whole batch at once.

Matrices of systems are lists of rows of arrays, right-hand sides lists of arrays, the batch on
their last axes: unrolled, so that XLA vectorises every operation over the batch instead of calling
LAPACK once a matrix. A matrix that is applied step after step is one array, and its transpose.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

# Unrolling 20 x 20 takes 17 s to compile; from here on a batched Cholesky is quicker overall.
_UNROLLED = 8


def solve_spd(J: Sequence[Sequence[Array]], r: Sequence[Array]) -> list[Array]:
    """Solve J x = r for symmetric positive definite J, without pivoting.

    Parameters
    ----------
    J : m rows of m arrays
        Lower triangle is read; entries broadcast against each other.
    r : m arrays
        Right-hand side.

    Returns
    -------
    m arrays
    """
    m = len(r)
    if m > _UNROLLED:
        return _solve_cholesky(J, r)
    A = [[J[i][j] for j in range(i + 1)] for i in range(m)]
    x = list(r)
    inverse: list[Array] = []
    for k in range(m):  # L D L^T, column by column
        inverse.append(1.0 / A[k][k])
        column = [A[i][k] for i in range(m) if i > k]
        for i in range(k + 1, m):
            A[i][k] = A[i][k] * inverse[k]
            for j in range(k + 1, i + 1):
                A[i][j] = A[i][j] - A[i][k] * column[j - k - 1]
            x[i] = x[i] - A[i][k] * x[k]
    for k in reversed(range(m)):
        x[k] = x[k] * inverse[k]
        for i in range(k + 1, m):
            x[k] = x[k] - A[i][k] * x[i]
    return x


def solve_general(A: Sequence[Sequence[Array]], b: Sequence[Array]) -> list[Array]:
    """Solve A x = b by elimination without pivoting; the caller judges the result.

    Meant for matrices of the form I + (small), which need no pivots. Derivatives are
    two more solves, not derivatives of the elimination.
    """
    transposed = [list(column) for column in zip(*A, strict=True)]
    return jax.lax.custom_linear_solve(
        lambda x: product(A, x),
        list(b),
        lambda _, r: _eliminate(A, r),
        lambda _, r: _eliminate(transposed, r),
    )


def _eliminate(A: Sequence[Sequence[Array]], b: Sequence[Array]) -> list[Array]:
    m = len(b)
    rows = [list(row) for row in A]
    x = list(b)
    for k in range(m):
        inverse = 1.0 / rows[k][k]
        for i in range(k + 1, m):
            f = rows[i][k] * inverse
            for j in range(k + 1, m):
                rows[i][j] = rows[i][j] - f * rows[k][j]
            x[i] = x[i] - f * x[k]
    for k in reversed(range(m)):
        for j in range(k + 1, m):
            x[k] = x[k] - rows[k][j] * x[j]
        x[k] = x[k] / rows[k][k]
    return x


def product(A: Sequence[Sequence[Array]], x: Sequence[Array]) -> list[Array]:
    """Matrix times vector."""
    return [sum((a * b for a, b in zip(row, x, strict=True)), jnp.zeros(())) for row in A]


def dot(a: Sequence[Array], b: Sequence[Array]) -> Array:
    """Inner product."""
    return sum((u * v for u, v in zip(a, b, strict=True)), jnp.zeros(()))


def _solve_cholesky(J: Sequence[Sequence[Array]], r: Sequence[Array]) -> list[Array]:
    m = len(r)
    lower = [[J[max(i, j)][min(i, j)] for j in range(m)] for i in range(m)]
    flat = jnp.broadcast_arrays(*[entry for row in lower for entry in row], *r)
    matrix = jnp.stack(flat[: m * m], axis=-1).reshape(*flat[0].shape, m, m)
    rhs = jnp.stack(flat[m * m :], axis=-1)
    factor = jax.lax.linalg.cholesky(matrix, symmetrize_input=False)
    half = jax.lax.linalg.triangular_solve(factor, rhs[..., None], left_side=True, lower=True)
    x = jax.lax.linalg.triangular_solve(factor, half, left_side=True, lower=True, transpose_a=True)[
        ..., 0
    ]
    return [x[..., i] for i in range(m)]


class Turned(NamedTuple):
    """A matrix and its transpose, each as it stands in memory."""

    A: Float[Array, "m n"]
    transpose: Float[Array, "n m"]


def turned(A: Float[Array, "m n"]) -> Turned:
    """A matrix that is multiplied by one vector after another; see :func:`through`."""
    return Turned(A, A.T)


@jax.custom_jvp
def through(by: Turned, x: Float[Array, " n"]) -> Float[Array, " m"]:
    """A x, in a form whose derivatives a CPU works out many at a time.

    Of many directions at once the derivative is one product of matrices. XLA has a vectorised
    loop for it in this order, X A^T, and for A X' none: each sum waits for its last term.
    """
    return by.A @ x


@through.defjvp
def _through_jvp(at: tuple[Turned, Array], along: tuple[Turned, Array]) -> tuple[Array, Array]:
    (by, x), (d, dx) = at, along
    return by.A @ x, d.A @ x + dx @ by.transpose
