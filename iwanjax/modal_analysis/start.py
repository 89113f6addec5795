"""Real modes at given poles: shapes by linear least squares, scaled by driving points."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from iwanjax.modal_analysis.modal_model import ModalModel, Modes

# A residual term's direction whose driving-point part is below this share of the largest one is
# the noise of the others.
_LEAST_PART = 1e-2


def linear_start(
    model: ModalModel,
    poles: Complex[np.ndarray, " n"],
    lower: tuple[float, float],
) -> tuple[Modes, Float[np.ndarray, " n"]]:
    r"""Modes where their poles are known.

    The terms' numerators are a linear least-squares fit; of each the part of rank one is
    :math:`\phi_s \phi_i^T`, scaled so that shapes at the inputs are those of the sensors there.

    Parameters
    ----------
    model : ModalModel
        What is measured; its own parameters are not used.
    poles : (n,) array
        rad/s.
    lower : (omega, zeta)
        Of the modes below the band.

    Returns
    -------
    Modes
    gain : (n,) array
        What each mode's term takes off the squared residual, the others staying.
    """
    s, H, deviation = (np.asarray(each) for each in (model.s, model.H, model.deviation))
    omega, zeta = np.abs(poles), -poles.real / np.abs(poles)
    n, (sensors, inputs) = len(poles), H.shape[1:]
    if not model.decays:  # residual modes of one frequency share one numerator
        omega, zeta = np.c_[[omega, zeta], lower, np.asarray(model.upper)]
    dynamic = 1.0 / (s[:, None] ** 2 + 2.0 * zeta * omega * s[:, None] + omega**2)
    remote = np.stack([1.0 / s, np.ones_like(s), s], axis=1)
    terms = np.concatenate([dynamic * s[:, None], dynamic, remote], axis=1)
    power = np.asarray(model.power)
    found = np.zeros((terms.shape[1] if model.decays else n + 2, sensors, inputs))
    gain = np.zeros(n)
    for j in range(sensors):
        columns = terms if model.decays else dynamic * s[:, None] ** power[j]
        for i in range(inputs):
            A, b = columns / deviation[:, j, i, None], H[:, j, i] / deviation[:, j, i]
            A, b = np.concatenate([A.real, A.imag]), np.concatenate([b.real, b.imag])
            size = np.linalg.norm(A, axis=0)
            found[:, j, i] = np.linalg.lstsq(A / size, b, rcond=None)[0] / size
            covariance = np.linalg.pinv(A.T @ A / np.outer(size, size), hermitian=True)
            each = (found[:, j, i] * size) ** 2 / np.diag(covariance)
            gain += each[:n] + (each[n : 2 * n] if model.decays else 0.0)
    if model.decays:
        pairs = np.concatenate([found[:n], found[n : 2 * n]], axis=2)
        factors = [_rank_one(each, ()) for each in pairs]
        shapes, drives = (np.stack(each, axis=1) for each in zip(*factors, strict=True))
        return Modes(omega, zeta, shapes, drives, found[2 * n :]), 2.0 * gain
    factors = [_rank_one(each, model.sites) for each in found[:n]]
    shapes, drives = (np.stack(each, axis=1) for each in zip(*factors, strict=True))
    for each in found[n:]:
        at_sensors, at_inputs = _residual(each, model.sites)
        shapes, drives = np.c_[shapes, at_sensors], np.c_[drives, at_inputs]
    spread = np.r_[np.arange(n), np.repeat([n, n + 1], inputs)]
    omega, zeta = omega[spread], zeta[spread]
    return Modes(omega, zeta, shapes, drives, np.zeros((3, 0, 0))), 2.0 * gain


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


def _residual(
    numerator: Float[np.ndarray, "s i"], sites: Sequence[int | None]
) -> tuple[np.ndarray, np.ndarray]:
    """The same of rank i; at driving points what a structure can have, a positive part."""
    inputs = numerator.shape[1]
    if None in sites:
        U, size, Vt = np.linalg.svd(numerator, full_matrices=False)
        root = np.zeros(inputs)
        root[: len(size)] = np.sqrt(size)
        wide = np.zeros((len(numerator), inputs))
        wide[:, : len(size)] = U
        return wide * root, (Vt.T * np.sqrt(size)) @ np.eye(len(size), inputs)
    at = [site for site in sites if site is not None]
    values, vectors = np.linalg.eigh(0.5 * (numerator[at] + numerator[at].T))
    kept = values > _LEAST_PART * max(values[-1], 0.0)
    root = np.sqrt(np.where(kept, values, 1.0))
    shapes = numerator @ np.where(kept, vectors / root, 0.0)
    return shapes, shapes[at]
