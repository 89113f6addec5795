"""Noise of the sensors, from what is recorded before a force, beyond the motion, or at the end."""

from collections.abc import Sequence

import numpy as np

from iwanjax.discrepancy.histories.recordings import StudyRecording, before_force
from iwanjax.discrepancy.history_settings import CONDITIONING, ConditioningSettings
from iwanjax.signals.comparison_band import END


def common_noise(
    recordings: Sequence[StudyRecording], settings: ConditioningSettings = CONDITIONING
) -> np.ndarray:
    """Standard deviation of each sensor's noise over all recordings, held-out ones as well.

    Some dozens of samples before a trigger leave a deviation open by a tenth, and with it how
    much of a residual is noise.

    Parameters
    ----------
    recordings : sequence of StudyRecording
        All with the same sensors.
    settings : ConditioningSettings
        Of the stage.

    Returns
    -------
    (sensors,) array
        NaN where nothing was measured before a force, or recordings differ: a range that was
        switched between them.
    """
    quiet = [each.quiet for each in recordings if len(each.quiet) >= settings.enough]
    if not quiet:
        return np.full(recordings[0].response.shape[1], np.nan)
    variances = np.stack([np.var(each, axis=0, ddof=1) for each in quiet])
    freedoms = np.array([len(each) - 1.0 for each in quiet])
    alike = variances.max(axis=0) < settings.other_noise * variances.min(axis=0)
    return np.where(alike, np.sqrt(freedoms @ variances / freedoms.sum()), np.nan)


def quietest(response: np.ndarray, settings: ConditioningSettings = CONDITIONING) -> np.ndarray:
    r"""Noise of sensors that are never at rest, by where the structure moves them least.

    .. math:: \sigma^2 = \tfrac{1}{2} f_s \min_B S_B

    with the mean S_B of the one-sided spectral density (Welch 1967) over each of some bands up to
    the highest frequency that is compared. What is left of the motion there makes it an upper
    bound; noise that is not white may exceed it elsewhere.
    """
    from scipy.signal import welch

    f, density = welch(response, nperseg=min(settings.segment, len(response)), axis=0)
    values = int(2.0 * END * len(response))
    count = min(settings.noise_bands, max(1, values // settings.noise_values))
    which = np.floor(f * count / END).astype(int)
    found = [np.mean(density[which == band], axis=0) for band in range(count)]
    return np.sqrt(0.5 * np.min(found, axis=0))


def noise_of(
    response: np.ndarray, first: int, settings: ConditioningSettings = CONDITIONING
) -> np.ndarray:
    """Of the sensors before the first force; else of third differences at the end."""
    before = before_force(response, first, settings)
    if len(before) >= settings.enough:
        return np.std(before, axis=0, ddof=1)
    least = settings.enough + settings.spoilt
    tail = response[-max(len(response) // 8, least) : -settings.spoilt]
    # Third differences of white noise have twenty times its variance.
    return np.std(np.diff(tail, 3, axis=0), axis=0) / np.sqrt(20.0)
