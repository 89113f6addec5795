"""Inertia: a force with the relative acceleration of an element's ends."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.joints.abstract import ParameterInfo, named
from iwanjax.joints.force_law import (
    EffectName,
    PlaceMotion,
)
from iwanjax.joints.motion_only import AbstractMotionOnly
from iwanjax.joints.stepped import AbstractStepped
from iwanjax.types import ArrayLike, real


class Inertia(AbstractMotionOnly, AbstractStepped):
    """Inertia: F = m a, a mass at a row to ground, an inerter (Smith 2002) between two points.

    Quasi-statically it carries nothing, and over a cycle nothing is lost.

    Parameters
    ----------
    m : float or array
        Mass, force x time^2/length.
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("m", "mass", "mass", 0.0, closed="lower", transform="log"),
    )
    effect: ClassVar[EffectName | None] = EffectName(
        "mass_error",
        "unmodelled mass (sensor, cable, fixture)",
        "frequencies that are off at every amplitude, the higher the more",
        "a mass",
    )
    either_sign: ClassVar[bool] = True
    inertial: ClassVar[bool] = True

    m: Array = eqx.field(converter=named("m"))

    def follow(self, motion: PlaceMotion, memory: Array) -> tuple[Array, Array]:
        """The force at the acceleration that the step ends with; nothing is remembered."""
        return self.m * motion.a, memory

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        """Zero at any frequency."""
        return jnp.zeros_like(self.m) * real(d)
