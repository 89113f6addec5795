"""Noise of measured forces, and of those that never end where something shows it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from iwanjax.settings.conditioning import CONDITIONING, ConditioningSettings
from iwanjax.signals.noise import in_bands, unexplained
from iwanjax.signals.sensor_noise import BETWEEN_PERIODS, QUIET_BANDS

BESIDE_PULSES, UNKNOWN = "beside its pulses", "not known"


class InputNoise(NamedTuple):
    """Noise of a recording's forces, and what shows it.

    Attributes
    ----------
    deviation : (inputs,) array
        Standard deviation of white noise; NaN where nothing shows it, zero where nothing acts.
    source : tuple of str
        Of each input: as given, beside its pulses, between periods, in quiet bands, not known;
        empty where nothing acts.
    """

    deviation: np.ndarray
    source: tuple[str, ...]

    def times(self, factor: float) -> "InputNoise":
        """The same of forces so many times as large."""
        return self._replace(deviation=self.deviation * factor)


def of_endless(
    force: Float[np.ndarray, " N"],
    period: int | None,
    settings: ConditioningSettings = CONDITIONING,
) -> tuple[float, str]:
    r"""Deviation of a force's white noise, and what shows it.

    Of P periods half the mean square of what changes from each to the next: noise, and what the
    generator does not repeat, which the structure answers. Else what is left in quiet bands, of
    which there are some beyond those that a shaker excites, and all of a sweep, whose spectrum is
    smooth: where that is no more than a force may be off by anyway. Random noise up to the
    highest frequency that is compared hides it.

    Parameters
    ----------
    force : (N,) array
        As measured.
    period : int or None
        Samples of a period of which it holds several.
    settings : ConditioningSettings
        Of the stage.

    Returns
    -------
    (float, str)
        In the force's unit; NaN and "not known" where nothing shows it.
    """
    column = force[:, None]
    if period is not None:
        count = len(force) // period
        changes = np.diff(column[: count * period].reshape(count, period, 1), axis=0)
        left = [np.mean(unexplained(each, None, ringing=False).variance) for each in changes]
        return float(np.sqrt(0.5 * np.mean(left))), BETWEEN_PERIODS
    quiet = in_bands(
        column, None, bands=settings.noise_bands, values=settings.noise_values, flat=settings.flat
    ).quiet.deviation[0]
    if quiet < settings.force_error * np.max(np.abs(force)):
        return float(quiet), QUIET_BANDS
    return float("nan"), UNKNOWN
