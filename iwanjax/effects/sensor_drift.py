"""The offset of a sensor wanders."""

import numpy as np

from iwanjax.effects.faults import AbstractAddedFault
from iwanjax.joints import ParameterInfo

# Half turns of the fastest part over a recording.
_FASTEST = 4


class SensorDrift(AbstractAddedFault):
    """A straight line and slow cosines (Ahmed, Natarajan and Rao 1974)."""

    @property
    def count(self) -> int:
        """Offset, slope and cosines."""
        return 2 + _FASTEST

    def columns(self, count: int, dt: float) -> np.ndarray:
        """Over the longest recording."""
        s = np.linspace(0.0, 1.0, count)
        turns = np.cos(np.pi * np.outer(s, np.arange(_FASTEST + 1)))
        return np.concatenate([turns, s[:, None]], axis=1)


DRIFT = SensorDrift(
    "sensor_drift",
    "offset that wanders, by temperature or an integrator",
    ParameterInfo("rms", "sensor", "of the drift, mean over the recordings", 0.0),
    "slow motion in one sensor that no force explains",
    "a drift",
    "Sensor {where} drifts",
)
"""An offset that wanders."""
