"""Finding overloads: samples that rest at a signal's extremes."""

import numpy as np
from jaxtyping import Bool, Float

from iwanjax.errors import InputError
from iwanjax.types import ArrayLike

_SHORTEST_RUN = 3
# Of the largest magnitude, what an extreme must reach: noise under one-sided pulses has one too.
_EXTREME = 0.5
# How many deviations of the noise make neighbours equal that are not.
_NOISE = 2.0
# Relative difference of samples that rest at the same limit.
_SAME = 1e-6


def clipped_samples(x: ArrayLike) -> int:
    """How many samples of a signal are clipped (:func:`clipped`)."""
    return int(np.sum(clipped(x)))


def clipped(x: ArrayLike) -> Bool[np.ndarray, " N"]:
    r"""Which samples of a signal are clipped.

    A clipped signal arrives at its limit with speed and rests there. So does the crest of a
    slow signal in coarse counts, but it arrives slowly: while L samples stay within q, the
    parabola :math:`x_0 - c k^2 / 2` through them has :math:`c ((L - 1) / 2)^2 / 2 \le q` and by
    the sample before the first it has fallen by no more than :math:`q ((L + 2) / (L - 1))^2`.
    A run that falls deeper at either end is clipped; q is one count and what noise adds to it.

    Parameters
    ----------
    x : (N,) array_like
        Signal of any unit. Values that are not finite count as not clipped.

    Returns
    -------
    (N,) array of bool
        Those in runs of at least three equal ones at the largest or the smallest value.
    """
    x = np.asarray(x, dtype=np.float64).ravel()
    found = np.zeros(x.shape, dtype=bool)
    finite = x[np.isfinite(x)]
    if finite.size < _SHORTEST_RUN or np.ptp(finite) == 0.0:
        return found
    spread = np.min(np.diff(np.unique(finite))) + _NOISE * _deviation(finite)
    largest = np.max(np.abs(finite))
    for side in (x, -x):
        if np.max(side[np.isfinite(side)]) >= _EXTREME * largest:
            found |= _clipped_above(side, spread)
    return found


def cut_off(x: ArrayLike) -> Float[np.ndarray, " N"]:
    r"""What clipping cut off the peaks of a signal, at a guess; zero elsewhere.

    Between the times a and b, where its flanks reach the limit, a parabola that goes on from them:

    .. math:: \frac{|F'(a)| + |F'(b)|}{2 (b - a)} (t - a)(b - t)

    Parameters
    ----------
    x : (N,) array_like
        Signal of any unit. Its two limits need not be of one size: it may have had an offset.
    """
    x = np.asarray(x, dtype=np.float64).ravel()
    flat = clipped(x)
    return _cut_off_above(x, flat) - _cut_off_above(-x, flat)


def _cut_off_above(x: np.ndarray, flat: np.ndarray) -> np.ndarray:
    """What was cut above the largest value; nothing where that is not flat."""
    top = np.max(x)
    lost = np.zeros_like(x)
    at_top = x >= top - _SAME * np.max(np.abs(x))
    if not np.any(at_top & flat):
        return lost
    edges = np.diff(np.concatenate([[False], at_top, [False]]).astype(int))
    runs = zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1, strict=True)
    for first, last in runs:
        if first < 2 or last > len(x) - 3:
            continue
        up, down = x[first - 1] - x[first - 2], x[last + 1] - x[last + 2]
        if min(up, down) <= 0.0:
            continue
        # Between samples, where the flanks reach the limit.
        begin = first - 1 + min(1.0, (top - x[first - 1]) / up)
        end = last + 1 - min(1.0, (top - x[last + 1]) / down)
        at = np.arange(first, last + 1)
        if end > begin:
            arch = np.maximum((at - begin) * (end - at), 0.0)
            lost[first : last + 1] = 0.5 * (up + down) / (end - begin) * arch
    return lost


def _deviation(x: np.ndarray) -> float:
    """Deviation of white noise, from sixth differences: of a slow signal they hold little."""
    if x.size <= 6:
        return 0.0
    # 924 is the sum of the squares of their weights, 0.6745 the median of a unit normal's size.
    return float(np.median(np.abs(np.diff(x, 6))) / (0.6745 * np.sqrt(924.0)))


def _clipped_above(x: np.ndarray, spread: float) -> np.ndarray:
    """Samples in clipped runs at the largest value; within ``spread`` samples may look equal."""
    top = np.max(x[np.isfinite(x)])
    edges = np.diff(np.concatenate([[False], x == top, [False]]).astype(int))
    first, last = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    lengths = last - first + 1
    long = lengths >= _SHORTEST_RUN
    first, last, lengths = first[long], last[long], lengths[long]
    deep = np.zeros(lengths.shape, dtype=bool)
    for m in (1, lengths):
        # Beyond the ends of the signal, and where it has no value, nothing falls.
        before = np.where(first >= m, x[np.maximum(first - m, 0)], top)
        after = np.where(last + m < x.size, x[np.minimum(last + m, x.size - 1)], top)
        fall = top - np.fmin(before, after)
        # Half a count more, for what rounding adds.
        deep |= fall > spread * (((lengths + 2 * m) / (lengths - 1)) ** 2 + 0.5)
    edges = np.zeros(x.size + 1, dtype=int)
    edges[first[deep]] += 1
    edges[last[deep] + 1] -= 1
    return np.cumsum(edges)[:-1] > 0


def refuse_clipped(decay: np.ndarray) -> None:
    """A channel that was overloaded in the decay measures nothing there.

    Raises
    ------
    InputError
    """
    count = clipped_samples(decay)
    if count:
        raise InputError(
            f"signal is clipped: {count} samples of the decay rest at its extreme; lower the "
            "range's gain, or give start= after the overload"
        )
