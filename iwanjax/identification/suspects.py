"""What is suspected beside the joints, what of it is fitted, and where that stands in theta.

First errors of the linear model and the joints' parameters in prior deviations, one joint after the
other; then size and shape of each slot; then, for each recording on its own, errors of the state.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

_OF_SLOT = 2


class Suspects(NamedTuple):
    """What is suspected beside the joints: a force at a place, or a sensor, in each slot.

    Attributes
    ----------
    row : (slots, modes) array
        Where a force acts, on all modes.
    force : (slots, kinds) array
        Zero but for the kind of force, where it is the unit of its size.
    chain : (slots, faults, sensors) array
        Zero but for the fault of a sensor, where it is 1.
    logarithmic : (slots,) array
        1 where the size is the exponential of its parameter.
    """

    row: Float[Array, "slots modes"]
    force: Float[Array, "slots kinds"]
    chain: Float[Array, "slots faults sensors"]
    logarithmic: Float[Array, " slots"]


class Values(NamedTuple):
    """What is fitted, of one recording.

    Attributes
    ----------
    z : (parameters,) array
        Errors of the linear model, then joint parameters, in prior deviations from those given.
    suspects : (slots, 2) array
        Of each slot the size in its unit, or its logarithm, and the logarithm of its shape.
    state : (directions,) array
        Errors of the state after the force, in deviations.
    """

    z: Float[Array, " parameters"]
    suspects: Float[Array, "slots 2"]
    state: Float[Array, " directions"]


def sizes_of(suspects: Suspects, values: Array) -> Array:
    """Sizes of the slots in their units."""
    size = values[:, 0]
    return jnp.where(suspects.logarithmic > 0, jnp.exp(jnp.minimum(size, 50.0)), size)


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
