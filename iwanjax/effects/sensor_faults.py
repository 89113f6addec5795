"""Faults of sensors: gain, delay, saturation, polarity."""

from iwanjax.effects.kinds import SensorKind
from iwanjax.effects.nested import TURNED, WRONG_SIGN
from iwanjax.joints import ParameterInfo

SENSOR_FAULTS = (
    SensorKind(
        "sensor_gain",
        "calibration of a sensor",
        ParameterInfo("gain_error", "1", "factor of the sensor less one"),
        "one sensor off by the same share at every frequency and amplitude",
        "gain",
        limits=(WRONG_SIGN,),
    ),
    SensorKind(
        "sensor_delay",
        "delay of a filter in one channel",
        ParameterInfo("delay", "time", "by which the sensor is late", 0.0),
        "one sensor whose phase lags in proportion to frequency",
        "delay",
        positive=True,
    ),
    SensorKind(
        "sensor_saturation",
        "overload of an amplifier",
        ParameterInfo("limit", "sensor", "largest value that the sensor shows", 0.0),
        "peaks of one sensor that are cut at one level",
        "limit",
    ),
    SensorKind(
        "sensor_polarity",
        "sensor mounted or wired the wrong way round",
        ParameterInfo("factor", "1", "factor of the sensor less one"),
        "one sensor with the opposite sign",
        "gain",
        fixed=TURNED,
    ),
)
"""What a measurement chain does to a signal."""
