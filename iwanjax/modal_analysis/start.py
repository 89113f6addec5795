"""Real modes at given poles: shapes by linear least squares, scaled by driving points."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex, Float

from iwanjax.modal_analysis.modal_model import ModalModel, ModalTerms

# A residual term's direction whose driving-point part is below this share of the largest one is
# the noise of the others.
_LEAST_PART = 1e-2


def linear_start(
    model: ModalModel, poles: Complex[np.ndarray, " n"]
) -> tuple[ModalTerms, Float[np.ndarray, " n"]]:
    r"""Modes where their poles are known.

    The terms' numerators are a linear least-squares fit; of each the part of rank one is
    :math:`\phi_s \phi_i^T`, scaled so that shapes at the inputs are those of the sensors there.

    Parameters
    ----------
    model : ModalModel
        What is measured; its own parameters are not used.
    poles : (n,) array
        rad/s.

    Returns
    -------
    ModalTerms
    gain : (n,) array
        What each mode's term takes off the squared residual, the others staying.
    """
    s, H, deviation = (np.asarray(each) for each in (model.s, model.H, model.deviation))
    omega, zeta = np.abs(poles), -np.real(poles) / np.abs(poles)
    n, (sensors, inputs) = len(poles), H.shape[1:]
    dynamic, beyond = (
        np.asarray(each) for each in model.terms(*map(jnp.asarray, (omega, zeta, s)))
    )
    if model.decays:
        dynamic = np.concatenate([dynamic * s[:, None], dynamic], axis=1)
    terms = np.concatenate([dynamic, beyond], axis=1)
    found = np.zeros((terms.shape[1], sensors, inputs))
    gain = np.zeros(n)
    for j, power in enumerate(np.asarray(model.power)):
        for i in range(inputs):
            A = terms * s[:, None] ** power / deviation[:, j, i, None]
            b = H[:, j, i] / deviation[:, j, i]
            found[:, j, i], each = _solved(A, b)
            gain += np.sum(each[: dynamic.shape[1]].reshape(-1, n), axis=0)
    numerators, remote = found[: dynamic.shape[1]], found[dynamic.shape[1] :]
    if model.decays:
        numerators = np.concatenate([numerators[:n], numerators[n:]], axis=2)
    factors = [_rank_one(each, () if model.decays else model.sites) for each in numerators]
    shapes, drives = (np.stack(each, axis=1) for each in zip(*factors, strict=True))
    return ModalTerms(*map(jnp.asarray, (omega, zeta, shapes, drives, remote))), gain


def _solved(A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Real factors of complex columns, and what each takes off the squared residual."""
    A, b = (np.concatenate([np.real(each), np.imag(each)]) for each in (A, b))
    size = np.linalg.norm(A, axis=0)
    x = np.linalg.lstsq(A / size, b, rcond=None)[0]
    covariance = np.linalg.pinv(A.T @ A / np.outer(size, size), hermitian=True)
    # Two parts of each complex value, as the residuals count them.
    return x / size, 2.0 * x**2 / np.diag(covariance)


def _rank_one(
    numerator: Float[np.ndarray, "s i"], sites: Sequence[int | None]
) -> tuple[np.ndarray, np.ndarray]:
    """Shapes at sensors (s,) and inputs (i,) whose product is nearest to a numerator."""
    U, size, Vt = np.linalg.svd(numerator, full_matrices=False)
    u, v = np.sqrt(size[0]) * U[:, 0], np.sqrt(size[0]) * Vt[0]
    known = [i for i, site in enumerate(sites) if site is not None]
    if not known:
        return u, v
    there = u[[site for site in sites if site is not None]]
    # c u and v / c agree at the driving points in size; in sign where the term there is positive.
    scale = np.sqrt(np.linalg.norm(v[known]) / max(np.linalg.norm(there), np.finfo(float).tiny))
    sign = 1.0 if there @ v[known] >= 0.0 else -1.0
    return scale * u, sign * v / scale


def residual_modes(
    numerator: Float[np.ndarray, "s i"], sites: Sequence[int | None]
) -> tuple[Float[np.ndarray, "s r"], Float[np.ndarray, "i r"]]:
    r"""Modes of one frequency that make a residual term, as far as a structure can have it.

    At the driving points the term has to be symmetric and positive, :math:`R_{dd} = V \Lambda
    V^T`; then :math:`\psi = R_{sd} V \Lambda^{-1/2}` has :math:`\psi_s \psi_d^T = R_{sd}`.

    Parameters
    ----------
    numerator : (s, i) array
        R.
    sites : tuple of int or None
        For each input the sensor at its place.

    Returns
    -------
    shapes, drives : (s, r), (i, r) array
        At sensors and inputs, one mode for each positive part.
    """
    known = [i for i, site in enumerate(sites) if site is not None]
    if not known:
        U, size, Vt = np.linalg.svd(numerator, full_matrices=False)
        return U * np.sqrt(size), Vt.T * np.sqrt(size)
    at = [site for site in sites if site is not None]
    there = numerator[np.ix_(at, known)]
    values, vectors = np.linalg.eigh(0.5 * (there + there.T))
    kept = values > _LEAST_PART * max(values[-1], 0.0)
    shapes = numerator[:, known] @ (vectors[:, kept] / np.sqrt(values[kept]))
    drives = numerator.T @ np.linalg.pinv(shapes).T
    drives[known] = shapes[at]
    return shapes, drives
