"""What is suspected beside the joints, and what of it is fitted."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float


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
