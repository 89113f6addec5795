"""Signals that hold no free decay of one mode are refused."""

import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.signals.decay import Noise
from iwanjax.signals.filters import check_signal
from iwanjax.types import ArrayLike

_FEWEST_SAMPLES = 64
LEAST_DECAY = 0.8
"""Of the highest amplitude, what the lowest must be below for a signal to be a decay."""
# or as many deviations of its noise, where it falls by less.
_CLEAR_DECAY = 30.0
NORMAL = 1.4826
"""A normal deviation over the median of its size."""
SURE = 4.0
"""Deviations by which a quantity differs from zero for sure."""
# Scatter of the damping's logarithm from level to level which no joint shows, and levels needed
# to tell.
_LARGEST_SCATTER, _ENOUGH_FOR_SCATTER = 0.2, 8


def checked_signal(signal: ArrayLike) -> np.ndarray:
    """A row of enough finite numbers that vary."""
    x = check_signal(signal)
    if x.size < _FEWEST_SAMPLES:
        raise InputError(f"signal has {x.size} samples; expected at least {_FEWEST_SAMPLES}")
    if np.ptp(x) == 0.0:
        raise InputError(f"signal is {x[0]:g} throughout; is the sensor connected?")
    return x


def refuse_no_decay(
    psi_1: np.ndarray, usable: slice, band: tuple[float, float], noise: Noise
) -> None:
    """The envelope must fall by a fifth, or many times its noise, from first to last eighth."""
    inside = psi_1[usable]
    share = max(1, inside.size // 8)
    first, last = np.exp(np.mean(inside[:share])), np.exp(np.mean(inside[-share:]))
    scatter = float(np.sqrt(np.max(noise.density) * (band[1] - band[0])))
    if last > LEAST_DECAY * first and first - last < _CLEAR_DECAY * scatter:
        raise InputError(
            f"ringdown: no decay in {band[0]:g} to {band[1]:g} Hz: the envelope goes from "
            f"{first:.3g} to {last:.3g}; expected a free decay of one mode"
        )


def refuse_beats(curves: ModalCurves, band: tuple[float, float]) -> None:
    """The damping of one mode goes smoothly with its amplitude; that of two that beat does not."""
    zeta, std = np.asarray(curves.damping), np.asarray(curves.damping_std)
    grows = bool(np.any(zeta < -SURE * std))
    known = (zeta > 0) & (std < 0.2 * zeta)
    scatter = 0.0
    if np.count_nonzero(known) >= _ENOUGH_FOR_SCATTER:
        scatter = _local_scatter(np.log(zeta[known]))
    if grows or scatter > _LARGEST_SCATTER:
        raise InputError(
            f"ringdown: the envelope in {band[0]:g} to {band[1]:g} Hz beats: the damping "
            f"{'turns negative' if grows else f'scatters by {100 * scatter:.0f} %'} along the "
            "decay, far more than the noise lets it; the band holds more than one mode, narrow "
            "it or use a modal filter"
        )


def _local_scatter(y: np.ndarray) -> float:
    """Deviation of values about the cubic through their four neighbours, where it is common.

    The median: at the onset of macroslip damping falls by ten within two levels, and only
    there.
    """
    weights = np.array([-1.0, 4.0, 0.0, 4.0, -1.0]) / 6.0
    off = np.convolve(y, weights, mode="valid") - y[2:-2]
    # The neighbours scatter as well.
    return float(NORMAL * np.median(np.abs(off)) / np.sqrt(1.0 + weights @ weights))
