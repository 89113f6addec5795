"""A joint left out, beside the one that a mode, a structure or a loop is modelled with."""

from typing import NamedTuple, Protocol

import numpy as np

from iwanjax.discrepancy.effects import Kind, kinds_of
from iwanjax.discrepancy.estimate import Estimate
from iwanjax.joints import Scales
from iwanjax.joints.iwan import IWAN_PARAMETERS
from iwanjax.joints.iwan4 import SLIDING_AT_ONCE

VALUES = len(IWAN_PARAMETERS)
"""Parameters of a joint left out, the last ones of a fit."""
# How near a joint is to the slider that it becomes where all of its sliders slip at once.
_ALL_AT_ONCE = 1.0 / 30.0


class AddedJoint(NamedTuple):
    """A whole joint, and the place of a structure where it acts; its shape is its own affair."""

    kind: Kind
    shape: float = 1.0
    where: str = ""


class WithAddedJoint(Protocol):
    """A fit that may hold one."""

    def added(self) -> tuple[np.ndarray, np.ndarray]:
        """Parameters of the joint left out, and their standard deviations."""
        ...


def joint_kind(hypotheses: tuple[str, ...]) -> Kind | None:
    """The kind that a joint left out is, if it is to be tried."""
    return next((kind for kind in kinds_of(hypotheses) if kind.name == "iwan_joint"), None)


def joint_estimates(fit: WithAddedJoint) -> tuple[Estimate, ...]:
    """Parameters of a joint left out, with deviations."""
    rows = zip(IWAN_PARAMETERS, *(x.tolist() for x in fit.added()), strict=True)
    return tuple(Estimate(*each) for each in rows)


def as_slider(k: float, slip: float) -> np.ndarray:
    """Parameters of the joint that a slider of stiffness k is the limit of."""
    return np.array(SLIDING_AT_ONCE.widened((k, slip), Scales(slip, 1.0), _ALL_AT_ONCE))
