"""A force's channel is late, or another recorder than that of the sensors is."""

from typing import ClassVar

import numpy as np

from iwanjax.effects.faults import AbstractForceFault
from iwanjax.joints import ParameterInfo

# Half the length of the interpolating filter, samples, and Kaiser's beta: up to 0.4 of the sampling
# rate, beyond the band that is compared, it is off by less than 1e-3 whatever the delay.
_HALF, _BETA = 24, 8.0


class ForceDelay(AbstractForceFault):
    """The channel shows the force that acted so many samples earlier."""

    most: ClassVar[float] = 4.0

    def unit(self, dt: float) -> float:
        """One sample."""
        return dt

    def acted(self, measured: np.ndarray, size: float, lost: np.ndarray) -> np.ndarray:
        """The measured force so much later, by a windowed sinc (Kaiser 1974)."""
        apart = size - np.arange(-_HALF, _HALF + 1)
        inside = np.sqrt(np.maximum(1.0 - (apart / (_HALF + 1)) ** 2, 0.0))
        taps = np.sinc(apart) * np.i0(_BETA * inside) / np.i0(_BETA)
        wide = np.pad(measured, _HALF)
        return np.correlate(wide, taps, "valid")


DELAY = ForceDelay(
    "force_delay",
    "delay of a force's conditioner, or between recorders of forces and of sensors",
    ParameterInfo("delay", "time", "by which the force is late; negative where the sensors are"),
    "all sensors whose phase leads in proportion to frequency",
    "a delay of the force",
    "The force at {where} and the sensors are not recorded at the same time",
)
