"""Noise of the sensors, from what is recorded before a force, beyond the motion, or at the end."""

from collections.abc import Sequence

import numpy as np

from iwanjax.discrepancy.histories.recordings import ENOUGH, SPOILT, StudyRecording, before_force
from iwanjax.signals.comparison_band import END

# Segments of a spectrum that noise is told by, samples; bands up to the highest frequency that is
# compared, at most, and values that each is the mean of, at least: a variance is then known to
# sqrt(2/50) = 20 %, and the least of 20 up to 40 % too small. Twice as many bands
# change nothing of Silverbox's multisine, half as many make its noise 5.9 times as large: its
# force ends just below the last band.
_SEGMENT, _BANDS, _VALUES = 1024, 20, 50

# Largest over smallest variance of a sensor's noise, beyond which its recordings differ: with five
# of 20 samples each one in a hundred does by chance (Hartley's test).
_OTHER_NOISE = 4.6


def common_noise(recordings: Sequence[StudyRecording]) -> np.ndarray:
    """Standard deviation of each sensor's noise over all recordings, held-out ones as well.

    Some dozens of samples before a trigger leave a deviation open by a tenth, and with it how
    much of a residual is noise.

    Parameters
    ----------
    recordings : sequence of StudyRecording
        All with the same sensors.

    Returns
    -------
    (sensors,) array
        NaN where nothing was measured before a force, or recordings differ: a range that was
        switched between them.
    """
    quiet = [each.quiet for each in recordings if len(each.quiet) >= ENOUGH]
    if not quiet:
        return np.full(recordings[0].response.shape[1], np.nan)
    variances = np.stack([np.var(each, axis=0, ddof=1) for each in quiet])
    freedoms = np.array([len(each) - 1.0 for each in quiet])
    alike = variances.max(axis=0) < _OTHER_NOISE * variances.min(axis=0)
    return np.where(alike, np.sqrt(freedoms @ variances / freedoms.sum()), np.nan)


def quietest(response: np.ndarray) -> np.ndarray:
    r"""Noise of sensors that are never at rest, by where the structure moves them least.

    .. math:: \sigma^2 = \tfrac{1}{2} f_s \min_B S_B

    with the mean S_B of the one-sided spectral density (Welch 1967) over each of some bands up to
    the highest frequency that is compared. What is left of the motion there makes it an upper
    bound; noise that is not white may exceed it elsewhere.
    """
    from scipy.signal import welch

    f, density = welch(response, nperseg=min(_SEGMENT, len(response)), axis=0)
    count = min(_BANDS, max(1, int(2.0 * END * len(response)) // _VALUES))
    which = np.floor(f * count / END).astype(int)
    found = [np.mean(density[which == band], axis=0) for band in range(count)]
    return np.sqrt(0.5 * np.min(found, axis=0))


def noise_of(response: np.ndarray, first: int) -> np.ndarray:
    """Of the sensors before the first force; else of third differences at the end."""
    before = before_force(response, first)
    if len(before) >= ENOUGH:
        return np.std(before, axis=0, ddof=1)
    tail = response[-max(len(response) // 8, ENOUGH + SPOILT) : -SPOILT]
    # Third differences of white noise have twenty times its variance.
    return np.std(np.diff(tail, 3, axis=0), axis=0) / np.sqrt(20.0)
