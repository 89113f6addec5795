"""A law of one's own: all that it takes."""

import math
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from iwanjax.joints import AbstractStepped, ParameterInfo, PlaceMotion, Scales


class RelievedDamper(AbstractStepped):
    """Shock absorber with a relief valve: F = c w tanh(v/w)."""

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("c", "force*time/length", "viscous coefficient at rest", 0.0),
        ParameterInfo("w", "length/time", "rate at which the valve opens", 0.0),
    )
    c: Array = eqx.field(converter=jnp.asarray)
    w: Array = eqx.field(converter=jnp.asarray)

    @classmethod
    def starts(cls, seen: Scales) -> tuple[float, ...]:
        """A tenth and a half of the largest rate."""
        largest = 2.0 * math.pi * seen.deflection / seen.period
        return 0.1 * largest, 0.5 * largest

    def follow(self, motion: PlaceMotion, memory: Array) -> tuple[Array, Array]:
        """Of the rate alone."""
        return self.c * self.w * jnp.tanh(motion.v / self.w), memory
