"""A sensor's gain is wrong, or its sign."""

from typing import Any, ClassVar

import numpy as np
from jaxtyping import Array

from iwanjax.effects.faults import TURNED, AbstractSensorFault
from iwanjax.joints import ParameterInfo


class SensorGain(AbstractSensorFault):
    """A factor 1 + size."""

    scales: ClassVar[bool] = True

    def slope(self, shown: np.ndarray) -> np.ndarray | None:
        """What is shown itself."""
        return shown if self.fixed is None else None

    def set_up(self, size: Array) -> Any:
        """The factor."""
        return 1.0 + size

    def rest(self, sensors: int) -> Any:
        """Nothing."""
        return ()

    def show(self, seen: Array, set_up: Any, memory: Any) -> tuple[Array, Any]:
        """Louder, softer or turned over."""
        return set_up * seen, memory


GAIN = SensorGain(
    "sensor_gain",
    "calibration of a sensor",
    ParameterInfo("gain_error", "1", "factor of the sensor less one"),
    "one sensor off by the same share at every frequency and amplitude",
    "a wrong gain",
    "Sensor {where} has a wrong gain",
    turned="sensor_polarity",
)
POLARITY = SensorGain(
    "sensor_polarity",
    "sensor mounted or wired the wrong way round",
    ParameterInfo("factor", "1", "factor of the sensor less one"),
    "one sensor with the opposite sign",
    "a wrong sign",
    "Sensor {where} has the wrong sign",
    fixed=TURNED,
)
