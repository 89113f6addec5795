"""Where a free decay begins and ends, how noisy it is, and how to divide it."""

from typing import NamedTuple

import numpy as np

from iwanjax.errors import InputError
from iwanjax.signals.filters import (
    analytic_signal,
    band_pass_gain,
    require_resolved,
    settling_time,
)

# A rise of the envelope by this factor above its lowest value so far, and by this many times
# the lowest root mean square of so many blocks, is a new contact.
_RISE, _ABOVE_NOISE, _BLOCKS = 1.15, 5.0, 20
# The envelope ends where it is this many deviations of the noise in the band.
_LOWEST_SIGNAL_TO_NOISE = 6.0
# Windows in which the noise is measured: as many reciprocals of the bandwidth, and the
# orders of the Fourier coefficients that a cubic leaves alone and the filter lets through.
_WINDOW, _LOWEST_ORDER, _PASSED = 16.0, 3, 0.4
# Windows on either side that share their noise.
_NEIGHBOURS = 3
# Least and largest logarithmic decrement in an interval, intervals that a decay gets which is
# too short for the least one, least number of periods and of reciprocals of the bandwidth.
_LEAST_DECREMENT, _LARGEST_DECREMENT, _FEW_INTERVALS = 0.08, 0.5, 6
_FEWEST_PERIODS, _FEWEST_CORRELATIONS = 8.0, 5.0


# Of the rate at which a decay begins, what a vibration that is driven may fall by.
_DRIVEN = 0.1


class Span(NamedTuple):
    """Samples of the free decay: first, one past the last, and how many the filter spoils.

    ``contact`` is the last time that the envelope rises; from there to ``first`` it is driven.
    """

    first: int
    stop: int
    settled: int
    contact: int


def decay_span(
    x: np.ndarray,
    sampling_rate: float,
    band: tuple[float, float],
    order: int,
    start: float | None,
    end: float | None,
) -> Span:
    """The free decay, from the last contact, or where a shaker lets go, to the end of the record.

    Raises
    ------
    InputError
        For a span outside the record or too short for the filter.
    """
    duration = x.size / sampling_rate
    for name, value in (("start", start), ("end", end)):
        if value is not None and not 0.0 <= value <= duration:
            raise InputError(f"{name} = {value:g} s lies outside the record, 0 to {duration:g} s")
    stop = x.size if end is None else round(end * sampling_rate)
    require_resolved(band, sampling_rate, x.size)
    settled = int(np.ceil(settling_time(band, order) * sampling_rate))
    if start is not None:
        contact = first = round(start * sampling_rate)
    else:
        envelope = np.abs(analytic_signal(centred(x[:stop]), sampling_rate, band, order))
        # At its end the record is cut off, which the filter answers as it would a hit.
        envelope = envelope[: max(1, stop - settled)]
        contact = _last_contact(envelope)
        first = contact + _driven(envelope[contact:], settled)
    if stop - first < 3 * settled:
        raise InputError(
            f"ringdown: the free decay from {first / sampling_rate:.3g} s to "
            f"{stop / sampling_rate:.3g} s is too short for the band ({band[0]:g}, {band[1]:g}) "
            f"Hz, whose filter takes {settled / sampling_rate:.3g} s to settle at either end; "
            "widen the band or record longer"
        )
    return Span(first, stop, settled, contact)


def centred(x: np.ndarray) -> np.ndarray:
    """The signal without the sensor's offset, which would be a step where the record begins.

    It is looked for at the end: the mean of a decay that is cut off is not zero.
    """
    return x - np.mean(x[-(x.size // 4) :])


def _last_contact(envelope: np.ndarray) -> int:
    """The last maximum that the envelope rises to from something clearly lower."""
    # What the envelope comes down to may be noise, and noise rises too.
    noise = _lowest(envelope)
    start = int(np.argmax(envelope))
    while True:
        after = envelope[start:]
        lowest = np.minimum.accumulate(after)
        rises = np.flatnonzero(after > _RISE * lowest + _ABOVE_NOISE * noise)
        if not rises.size:
            return start
        begun = int(np.argmax(after == lowest[rises[0]]))
        start += begun + int(np.argmax(after[begun:]))


def _lowest(envelope: np.ndarray) -> float:
    """Lowest root mean square of blocks: not below the noise."""
    blocks = np.array_split(envelope**2, min(envelope.size, _BLOCKS))
    return float(np.sqrt(min(np.mean(block) for block in blocks)))


def _driven(envelope: np.ndarray, settled: int) -> int:
    """Samples in which an envelope stays before it decays: something drives it until then.

    The logarithm of a free decay lies below its chord, or near it: damping grows with amplitude,
    but for macroslip. That of a driven vibration which then decays lies above, most where it is
    let go. It is driven if it falls by less than a tenth of the rate at which it decays from
    there, and for longer than the filter rounds off a sudden beginning.
    """
    quiet = np.flatnonzero(envelope < _ABOVE_NOISE * _lowest(envelope))
    y = np.log(np.maximum(envelope[: quiet[0] if quiet.size else None], np.finfo(float).tiny))
    if y.size < _BLOCKS:
        return 0
    above = y - np.linspace(y[0], y[-1], y.size)
    knee = int(np.argmax(above))
    # From there until it has fallen by a factor e.
    fallen = np.flatnonzero(y[knee:] < y[knee] - 1.0)
    if knee <= settled or not fallen.size:
        return 0
    before, after = (y[0] - y[knee]) / knee, (y[knee] - y[knee + fallen[0]]) / fallen[0]
    return knee if before < _DRIVEN * after else 0


class Noise(NamedTuple):
    """Noise in phase with the carrier, in windows along the decay.

    Attributes
    ----------
    sample : (windows,) array
        Middle of each window.
    density : (windows,) array
        Unit^2/Hz, one-sided around the carrier.
    stop : int
        Sample at which the envelope sinks into the noise.
    """

    sample: np.ndarray
    density: np.ndarray
    stop: int

    def at(self, sample: np.ndarray) -> np.ndarray:
        """Density at samples, geometrically between windows."""
        return np.exp(np.interp(sample, self.sample, np.log(self.density)))


def measured_noise(
    z: np.ndarray, sampling_rate: float, band: tuple[float, float], order: int, settled: int
) -> Noise:
    """The noise that the envelope and phase show about a cubic in each window.

    In a window the relative residual of the analytic signal is transformed; the orders
    below ``_LOWEST_ORDER`` are the cubic's, those near the corners the filter's. What
    remains is white noise, or leakage that is treated as such.

    Raises
    ------
    InputError
        When not even the first windows stand out of the noise.
    """
    width = band[1] - band[0]
    size = int(_WINDOW / width * sampling_rate)
    usable = z.size - 2 * settled
    count = max(1, usable // size)
    size = min(size, usable // count)
    first = settled + size * np.arange(count)
    windows = z[settled : settled + count * size].reshape(count, size)
    psi_1, psi_2 = np.log(np.abs(windows)), np.unwrap(np.angle(windows), axis=1)
    # Cubics by orthonormal columns, of all windows at once.
    cubics = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, size), 3))[0]
    smooth_1, smooth_2 = (each @ cubics @ cubics.T for each in (psi_1, psi_2))
    residual = windows * np.exp(-1j * smooth_2) - np.exp(smooth_1)
    carrier = np.mean(np.diff(psi_2), axis=1) * sampling_rate / (2.0 * np.pi)
    duration = size / sampling_rate
    highest = max(_LOWEST_ORDER, int(_PASSED * width * duration))
    orders = np.arange(_LOWEST_ORDER, highest + 1)
    orders = np.concatenate([-orders[::-1], orders])
    gain = band_pass_gain(np.abs(carrier[:, None] + orders / duration), band, order)
    spectrum = np.fft.fft(residual)[:, orders] / sampling_rate
    # Half of the complex residual is in phase with the carrier.
    power = np.mean(0.5 * np.abs(spectrum / gain) ** 2, axis=1) / duration
    level = np.exp(np.mean(psi_1, axis=1))
    middle = first + 0.5 * (size - 1)
    near = np.abs(np.subtract.outer(np.arange(count), np.arange(count))) <= _NEIGHBOURS
    density = near @ power / near.sum(axis=1)
    lost = np.flatnonzero(level < _LOWEST_SIGNAL_TO_NOISE * np.sqrt(density * width))
    kept = int(lost[0]) if lost.size else count
    if kept == 0:
        raise InputError(
            f"ringdown: nothing stands out of the noise between {band[0]:g} and {band[1]:g} Hz; "
            "is the mode in the band?"
        )
    stop = settled + kept * size if lost.size else z.size - settled
    return Noise(middle[:kept], np.maximum(density[:kept], _tiny(level[:kept])), stop)


def _tiny(level: np.ndarray) -> np.ndarray:
    """Round-off, so that a signal without noise has a deviation too."""
    return (1e-14 * level) ** 2


def plan_intervals(
    psi_1: np.ndarray,
    sampling_rate: float,
    band: tuple[float, float],
    noise: Noise,
    settled: int,
    precision: float,
) -> np.ndarray:
    """Edges of the intervals, as samples: each long enough for the damping to be known.

    A line over h seconds of an envelope A has a slope of variance 12 S/(A^2 h^3).
    """
    samples = np.arange(settled, noise.stop)
    x = np.linspace(-1.0, 1.0, samples.size)
    smooth = np.polynomial.Polynomial.fit(x, psi_1[samples], 5)
    t_per_x = 0.5 * samples.size / sampling_rate
    overall = -(smooth(1.0) - smooth(-1.0)) / (2.0 * t_per_x)
    # A wiggle of the polynomial must not make an interval endless.
    rate = np.maximum(-smooth.deriv()(x) / t_per_x, 0.1 * abs(overall) + 1e-12)
    for_precision = np.cbrt(
        12.0 * noise.at(samples) * np.exp(-2.0 * smooth(x)) / (precision * rate) ** 2
    )
    center = 0.5 * (band[0] + band[1])
    # A record that ends early gets some intervals all the same.
    least_decrement = min(_LEAST_DECREMENT, 2.0 * t_per_x * overall / _FEW_INTERVALS)
    least = np.maximum(
        least_decrement / rate,
        max(_FEWEST_PERIODS / center, _FEWEST_CORRELATIONS / (band[1] - band[0])),
    )
    length = np.clip(for_precision, least, np.maximum(least, _LARGEST_DECREMENT / rate))
    passed = np.concatenate([[0.0], np.cumsum(1.0 / (length * sampling_rate))])
    count = int(passed[-1])
    if count == 0:
        return samples[[0, -1]]
    return np.round(
        settled
        + np.interp(np.arange(count + 1) * passed[-1] / count, passed, np.arange(passed.size))
    ).astype(int)
