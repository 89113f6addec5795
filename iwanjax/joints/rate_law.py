"""Forces of the rate alone: nothing at rest, an area in a cycle."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.joints.abstract import Law
from iwanjax.joints.discrete import Viscous
from iwanjax.joints.force_law import AbstractForceLaw, PlaceMotion
from iwanjax.types import ArrayLike, real


class AbstractRateLaw(AbstractForceLaw):
    r"""A force of the rate alone, :math:`F = f(v; c)`. Quasi-statically it carries nothing.

    Attributes
    ----------
    c : array
        Coefficient, of the unit that makes f a force.
    """

    c: eqx.AbstractVar[Array]

    @abc.abstractmethod
    def rate_law(self, v: Array) -> tuple[Array, Array]:
        """Force at a rate v, length/time, and its slope dF/dv, each of the shape of v."""

    @property
    def initial_stiffness(self) -> Array:
        """Zero."""
        return jnp.zeros_like(self.c)

    @property
    def limit_stiffness(self) -> Array:
        """Zero."""
        return jnp.zeros_like(self.c)

    def discrete(self, sliders: int | None = None) -> Viscous:
        """The force follows the rate."""
        return Viscous(self)

    def follow(self, motion: PlaceMotion, memory: Array) -> tuple[Array, Array]:
        """The force at the rate that the step ends with; nothing is remembered."""
        return self.rate_law(motion.v)[0], memory

    def law(self) -> Law:
        """No force and no tangent in quasi-static loading."""
        zero = jnp.zeros_like(self.c)
        return lambda d: (zero * d, zero * d)

    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """Zero: the force is in quadrature with the deflection."""
        return self.backbone(d)

    def loading(self, d: ArrayLike, d_0: ArrayLike) -> Float[Array, "..."]:
        """The in-phase part of the loop: zero."""
        return self.backbone(d)

    def _rate(self, omega: ArrayLike | None) -> Array:
        """Circular frequency of a cycle, without which its loss is not known."""
        if omega is None:
            raise InputError(
                f"{type(self).__name__}.dissipation needs omega= (rad/s): its loss depends on rate"
            )
        return real(omega)
