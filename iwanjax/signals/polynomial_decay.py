"""A free decay by one polynomial each for the logarithm of its envelope and its phase."""

import numpy as np

from iwanjax.signals.decay_slopes import Decay, DecaySlopes


def polynomial_slopes(decay: Decay) -> DecaySlopes:
    r"""Weighted least squares over the whole decay, of the order that predicts best.

    In polynomials that are orthonormal under the noise's weights each coefficient has variance 1,
    and one more of them pays where its square exceeds 2 (Mallows 1973). There are no more than
    intervals. Points of one polynomial share its errors.
    """
    psi_1, psi_2 = decay.logarithm
    first, stop = int(decay.edges[0]), int(decay.edges[-1])
    samples = np.arange(first, stop)
    x = np.linspace(-1.0, 1.0, samples.size)
    at = np.interp(decay.middles * decay.sampling_rate, samples, x)
    per_second = 2.0 * decay.sampling_rate / (samples.size - 1)
    variance = decay.noise.at(samples) * decay.sampling_rate * np.exp(-2.0 * psi_1[samples])
    weight = 1.0 / np.sqrt(variance)
    most = 2 * (decay.edges.size - 1)
    Q, R = np.linalg.qr(weight[:, None] * np.polynomial.legendre.legvander(x, most))
    # Values and derivatives of the orthonormal polynomials at the points.
    basis = [
        np.linalg.solve(R.T, _derivatives(at, most, order).T).T * per_second**order
        for order in range(3)
    ]
    found = []
    for psi in (psi_1, psi_2):
        c = Q.T @ (weight * psi[samples])
        best = int(np.argmax(np.cumsum(c**2 - 2.0)[1:])) + 2
        found.append((c, min(best + 2, c.size)))
    (c_1, n_1), (c_2, n_2) = found
    return DecaySlopes(
        time=decay.middles,
        height=basis[0][:, :n_1] @ c_1[:n_1],
        height_variance=_variance(basis[0], c_1, n_1),
        rate=basis[1][:, :n_1] @ c_1[:n_1],
        rate_variance=_variance(basis[1], c_1, n_1),
        omega=basis[1][:, :n_2] @ c_2[:n_2],
        omega_variance=_variance(basis[1], c_2, n_2),
        omega_slope=basis[2][:, :n_2] @ c_2[:n_2],
    )


def _derivatives(at: np.ndarray, most: int, order: int) -> np.ndarray:
    """Derivatives of Legendre polynomials, (points, most + 1)."""
    each = np.polynomial.legendre.legder(np.eye(most + 1), order, axis=0)
    return np.polynomial.legendre.legval(at, each).T


def _variance(basis: np.ndarray, c: np.ndarray, kept: int) -> np.ndarray:
    """Of the coefficients that are kept, and of what the next one would add."""
    left_out = np.zeros_like(c)
    left_out[kept : kept + 2] = c[kept : kept + 2] ** 2
    left_out[:kept] = 1.0
    return basis**2 @ left_out
