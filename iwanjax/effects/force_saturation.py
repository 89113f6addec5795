"""The peaks of a measured force are cut."""

from typing import ClassVar

import numpy as np

from iwanjax.effects.faults import AbstractForceFault
from iwanjax.joints import ParameterInfo
from iwanjax.signals.clipping import clipped

# Relative difference of samples that rest at the same limit.
_SAME = 1e-6


class ForceSaturation(AbstractForceFault):
    r"""Of a peak that was cut between the times a and b a parabola is lost.

    .. math:: F = F_m + s\, \frac{|F'(a)| + |F'(b)|}{2 (b - a)} (t - a)(b - t)

    For s = 1 it goes on from the slopes of its flanks.
    """

    positive: ClassVar[bool] = True

    def acted(self, measured: np.ndarray, size: float) -> np.ndarray:
        """The measured force with its peaks."""
        flat = clipped(measured)
        return measured + size * (_lost(measured, flat) - _lost(-measured, flat))


def _lost(x: np.ndarray, flat: np.ndarray) -> np.ndarray:
    """What was cut above the largest value, for size 1; nothing where that is not flat.

    The two limits need not be of one size: a channel may have had an offset.
    """
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


SATURATION = ForceSaturation(
    "force_saturation",
    "overload of a load cell or of its amplifier",
    ParameterInfo("lost_peak", "1", "height of the lost peaks over what their flanks ask for", 0.0),
    "peaks of a force that are cut at one level; more response than the force explains",
    "saturation of the force",
    "The force at {where} is cut at its peaks",
)
"""Peaks of a force that its channel cuts."""
