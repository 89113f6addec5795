r"""Modes of a structure whose joint stiffness changes, without another eigenproblem.

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
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from iwanjax.structures.jointed import ModalBasis
from iwanjax.structures.small import dot, product, solve_general

_ITERATIONS = 8
# Relative change of an eigenvalue by one more iteration that counts as none.
_SETTLED = 1e-10


class ModifiedModes(NamedTuple):
    """Modes after the change; K modes and any number of lanes (parameter sets).

    Attributes
    ----------
    lam : (K, lanes) array
        Squared circular frequency, (rad/s)^2.
    y : m arrays (K, lanes)
        Joint deflections of the mass-normalised shape, B^T phi.
    assurance : (K, lanes) array
        Modal assurance of the shape with the reference's. Above 1/2 no other mode can be
        meant; 0 where the iteration has not settled.
    """

    lam: Array
    y: list[Array]
    assurance: Array


def modified_modes(
    basis: ModalBasis, modes: Int[Array, " K"], change: Sequence[Array]
) -> ModifiedModes:
    """Modes of the reference, followed through a change of the joints' stiffness.

    Parameters
    ----------
    basis : ModalBasis
        The reference.
    modes : (K,) array of int
        Indices of the K modes in the reference.
    change : m arrays
        Stiffness added at each joint row, force/length; scalars or (lanes,).

    Returns
    -------
    ModifiedModes
        Differentiable with respect to ``change`` (implicitly).
    """
    (lanes,) = jnp.broadcast_shapes((1,), *(jnp.shape(k) for k in change))
    dK = jnp.stack([jnp.broadcast_to(k, (lanes,)) for k in change])
    lam = _eigenvalues(basis, dK, modes)
    y, sensitivity = _shapes(basis, modes, dK, lam)
    norm2 = 1.0 + sensitivity
    error = jnp.abs(_mismatch(basis, modes, dK, lam, y)) / (norm2 * jnp.abs(lam))
    assurance = jnp.where(error <= _SETTLED, 1.0 / norm2, 0.0)
    scale = jax.lax.rsqrt(norm2)
    return ModifiedModes(lam, [row * scale for row in y], jax.lax.stop_gradient(assurance))


@jax.custom_jvp
def _eigenvalues(
    basis: ModalBasis, dK: Float[Array, "m lanes"], modes: Int[Array, " K"]
) -> Float[Array, "K lanes"]:
    def newton(_: int, lam: Array) -> Array:
        y, sensitivity = _shapes(basis, modes, dK, lam)
        return lam + _mismatch(basis, modes, dK, lam, y) / (1.0 + sensitivity)

    start = jnp.broadcast_to(basis.omega2[modes][:, None], (modes.shape[0], dK.shape[1]))
    return jax.lax.fori_loop(0, _ITERATIONS, newton, start)


@_eigenvalues.defjvp
def _eigenvalues_jvp(primals, tangents):
    basis, dK, modes = primals
    lam = _eigenvalues(basis, dK, modes)
    _, sensitivity = _shapes(basis, modes, dK, lam)

    def mismatch(basis: ModalBasis, dK: Array) -> Array:
        return _mismatch(basis, modes, dK, lam, _shapes(basis, modes, dK, lam)[0])

    _, change = jax.jvp(mismatch, primals[:2], tangents[:2])
    return lam, change / (1.0 + sensitivity)


def _mismatch(
    basis: ModalBasis, modes: Int[Array, " K"], dK: Array, lam: Array, y: Sequence[Array]
) -> Array:
    """lambda_r + p_r^T dK y - lambda."""
    forces = [k * v for k, v in zip(dK, y, strict=True)]
    shift = dot([p[:, None] for p in basis.P[:, modes]], forces)
    return basis.omega2[modes][:, None] - lam + shift


def _shapes(
    basis: ModalBasis, modes: Int[Array, " K"], dK: Array, lam: Array
) -> tuple[list[Array], Array]:
    """y(lambda), and (y dK)^T W_r' (y dK): the other modes' share of eta^T eta."""
    P = basis.P
    m, count = P.shape
    lower = np.tril_indices(m)
    pairs = P[lower[0]] * P[lower[1]]
    # W_r leaves mode r itself out.
    others = (jnp.arange(count)[:, None] != modes)[:, :, None]
    distance = jnp.where(others, basis.omega2[:, None, None] - lam, 1.0)
    weight = jnp.where(others, 1.0 / distance, 0.0)
    W = _symmetric(jnp.tensordot(pairs, weight, axes=1), m)
    dW = _symmetric(jnp.tensordot(pairs, weight**2, axes=1), m)
    A = [[(1.0 if i == j else 0.0) + W[i][j] * dK[j] for j in range(m)] for i in range(m)]
    y = solve_general(A, [p[:, None] * jnp.ones_like(lam) for p in P[:, modes]])
    g = [k * v for k, v in zip(dK, y, strict=True)]
    return y, dot(g, product(dW, g))


def _symmetric(lower: Array, m: int) -> list[list[Array]]:
    """Rows of a symmetric matrix from its lower triangle, stacked on the first axis."""

    def at(i: int, j: int) -> Array:
        return lower[max(i, j) * (max(i, j) + 1) // 2 + min(i, j)]

    return [[at(i, j) for j in range(m)] for i in range(m)]
