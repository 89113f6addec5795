"""The gain of a force's channel is wrong, or its sign."""

import numpy as np

from iwanjax.effects.faults import TURNED, AbstractForceFault
from iwanjax.joints import ParameterInfo


class ForceGain(AbstractForceFault):
    """The channel shows 1 + size times the force that acted."""

    def acted(self, measured: np.ndarray, size: float, lost: np.ndarray) -> np.ndarray:
        """The measured force over the channel's factor."""
        return measured / (1.0 + size)


GAIN = ForceGain(
    "force_gain",
    "calibration of a load cell",
    ParameterInfo("gain_error", "1", "factor of the force's channel less one"),
    "all sensors off by the same share wherever one input drives",
    "a wrong gain of the force",
    "The force at {where} has a wrong gain",
    turned="force_polarity",
)
POLARITY = ForceGain(
    "force_polarity",
    "load cell wired the wrong way round, tension for compression",
    ParameterInfo("factor", "1", "factor of the force's channel less one"),
    "all sensors with the opposite sign wherever one input drives",
    "a wrong sign of the force",
    "The force at {where} has the wrong sign",
    fixed=TURNED,
)
