"""Where each value of a hypothesis stands in its vector theta.

First errors of the linear model and the joints' parameters in prior deviations, one joint after the
other; then size and shape of each slot; then, for each recording on its own, errors of the state.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Array

from iwanjax.identification.suspects import Values

_OF_SLOT = 2


class ParameterMap(NamedTuple):
    """Places of values in theta.

    Attributes
    ----------
    joints : int
        Number of the joints' parameters.
    """

    joints: int

    def size(self, slot: int) -> int:
        """Place of a slot's size, in its unit or as its logarithm."""
        return self.joints + _OF_SLOT * slot

    def shape(self, slot: int) -> int:
        """Place of the logarithm of a slot's shape."""
        return self.size(slot) + 1

    def slot(self, slot: int) -> slice:
        """Places of a slot's size and shape."""
        return slice(self.size(slot), self.size(slot + 1))

    def sizes(self, slots: int) -> slice:
        """Places of the sizes of so many slots."""
        return slice(self.joints, self.end(slots), _OF_SLOT)

    def end(self, slots: int) -> int:
        """Number of values without errors of the state."""
        return self.size(slots)

    def given(self, z: np.ndarray | None = None, slots: int = 1) -> np.ndarray:
        """Joints at z, as given without it, and slots that hold nothing."""
        z = np.zeros(self.joints) if z is None else z
        return np.concatenate([z, np.zeros(_OF_SLOT * slots)])

    def split(self, theta: Array, slots: int) -> Values:
        """Values from one vector: joints, slots, state."""
        end = self.end(slots)
        of_slots = theta[self.joints : end].reshape(slots, _OF_SLOT)
        return Values(theta[: self.joints], of_slots, theta[end:])
