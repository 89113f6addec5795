"""A spring that softens to a largest force, smoothly."""

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.joints.abstract import Law, ParameterInfo, named
from iwanjax.joints.force_law import (
    WITHIN_K,
    EffectName,
    NestedLaw,
    Scales,
    Variant,
)
from iwanjax.joints.springs import NEVER_GIVING_WAY, AbstractSpring
from iwanjax.types import ArrayLike, real


class TanhSpring(AbstractSpring):
    r"""Softening spring: F = k width tanh(d/width), of stiffness k at rest.

    Its force grows to k width and no further; to third order :math:`F = k d (1 - d^2/(3 width^2))`.

    Parameters
    ----------
    k : float or array
        Stiffness at rest, force/length.
    width : float or array
        Deflection at which the tangent at rest would reach the largest force, length.
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("k", "force/length", "stiffness at rest", lower=0.0, transform="log"),
        ParameterInfo("width", "length", "largest force over k", lower=0.0, transform="log"),
    )
    effect: ClassVar[EffectName | None] = EffectName(
        "tanh_spring", "softening spring", noun="a softening spring"
    )
    tried: ClassVar[bool] = False
    taken_for: ClassVar[tuple[str, ...]] = ("cubic_stiffness", "gap_contact")
    variants: ClassVar[tuple[Variant, ...]] = (Variant(), WITHIN_K)

    k: Array = eqx.field(converter=named("k"))
    width: Array = eqx.field(converter=named("width"))

    @classmethod
    def starts(cls, seen: Scales) -> tuple[float, ...]:
        """Hardly softened, and at its largest force over most of the motion."""
        return 2.0 * seen.deflection, 0.3 * seen.deflection

    @classmethod
    def nested(cls, **held: Any) -> tuple[NestedLaw, ...]:
        """One that is never deflected far enough is a linear spring."""
        return (NEVER_GIVING_WAY,)

    @property
    def initial_stiffness(self) -> Array:
        """k, force/length."""
        return self.k + jnp.zeros_like(self.width)

    @property
    def limit_stiffness(self) -> Array:
        """Zero: the force grows no more."""
        return jnp.zeros_like(self.k * self.width)

    def law(self) -> Law:
        """Virgin curve d -> (force, tangent)."""
        k, width = self.k, self.width

        def evaluate(d: Array) -> tuple[Array, Array]:
            share = jnp.tanh(d / width)
            return k * width * share, k * (1.0 - share) * (1.0 + share)

        return evaluate

    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """Force over deflection, force/length."""
        amplitude = jnp.abs(real(d))
        at_rest = amplitude == 0
        safe = jnp.where(at_rest, 1.0, amplitude)
        return jnp.where(at_rest, self.initial_stiffness, self.backbone(safe) / safe)
