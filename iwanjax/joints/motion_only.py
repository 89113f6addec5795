"""Elements that carry nothing in slow loading: forces of rates, of accelerations or of time."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.joints.abstract import AbstractJoint, Law
from iwanjax.types import ArrayLike, real


class AbstractMotionOnly(AbstractJoint):
    """An element without force and stiffness in a slow cycle, as quasi-static analysis takes it."""

    # Of the deflection its force is none at all.
    linear: ClassVar[bool] = True

    @property
    def initial_stiffness(self) -> Array:
        """Zero."""
        shapes = (jnp.shape(getattr(self, info.name)) for info in self.parameters)
        return jnp.zeros(jnp.broadcast_shapes(*shapes))

    @property
    def limit_stiffness(self) -> Array:
        """Zero."""
        return self.initial_stiffness

    def law(self) -> Law:
        """No force and no tangent."""
        zero = self.initial_stiffness
        return lambda d: (zero * d, zero * d)

    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """Zero, unless the element says what a frequency makes of it."""
        return self.backbone(d)

    def loading(self, d: ArrayLike, d_0: ArrayLike) -> Float[Array, "..."]:
        """Zero."""
        return self.backbone(d)

    def _rate(self, omega: ArrayLike | None) -> Array:
        """Circular frequency of a cycle, without which its loss is not known."""
        if omega is None:
            raise InputError(
                f"{type(self).__name__}.dissipation needs omega= (rad/s): its loss depends on rate"
            )
        return real(omega)
