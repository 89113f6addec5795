"""A sensor is coupled by a capacitor, or is piezoelectric: what is slow it does not show."""

import math
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.effects.faults import AbstractSensorFault
from iwanjax.joints import ParameterInfo


class SensorHighPass(AbstractSensorFault):
    r"""A high-pass filter of first order, :math:`s / (s + \omega_c)`, by Tustin's rule.

    A size is :math:`\omega_c` times the sampling interval.
    """

    positive: ClassVar[bool] = True
    most: ClassVar[float] = 0.5

    def unit(self, dt: float) -> float:
        """One radian a sample, in Hz."""
        return 1.0 / (2.0 * math.pi * dt)

    def slope(self, shown: np.ndarray) -> np.ndarray | None:
        """The integral, by the trapezoidal rule."""
        return 0.5 * shown - np.cumsum(shown, axis=1)

    def set_up(self, size: Array) -> Any:
        """What of the slow part is kept, and what is added to it."""
        half = 0.5 * size
        return (1.0 - half) / (1.0 + half), half / (1.0 + half)

    def rest(self, sensors: int) -> Any:
        """The slow part, and the last sample."""
        return jnp.zeros(sensors), jnp.zeros(sensors)

    def show(self, seen: Array, set_up: Any, memory: Any) -> tuple[Array, Any]:
        """What is seen less its slow part."""
        (kept, added), (slow, last) = set_up, memory
        slow = kept * slow + added * (seen + last)
        return seen - slow, (slow, seen)


HIGH_PASS = SensorHighPass(
    "sensor_high_pass",
    "AC coupling, discharge of a piezoelectric sensor",
    ParameterInfo("corner", "1/time", "frequency below which the sensor shows little", 0.0),
    "one sensor whose phase leads and whose size falls towards low frequencies",
    "a high-pass filter",
    "Sensor {where} has a high-pass filter",
)
"""AC coupling of first order."""
