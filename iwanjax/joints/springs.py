"""Elastic elements: the force is a function of the deflection, nothing is dissipated."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.joints.abstract import AbstractJoint, Law, ParameterInfo, named
from iwanjax.types import ArrayLike, real


def _lossless(d: ArrayLike, stiffness: Array) -> Array:
    """Zero energy per cycle, of the shape the other elements would give."""
    return jnp.zeros(jnp.broadcast_shapes(np.shape(d), stiffness.shape), dtype=stiffness.dtype)


class LinearSpring(AbstractJoint):
    """F = k d. In a structure it is part of the low-amplitude stiffness like every K_T.

    Parameters
    ----------
    k : float or array
        Stiffness, force/length.
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("k", "force/length", "stiffness", 0.0, closed="lower", transform="log"),
    )
    linear: ClassVar[bool] = True

    k: Array = eqx.field(converter=named("k"))

    @property
    def initial_stiffness(self) -> Array:
        """k, force/length."""
        return self.k

    @property
    def limit_stiffness(self) -> Array:
        """k, force/length."""
        return self.k

    def law(self) -> Law:
        """Virgin curve d -> (force, tangent)."""
        k = self.k
        return lambda d: (k * d, k * jnp.ones_like(d))

    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """K whatever the amplitude, force/length."""
        return self.k + _lossless(d, self.k)

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        """Zero."""
        return _lossless(d, self.k)

    def loading(self, d: ArrayLike, d_0: ArrayLike) -> Float[Array, "..."]:
        """The spring's force: loading and unloading coincide."""
        return self.backbone(d)


class CubicSpring(AbstractJoint):
    """F = k3 d^3: hardening (k3 > 0), as of bending-stretching, or softening.

    Parameters
    ----------
    k3 : float or array
        Cubic stiffness, force/length^3.
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("k3", "force/length^3", "cubic stiffness"),
    )

    k3: Array = eqx.field(converter=named("k3"))

    @property
    def initial_stiffness(self) -> Array:
        """Zero at rest, force/length."""
        return jnp.zeros_like(self.k3)

    @property
    def limit_stiffness(self) -> Array:
        """Infinite: the force outgrows the deflection."""
        return jnp.where(self.k3 == 0, 0.0, jnp.sign(self.k3) * jnp.inf)

    def law(self) -> Law:
        """Virgin curve d -> (force, tangent)."""
        k3 = self.k3
        return lambda d: (k3 * d**3, 3.0 * k3 * d**2)

    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """k3 d^2, force/length."""
        return self.k3 * real(d) ** 2

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        """Zero."""
        return _lossless(d, self.k3)

    def loading(self, d: ArrayLike, d_0: ArrayLike) -> Float[Array, "..."]:
        """The spring's force: loading and unloading coincide."""
        return self.backbone(d)


class Gap(AbstractJoint):
    """Clearance on both sides: F = k (|d| - gap) sign(d) beyond the gap, 0 within.

    Parameters
    ----------
    k : float or array
        Contact stiffness, force/length.
    gap : float or array
        Clearance to each side, length.
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("k", "force/length", "contact stiffness", lower=0.0, transform="log"),
        ParameterInfo("gap", "length", "clearance", 0.0, closed="lower", transform="log"),
    )

    k: Array = eqx.field(converter=named("k"))
    gap: Array = eqx.field(converter=named("gap"))

    @property
    def initial_stiffness(self) -> Array:
        """Zero while there is clearance, k without, force/length."""
        return jnp.where(self.gap > 0, 0.0, self.k)

    @property
    def limit_stiffness(self) -> Array:
        """k, force/length."""
        return self.k + jnp.zeros_like(self.gap)

    def law(self) -> Law:
        """Virgin curve d -> (force, tangent)."""
        k, gap = self.k, self.gap

        def evaluate(d: Array) -> tuple[Array, Array]:
            touches = jnp.abs(d) >= gap
            return jnp.where(touches, k * (d - gap * jnp.sign(d)), 0.0), jnp.where(touches, k, 0.0)

        return evaluate

    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """K (1 - gap/|d|) beyond the gap, 0 within, force/length."""
        amplitude = jnp.abs(real(d))
        touches = amplitude > self.gap
        safe = jnp.where(touches, amplitude, 1.0)
        return jnp.where(touches, self.k * (1.0 - self.gap / safe), self.initial_stiffness)

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        """Zero."""
        return _lossless(d, self.k + self.gap)

    def loading(self, d: ArrayLike, d_0: ArrayLike) -> Float[Array, "..."]:
        """The contact's force: loading and unloading coincide."""
        return self.backbone(d)
