"""What is wrong with a channel, by its samples alone: hum, drift, dropouts; where its energy is."""

import enum
from typing import NamedTuple

import numpy as np

from iwanjax.signals.noise import CHANCE


class _Mains(enum.IntEnum):
    """Frequencies of the mains, Hz."""

    EUROPE = 50
    AMERICA = 60


# Parts of a record that show whether a line goes on, or an offset moves.
_PARTS = 4


class Hum(NamedTuple):
    """A line at the frequency of the mains that goes on throughout.

    Attributes
    ----------
    frequency : float
        Hz; zero where there is none.
    amplitude : float
        Peak, in the channel's unit.
    """

    frequency: float = 0.0
    amplitude: float = 0.0


NO_HUM = Hum()


def hum(x: np.ndarray, rate: float) -> Hum:
    """The mains' line in a channel: one that stands out of each quarter and is alike in all.

    In each quarter a sine of the frequency is fitted by least squares beside those of one step of
    resolution away on either side; what stands there by chance has a squared amplitude that is
    exponentially distributed with their mean. A decaying mode is not alike in all quarters.

    Parameters
    ----------
    x : (N,) array
        One channel.
    rate : float
        Hz.
    """
    best = NO_HUM
    parts = np.array_split(x - x.mean(), _PARTS)
    for line in map(float, _Mains):
        step = _PARTS * rate / x.size
        if line < 4.0 * step or line + 4.0 * step > 0.5 * rate:
            continue
        at = np.array([_amplitudes(part, rate, line, step) for part in parts])
        mine, beside = at[:, 0], np.sqrt(np.mean(at[:, 1:] ** 2, axis=1))
        clear = np.all(mine**2 > -np.log(CHANCE / _PARTS) * beside**2)
        if clear and np.max(mine) < 2.0 * np.min(mine) and np.mean(mine) > best.amplitude:
            best = Hum(line, float(np.mean(mine)))
    return best


def _amplitudes(x: np.ndarray, rate: float, line: float, step: float) -> np.ndarray:
    """Amplitudes at a line, then at the third and fourth steps of resolution beside it."""
    window = np.hanning(x.size)
    turn = -2j * np.pi * np.arange(x.size) / rate
    at = line + step * np.array([0.0, -4.0, -3.0, 3.0, 4.0])
    sums = [np.sum(np.exp(turn * f) * (window * x)) for f in at]
    return 2.0 * np.abs(sums) / window.sum()


def offset_and_drift(x: np.ndarray) -> tuple[float, float]:
    """Where a channel rests at its end, and by how much that moved from quarter to quarter.

    Parameters
    ----------
    x : (N,) array
        One channel.

    Returns
    -------
    float
        Mean of the last quarter.
    float
        Largest less smallest of the quarters' means.
    """
    levels = [float(np.mean(part)) for part in np.array_split(x, _PARTS)]
    return levels[-1], max(levels) - min(levels)


def dropouts(x: np.ndarray) -> int:
    r"""Samples in stretches that stand still while the signal moves around them.

    Of n pairs of neighbours beside a stretch of L equal values k are equal, so that the next pair
    is with probability (k + 1)/(n + 2); a stretch counts where among N samples less than one in a
    hundred of its length is expected, and where it is left, or entered, by more than two counts,
    as the crest of a slow wave is not. Stretches at the record's ends and at the extremes, which
    are overloads, do not count.

    Parameters
    ----------
    x : (N,) array
        One channel.
    """
    same = np.diff(x) == 0.0
    edges = np.diff(np.concatenate([[False], same, [False]]).astype(int))
    first, last = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    moved = np.abs(np.diff(x))[~same]
    if not first.size or not moved.size:
        return 0
    count, equal = np.min(moved), np.concatenate([[0], np.cumsum(same)])
    extremes, found = (np.min(x), np.max(x)), 0
    for a, b in zip(first, last, strict=True):
        length = b - a + 1
        if a == 0 or b == x.size - 1 or x[a] in extremes:
            continue
        low, high = max(0, a - 4 * length), min(same.size, b + 4 * length)
        k = equal[a] - equal[low] + equal[high] - equal[b]
        chance = (k + 1.0) / (high - b + a - low + 2.0)
        jumps = max(abs(x[a] - x[a - 1]), abs(x[b + 1] - x[b]))
        if x.size * chance ** (length - 1) < CHANCE and jumps > 2.0 * count:
            found += int(length)
    return found


def band_with_energy(x: np.ndarray, rate: float) -> tuple[float, float]:
    """Frequencies between which a channel has 98 % of its energy, Hz.

    Parameters
    ----------
    x : (N,) array
        One channel.
    rate : float
        Hz.
    """
    power = np.abs(np.fft.rfft((x - np.mean(x)) * np.hanning(x.size))) ** 2
    share = np.cumsum(power) / np.sum(power)
    at = np.searchsorted(share, [CHANCE, 1.0 - CHANCE])
    low, high = at * rate / x.size
    return float(low), float(high)
