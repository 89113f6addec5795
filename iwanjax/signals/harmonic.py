"""The second harmonic of a mode at half the frequency, which looks like a mode that beats."""

from typing import NamedTuple

import numpy as np

from iwanjax.signals.decay import centred, decay_span
from iwanjax.signals.filters import analytic_signal, settling_time

_LEFT = 0.1
"""Share of squares that a harmonic leaves at most."""


class Harmonic(NamedTuple):
    """What a mode at half the frequency leaves in a band.

    Attributes
    ----------
    signal : (N,) array
        The record without it.
    coefficient : complex
        Of the square of the lower mode's analytic signal.
    start : float
        Where the lower mode begins to decay, s.
    """

    signal: np.ndarray
    coefficient: complex
    start: float


def without_harmonic(
    x: np.ndarray,
    sampling_rate: float,
    band: tuple[float, float],
    order: int,
    first: int,
    stop: int,
) -> Harmonic | None:
    r"""A record without the second harmonic of a mode at half the band; None without such.

    A force that is even in the deflection drives at twice the frequency of a mode of analytic
    signal :math:`z_1`. Where the mode in the band is near it, its own signal goes on beside it,

    .. math:: \frac{z_2}{z_1^2} = c + B\,\mathrm{e}^{s t},

    over the second half of the decay, by least squares weighted by :math:`|z_1|^4`, from the ratio
    of successive differences over a lag. There is a harmonic if c alone explains the ratio but for
    a tenth of its squares, or if c leaves a tenth of what B alone does.

    Parameters
    ----------
    x : (N,) array
        One channel.
    sampling_rate : float
        Hz.
    band : (float, float)
        Of the upper mode, Hz.
    order : int
        Of the band-pass.
    first, stop : int
        Samples of the decay.
    """
    half = (0.5 * band[0], 0.5 * band[1])
    settled = int(np.ceil(settling_time(half, order) * sampling_rate))
    # Averages as long as the filter's memory, over the second half of what is left.
    size = max(1, int(sampling_rate / (band[1] - band[0])))
    begin = (first + stop) // 2
    count = (stop - settled - begin) // size
    if count < 16:
        return None
    z_1, z_2 = (analytic_signal(centred(x), sampling_rate, each, order) for each in (half, band))
    square = z_1**2
    part = slice(begin, begin + count * size)
    if np.linalg.norm(z_1[part]) < np.linalg.norm(z_2[part]):
        return None  # no harmonic is larger than what it is one of
    energy = np.mean(np.abs(square[part].reshape(count, size)) ** 2, axis=1)
    ratio = np.mean((z_2 * np.conj(square))[part].reshape(count, size), axis=1) / energy
    lag, weight = count // 8, np.sqrt(energy)
    one = np.ones((count, 1))
    change = ratio[lag:] - ratio[:-lag]
    (c, *_), left = _going(one, ratio, weight, _turn(change, lag))
    alone = [
        _fitted(one, ratio, weight)[1],
        _going(one[:, :0], ratio, weight, _turn(ratio, lag))[1],
    ]
    whole = np.sum(np.abs(weight * ratio) ** 2)
    if alone[0] > _LEFT * whole and left > _LEFT * alone[1]:
        return None
    start = decay_span(x, sampling_rate, half, order, None, None).first / sampling_rate
    return Harmonic(x - np.real(c * square), complex(c), start)


def _turn(values: np.ndarray, lag: int) -> complex:
    """Factor from one value of a geometric series to the next, by least squares over a lag."""
    factor = np.vdot(values[:-lag], values[lag:]) / np.vdot(values[:-lag], values[:-lag])
    return complex(factor ** (1.0 / lag))


def _going(
    columns: np.ndarray, values: np.ndarray, weight: np.ndarray, start: complex
) -> tuple[np.ndarray, float]:
    """Columns and a geometric series beside them, of the factor that leaves least."""
    import scipy.optimize  # here, because it takes long to import

    steps = np.arange(len(values))[:, None]

    def fitted(exponent: np.ndarray) -> tuple[np.ndarray, float]:
        series = np.exp(np.clip(exponent[0], -1.0, 1.0) * steps + 1j * exponent[1] * steps)
        series = series / np.max(np.abs(series))
        return _fitted(np.hstack([columns, series]), values, weight)

    begin = np.array([np.log(abs(start)), np.angle(start)])
    best = scipy.optimize.minimize(lambda at: fitted(at)[1], begin, method="Nelder-Mead")
    return fitted(best.x)


def _fitted(
    columns: np.ndarray, values: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, float]:
    """Weighted least squares: coefficients, and the squares that they leave."""
    found = np.linalg.lstsq(columns * weight[:, None], values * weight)[0]
    return found, float(np.sum(np.abs(weight * (values - columns @ found)) ** 2))
