"""Noise of sensors in recordings of any kind, separated from what a structure and its forces do.

Over a few neighbouring frequencies a response, and what a force makes of it, follows a ratio of
two polynomials of low degree, a mode however sharp with them; noise does not. What such ratios
cannot explain is noise wherever the structure is linear, whether it is at rest at the ends of the
record or not, and whether the force is a hit, a sweep, random or none (local polynomial method:
Pintelon and Schoukens, System Identification, 2nd ed. 2012, section 7.2; local rational method:
McKelvey and Guérin, 16th IFAC Symposium on System Identification 2012).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from iwanjax.signals.comparison_band import END

# Of the polynomials, as in Pintelon and Schoukens; two poles to a piece are one mode, or two.
_DEGREE, _POLES = 2, 2
CHANCE = 0.01
"""What one of a hundred records of noise alone would show is no noise."""


class NoiseLevel(NamedTuple):
    """Noise of some sensors.

    Attributes
    ----------
    deviation : (sensors,) array
        Standard deviation: that of white noise with as much power in the band that is compared.
    freedom : (sensors,) array
        Degrees of freedom of its square, whose relative variance is 2 over it.
    """

    deviation: np.ndarray
    freedom: np.ndarray


class Unexplained(NamedTuple):
    """What local models leave of a spectrum, piece by piece from low to high frequencies.

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
    response: Float[np.ndarray, "N sensors"],
    force: Float[np.ndarray, "N inputs"] | None,
    *,
    ringing: bool = True,
) -> Unexplained:
    r"""Spectra less what a smooth or ringing motion and answers to forces explain.

    In each piece of the discrete spectrum, :math:`x` from -1 to 1 over it,

    .. math::

        (1 + d_1 x + d_2 x^2)\, Y
            = \sum_{i} F_i \sum_{r \le 2} a_{ir} x^r + \sum_{r \le 2} b_r x^r + D E

    is fitted by least squares, where D is the bracket on the left; the last sum is what moved at
    the ends of the record. D is 1 but where that leaves more than chance would: at a mode. The
    variance of E is that of what is left over the mean of :math:`|D|^2`: exact where E is flat
    over the piece, too low by what a mode amplifies in it where the noise has passed through the
    structure.

    Parameters
    ----------
    response : (N, sensors) array
        Any offset; NaN throughout for a sensor that is lacking.
    force : (N, inputs) array or None
        Inputs that are zero throughout count for nothing.
    ringing : bool
        Whether a mode may ring that noise could be confused with; D is 1 everywhere if not.

    Returns
    -------
    Unexplained
        Up to the highest frequency that is compared; a last piece that is not full is left out.
    """
    N = len(response)
    acting = np.zeros((N, 0)) if force is None else force[:, np.any(force != 0, axis=0)]
    if 2 * _unknowns(acting, ringing) > int(END * N):
        # Too short to separate what the forces do.
        acting = acting[:, :0]
    unknowns = _unknowns(acting, ringing)
    # Half of the values show the noise.
    size = 2 * unknowns
    count = int(END * N) // size
    Y, F = (
        # The first value is the offset.
        np.fft.rfft(x, axis=0)[1 : 1 + count * size].reshape(count, size, -1)
        for x in (response, acting)
    )
    x = np.linspace(-1.0, 1.0, size)[:, None] ** np.arange(max(_DEGREE, _POLES) + 1)
    own = np.broadcast_to(x[:, : _DEGREE + 1], (count, size, _DEGREE + 1))
    answers = np.einsum("bki,kr->bkir", _of_unit_size(F), own[0]).reshape(count, size, -1)
    columns = np.concatenate([own, answers], axis=2)
    Q = np.linalg.qr(columns)[0]
    freedom, smooth = size - unknowns, size - columns.shape[2]
    left = np.sum(np.abs(Y - Q @ (Q.conj().swapaxes(1, 2) @ Y)) ** 2, axis=1) / smooth
    if ringing:
        more = exceeded(2 * smooth, 2 * freedom, CHANCE)
        for i in np.flatnonzero(np.all(np.isfinite(Y), axis=(0, 1))):
            ring = _beside_modes(Y[:, :, i], columns, x[:, 1 : _POLES + 1]) / freedom
            left[:, i] = np.where(left[:, i] > more * ring, ring, left[:, i])
    return Unexplained(left / N, 2 * freedom)


def _unknowns(acting: np.ndarray, ringing: bool) -> int:
    """Of each piece."""
    return (_DEGREE + 1) * (1 + acting.shape[1]) + _POLES * ringing


def _of_unit_size(values: np.ndarray) -> np.ndarray:
    """Spectra, (pieces, frequencies, ...), over their root mean square in each piece."""
    mean = np.mean(np.abs(values) ** 2, axis=1, keepdims=True)
    return values / np.sqrt(mean + np.finfo(float).tiny)


def _beside_modes(y: np.ndarray, columns: np.ndarray, powers: np.ndarray) -> np.ndarray:
    """Sum of squares that modes leave of one sensor, over the mean of |D|^2, (pieces,)."""
    unit, size = _of_unit_size(y), np.mean(np.abs(y) ** 2, axis=1)
    Q, R = np.linalg.qr(np.concatenate([columns, unit[:, :, None] * powers], axis=2))
    along = Q.conj().swapaxes(1, 2) @ unit[:, :, None]
    left = np.sum(np.abs(unit - (Q @ along)[:, :, 0]) ** 2, axis=1)
    # The poles' own part of the triangle: their coefficients by themselves.
    d = np.linalg.pinv(R[:, -_POLES:, -_POLES:]) @ along[:, -_POLES:]
    D = 1.0 - d[:, :, 0] @ powers.T
    return size * left / np.mean(np.abs(D) ** 2, axis=1)


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


class NoiseInBands(NamedTuple):
    """Noise of sensors that are never at rest.

    Attributes
    ----------
    quiet : NoiseLevel
        Where the structure does least: a lower bound of coloured noise, and an upper bound where a
        structure that is not linear moves at all frequencies.
    whole : NoiseLevel
        All that is not explained: an upper bound, and the noise itself where ``smooth``.
    smooth : (sensors,) array of bool
        Whether no band stands out of the others, as modes do and noise does not.
    """

    quiet: NoiseLevel
    whole: NoiseLevel
    smooth: np.ndarray


def in_bands(
    response: Float[np.ndarray, "N sensors"],
    force: Float[np.ndarray, "N inputs"] | None,
    *,
    bands: int,
    values: int,
    flat: float,
) -> NoiseInBands:
    r"""Noise of sensors that are never at rest, by what is not explained in bands.

    The quietest band alone would be too low by chance; it is pooled with those that are no louder
    than noise may be there. What is not linear is above that in the other bands. Noise of a
    sensor and its amplifier is white, or rises towards low frequencies by no more than

    .. math:: S(f) \le S(g)\, \max(1, g^2/f^2)

    (drift that is an integral of white noise), beyond chance and 3 dB. Where all bands agree with
    all others in that, all of it is noise of some colour: no mode stands out.

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
    level = np.array([np.mean(left.variance[part], axis=0) for part in parts])
    each = left.freedom * pieces / count
    middle = np.array([np.mean(part) + 0.5 for part in parts])
    rises = np.maximum(1.0, middle / middle[:, None]) ** 2
    # Each is compared with each.
    allowed = max(float(exceeded(each, each, CHANCE / count**2)), flat)
    smooth = np.all(level[:, None] <= allowed * rises[:, :, None] * level, axis=(0, 1))
    whole = NoiseLevel(np.sqrt(np.mean(level, axis=0)), each * _as_many(level))
    return NoiseInBands(_quietest(level, each, flat), whole, smooth)


def _as_many(square: np.ndarray) -> np.ndarray:
    """Of how many equal ones a mean of squares, (parts, ...), is as sure (Satterthwaite 1946)."""
    whole, squares = np.sum(square, axis=0) ** 2, np.sum(square**2, axis=0)
    return np.divide(whole, squares, out=np.full_like(whole, len(square)), where=squares > 0.0)


def _quietest(level: np.ndarray, each: float, flat: float) -> NoiseLevel:
    """Variances of bands, (bands, sensors), pooled as long as they are alike."""
    count = len(level)
    level = np.sort(level, axis=0)
    known = np.arange(1, count + 1)
    pooled = np.cumsum(level, axis=0) / known[:, None]
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


class NoiseBetweenPeriods(NamedTuple):
    """Noise of a steady cycle.

    Attributes
    ----------
    level : NoiseLevel
        Of the sensors.
    steady : (sensors,) array of bool
        Whether later changes are as large as earlier ones: none of them is a motion that dies
        away. Of two periods there is one change, which does not say.
    """

    level: NoiseLevel
    steady: np.ndarray


def between_periods(
    response: Float[np.ndarray, "N sensors"], force: Float[np.ndarray, "N inputs"], period: int
) -> NoiseBetweenPeriods:
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
    left = [unexplained(y, f, ringing=False) for y, f in zip(*changes, strict=True)]
    variance = np.stack([each.variance for each in left])
    square = np.mean(variance, axis=1)
    # By as many values as the loudest modes, which noise may have passed through, leave.
    values = left[0].freedom * _as_many(np.mean(variance, axis=0))
    freedom = values * 2.0 * (count - 1) ** 2 / (3 * count - 4)
    level = NoiseLevel(np.sqrt(0.5 * np.mean(square, axis=0)), freedom)
    half = len(square) // 2
    if not half:
        return NoiseBetweenPeriods(level, np.zeros(response.shape[1], bool))
    early, late = np.mean(square[:half], axis=0), np.mean(square[-half:], axis=0)
    # As sure as one frequency of each piece makes it: a mode may amplify no more of it.
    sure = values * half / left[0].freedom * 2
    steady = early <= exceeded(sure, sure, CHANCE) * late
    return NoiseBetweenPeriods(level, steady)


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


def deviation_in_band(noise: Float[np.ndarray, "N sensors"]) -> np.ndarray:
    """Deviation of white noise with as much power in the band that is compared, (sensors,)."""
    spectrum = np.fft.rfft(noise, axis=0)[1 : int(END * len(noise))]
    return np.sqrt(np.mean(np.abs(spectrum) ** 2, axis=0) / len(noise))


def of_rounding(response: Float[np.ndarray, "N sensors"]) -> np.ndarray:
    """Deviation of a converter's rounding, (sensors,): its step over the root of twelve.

    The step is the least that two samples differ by. Noise less than it may not show at all.
    """
    steps = (np.diff(np.unique(column)) for column in response.T)
    return np.array([np.min(each) if each.size else 0.0 for each in steps]) / np.sqrt(12.0)
