"""The Jenkins element: a spring in series with one Coulomb slider."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.joints.abstract import Law, ParameterInfo, named
from iwanjax.joints.force_law import (
    WITHIN_K,
    AbstractForceLaw,
    EffectName,
    NestedLaw,
    PlaceMotion,
    Scales,
    Values,
    Variant,
)
from iwanjax.joints.masing import masing_loading
from iwanjax.joints.sliders import SLIDERS, SliderBank
from iwanjax.joints.springs import NEVER_GIVING_WAY, LinearSpring
from iwanjax.types import ArrayLike, real


class Jenkins(AbstractForceLaw):
    r"""Elastic, perfectly plastic element: F = K_T d up to F_S, then F_S (dry friction).

    .. math:: D = 4 F_S\,\max(|d| - F_S/K_T,\ 0)

    Parameters
    ----------
    F_S : float or array
        Slip force, force.
    K_T : float or array
        Stiffness of the spring, force/length.

    Examples
    --------
    >>> import iwanjax as ij
    >>> joint = ij.Jenkins(F_S=1.0, K_T=2.0)
    >>> joint.backbone([0.25, 0.5, 3.0]).tolist()
    [0.5, 1.0, 1.0]
    >>> float(joint.dissipation(1.5))  # 4 F_S (d - F_S / K_T)
    4.0
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("F_S", "force", "slip force", lower=0.0, transform="log"),
        ParameterInfo("K_T", "force/length", "stiffness before slip", lower=0.0, transform="log"),
    )
    effect: ClassVar[EffectName | None] = EffectName(
        "coulomb_friction",
        "dry friction at a support or seal",
        "damping that falls with amplitude once it slips, stiffness at small amplitude",
        "dry friction",
    )

    variants: ClassVar[tuple[Variant, ...]] = (Variant(), WITHIN_K)

    F_S: Array = eqx.field(converter=named("F_S"))
    K_T: Array = eqx.field(converter=named("K_T"))

    @classmethod
    def searched(cls) -> tuple[ParameterInfo, ...]:
        """Stiffness and deflection at slip: with the latter alone the force's form changes."""
        slip = ParameterInfo("slip", "length", "deflection at slip", lower=0.0, transform="log")
        return replace(cls.parameters[1], name="k"), slip

    @classmethod
    def scaled(cls, size: ArrayLike, shape: ArrayLike, **held: Any) -> Self:
        """Of stiffness ``size`` and slip at deflection ``shape``."""
        return cls(F_S=real(size) * real(shape), K_T=size)

    @classmethod
    def starts(cls, seen: Scales) -> tuple[float, ...]:
        """Slip at small and at middling deflections."""
        return 0.003 * seen.deflection, 0.05 * seen.deflection

    @classmethod
    def nested(cls, **held: Any) -> tuple[NestedLaw, ...]:
        """One that never slips is a spring."""
        return (NEVER_GIVING_WAY,)

    def follow(self, motion: PlaceMotion, memory: Array) -> tuple[Array, Array]:
        """The spring is stretched no further than to slip; its stretch is remembered."""
        slip = self.F_S / self.K_T
        stretch = jnp.clip(memory + motion.moved, -slip, slip)
        return self.K_T * stretch, stretch

    @property
    def initial_stiffness(self) -> Array:
        """K_T, force/length."""
        return self.K_T

    @property
    def limit_stiffness(self) -> Array:
        """Zero: the force stays at F_S."""
        return jnp.zeros_like(self.K_T)

    def discrete(self, sliders: int | None = SLIDERS) -> SliderBank:
        """A bank of one slider."""
        return SliderBank((self.F_S / self.K_T)[..., None], self.K_T[..., None])

    def law(self) -> Law:
        """Virgin curve d -> (force, tangent)."""
        F_S, K_T = self.F_S, self.K_T
        d_s = F_S / K_T

        def evaluate(d: Array) -> tuple[Array, Array]:
            sticks = jnp.abs(d) < d_s
            return jnp.where(sticks, K_T * d, F_S * jnp.sign(d)), jnp.where(sticks, K_T, 0.0)

        return evaluate

    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """Secant stiffness of the cycle of amplitude |d|, force/length."""
        s = jnp.abs(real(d)) * self.K_T / self.F_S
        return self.K_T / jnp.where(s < 1.0, 1.0, s)

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        """Energy per cycle of amplitude |d|, force x length (``omega`` is ignored)."""
        slip = jnp.abs(real(d)) - self.F_S / self.K_T
        return 4.0 * self.F_S * jnp.where(slip > 0.0, slip, 0.0)

    def loading(self, d: ArrayLike, d_0: ArrayLike) -> Float[Array, "..."]:
        """Loading branch of the steady loop of amplitude d_0, by Masing's rule."""
        return masing_loading(self.law(), real(d), real(d_0))


def dry_friction_within(
    rest: Callable[[Scales, float], Values],
    narrowed: Callable[[Values], tuple[Values, ...]] = lambda values: (
        (values[1], values[0] / values[1]),
    ),
) -> NestedLaw:
    """Dry friction as a limit of an element whose parameters begin with F_S and K_T.

    Parameters
    ----------
    rest : function
        (what the place has seen, share) -> its other parameters, at which it slides at once.
    narrowed : function, optional
        As of :class:`~iwanjax.joints.force_law.NestedLaw`; by default of the same F_S and K_T.
    """
    return NestedLaw(
        Jenkins,
        narrowed,
        lambda slider, seen, share: (slider[0] * slider[1], slider[0], *rest(seen, share)),
    )


def spring_within(rest: Callable[[Scales, float], Values]) -> NestedLaw:
    """A spring as a limit of such an element, one that never slips; ``rest`` as for friction."""
    return NestedLaw(
        LinearSpring,
        lambda values: (values[1:2],),
        lambda spring, seen, share: (
            spring[0] * seen.deflection / share,
            *spring,
            *rest(seen, share),
        ),
    )
