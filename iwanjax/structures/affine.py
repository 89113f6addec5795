"""A linear structure whose matrices are affine in a few parameters, and how its modes follow."""

from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from iwanjax.errors import InputError
from iwanjax.structures.checks import positive_definite, square_matrix
from iwanjax.structures.linear import LinearStructure
from iwanjax.types import ArrayLike, warn_single_precision

# Eigenvalues nearer to one another than this share of the larger, or than round-off of the
# largest of all, are taken for one: their shapes turn freely among themselves.
_REPEATED, _ROUND_OFF = 1e-9, 1e-13


class Term(NamedTuple):
    """What one unit of a parameter adds to the matrices.

    Attributes
    ----------
    K : (n, n) array_like or None
        To the stiffness; None for nothing.
    M : (n, n) array_like or None
        To the mass.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> added = ij.Term(M=np.diag([1.0, 0.0]))  # a mass on the first coordinate
    >>> family = ij.AffineStructure(np.eye(2), np.eye(2), {"m": added})
    >>> family.at({"m": 0.5}).M.tolist()
    [[1.5, 0.0], [0.0, 1.0]]
    """

    K: ArrayLike | None = None
    M: ArrayLike | None = None


def spring(*rows: ArrayLike) -> Term:
    r"""Springs of one stiffness k on deflections d = row @ u: :math:`\sum_i b_i b_i^T`.

    Parameters
    ----------
    rows : (n,) array_like
        One for each spring.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> np.asarray(ij.spring([-1.0, 1.0]).K).tolist()
    [[1.0, -1.0], [-1.0, 1.0]]
    """
    B = np.stack([np.asarray(row, float) for row in rows])
    return Term(K=B.T @ B)


class AffineStructure(eqx.Module):
    r"""K(theta) = K_0 + sum_i theta_i K_i and M(theta) = M_0 + sum_i theta_i M_i.

    Young's modulus of a part, springs, added masses: what low-amplitude updating varies
    (thesis Sec. 3.4.2). With Craig-Bampton matrices the family is exact for springs on the
    interface and for one modulus of the whole body, neither of which changes the reduction's
    shapes.

    Parameters
    ----------
    M, K : (n, n) array_like
        What does not vary, symmetric; K may be zero.
    terms : mapping of str to Term
        What a unit of each parameter adds.

    Raises
    ------
    InputError
        For matrices that are not square, finite, symmetric or of one size, and for no terms.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> springs = {"k1": ij.spring([1, 0]), "k2": ij.spring([-1, 1])}
    >>> family = ij.AffineStructure(np.eye(2), np.zeros((2, 2)), springs)
    >>> family.at({"k1": 2.0, "k2": 1.0}).K.tolist()
    [[3.0, -1.0], [-1.0, 1.0]]
    """

    names: tuple[str, ...] = eqx.field(static=True)
    M: Float[Array, "n n"]
    K: Float[Array, "n n"]
    mass_terms: Float[Array, "parameters n n"]
    stiffness_terms: Float[Array, "parameters n n"]

    def __init__(self, M: ArrayLike, K: ArrayLike, terms: Mapping[str, Term]):
        warn_single_precision()
        mass = square_matrix(M, "M")
        n = mass.shape[0]
        if not terms:
            raise InputError("AffineStructure: no terms; give at least one parameter")
        self.names = tuple(terms)
        self.M = jnp.asarray(mass)
        self.K = jnp.asarray(square_matrix(K, "K", n))
        self.mass_terms = _stacked("M", {name: each.M for name, each in terms.items()}, n)
        self.stiffness_terms = _stacked("K", {name: each.K for name, each in terms.items()}, n)

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return self.M.shape[0]

    def matrices(self, theta: Float[Array, " parameters"]) -> tuple[Array, Array]:
        """M and K at parameter values, (n, n) each."""
        return (
            self.M + jnp.tensordot(theta, self.mass_terms, axes=1),
            self.K + jnp.tensordot(theta, self.stiffness_terms, axes=1),
        )

    def modes(self, theta: Float[Array, " parameters"]) -> tuple[Array, Array]:
        r"""All modes, rigid ones first: :math:`\lambda` (n,) in (rad/s)^2, Phi (n, n).

        Shapes are mass-normalised. Values only: :meth:`followed` has the derivatives.
        """
        M, K = self.matrices(jax.lax.stop_gradient(theta))
        root = jnp.linalg.cholesky(M)
        half = jax.scipy.linalg.solve_triangular(root, K, lower=True)
        A = jax.scipy.linalg.solve_triangular(root, half.T, lower=True)
        lam, V = jnp.linalg.eigh(0.5 * (A + A.T))
        return lam, jax.scipy.linalg.solve_triangular(root.T, V, lower=False)

    def followed(
        self,
        theta: Float[Array, " parameters"],
        lam: Float[Array, " n"],
        Phi: Float[Array, "n n"],
        which: Int[Array, " k"],
    ) -> tuple[Array, Array]:
        r"""Some of the modes as functions of the parameters, (k,) and (n, k).

        Rayleigh's quotient and modal superposition about the modes at hand (Fox and Kapoor,
        AIAA J. 6, 1968): the values are theirs, the first derivatives exact,

        .. math::
            \dot\lambda_i = \phi_i^T(\dot K - \lambda_i\dot M)\phi_i, \qquad
            \dot\phi_i = \sum_{j\ne i}\phi_j
            \frac{\phi_j^T(\dot K - \lambda_i\dot M)\phi_i}{\lambda_i-\lambda_j}
            - \tfrac12 \phi_i\,\phi_i^T\dot M\phi_i .

        Shapes of repeated eigenvalues, which turn freely among themselves, are taken not to.

        Parameters
        ----------
        theta : (parameters,) array
            Where ``lam`` and ``Phi`` are the modes.
        lam, Phi : (n,), (n, n) array
            From :meth:`modes`.
        which : (k,) array of int
            Those to follow.
        """
        lam, Phi = jax.lax.stop_gradient((lam, Phi))
        lam_i, phi = lam[which], Phi[:, which]
        K_phi = self.K @ phi + jnp.tensordot(theta, self.stiffness_terms @ phi, axes=1)
        M_phi = self.M @ phi + jnp.tensordot(theta, self.mass_terms @ phi, axes=1)
        modal_mass = jnp.sum(phi * M_phi, axis=0)
        apart = lam_i - lam[:, None]
        size = jnp.maximum(jnp.abs(lam_i), jnp.abs(lam)[:, None])
        other = jnp.abs(apart) > _REPEATED * size + _ROUND_OFF * lam[-1]
        shares = jnp.where(
            other, Phi.T @ (K_phi - lam_i * M_phi) / jnp.where(other, apart, 1.0), 0.0
        )
        shape = phi + Phi @ (shares - jax.lax.stop_gradient(shares))
        return jnp.sum(phi * K_phi, axis=0) / modal_mass, shape * jax.lax.rsqrt(modal_mass)

    def at(self, values: Mapping[str, float]) -> LinearStructure:
        """The structure with these parameters, undamped.

        Raises
        ------
        InputError
            For parameters that are missing or unknown, and a mass that is not positive
            definite.
        """
        if set(values) != set(self.names):
            raise InputError(
                f"AffineStructure.at: got {', '.join(values)}; expected {', '.join(self.names)}"
            )
        M, K = self.matrices(jnp.asarray([float(values[name]) for name in self.names]))
        positive_definite(np.asarray(M), "M")
        return LinearStructure(M, None, K)


def _stacked(what: str, terms: Mapping[str, ArrayLike | None], n: int) -> Array:
    found = [
        np.zeros((n, n)) if term is None else square_matrix(term, f"{what} of term {name!r}", n)
        for name, term in terms.items()
    ]
    return jnp.asarray(np.stack(found))
