"""Forces of the rate alone: nothing at rest, an area in a cycle."""

import abc

import equinox as eqx
from jaxtyping import Array

from iwanjax.joints.discrete import Viscous
from iwanjax.joints.force_law import AbstractForceLaw, PlaceMotion
from iwanjax.joints.motion_only import AbstractMotionOnly


class AbstractRateLaw(AbstractMotionOnly, AbstractForceLaw):
    r"""A force of the rate alone, :math:`F = f(v; c)`.

    Attributes
    ----------
    c : array
        Coefficient, of the unit that makes f a force.
    """

    c: eqx.AbstractVar[Array]

    @abc.abstractmethod
    def rate_law(self, v: Array) -> tuple[Array, Array]:
        """Force at a rate v, length/time, and its slope dF/dv, each of the shape of v."""

    def discrete(self, sliders: int | None = None) -> Viscous:
        """The force follows the rate."""
        return Viscous(self)

    def follow(self, motion: PlaceMotion, memory: Array) -> tuple[Array, Array]:
        """The force at the rate that the step ends with; nothing is remembered."""
        return self.rate_law(motion.v)[0], memory
