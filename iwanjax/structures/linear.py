"""A linear structure from its matrices, its modes, and how far they are trusted."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.structures.checks import finite_array, positive_definite, square_matrix
from iwanjax.types import ArrayLike, warn_single_precision


class Modes(NamedTuple):
    """Elastic modes, lowest first; unpacks as ``omega, Phi = structure.modes()``.

    ``omega`` (modes,) in rad/s; ``Phi`` (n, modes) mass-normalised, each column's largest
    component positive.
    """

    omega: Array
    Phi: Array

    @property
    def frequency(self) -> Array:
        """Natural frequencies, Hz."""
        return self.omega / (2.0 * jnp.pi)


class LinearStructure(eqx.Module):
    r"""M u'' + C u' + K u = f, the structure without its joints (thesis Eq. 2.1).

    Parameters
    ----------
    M : (n, n) array_like
        Mass, symmetric and positive definite.
    C : (n, n) array_like or None
        Viscous damping, symmetric; None for none.
    K : (n, n) array_like
        Stiffness without the joints, symmetric. It may be singular: the structure may
        float freely, or be held together by its joints alone.

    The coordinates may be physical, Craig-Bampton or modal; units are any consistent set.

    Raises
    ------
    InputError
        For matrices that are not square, finite, real, symmetric or of one size, and for
        a mass that is not positive definite.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> structure = ij.LinearStructure(np.eye(2), None, [[2.0, -1.0], [-1.0, 1.0]])
    >>> structure.modes().omega.round(4).tolist()
    [0.618, 1.618]
    """

    M: Float[Array, "n n"]
    C: Float[Array, "n n"]
    K: Float[Array, "n n"]

    def __init__(self, M: ArrayLike, C: ArrayLike | None, K: ArrayLike):
        warn_single_precision()
        mass = square_matrix(M, "M")
        n = mass.shape[0]
        positive_definite(mass, "M")
        self.M = jnp.asarray(mass)
        self.C = jnp.asarray(np.zeros((n, n)) if C is None else square_matrix(C, "C", n))
        self.K = jnp.asarray(square_matrix(K, "K", n))

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return self.M.shape[0]

    def modes(self) -> Modes:
        r"""Elastic modes of (K, M), thesis Eq. (2.4).

        Rigid-body modes are taken out by the null-space transform of Sec. 3.2.2: with
        L = null(Phi_R^T M), the modes are L times those of (L^T K L, L^T M L).

        Returns
        -------
        Modes

        Raises
        ------
        InputError
            When K has a negative eigenvalue beyond round-off.
        """
        import scipy.linalg  # here, because it adds a third of a second to the first import

        M, K = np.asarray(self.M), np.asarray(self.K)
        L = null_space_transform(M, self._rigid())
        values, vectors = scipy.linalg.eigh(L.T @ K @ L, L.T @ M @ L)
        Phi = L @ vectors
        largest = np.take_along_axis(Phi, np.argmax(np.abs(Phi), axis=0)[None], axis=0)
        return Modes(jnp.asarray(np.sqrt(values)), jnp.asarray(Phi * np.sign(largest)))

    def rigid_body_modes(self) -> Float[Array, "n rigid"]:
        """Mass-normalised rigid-body modes (and mechanisms), (n, rigid); rigid may be 0."""
        return jnp.asarray(self._rigid())

    def damping_matrix(self, zeta: ArrayLike) -> Float[Array, "n n"]:
        r"""Modal damping :math:`C = M\Phi\,\mathrm{diag}(2\zeta\omega)\Phi^T M` (2.25, 3.19).

        Parameters
        ----------
        zeta : float or (k,) array_like
            Damping ratio of all elastic modes, or of the first k (the rest have none).

        Raises
        ------
        InputError
            For negative ratios or more of them than elastic modes.
        """
        omega, Phi = self.modes()
        ratios = finite_array(zeta, "zeta")
        if ratios.ndim == 0:
            ratios = np.full(omega.shape, float(ratios))
        if ratios.ndim != 1 or ratios.shape[0] > omega.shape[0]:
            raise InputError(
                f"zeta has shape {ratios.shape}; expected a number or up to {omega.shape[0]} "
                "ratios, one per elastic mode"
            )
        if np.any(ratios < 0):
            raise InputError(f"zeta holds a negative damping ratio ({ratios.min():.3g})")
        k = ratios.shape[0]
        shapes = self.M @ Phi[:, :k]
        return shapes * (2.0 * ratios * omega[:k]) @ shapes.T

    def _rigid(self) -> np.ndarray:
        import scipy.linalg

        M, K = np.asarray(self.M, np.float64), np.asarray(self.K, np.float64)
        values, vectors = scipy.linalg.eigh(K, M)
        # Round-off of a zero eigenvalue is eps times the largest, a few times over.
        tolerance = 100.0 * len(values) * np.finfo(np.float64).eps * abs(values[-1])
        if values[0] < -tolerance:
            raise InputError(
                f"K is not positive semidefinite: smallest eigenvalue of (K, M) is "
                f"{values[0]:.3g} (rad/s)^2; check signs and that no spring is negative"
            )
        return vectors[:, values <= tolerance]


def null_space_transform(M: np.ndarray, Phi_R: np.ndarray) -> np.ndarray:
    """Basis L of all motion without rigid-body momentum, null(Phi_R^T M) (3.10).

    Parameters
    ----------
    M : (n, n) array
        Mass.
    Phi_R : (n, rigid) array
        Rigid-body modes; with none, L is the identity.

    Returns
    -------
    (n, n - rigid) array
    """
    import scipy.linalg

    if Phi_R.shape[1] == 0:
        return np.eye(M.shape[0])
    return scipy.linalg.null_space(Phi_R.T @ M)


@dataclass(frozen=True)
class LinearTrust:
    r"""Relative standard deviations of a linear model's modes, elastic ones, the lowest first.

    .. math:: \omega_k = \bar\omega_k e^{s_\omega z_k}, \qquad
              \zeta_k = \bar\zeta_k e^{s_\zeta z'_k}, \qquad z_k, z'_k \sim N(0, 1)

    Parameters
    ----------
    frequencies : float or sequence of float
        Of natural frequencies: one for all modes, or one for each; beyond those given the last.
    damping : float or sequence of float
        Of modal damping, likewise.
    shapes : float
        Of mode shapes at the sensors. They are not fitted: this share of a channel's root mean
        square is what a right model may leave.

    Examples
    --------
    >>> import numpy as np
    >>> from iwanjax.structures import LinearTrust
    >>> trust = LinearTrust(frequencies=0.005, damping=(0.1, 0.3))
    >>> trust.deviations(np.array([0.0, 4.0, 9.0]))
    array([[0.   , 0.005, 0.005],
           [0.   , 0.1  , 0.3  ]])
    """

    frequencies: float | Sequence[float] = 0.005
    damping: float | Sequence[float] = 0.3
    shapes: float = 0.0

    def deviations(self, omega2: Float[np.ndarray, " modes"]) -> Float[np.ndarray, "2 modes"]:
        """Deviations of frequencies and of damping; none of a rigid body's."""
        elastic = np.cumsum(omega2 > 0.0) - 1
        rows = [
            np.asarray(each, float)[np.clip(elastic, 0, np.size(each) - 1)]
            if np.ndim(each)
            else np.full(len(omega2), each, float)
            for each in (self.frequencies, self.damping)
        ]
        return np.where(omega2 > 0.0, np.stack(rows), 0.0)
