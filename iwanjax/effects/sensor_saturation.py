"""A sensor, or its amplifier, is overloaded."""

from typing import Any, ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from iwanjax.effects.faults import AbstractSensorFault
from iwanjax.joints import ParameterInfo


class SensorSaturation(AbstractSensorFault):
    """No value above a limit is shown."""

    positive: ClassVar[bool] = True
    none_at_infinity: ClassVar[bool] = True

    def tried(self, largest: float) -> tuple[float, ...]:
        """Nothing above what it showed."""
        return (largest,)

    def set_up(self, size: Array) -> Any:
        """The limit; none where the size is zero."""
        return jnp.where(size > 0, size, jnp.inf)

    def rest(self, sensors: int) -> Any:
        """Nothing."""
        return ()

    def show(self, seen: Array, set_up: Any, memory: Any) -> tuple[Array, Any]:
        """Cut at the limit."""
        return jnp.clip(seen, -set_up, set_up), memory


SATURATION = SensorSaturation(
    "sensor_saturation",
    "overload of an amplifier",
    ParameterInfo("limit", "sensor", "largest value that the sensor shows", 0.0),
    "peaks of one sensor that are cut at one level",
    "saturation",
    "Sensor {where} saturates",
)
"""Peaks that an amplifier cuts."""
