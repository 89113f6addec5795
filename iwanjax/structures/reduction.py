r"""Craig-Bampton reduction of sparse matrices, with averaged motions as its interface.

The interface is any set of rows c with q = C u: single degrees of freedom, or the average
motions of contact patches. Constraint modes answer q = 1, fixed-interface modes have q = 0:

.. math::
    K\Psi + C^T\Lambda = 0,\; C\Psi = I, \qquad
    K\Phi + C^T\Lambda' = M\Phi\,\mathrm{diag}(\omega^2),\; C\Phi = 0, \qquad u = \Psi q + \Phi\eta

K is singular for a free structure and C would fill the factors, so neither is factorised: a few
single degrees of freedom are held by springs, and multipliers for C, together with the springs'
forces, are solved for in a small dense system that takes the springs back out exactly.
(R. R. Craig, M. C. C. Bampton, AIAA J. 6 (1968) 1313; thesis Sec. 3.3.1.)
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg

from iwanjax.errors import InputError
from iwanjax.threads import one_thread

# SciPy's type stubs do not know the shapes of its sparse arrays.
Sparse: TypeAlias = Any

# Relative residual of a static solution that round-off explains.
_RESIDUAL = 1e-6
# What is left of a unit row that others explain to all but round-off.
_DEPENDENT = 1e-9
_FREE = (
    "holding the interface leaves the structure free to move (a static solution misses "
    "equilibrium {}); every separate part needs enough interface rows"
)
# Start of Lanczos iterations: the same each time, so that results repeat to the last digit.
_SEED = 20170101


@dataclass(frozen=True, eq=False)
class CraigBampton:
    r"""A reduction basis and the matrices in its coordinates (q, η).

    Attributes
    ----------
    M, K : (b + k, b + k) arrays
        Mass and stiffness in the coordinates.
    basis : (n, b + k) array
        Constraint modes, then mass-normalised fixed-interface modes.
    fixed_frequency : (k,) array
        Natural frequencies with the interface held, Hz.
    residual_flexibility : (m,) array
        Share of each load's static flexibility, interface held, that the fixed-interface
        modes lack: :math:`1 - \sum_i (c\,\phi_i)^2/\omega_i^2 / c\,x` with x the exact
        response to the load c. Near 1 for a load whose response is local.
    """

    M: np.ndarray
    K: np.ndarray
    basis: np.ndarray
    fixed_frequency: np.ndarray
    residual_flexibility: np.ndarray

    def effective_mass(self, rigid: np.ndarray) -> np.ndarray:
        r"""Mass that each fixed-interface mode moves when the interface moves rigidly, (k, r).

        :math:`(\phi_i^T M \Psi r)^2`; a mode with much of it may not be left out.

        Parameters
        ----------
        rigid : (b, r) array
            Interface coordinates of the rigid motions.
        """
        b = len(rigid)
        return (self.M[b:, :b] @ rigid) ** 2


class _Bordered:
    r"""Solves :math:`A x + W s = f,\; W^T x - D s = g` with one factorisation of A.

    A column w with D = 1/k is a spring k on :math:`w^T x`; with D = 0 it prescribes
    :math:`w^T x = g`.
    """

    def __init__(self, A: Sparse, W: Sparse, D: np.ndarray):
        # Symmetric and positive definite: no pivoting, hence an ordering that fills little.
        self._factors: Any = scipy.sparse.linalg.splu(
            A, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        self._W = W
        self._Y = self._factors.solve(W.toarray())
        self._small = scipy.linalg.lu_factor(W.T @ self._Y + np.diag(D))

    def solve(self, f: np.ndarray) -> np.ndarray:
        """The x of g = 0."""
        x = self._factors.solve(f)
        return x - self._Y @ scipy.linalg.lu_solve(self._small, self._W.T @ x)

    def prescribed(self, g: np.ndarray) -> np.ndarray:
        """The x of f = 0."""
        return self._Y @ scipy.linalg.lu_solve(self._small, g)

    def modes(self, K: Any, M: Sparse, count: int, shift: float) -> tuple[Any, Any]:
        """The ``count`` eigenvalues nearest above ``shift`` and their shapes."""
        # Calling the class gives a subclass, which the stubs do not know.
        operator: Any = scipy.sparse.linalg.LinearOperator
        inverse = operator(M.shape, matvec=lambda f: self.solve(np.ravel(f)), dtype=np.float64)
        start = inverse @ (M @ np.random.default_rng(_SEED).normal(size=M.shape[0]))
        values, shapes = scipy.sparse.linalg.eigsh(
            K, count, M, sigma=shift, OPinv=inverse, v0=start
        )
        order = np.argsort(values)
        return values[order], shapes[:, order]


# Products with a hundred columns: a second thread of BLAS takes four times the processor time.
@one_thread()
def craig_bampton(
    M: Sparse,
    K: Sparse,
    interface: Sparse,
    modes: int,
    loads: Sparse | None = None,
    *,
    attach: bool = False,
) -> CraigBampton:
    """Reduce sparse matrices to the interface's motions and fixed-interface modes.

    Parameters
    ----------
    M, K : (n, n) sparse arrays
        Symmetric; K may let the structure float, as long as holding the interface stops it.
    interface : (b, n) sparse array
        Rows C of the coordinates q = C u that are kept.
    modes : int
        Number of fixed-interface modes k.
    loads : (m, n) sparse array, optional
        Rows of loads whose residual flexibility is reported.
    attach : bool
        Make the loads' static responses exact: what the modes lack of them joins the modes as
        m further shapes (residual attachment modes) with their Ritz frequencies.

    Returns
    -------
    CraigBampton

    Raises
    ------
    InputError
        For sizes that do not fit, rows that are linearly dependent, and an interface that
        leaves the structure free to move when it is held.
    """
    n, b = M.shape[0], interface.shape[0]
    if M.shape != (n, n) or K.shape != (n, n) or interface.shape != (b, n):
        raise InputError(
            f"M {M.shape}, K {K.shape} and interface {interface.shape} do not fit; expected "
            "(n, n), (n, n) and (b, n)"
        )
    if not isinstance(modes, int) or not 1 <= modes < n - b - 1:
        raise InputError(
            f"modes = {modes!r}: expected a number of fixed-interface modes, from 1 to {n - b - 2}"
        )
    C = sp.csc_array(interface)
    held = _held(M, K, C)
    Psi = _constraint_modes(held, C)
    lam, Phi = held.modes(K, M, modes, 0.0)
    residual = np.zeros(0)
    if loads is not None:
        rows = loads.toarray()
        X = held.solve(rows.T)
        exact = np.sum(rows.T * X, axis=0)
        residual = 1.0 - np.sum((rows @ Phi) ** 2 / lam, axis=1) / exact
        if attach:
            X -= Phi @ (Phi.T @ (M @ X))
            # M-orthogonal to eigenvectors is K-orthogonal too: the rest is a problem of its own.
            ritz, mixture = scipy.linalg.eigh(_projected(K, X), _projected(M, X))
            lam, Phi = np.concatenate([lam, ritz]), np.hstack([Phi, X @ mixture])
    basis = np.hstack([Psi, Phi])
    mass, stiffness = _projected(M, basis), _projected(K, basis)
    # Zero by the equations above; kept zero so that statics stay exact.
    stiffness[:b, b:] = stiffness[b:, :b] = 0.0
    stiffness[b:, b:] = np.diag(lam)
    mass[b:, b:] = np.eye(len(lam))
    return CraigBampton(mass, stiffness, basis, np.sqrt(lam) / (2 * np.pi), residual)


@one_thread()
def full_modes(
    M: Sparse,
    K: Sparse,
    springs: Mapping[str, tuple[Sparse, float]],
    count: int,
    shift: float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest modes of the unreduced structure, springs added: the reference for a reduction.

    Parameters
    ----------
    M, K : (n, n) sparse arrays
        As for :func:`craig_bampton`.
    springs : mapping of str to ((1, n) row, stiffness)
        Springs on ``row @ u``; infinite stiffness couples rigidly.
    count : int
        Number of modes, rigid ones included.
    shift : float
        Distance below zero from where modes are sought, Hz: small beside the elastic ones.

    Returns
    -------
    frequency : (count,) array
        Hz; of rigid modes, zero to round-off.
    shapes : (n, count) array
        Mass-normalised.
    """
    sigma = (2 * np.pi * shift) ** 2
    # A column that does nothing keeps the small system from being empty.
    rows, D = [sp.csr_array((1, M.shape[0]))], [1.0]
    for row, stiffness in springs.values():
        if stiffness != 0:
            rows.append(row)
            D.append(1.0 / stiffness)
    W = sp.csc_array(sp.vstack(rows).T)
    lam, shapes = _Bordered(sp.csc_array(K + sigma * M), W, np.array(D)).modes(K, M, count, -sigma)
    return np.sqrt(np.maximum(lam, 0.0)) / (2 * np.pi), shapes


def _held(M: Sparse, K: Sparse, C: Sparse) -> _Bordered:
    """Solver with the interface prescribed: multipliers for C, then the pins' forces."""
    touched = np.unique(C.nonzero()[1])
    rows = C[:, touched].toarray()
    sizes = np.linalg.norm(rows, axis=1)
    if np.any(sizes == 0):
        raise InputError(f"interface row {int(np.argmin(sizes))} is zero")
    # Pivoting picks single DOFs that see all of the interface's motions as well as any can.
    factors: Any = scipy.linalg.qr(rows / sizes[:, None], mode="r", pivoting=True)
    R, order = factors
    diagonal = np.abs(np.diag(R))
    if len(diagonal) < len(rows) or diagonal[-1] < _DEPENDENT * diagonal[0]:
        raise InputError("interface rows are linearly dependent; leave out those that repeat")
    pins = touched[order[: len(rows)]]
    stiffness = np.asarray(K.diagonal())[pins]
    unit = sp.csc_array(
        (np.ones(len(pins)), (pins, np.arange(len(pins)))), shape=(K.shape[0], len(pins))
    )
    A = sp.csc_array(K + (unit * stiffness) @ unit.T)
    D = np.concatenate([np.zeros(len(rows)), -1.0 / stiffness])
    try:
        held = _Bordered(A, sp.csc_array(sp.hstack([C.T, -unit])), D)
    except RuntimeError:  # a pivot that is exactly zero
        raise InputError(_FREE.format("infinitely")) from None
    missing = _violation(held, M, K, C)
    if not missing < _RESIDUAL:
        raise InputError(_FREE.format(f"by {missing:.1g}"))
    return held


def _violation(held: _Bordered, M: Sparse, K: Sparse, C: Sparse) -> float:
    """How far a static solution is from equilibrium and from a held interface, relative."""
    f = M @ np.random.default_rng(_SEED).normal(size=K.shape[0])
    x = held.solve(f)
    missing = f - K @ x
    across, _ = np.linalg.qr(C.T.toarray())
    missing -= across @ (across.T @ missing)
    slip = np.linalg.norm(across.T @ x) / np.linalg.norm(x)
    return float(np.linalg.norm(missing) / np.linalg.norm(f) + slip)


def _constraint_modes(held: _Bordered, C: Sparse) -> np.ndarray:
    """Static responses to unit motion of one interface coordinate each, (n, b)."""
    b = C.shape[0]
    return held.prescribed(np.vstack([np.eye(b), np.zeros((b, b))]))


def _projected(matrix: Sparse, basis: np.ndarray) -> np.ndarray:
    product = basis.T @ (matrix @ basis)
    return 0.5 * (product + product.T)
