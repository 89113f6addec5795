"""Poles of frequency response functions, by models of rising order."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

# The band takes this share of the unit circle in the z-domain: its ends, which a polynomial of
# finite order joins, stay apart (Verboven, PhD thesis, VUB 2002, sec. 5.3.3: 0.9 to 0.95).
_CIRCLE = 0.95
MOST_DAMPING = 0.15
"""Damping ratios above this are of no mode that a response shows as one: its peak is as wide as a
third of its frequency."""


@dataclass(frozen=True, eq=False)
class Stabilisation:
    """Poles of models of rising order.

    Attributes
    ----------
    order : (p,) array of int
        Of the model that each pole is of.
    frequency, damping : (p,) array
        Hz, and ratio, of each pole in the band that decays.
    mode : (p,) array of int
        Index of the mode that it belongs to; -1 for none.
    """

    order: np.ndarray
    frequency: Float[np.ndarray, " p"]
    damping: Float[np.ndarray, " p"]
    mode: np.ndarray


def poles_by_order(
    s: Complex[np.ndarray, " F"],
    H: Complex[np.ndarray, "F s i"],
    weight: Float[np.ndarray, "F s"],
    orders: Sequence[int],
) -> list[Complex[np.ndarray, " poles"]]:
    r"""Poly-reference least-squares complex frequency estimates (p-LSCF).

    Each response is a polynomial over a denominator that all share,
    :math:`H_s = B_s A^{-1}` with A(z) of size (i, i) and
    :math:`z = e^{(s - i\omega_0) T}`, from the linear least squares of
    :math:`w_s (B_s - H_s A)`, A's lowest coefficient the identity: poles of noise are unstable
    then, so that what is stable is physical.

    Parameters
    ----------
    s : (F,) array
        sigma + i omega of the lines, rad/s.
    H : (F, s, i) array
        Frequency response functions.
    weight : (F, s) array
        One over their deviation.
    orders : sequence of int
        Of A.

    Returns
    -------
    list of (poles,) array
        For each order the poles :math:`\lambda` with positive imaginary part, rad/s, those that
        grow included.

    References
    ----------
    Guillaume, Verboven, Vanlanduit, Van der Auweraer and Peeters, IMAC 21 (2003);
    Cauberghe, PhD thesis, VUB 2004, for the coefficient that is the identity.
    """
    omega, sigma = np.imag(s), float(np.real(s)[0])
    F, sensors, inputs = H.shape
    width = (omega[-1] - omega[0]) / _CIRCLE
    T = 2.0 * math.pi / width
    begin = omega[0] - 0.5 * (width - (omega[-1] - omega[0]))
    powers = np.exp(1j * (omega - begin) * T)[:, None] ** np.arange(max(orders) + 1)
    # Of the highest order; those of lower ones are their leading parts.
    gram, projected = np.zeros(((max(orders) + 1) * inputs,) * 2, complex), []
    for k in range(sensors):
        Q, _ = np.linalg.qr(powers * weight[:, k, None])
        Y = powers[:, :, None] * (H[:, k, None, :] * weight[:, k, None, None])
        Y = Y.reshape(F, -1)
        gram = gram + Y.conj().T @ Y
        projected.append(Q.conj().T @ Y)
    found = []
    for n in orders:
        size = (n + 1) * inputs
        seen = np.concatenate([each[: n + 1, :size] for each in projected])
        normal = gram[:size, :size] - seen.conj().T @ seen
        z = _roots(normal, inputs)
        angle = np.mod(np.angle(z), 2.0 * math.pi)
        poles = np.log(np.abs(z)) / T + 1j * (angle / T + begin)
        found.append(poles[poles.imag > 0.0] + sigma)
    return found


def _roots(normal: np.ndarray, inputs: int) -> np.ndarray:
    """Roots of the denominator that these normal equations give, its lowest coefficient one."""
    n = len(normal) // inputs - 1
    rest = np.linalg.lstsq(normal[inputs:, inputs:], -normal[inputs:, :inputs], rcond=None)[0]
    # In powers of 1/z, whose highest coefficient is the identity.
    backward = rest.reshape(n, inputs, inputs)[::-1]
    companion = np.zeros((n * inputs, n * inputs), complex)
    companion[:-inputs, inputs:] = np.eye((n - 1) * inputs)
    companion[-inputs:] = -np.concatenate([each.T for each in backward], axis=1)
    z = np.linalg.eigvals(companion)
    return 1.0 / z[np.abs(z) > 0.0]


def clustered(
    found: Sequence[Complex[np.ndarray, " poles"]],
    orders: Sequence[int],
    band: tuple[float, float],
    least: int,
    window: float = 0.0,
) -> tuple[Complex[np.ndarray, " modes"], Stabilisation]:
    r"""Poles that come back at order after order, lowest frequency first.

    Poles are of one mode where they lie, on average, nearer to each other than half of their
    decay rate as measured, :math:`|\lambda - \lambda'| < \tfrac12 (\sigma - \mathrm{Re} \lambda)`.

    Parameters
    ----------
    found : list of (poles,) array
        Of each order.
    orders : sequence of int
    band : (f_1, f_2)
        Hz.
    least : int
        Orders that a mode must show in.
    window : float
        sigma of an exponential window, 1/s.
    """
    order = np.concatenate([np.full(len(p), n) for n, p in zip(orders, found, strict=True)])
    poles = np.concatenate(found)
    frequency = np.abs(poles) / (2.0 * math.pi)
    damping = -np.real(poles) / np.abs(poles)
    kept = (damping > 0) & (damping < MOST_DAMPING)
    kept &= (frequency >= band[0]) & (frequency <= band[1])
    order, poles, frequency, damping = (x[kept] for x in (order, poles, frequency, damping))
    modes = np.full(len(poles), -1)
    if len(poles) < max(least, 2):
        return np.zeros(0, complex), Stabilisation(order, frequency, damping, modes)
    rate = window - np.real(poles)
    apart = np.abs(poles[:, None] - poles) / (0.5 * (rate[:, None] + rate))
    upper = apart[np.triu_indices(len(poles), 1)]
    import scipy.cluster.hierarchy  # here, because it takes a tenth of a second to import

    tree = scipy.cluster.hierarchy.linkage(upper, "average")
    cluster = scipy.cluster.hierarchy.fcluster(tree, _APART, "distance")
    middles = {}
    for each in np.unique(cluster):
        own = cluster == each
        if len(np.unique(order[own])) >= least:
            middles[each] = np.median(np.real(poles[own])) + 1j * np.median(np.imag(poles[own]))
    ordered = sorted(middles, key=lambda each: abs(middles[each]))
    for i, each in enumerate(ordered):
        modes[cluster == each] = i
    return (
        np.array([middles[each] for each in ordered], complex),
        Stabilisation(order, frequency, damping, modes),
    )


# Half of a decay rate: a quarter of the half-power bandwidth, below which two peaks are one.
_APART = 0.5
