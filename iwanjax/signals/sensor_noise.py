"""Noise of a recording's sensors, how it was estimated, and between which bounds it is."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from iwanjax.settings.conditioning import CONDITIONING, ConditioningSettings
from iwanjax.signals.clipping import clipped
from iwanjax.signals.noise import (
    CHANCE,
    NoiseInBands,
    NoiseLevel,
    deviation_in_band,
    exceeded,
    in_bands,
)
from iwanjax.signals.one_step import one_step_errors

GIVEN, BEFORE_FORCE = "as given", "before the force"
BETWEEN_PERIODS, QUIET_BANDS = "between periods", "in quiet bands"
WHOLE_BAND, ONE_STEP = "over the whole band", "one step ahead"
BESIDE_MODEL = "beside the fitted model"
OUTRIGHT = BEFORE_FORCE, BETWEEN_PERIODS
"""Sources that hold all that is not motion, and nothing else."""


class SensorNoise(NamedTuple):
    """Noise of a recording's sensors, and how that was estimated.

    Attributes
    ----------
    deviation : (sensors,) array
        Standard deviation: that of white noise with as much power in the band that is compared.
    freedom : (sensors,) array
        Degrees of freedom of its square; infinite where the study gives it.
    source : tuple of str
        Of each sensor: as given, before the force, between periods, over the whole band, one step
        ahead, in quiet bands, or beside the fitted model.
    lower, upper : (sensors,) array
        Deviations between which it is: in quiet bands or one step ahead, and all that no linear
        model of a few modes explains. The deviation itself where nothing else is in it.
    """

    deviation: np.ndarray
    freedom: np.ndarray
    source: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray

    @property
    def open(self) -> np.ndarray:
        """Of which sensors it is known within bounds only, (sensors,)."""
        return self.lower < self.upper

    def where(self, better: np.ndarray, other: "SensorNoise") -> "SensorNoise":
        """The other one's where that is better, (sensors,)."""
        return SensorNoise(
            np.where(better, other.deviation, self.deviation),
            np.where(better, other.freedom, self.freedom),
            tuple(np.where(better, other.source, self.source).tolist()),
            np.where(better, other.lower, self.lower),
            np.where(better, other.upper, self.upper),
        )

    def first(self, count: int) -> "SensorNoise":
        """Of the first few sensors."""
        return SensorNoise(
            self.deviation[:count],
            self.freedom[:count],
            self.source[:count],
            self.lower[:count],
            self.upper[:count],
        )

    def times(self, factor: np.ndarray | float) -> "SensorNoise":
        """The same of sensors so many times as loud."""
        deviation, lower, upper = (x * factor for x in (self.deviation, self.lower, self.upper))
        return self._replace(deviation=deviation, lower=lower, upper=upper)

    def at_least(self, least: np.ndarray) -> "SensorNoise":
        """No less than so much, (sensors,)."""
        deviation, lower, upper = (
            np.maximum(x, least) for x in (self.deviation, self.lower, self.upper)
        )
        return self._replace(deviation=deviation, lower=lower, upper=upper)

    @classmethod
    def of(cls, level: NoiseLevel, source: str) -> "SensorNoise":
        """All of one source, which leaves nothing open."""
        sources = (source,) * len(level.deviation)
        return cls(*level, sources, level.deviation, level.deviation)


def louder(one: SensorNoise, other: SensorNoise, allowed: np.ndarray | float) -> np.ndarray:
    """Whether noise is more than chance and so many times another estimate, (sensors,)."""
    chance = exceeded(one.freedom, other.freedom, CHANCE)
    return one.deviation > allowed * np.sqrt(chance) * other.deviation


def along_motion(
    response: Float[np.ndarray, "N sensors"],
    force: Float[np.ndarray, "N inputs"] | None,
    settings: ConditioningSettings = CONDITIONING,
) -> SensorNoise:
    """Noise of sensors while they move, bounded from both sides.

    Three estimates, each with its own blind spot. What no linear model explains over the whole
    band, U, is noise of any colour beside a structure that is linear; where the structure is not,
    or a force that nobody measured acts on it, U stands out at its modes and is an upper bound.
    Quiet bands, Q, hold less noise than others where it is coloured, and harmonics where a law
    moves at all frequencies. One-step errors while the sensor moves least, E, hold no more of a
    law than a small motion does. The noise is taken to be

    * U where no band stands out, and E has nothing to do with the size of the motion;
    * E where E is below Q, whose bands hold harmonics then; and where E is above Q, a band stands
      out, but E has nothing to do with the motion: noise that passes through the structure;
    * Q where E grows with the motion.

    The last two say how much noise there is at least, as a model in the free run meets it: what a
    mode amplifies of a force's noise is in U alone.

    Parameters
    ----------
    response : (N, sensors) array
        As measured; NaN throughout for a sensor that is lacking.
    force : (N, inputs) array or None
        Zero outside its pulses.
    settings : ConditioningSettings
        Of the stage.
    """
    quiet, whole, smooth = _in_bands(response, force, settings)
    spoilt = np.stack([clipped(column) for column in response.T], axis=1)
    errors = one_step_errors(response, force, spoilt, lags=settings.lags)
    found, least = SensorNoise.of(quiet, QUIET_BANDS), SensorNoise.of(errors.least, ONE_STEP)
    passes = errors.steady & (least.deviation > found.deviation)
    bound = found.where(louder(found, least, 1.0) | passes, least)
    bound = bound._replace(
        lower=np.fmin(quiet.deviation, least.deviation),
        upper=np.fmax(whole.deviation, bound.deviation),
    )
    return bound.where(smooth & errors.steady, SensorNoise.of(whole, WHOLE_BAND))


def beside_model(
    known: SensorNoise,
    left: Float[np.ndarray, "N sensors"],
    settings: ConditioningSettings = CONDITIONING,
) -> SensorNoise:
    """Noise of sensors by what a model leaves of them, where that is like noise.

    Beside the motion of a structure coloured noise may be known from below only. What a model
    leaves holds none of the motion that it explains: where no band of it stands out, as modes do,
    all of it is noise of some colour, or nothing that can be told from that.

    Parameters
    ----------
    known : SensorNoise
        By the recording alone; stays where nothing of it is open.
    left : (N, sensors) array
        Measured less predicted; NaN throughout for a sensor that is lacking.
    settings : ConditioningSettings
        Of the stage.
    """
    # Beside no force: what is left of the answers to one is an error of the model.
    told = along_motion(left, None, settings)
    alike = known.open & (np.array(told.source) == WHOLE_BAND)
    # All of it, with the slow part that local models would explain as well.
    level = NoiseLevel(deviation_in_band(left), told.freedom)
    return known.where(alike, SensorNoise.of(level, BESIDE_MODEL))


def like_others(known: SensorNoise, others: Sequence[SensorNoise]) -> SensorNoise:
    """Noise of a recording's sensors as beside the model in others, within its own bounds.

    Parameters
    ----------
    known : SensorNoise
        By the recording alone; stays where nothing of it is open.
    others : sequence of SensorNoise
        Of recordings that a model was fitted to.
    """
    beside = np.array([each.source for each in others]) == BESIDE_MODEL
    count = np.sum(beside, axis=0)
    square, freedom = (
        np.sum(np.where(beside, x, 0.0), axis=0) / np.maximum(count, 1)
        for x in (
            [each.deviation**2 for each in others],
            [each.freedom for each in others],
        )
    )
    level = NoiseLevel(np.clip(np.sqrt(square), known.lower, known.upper), freedom)
    return known.where(known.open & (count > 0), SensorNoise.of(level, BESIDE_MODEL))


def in_compared_band(
    response: Float[np.ndarray, "N sensors"],
    force: Float[np.ndarray, "N inputs"] | None,
    settings: ConditioningSettings = CONDITIONING,
) -> SensorNoise:
    """Noise of sensors by the band that is compared alone, as after a filter that ends beyond it.

    What a filter has made of white noise can be foretold from one sample to the next, so that
    one-step errors say nothing; else as :func:`along_motion`.
    """
    quiet, whole, smooth = _in_bands(response, force, settings)
    bound = SensorNoise.of(quiet, QUIET_BANDS)
    bound = bound._replace(upper=np.fmax(whole.deviation, bound.deviation))
    return bound.where(smooth, SensorNoise.of(whole, WHOLE_BAND))


def in_quiet_bands(
    response: Float[np.ndarray, "N sensors"],
    force: Float[np.ndarray, "N inputs"] | None,
    settings: ConditioningSettings = CONDITIONING,
) -> SensorNoise:
    """Noise of sensors in quiet bands, whatever the structure and its forces do."""
    return SensorNoise.of(_in_bands(response, force, settings).quiet, QUIET_BANDS)


def _in_bands(
    response: np.ndarray, force: np.ndarray | None, settings: ConditioningSettings
) -> NoiseInBands:
    return in_bands(
        response,
        force,
        bands=settings.noise_bands,
        values=settings.noise_values,
        flat=settings.flat,
    )
