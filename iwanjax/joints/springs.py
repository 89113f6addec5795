"""Elastic elements: the force is a function of the deflection, nothing is dissipated."""

from typing import Any, ClassVar, Literal, TypeAlias, get_args

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.joints.abstract import Law, ParameterInfo, named
from iwanjax.joints.force_law import (
    AbstractForceLaw,
    EffectName,
    NestedLaw,
    PlaceMotion,
    Scales,
    Variant,
    stiffness_alone,
)
from iwanjax.types import ArrayLike, real

Sides: TypeAlias = Literal["both", "positive", "negative"]
"""Deflections at which a clearance ends in contact."""


class AbstractSpring(AbstractForceLaw):
    """An element whose force is that of its virgin curve on every path.

    Of a curve that is not odd, secant and harmonic stiffness are those of a cycle between -d and
    d about the undeflected state: the slope from tip to tip. A quasi-static solve follows one
    side of the curve only, the one the mode's load deflects it to, so that the curves of
    :func:`iwanjax.qsma` then depend on the sign of the mode's shape and of the joint's row.
    """

    def follow(self, motion: PlaceMotion, memory: Array) -> tuple[Array, Array]:
        """The curve at the end of the step; nothing is remembered."""
        return self.law()(motion.d)[0], memory

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        """Zero."""
        return jnp.zeros_like(self.backbone(d))

    def tip_stiffness(self, d: ArrayLike) -> Float[Array, "..."]:
        """The secant: all that is stored at a tip is given back."""
        return self.secant(d)

    def loading(self, d: ArrayLike, d_0: ArrayLike) -> Float[Array, "..."]:
        """The spring's force: loading and unloading coincide."""
        return self.backbone(d)

    def loop(
        self, d_0: ArrayLike, points: int = 201
    ) -> tuple[Float[Array, " points"], Float[Array, " points"]]:
        """The curve from -d_0 to d_0 and back; arguments as for every joint."""
        d, _ = super().loop(d_0, points)
        return d, self.backbone(d)


class LinearSpring(AbstractSpring):
    """Linear spring: F = k d.

    In a structure it is part of the low-amplitude stiffness like every K_T.

    Parameters
    ----------
    k : float or array
        Stiffness, force/length.

    Examples
    --------
    >>> import iwanjax as ij
    >>> ij.LinearSpring(k=2.0).backbone([-1.0, 3.0]).tolist()
    [-2.0, 6.0]
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("k", "force/length", "stiffness", 0.0, closed="lower", transform="log"),
    )
    effect: ClassVar[EffectName | None] = EffectName(
        "stiffness_error",
        "wrong or missing linear stiffness, boundary",
        "a frequency that is off at every amplitude",
        "a linear spring",
    )
    either_sign: ClassVar[bool] = True
    elastic: ClassVar[bool] = True
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
        return self.tangent(d)


class QuadraticSpring(AbstractSpring):
    """Quadratic spring: F = k2 d^2, softer to one side than to the other, as a curved member is.

    Its force does the same at -d and d, so that the slope from tip to tip of a cycle is zero at
    every amplitude: quasi-static curves show nothing of it, motion does (a mean shift and even
    harmonics).

    Parameters
    ----------
    k2 : float or array
        Quadratic stiffness, force/length^2; its sign says to which side the element stiffens.

    Examples
    --------
    >>> import iwanjax as ij
    >>> ij.QuadraticSpring(k2=2.0).backbone([-1.0, 1.0]).tolist()
    [2.0, 2.0]
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("k2", "force/length^2", "quadratic stiffness"),
    )
    effect: ClassVar[EffectName | None] = EffectName(
        "quadratic_stiffness",
        "asymmetric elastic force, curvature",
        "an offset and second harmonics that grow with amplitude",
        "a quadratic spring",
    )

    k2: Array = eqx.field(converter=named("k2"))

    @property
    def initial_stiffness(self) -> Array:
        """Zero at rest, force/length."""
        return jnp.zeros_like(self.k2)

    @property
    def limit_stiffness(self) -> Array:
        """Zero: the slope from tip to tip at every amplitude, force/length."""
        return jnp.zeros_like(self.k2)

    def law(self) -> Law:
        """Virgin curve d -> (force, tangent)."""
        k2 = self.k2
        return lambda d: (k2 * d**2, 2.0 * k2 * d)

    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """Zero, the slope from tip to tip, force/length."""
        return jnp.zeros_like(self.backbone(d))


NEVER_GIVING_WAY = NestedLaw(
    LinearSpring,
    stiffness_alone,
    lambda spring, seen, share: (*spring, seen.deflection / share),
)
"""Of a law with a stiffness at rest and the deflection where it gives way, beyond all of them."""


class CubicSpring(AbstractSpring):
    """Cubic spring: F = k3 d^3, hardening (as bending-stretching) or softening (k3 < 0).

    Parameters
    ----------
    k3 : float or array
        Cubic stiffness, force/length^3.

    Examples
    --------
    >>> import iwanjax as ij
    >>> ij.CubicSpring(k3=2.0).backbone([-1.0, 2.0]).tolist()
    [-2.0, 16.0]
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("k3", "force/length^3", "cubic stiffness"),
    )
    effect: ClassVar[EffectName | None] = EffectName(
        "cubic_stiffness",
        "hardening or softening, geometric",
        "a frequency that changes with the square of the amplitude; third harmonics",
        "a cubic spring",
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


class BilinearSpring(AbstractSpring):
    """Bilinear spring: F = dk d for d > 0, else none, as a contact that opens and closes at d = 0.

    In a cycle about the undeflected state it counts half, at every amplitude.

    Parameters
    ----------
    dk : float or array
        Stiffness that positive deflections meet in addition, force/length; negative for a
        contact that opens there.

    Examples
    --------
    >>> import iwanjax as ij
    >>> ij.BilinearSpring(dk=2.0).backbone([-1.0, 1.0]).tolist()
    [0.0, 2.0]
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("dk", "force/length", "stiffness of the positive side alone"),
    )
    effect: ClassVar[EffectName | None] = EffectName(
        "bilinear_stiffness",
        "opening and closing contact, preload loss in a joint",
        "an offset and even harmonics that keep their share at every amplitude",
        "a bilinear spring",
    )

    dk: Array = eqx.field(converter=named("dk"))

    @property
    def initial_stiffness(self) -> Array:
        """Half dk, the slope from tip to tip of however small a cycle, force/length."""
        return 0.5 * self.dk

    @property
    def limit_stiffness(self) -> Array:
        """Half dk, force/length."""
        return 0.5 * self.dk

    def law(self) -> Law:
        """Virgin curve d -> (force, tangent)."""
        dk = self.dk
        return lambda d: (dk * jnp.maximum(d, 0.0), jnp.where(d > 0.0, dk, 0.0))

    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """Half dk, the slope from tip to tip, force/length."""
        return 0.5 * self.dk * jnp.ones_like(real(d))


class Gap(AbstractSpring):
    """Clearance: F = k (|d| - gap) sign(d) beyond the gap, 0 within.

    Parameters
    ----------
    k : float or array
        Contact stiffness, force/length.
    gap : float or array
        Clearance to each side, length.
    sides : {"both", "positive", "negative"}
        Where there is contact; a one-sided stop has none at deflections of the other sign.

    Raises
    ------
    InputError
        For a parameter outside its bounds, and other ``sides``.

    Examples
    --------
    >>> import iwanjax as ij
    >>> ij.Gap(k=2.0, gap=0.5).backbone([-1.0, 0.2, 1.0]).tolist()
    [-1.0, 0.0, 1.0]
    >>> ij.Gap(k=2.0, gap=0.5, sides="positive").backbone([-1.0, 1.0]).tolist()
    [0.0, 1.0]
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("k", "force/length", "contact stiffness", lower=0.0, transform="log"),
        ParameterInfo("gap", "length", "clearance", 0.0, closed="lower", transform="log"),
    )
    effect: ClassVar[EffectName | None] = EffectName(
        "gap_contact",
        "clearance, stop, bolt-shank pinning",
        "a frequency that rises suddenly above some amplitude",
        "a gap",
    )
    variants: ClassVar[tuple[Variant, ...]] = (
        Variant("", (("sides", "both"),)),
        Variant("where d > 0", (("sides", "positive"),)),
        Variant("where d < 0", (("sides", "negative"),)),
    )

    k: Array = eqx.field(converter=named("k"))
    gap: Array = eqx.field(converter=named("gap"))
    sides: Sides = eqx.field(static=True, default="both")

    @classmethod
    def starts(cls, seen: Scales) -> tuple[float, ...]:
        """Clearances that a good part of the motion is beyond."""
        return 0.3 * seen.deflection, 0.7 * seen.deflection

    @classmethod
    def nested(cls, **held: Any) -> tuple[NestedLaw, ...]:
        """Of no width: a spring, or one for positive deflections."""
        simpler = {"both": LinearSpring, "positive": BilinearSpring}
        sides = held.get("sides", "both")
        if sides not in simpler:
            return ()
        return (
            NestedLaw(
                simpler[sides],
                stiffness_alone,
                lambda spring, seen, share: (*spring, share * seen.deflection),
            ),
        )

    @property
    def initial_stiffness(self) -> Array:
        """Zero while there is clearance, that of large amplitudes without, force/length."""
        return jnp.where(self.gap > 0, 0.0, self.limit_stiffness)

    @property
    def limit_stiffness(self) -> Array:
        """k, of a one-sided stop half of it: the slope from tip to tip, force/length."""
        share = 1.0 if self.sides == "both" else 0.5
        return share * self.k + jnp.zeros_like(self.gap)

    def law(self) -> Law:
        """Virgin curve d -> (force, tangent)."""
        k, gap, sides = self.k, self.gap, self.sides

        def evaluate(d: Array) -> tuple[Array, Array]:
            reach = {"both": jnp.abs(d), "positive": d, "negative": -d}[sides]
            touches = reach >= gap
            return jnp.where(touches, k * (d - gap * jnp.sign(d)), 0.0), jnp.where(touches, k, 0.0)

        return evaluate

    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """K (1 - gap/|d|) beyond the gap, 0 within, half of it for one side, force/length."""
        amplitude = jnp.abs(real(d))
        touches = amplitude > self.gap
        safe = jnp.where(touches, amplitude, 1.0)
        beyond = self.limit_stiffness * (1.0 - self.gap / safe)
        return jnp.where(touches, beyond, self.initial_stiffness)

    def __repr__(self) -> str:
        """The element with its parameters, and where it touches if not on both sides."""
        text = super().__repr__()
        return text if self.sides == "both" else f"{text[:-1]}, sides={self.sides!r})"

    def __check_init__(self) -> None:
        """Refuse sides that do not exist."""
        if self.sides not in get_args(Sides):
            raise InputError(
                f"Gap: sides = {self.sides!r}; expected {', '.join(map(repr, get_args(Sides)))}"
            )
