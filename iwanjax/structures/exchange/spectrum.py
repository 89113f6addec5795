"""The low end of the spectrum of (K, M), small or sparse, whether M has an inverse or not."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg

from iwanjax.errors import InputError
from iwanjax.structures.exchange.contents import Matrix, full

# A dense eigenproblem of this size takes a tenth of a second.
_DENSE = 400
# Shifts below zero, as parts of the typical K_ii / M_ii. The first is far below elastic
# eigenvalues of any mesh and far above round-off; the others are for matrices written with
# few digits, whose rigid-body eigenvalues are small and of either sign.
_SHIFTS = (1e-10, 1e-7, 1e-5)
# Of a matrix scaled to a unit diagonal, pivots smaller than this are round-off.
_PIVOT = 1e-12
# A rigid-body eigenvalue is smaller than the first elastic one by this at least, that is a
# frequency by 1000; a structure on soft suspension has its own by 10 to 100.
_GAP = 1e-6
# Beside the largest mu, smaller ones are round-off.
_NO_MASS = 1e-14


class Spectrum(NamedTuple):
    """Lowest eigenvalues of K x = lambda M x.

    ``rigid`` of them vanish. ``elastic`` (count,), (rad/s)^2, ascending, are the next; none
    when ``negative``, the number that are negative beyond round-off, is not 0.
    """

    rigid: int
    elastic: np.ndarray
    negative: int


def lowest_eigenvalues(K: Matrix, M: Matrix, count: int) -> Spectrum:
    r"""The lowest eigenvalues by shift and invert about a negative shift.

    With :math:`A = K + \sigma M` positive definite, the eigenvalues of :math:`M x = \mu A x` give
    :math:`\lambda = 1/\mu - \sigma`; a massless DOF has :math:`\mu = 0`. A first, small
    :math:`\sigma` tells the definiteness of K and finds about where the elastic eigenvalues
    begin; from there they come out accurately. By Sylvester's law of inertia the negative
    pivots of A count the eigenvalues below :math:`-\sigma`, and those of
    :math:`K - \tau M` the rigid-body modes, of which Lanczos iterations may miss some.

    Parameters
    ----------
    K, M : (n, n) array or sparse array
        Stiffness, and a positive semidefinite mass.
    count : int
        How many elastic ones; fewer come out where fewer are finite.

    Raises
    ------
    InputError
        When some motion has neither mass nor stiffness.
    """
    stiff, heavy = K.diagonal(), M.diagonal()
    ratios = np.abs(stiff[heavy > 0] / heavy[heavy > 0])
    typical = float(np.median(ratios)) or float(np.max(ratios)) or 1.0
    wanted = min(6 + count + 1, int(np.sum(heavy > 0)))
    negative = 0
    for shift in _SHIFTS:
        sigma = shift * typical
        factor = _factored(K + sigma * M)
        below = int(np.sum(factor.pivots < -_PIVOT))
        negative = negative or below
        # Where A is singular but for round-off, a larger shift may do.
        rough = None if below else factor.largest(M, wanted)
        if rough is not None:
            return _refined(K, M, _unshifted(rough, sigma), count, sigma)
    if negative:
        return Spectrum(0, np.empty(0), negative)
    raise InputError(
        "K and M are singular together: some motion has neither mass nor stiffness; look for "
        "nodes that nothing holds"
    )


def _refined(K: Matrix, M: Matrix, rough: np.ndarray, count: int, small: float) -> Spectrum:
    """Rigid-body and elastic eigenvalues, given what the lowest and a small one are about."""
    rigid = _vanishing(rough, small)
    if rigid == len(rough):
        return Spectrum(rigid, np.empty(0), 0)
    sigma = float(rough[rigid])
    found = _factored(K + sigma * M).largest(M, len(rough))
    values = rough if found is None else _unshifted(found, sigma)
    bound = np.sqrt(_GAP) * float(values[_vanishing(values, small)])
    if rigid:
        pivots = _factored(K - bound * M).pivots
        rigid = int(np.sum(pivots < 0)) if len(pivots) == K.shape[0] else rigid
    return Spectrum(rigid, values[values > bound][:count], 0)


def _unshifted(mu: np.ndarray, sigma: float) -> np.ndarray:
    """Eigenvalues lambda, ascending; mu that are round-off belong to motions without mass."""
    return np.sort(1.0 / mu[mu > _NO_MASS * np.max(mu)] - sigma)


def _vanishing(values: np.ndarray, small: float) -> int:
    """How many of ascending eigenvalues vanish, by themselves or beside the next."""
    vanish = np.abs(values) < _GAP * small
    # Below what is small: stiff springs, which penalties are, leave wide gaps higher up.
    vanish[:-1] |= np.abs(values[:-1]) < np.minimum(_GAP * values[1:], small)
    return int(np.flatnonzero(vanish)[-1]) + 1 if np.any(vanish) else 0


def definiteness(M: Matrix) -> str:
    """``"definite"``, ``"singular"`` or ``"indefinite"``, for a mass of positive diagonal."""
    least = float(np.min(_factored(M).pivots))
    return "indefinite" if least < -_PIVOT else "singular" if least < _PIVOT else "definite"


class _Factor(NamedTuple):
    """A symmetric matrix A scaled to a unit diagonal, and its factors.

    ``pivots`` have the signs of the eigenvalues; there is but one, 0, where it cannot be
    factored. ``largest(M, count)`` are the largest mu of
    M x = mu A x, or None where A is not definite.
    """

    pivots: np.ndarray
    largest: Callable[[Matrix, int], np.ndarray | None]


def _factored(A: Matrix) -> _Factor:
    diagonal = np.abs(A.diagonal())
    scale = sp.diags_array(1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)))
    return (_dense if A.shape[0] <= _DENSE else _sparse)(A, scale)


def _dense(A: Matrix, scale: Matrix) -> _Factor:
    scaled = full(scale @ A @ scale)
    n = scaled.shape[0]

    def largest(M: Matrix, count: int) -> np.ndarray | None:
        wanted = [n - count, n - 1]
        try:
            return scipy.linalg.eigh(
                full(scale @ M @ scale), scaled, eigvals_only=True, subset_by_index=wanted
            )
        except np.linalg.LinAlgError:
            return None

    return _Factor(scipy.linalg.eigvalsh(scaled), largest)


def _sparse(A: Matrix, scale: Matrix) -> _Factor:
    """L U with pivots from the diagonal, so that U = D L^T."""
    scaled = sp.csc_array(scale @ A @ scale)
    singular = _Factor(np.zeros(1), lambda M, count: None)
    try:
        factor = scipy.sparse.linalg.splu(
            scaled,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:
        return singular
    if not np.array_equal(factor.perm_r, factor.perm_c):
        return singular  # a pivot of zero made it exchange rows
    n = A.shape[0]

    def largest(M: Matrix, count: int) -> np.ndarray | None:
        operator: Any = scipy.sparse.linalg.LinearOperator
        values: Any = scipy.sparse.linalg.eigsh(
            sp.csc_array(scale @ M @ scale),
            k=count,
            M=scaled,
            Minv=operator((n, n), matvec=factor.solve, dtype=np.float64),
            which="LA",
            v0=np.random.default_rng(0).standard_normal(n),
            return_eigenvectors=False,
        )
        return values

    return _Factor(factor.U.diagonal(), largest)
