"""The mains hum in a sensor's channel."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from iwanjax.effects.faults import AbstractAddedFault
from iwanjax.joints import ParameterInfo
from iwanjax.signals.comparison_band import END

# Hz; by how much a line, or a recorder's clock, may be off it, relative; and what of a turn over
# the longest recording a step of the frequency may be.
_MAINS, _OFF, _TURN = (50.0, 60.0), 0.01, 0.05
# Rectifiers add the third harmonic.
_ORDERS = (1, 3)


@dataclass(frozen=True)
class SensorHum(AbstractAddedFault):
    """The mains' frequency and its third harmonic, each of any amplitude and phase.

    Attributes
    ----------
    frequency : float
        Hz.
    orders : tuple of int
        Harmonics below the end of the band that is compared.
    """

    frequency: float = math.nan
    orders: tuple[int, ...] = (1,)
    over_rms: ClassVar[float] = math.sqrt(2.0)
    told: ClassVar[ParameterInfo | None] = ParameterInfo("frequency", "1/time", "of the mains")

    @property
    def count(self) -> int:
        """A sine and a cosine for each harmonic."""
        return 2 * len(self.orders)

    def tuned(self, left: np.ndarray, dt: float) -> "Self | None":
        """At the frequency near that of a mains that explains most; None where none is seen."""
        steps = round(left.shape[1] / _TURN)
        f = np.fft.rfftfreq(steps, dt)
        # Of a recording of less than a few turns one step is more than the mains is off.
        near = [
            np.abs(f - mains) <= max(_OFF * mains, f[1])
            for mains in _MAINS
            if mains * (1.0 + _OFF) * dt < END
        ]
        if not near:
            return None
        power = np.sum(np.abs(np.fft.rfft(left, steps, axis=1)) ** 2, axis=0)
        frequency = float(f[np.argmax(power * np.any(near, axis=0))])
        orders = tuple(order for order in _ORDERS if order * frequency * dt < END)
        return replace(self, frequency=frequency, orders=orders)

    def columns(self, count: int, dt: float) -> np.ndarray:
        """Cosines and sines."""
        turn = 2.0 * np.pi * dt * self.frequency * np.outer(np.arange(count), self.orders)
        return np.concatenate([np.cos(turn), np.sin(turn)], axis=1)

    def moved(self, by: float, span: float) -> Self:
        """At a frequency of so many turns over a recording more."""
        return replace(self, frequency=self.frequency + by / span)

    def value(self, span: float) -> tuple[float, float]:
        """The frequency; one turn over a recording."""
        return self.frequency, 1.0 / span


HUM = SensorHum(
    "sensor_hum",
    "mains pick-up, earth loop",
    ParameterInfo("amplitude", "sensor", "of the hum, mean over the recordings", 0.0),
    "a line at the mains' frequency in one sensor that does not depend on the excitation",
    "mains hum",
    "Sensor {where} picks up mains hum",
)
"""Mains and its third harmonic."""
