"""Noise of sensors in recordings of any kind, told from what a structure and its forces do.

A response is smooth over a few neighbouring frequencies, and so is what a force makes of it, each
by its own smooth factor; noise is not. What such factors cannot explain is noise wherever the
structure is linear, whether it is at rest at the ends of the record or not, and whether the force
is a hit, a sweep, random or none (local polynomial method: Pintelon and Schoukens, System
Identification, 2nd ed. 2012, section 7.2).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from iwanjax.signals.comparison_band import END

# Of the polynomials, as in Pintelon and Schoukens.
_DEGREE = 2
CHANCE = 0.01
"""What one of a hundred records of noise alone would show is no noise."""


class NoiseLevel(NamedTuple):
    """Noise of some sensors.

    Attributes
    ----------
    deviation : (sensors,) array
        Standard deviation.
    freedom : (sensors,) array
        Degrees of freedom of its square, whose relative variance is 2 over it.
    """

    deviation: np.ndarray
    freedom: np.ndarray


class Unexplained(NamedTuple):
    """What smooth factors leave of a spectrum, piece by piece from low to high frequencies.

    Attributes
    ----------
    variance : (pieces, sensors) array
        Of white noise that would leave as much.
    freedom : int
        Degrees of freedom of each.
    """

    variance: np.ndarray
    freedom: int


def unexplained(
    response: Float[np.ndarray, "N sensors"], force: Float[np.ndarray, "N inputs"] | None
) -> Unexplained:
    r"""Spectra less what a smooth motion and smooth answers to forces explain.

    In each piece of the discrete spectrum, :math:`x` from -1 to 1 over it,

    .. math:: Y = \sum_{i} F_i \sum_{r \le 2} a_{ir} x^r + \sum_{r \le 2} b_r x^r + E

    is fitted by least squares; the second sum is what moved at the ends of the record.

    Parameters
    ----------
    response : (N, sensors) array
        Any offset.
    force : (N, inputs) array or None
        Inputs that are zero throughout count for nothing.

    Returns
    -------
    Unexplained
        Up to the highest frequency that is compared; a last piece that is not full is left out.
    """
    N = len(response)
    acting = np.zeros((N, 0)) if force is None else force[:, np.any(force != 0, axis=0)]
    if 2 * (_DEGREE + 1) * (1 + acting.shape[1]) > int(END * N):
        # Too short to tell what the forces do.
        acting = acting[:, :0]
    unknowns = (_DEGREE + 1) * (1 + acting.shape[1])
    # Half of the values tell the noise.
    size = 2 * unknowns
    count = int(END * N) // size
    Y, F = (
        # The first value is the offset.
        np.fft.rfft(x, axis=0)[1 : 1 + count * size].reshape(count, size, -1)
        for x in (response, acting)
    )
    x = np.linspace(-1.0, 1.0, size)[:, None] ** np.arange(_DEGREE + 1)
    scaled = F / np.sqrt(np.mean(np.abs(F) ** 2, axis=1, keepdims=True) + np.finfo(float).tiny)
    answers = np.einsum("bki,kr->bkir", scaled, x).reshape(count, size, -1)
    columns = np.concatenate([np.broadcast_to(x, (count, *x.shape)), answers], axis=2)
    Q = np.linalg.qr(columns)[0]
    left = Y - Q @ (Q.conj().swapaxes(1, 2) @ Y)
    freedom = size - unknowns
    return Unexplained(np.sum(np.abs(left) ** 2, axis=1) / (N * freedom), 2 * freedom)


def exceeded(one: np.ndarray | float, other: np.ndarray | float, share: float) -> np.ndarray:
    """Ratio of two estimates of one variance that is exceeded in such a share of cases.

    Parameters
    ----------
    one, other : array
        Degrees of freedom, of numerator and denominator; infinite for what is known.
    share : float
        Of all cases.
    """
    from scipy.special import fdtri

    # As good as infinite, where the distribution's integral still is finite.
    sure = 1.0 / np.finfo(float).eps
    return fdtri(np.minimum(one, sure), np.minimum(other, sure), 1.0 - share)


def in_quiet_bands(
    response: Float[np.ndarray, "N sensors"],
    force: Float[np.ndarray, "N inputs"] | None,
    *,
    bands: int,
    values: int,
    flat: float,
) -> NoiseLevel:
    """Noise of sensors that are never at rest: where the structure does least by itself.

    The quietest band alone would be too low by chance; it is pooled with those that are no louder
    than noise may be there. What is not linear, or too sharp for :func:`unexplained`, is above
    that in the other bands. Where it is in all of them this is an upper bound.

    Parameters
    ----------
    response, force : array
        As for :func:`unexplained`.
    bands : int
        Bands up to the highest frequency that is compared, at most.
    values : int
        Degrees of freedom of each, at least.
    flat : float
        Times the variance of the quieter bands that noise may have in another one.
    """
    left = unexplained(response, force)
    pieces = len(left.variance)
    count = min(bands, max(1, pieces * left.freedom // values))
    parts = np.array_split(np.arange(pieces), count)
    level = np.sort([np.mean(left.variance[part], axis=0) for part in parts], axis=0)
    known = np.arange(1, count + 1)
    pooled = np.cumsum(level, axis=0) / known[:, None]
    each = left.freedom * pieces / count
    chance = exceeded(each, each * known[:-1], CHANCE / count)
    louder = level[1:] > np.maximum(chance, flat)[:, None] * pooled[:-1]
    louder = np.vstack([louder, np.ones_like(level[:1], dtype=bool)])
    last = np.argmax(louder, axis=0)
    deviation = np.sqrt(np.take_along_axis(pooled, last[None], axis=0)[0])
    return NoiseLevel(deviation, each * known[last])


def at_rest(signal: Float[np.ndarray, "N sensors"]) -> NoiseLevel:
    """Noise of sensors that see no motion, without lines: mains hum, or a mode that still rings.

    A line is what stands out of a spectrum beyond chance (Fisher 1929), from two cycles in the
    record on: slower ones are noise that rises towards low frequencies. Its amplitude, phase and
    frequency are three values that tell no more of the noise.
    """
    each = [_without_lines(column - np.mean(column)) for column in signal.T]
    freedom = np.array([len(signal) - 1.0 - 3.0 * count for _, count in each])
    square = np.array([np.sum(left**2) for left, _ in each])
    return NoiseLevel(np.sqrt(square / freedom), freedom)


def _without_lines(x: np.ndarray) -> tuple[np.ndarray, int]:
    """A signal without its lines, as long as some are left, and their number."""
    N, count = len(x), 0
    lines = N // 2 - 1
    chance = 1.0 - (CHANCE / lines) ** (1.0 / (lines - 1.0))
    # Where a third of the record would be fitted nothing tells lines from noise.
    while 9 * (count + 1) < N:
        power = np.abs(np.fft.rfft(x)[2:]) ** 2
        if not np.max(power) > chance * np.sum(power):
            break
        # Of a line between two frequencies the larger part is at the nearer one.
        fine = np.abs(np.fft.rfft(x, 16 * N))
        fine[: 16 * 2 - 8] = 0.0
        turn = 2.0 * np.pi * np.argmax(fine) / (16 * N) * np.arange(N)
        Q = np.linalg.qr(np.stack([np.ones(N), np.cos(turn), np.sin(turn)], axis=1))[0]
        x, count = x - Q @ (Q.T @ x), count + 1
    return x, count


def between_periods(
    response: Float[np.ndarray, "N sensors"], force: Float[np.ndarray, "N inputs"], period: int
) -> NoiseLevel:
    r"""Noise of a steady cycle: what changes from each of P periods to the next.

    .. math:: \sigma^2 = \frac{1}{2 (P-1)} \sum_p |E_{p+1} - E_p|^2

    Changes of the force, and an offset that wanders, are explained before (:func:`unexplained`).
    Differences of neighbours have :math:`2 (P-1)^2 / (3P-4)` degrees of freedom for each value (von
    Neumann 1941). Whatever repeats, linear or not, is none of it.

    Parameters
    ----------
    response, force : array
        At least two periods, from any moment on.
    period : int
        Samples of one.
    """
    count = len(response) // period
    changes = (
        np.diff(x[: count * period].reshape(count, period, -1), axis=0) for x in (response, force)
    )
    left = [unexplained(y, f) for y, f in zip(*changes, strict=True)]
    deviation = np.sqrt(0.5 * np.mean([each.variance for each in left], axis=(0, 1)))
    values = left[0].freedom * len(left[0].variance)
    freedom = values * 2.0 * (count - 1) ** 2 / (3 * count - 4)
    return NoiseLevel(deviation, np.full(response.shape[1], freedom))


def period_of(force: Float[np.ndarray, "N inputs"], repeats: float, least: int) -> int:
    """Samples of the shortest period of the force that divides the record; else all of them.

    Parameters
    ----------
    force : (N, inputs) array
        As measured.
    repeats : float
        Change from period to period, as share of the force, that is noise.
    least : int
        Samples of a period, at least.
    """
    N = len(force)
    size = np.sqrt(np.mean(force**2))
    for period in (N // count for count in range(N // least, 1, -1) if N % count == 0):
        change = np.sqrt(np.mean((force[period:] - force[:-period]) ** 2))
        if change <= repeats * size:
            return period
    return N


def of_rounding(response: Float[np.ndarray, "N sensors"]) -> np.ndarray:
    """Deviation of a converter's rounding, (sensors,): its step over the root of twelve.

    The step is the least that two samples differ by. Noise less than it may not show at all.
    """
    steps = (np.diff(np.unique(column)) for column in response.T)
    return np.array([np.min(each) if each.size else 0.0 for each in steps]) / np.sqrt(12.0)
