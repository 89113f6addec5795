"""A slider with a dead band after each reversal: a worn pin, a loose clamp."""

from dataclasses import replace
from typing import Any, ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.joints.abstract import Law, ParameterInfo, named
from iwanjax.joints.force_law import EffectName, NestedLaw, PlaceMotion, Scales
from iwanjax.joints.jenkins import dry_friction_within
from iwanjax.joints.springs import Gap
from iwanjax.joints.stepped import AbstractStepped
from iwanjax.types import ArrayLike, real


class Backlash(AbstractStepped):
    r"""Slider with a dead band: a spring with clearance in series with one Coulomb slider.

    With x the deflection of the clearance and its spring, which the slider limits:

    .. math:: F = K_T \max(|x| - gap, 0)\,\mathrm{sign}(x), \qquad |x| \le gap + F_S/K_T

    After each reversal the spring is unloaded, crosses the clearance, 2 gap wide, without force,
    and is loaded the other way. Per steady cycle of amplitude d it loses
    :math:`4 F_S \max(|d| - gap - F_S/K_T, 0)`.

    Parameters
    ----------
    F_S : float or array
        Slip force, force.
    K_T : float or array
        Stiffness of the spring, force/length.
    gap : float or array
        Clearance to each side, length.
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("F_S", "force", "slip force", lower=0.0, transform="log"),
        ParameterInfo("K_T", "force/length", "stiffness before slip", lower=0.0, transform="log"),
        ParameterInfo("gap", "length", "clearance", 0.0, closed="lower", transform="log"),
    )
    effect: ClassVar[EffectName | None] = EffectName(
        "backlash", "slider with a dead band", noun="a slider with a dead band"
    )
    rate_dependent: ClassVar[bool] = False
    tried: ClassVar[bool] = False

    F_S: Array = eqx.field(converter=named("F_S"))
    K_T: Array = eqx.field(converter=named("K_T"))
    gap: Array = eqx.field(converter=named("gap"))

    @classmethod
    def searched(cls) -> tuple[ParameterInfo, ...]:
        """Stiffness and clearance."""
        return replace(cls.parameters[1], name="k"), replace(cls.parameters[2], closed="")

    @classmethod
    def scaled(cls, size: ArrayLike, shape: ArrayLike, slip: float = 1.0, **held: Any) -> Self:
        """Of stiffness ``size`` and clearance ``shape``; it slips ``slip`` clearances beyond it."""
        return cls(F_S=slip * real(size) * real(shape), K_T=size, gap=shape)

    @classmethod
    def starts(cls, seen: Scales) -> tuple[float, ...]:
        """A narrow clearance, and one that only large motions cross."""
        return 0.05 * seen.deflection, 0.3 * seen.deflection

    @classmethod
    def nested_whole(cls, **held: Any) -> tuple[NestedLaw, ...]:
        """Without clearance it is dry friction; that never slips, a gap."""
        return (
            dry_friction_within(lambda seen, share: (share * seen.deflection,)),
            NestedLaw(
                Gap,
                lambda values: (values[1:],),
                lambda contact, seen, share: (contact[0] * seen.deflection / share, *contact),
            ),
        )

    @property
    def limit_stiffness(self) -> Array:
        """Zero: the force stays at F_S."""
        return jnp.zeros_like(self.F_S * self.K_T * self.gap)

    def follow(self, motion: PlaceMotion, memory: Array) -> tuple[Array, Array]:
        """Clearance and spring are deflected no further than to slip; that is remembered."""
        reach = self._reach
        x = jnp.clip(memory + motion.moved, -reach, reach)
        return self._spring(x)[0], x

    def _spring(self, x: Array) -> tuple[Array, Array]:
        touches = jnp.abs(x) > self.gap
        force = self.K_T * jnp.where(touches, x - self.gap * jnp.sign(x), 0.0)
        return force, jnp.where(touches, self.K_T, 0.0)

    @property
    def _reach(self) -> Array:
        """Deflection at slip."""
        return self.gap + self.F_S / self.K_T

    def law(self) -> Law:
        """Virgin curve d -> (force, tangent)."""
        reach, spring = self._reach, self._spring

        def evaluate(d: Array) -> tuple[Array, Array]:
            force, tangent = spring(jnp.clip(d, -reach, reach))
            return force, jnp.where(jnp.abs(d) < reach, tangent, 0.0)

        return evaluate

    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """Secant stiffness of the cycle of amplitude |d|, force/length."""
        amplitude = jnp.abs(real(d))
        at_rest = amplitude == 0
        safe = jnp.where(at_rest, 1.0, amplitude)
        return jnp.where(at_rest, self.initial_stiffness, self.backbone(safe) / safe)

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        """Energy per cycle of amplitude |d|, force x length (``omega`` is ignored)."""
        slip = jnp.abs(real(d)) - self._reach
        return 4.0 * self.F_S * jnp.where(slip > 0.0, slip, 0.0)

    def loading(self, d: ArrayLike, d_0: ArrayLike) -> Float[Array, "..."]:
        """Loading branch of the steady loop of amplitude d_0."""
        to, amplitude = real(d), jnp.abs(real(d_0))
        reach = self._reach
        x = jnp.clip(to + jnp.where(amplitude > reach, amplitude - reach, 0.0), -reach, reach)
        return self._spring(x)[0]
