r"""One mode of a structure whose joint stiffness changes, without another eigenproblem.

With the modes (Lambda, Phi) of a reference and P = B^T Phi, adding B dK B^T gives

.. math:: (\Lambda - \lambda)\,\eta + P^T dK\,P\,\eta = 0 .

Scaling the mode of interest r to eta_r = 1 leaves m unknowns y = P eta and a scalar:

.. math::
    y(\lambda) &= (I + W_r(\lambda)\,dK)^{-1} p_r, \qquad
    W_r(\lambda) = \sum_{k\ne r} \frac{p_k p_k^T}{\lambda_k-\lambda} \\
    \lambda &= \lambda_r + p_r^T dK\,y(\lambda)

Newton's method on the second line is Rayleigh-quotient iteration: the derivative of its
right-hand side is 1 - eta^T eta. All modes of the reference take part, so that the result
is exact, at m^2 N operations an iteration and parameter set.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.structures.jointed import ModalBasis
from iwanjax.structures.small import dot, product, solve_general

_ITERATIONS = 8


class ModifiedMode(NamedTuple):
    """The mode after the change.

    Attributes
    ----------
    lam : (lanes) array
        Squared circular frequency, (rad/s)^2.
    y : m arrays (lanes)
        Joint deflections of the mass-normalised shape, B^T phi.
    error : (lanes) array
        Relative change of ``lam`` that another iteration would make.
    """

    lam: Array
    y: list[Array]
    error: Array


def modified_mode(basis: ModalBasis, r: int, change: Sequence[Array]) -> ModifiedMode:
    """Mode r of the reference, followed through a change of the joints' stiffness.

    Parameters
    ----------
    basis : ModalBasis
        The reference.
    r : int
        Index of the mode in the reference.
    change : m arrays
        Stiffness added at each joint row, force/length; the batch is on the last axis.

    Returns
    -------
    ModifiedMode
        Differentiable with respect to ``change`` (implicitly).
    """
    lanes = jnp.broadcast_shapes(*(jnp.shape(k) for k in change))
    dK = jnp.stack([jnp.broadcast_to(k, lanes) for k in change])
    lam = _eigenvalue(basis, dK, r)
    y, sensitivity = _shape(basis, r, dK, lam)
    norm2 = 1.0 + sensitivity
    error = jnp.abs(_mismatch(basis, r, dK, lam, y)) / (norm2 * jnp.abs(lam))
    scale = jax.lax.rsqrt(norm2)
    return ModifiedMode(lam, [row * scale for row in y], jax.lax.stop_gradient(error))


@partial(jax.custom_jvp, nondiff_argnums=(2,))
def _eigenvalue(basis: ModalBasis, dK: Float[Array, "m *lanes"], r: int) -> Array:
    start = basis.omega2[r]
    lam = jnp.broadcast_to(start, dK.shape[1:])
    for _ in range(_ITERATIONS):
        y, sensitivity = _shape(basis, r, dK, lam)
        lam = lam + _mismatch(basis, r, dK, lam, y) / (1.0 + sensitivity)
    return lam


@_eigenvalue.defjvp
def _eigenvalue_jvp(r, primals, tangents):
    basis, dK = primals
    lam = _eigenvalue(basis, dK, r)
    _, sensitivity = _shape(basis, r, dK, lam)

    def mismatch(basis: ModalBasis, dK: Array) -> Array:
        return _mismatch(basis, r, dK, lam, _shape(basis, r, dK, lam)[0])

    _, change = jax.jvp(mismatch, primals, tangents)
    return lam, change / (1.0 + sensitivity)


def _mismatch(basis: ModalBasis, r: int, dK: Array, lam: Array, y: Sequence[Array]) -> Array:
    """lambda_r + p_r^T dK y - lambda."""
    shift = sum((p * k * v for p, k, v in zip(basis.P[:, r], dK, y, strict=True)), jnp.zeros(()))
    return basis.omega2[r] - lam + shift


def _shape(basis: ModalBasis, r: int, dK: Array, lam: Array) -> tuple[list[Array], Array]:
    """y(lambda), and (y dK)^T W_r' (y dK): the other modes' share of eta^T eta."""
    P = basis.P
    m, modes = P.shape
    rest = np.delete(np.arange(modes), r)
    lower = np.tril_indices(m)
    pairs = P[lower[0]][:, rest] * P[lower[1]][:, rest]
    weight = 1.0 / (basis.omega2[rest].reshape(-1, *(1,) * lam.ndim) - lam)
    W = _symmetric(jnp.tensordot(pairs, weight, axes=1), m)
    dW = _symmetric(jnp.tensordot(pairs, weight**2, axes=1), m)
    A = [[(1.0 if i == j else 0.0) + W[i][j] * dK[j] for j in range(m)] for i in range(m)]
    y = solve_general(A, [P[i, r] * jnp.ones_like(lam) for i in range(m)])
    g = [k * v for k, v in zip(dK, y, strict=True)]
    return y, dot(g, product(dW, g))


def _symmetric(lower: Array, m: int) -> list[list[Array]]:
    """Rows of a symmetric matrix from its lower triangle, stacked on the first axis."""
    return [
        [lower[max(i, j) * (max(i, j) + 1) // 2 + min(i, j)] for j in range(m)] for i in range(m)
    ]
