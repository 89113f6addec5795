"""The peaks of a measured force are cut."""

from typing import ClassVar

import numpy as np

from iwanjax.effects.faults import AbstractForceFault
from iwanjax.joints import ParameterInfo


class ForceSaturation(AbstractForceFault):
    """The channel cut the peaks of the force that acted.

    They are size times as high as their flanks ask for (:func:`iwanjax.signals.clipping.cut_off`).
    """

    positive: ClassVar[bool] = True
    last: ClassVar[bool] = True

    def acted(self, measured: np.ndarray, size: float, lost: np.ndarray) -> np.ndarray:
        """The measured force with its peaks."""
        return measured + size * lost


SATURATION = ForceSaturation(
    "force_saturation",
    "overload of a load cell or of its amplifier",
    ParameterInfo("lost_peak", "1", "height of the lost peaks over what their flanks ask for", 0.0),
    "peaks of a force that are cut at one level; more response than the force explains",
    "saturation of the force",
    "The force at {where} is cut at its peaks",
)
"""Peaks of a force that its channel cuts."""
