"""A stiffness that changes with time: loosening or heating within a recording."""

from typing import Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.joints.abstract import ParameterInfo, named
from iwanjax.joints.discrete import AbstractDiscrete, Reaction
from iwanjax.joints.force_law import (
    STRENGTHS,
    AbstractForceLaw,
    EffectName,
    NestedLaw,
    PlaceMotion,
    Scales,
)
from iwanjax.joints.motion_only import AbstractMotionOnly
from iwanjax.joints.springs import LinearSpring
from iwanjax.types import ArrayLike


class ChangingStiffness(AbstractMotionOnly, AbstractForceLaw):
    r"""Changing stiffness: F = k(t) d, k = rate tau (1 - exp(-t/tau)) from the beginning on.

    With t from the beginning of each recording: what tends to another temperature or bolt force
    the slower the less is left of the way, and with tau much longer than a recording a change in
    proportion to time. A negative rate is what a spring of the structure loses. Quasi-static
    analysis is of the beginning, where there is none of it yet.

    Parameters
    ----------
    rate : float or array
        Of the stiffness at the beginning, force/(length x time).
    tau : float or array
        Time after which 1/e of the change is left, time.

    Examples
    --------
    >>> import iwanjax as ij
    >>> from iwanjax.joints import ChangingStiffness
    >>> element = ChangingStiffness(rate=-2.0, tau=1.0)
    >>> force = ij.hysteresis(element, [1.0] * 3, dt=1.0)
    >>> [round(float(each), 4) for each in force]  # -2 (1 - exp(-1)) and so on
    [-1.2642, -1.7293, -1.9004]
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("rate", "force/(length*time)", "of the stiffness at the beginning"),
        ParameterInfo("tau", "time", "time constant of its change", lower=0.0, transform="log"),
    )
    effect: ClassVar[EffectName | None] = EffectName(
        "changing_stiffness",
        "loosening or heating within a recording",
        "a frequency that changes with time, whatever the amplitude",
        "a stiffness that changes with time",
    )
    either_sign: ClassVar[bool] = True
    tried: ClassVar[bool] = False

    rate: Array = eqx.field(converter=named("rate"))
    tau: Array = eqx.field(converter=named("tau"))

    @classmethod
    def starts(cls, seen: Scales) -> tuple[float, ...]:
        """A change that ends early, and one that goes on for longer than the recording."""
        return 0.2 * seen.duration, 2.0 * seen.duration

    @classmethod
    def begun(cls, seen: Scales, **held: Any) -> tuple[Self, ...]:
        """Changes by shares of what holds the place, either way, over the whole recording."""
        shares = [sign * share for share in STRENGTHS for sign in (1.0, -1.0)]
        rate = seen.stiffness / seen.duration
        return tuple(cls(share * rate, tau) for tau in cls.starts(seen) for share in shares)

    @classmethod
    def nested(cls, **held: Any) -> tuple[NestedLaw, ...]:
        """One that is over at once is a spring."""
        return (
            NestedLaw(
                LinearSpring,
                lambda values: ((values[0] * values[1],),),
                lambda spring, seen, share: (
                    spring[0] / (share * seen.period),
                    share * seen.period,
                ),
            ),
        )

    def grown(self, t: Array) -> Array:
        """Stiffness after a time, force/length; none before the beginning."""
        return -self.rate * self.tau * jnp.expm1(-jnp.maximum(t, 0.0) / self.tau)

    def follow(self, motion: PlaceMotion, memory: Array) -> tuple[Array, Array]:
        """As stiff as it is at the end of the step; the time is remembered."""
        t = memory + motion.dt
        return self.grown(t) * motion.d, t

    def discrete(self, sliders: int | None = None) -> "Changing":
        """The stiffness grows with time."""
        return Changing(self)

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        """Zero."""
        return self.backbone(d)


class ChangingState(NamedTuple):
    """What a changing stiffness remembers.

    Attributes
    ----------
    t : array
        Since the beginning.
    d : array
        Deflection.
    """

    t: Array
    d: Array


class Changing(AbstractDiscrete):
    """A changing stiffness in motion: what it stores grows with it, at the cost of who grows it.

    Parameters
    ----------
    spring : ChangingStiffness
        One parameter set.
    """

    spring: ChangingStiffness
    rate_dependent: ClassVar[bool] = True

    def init(self) -> ChangingState:
        """At the beginning, d = 0."""
        zero = jnp.zeros_like(self.spring.rate * self.spring.tau)
        return ChangingState(zero, zero)

    def haste(self, dt: Array) -> Array:
        """Time constants within a step."""
        return dt / self.spring.tau

    def step(self, d: Array, v: Array, dt: Array, state: ChangingState) -> Reaction:
        """Move to d; the loss is minus what the growth has fed, d linear over the step."""
        t = state.t + dt
        before, after = self.spring.grown(state.t), self.spring.grown(t)
        mean = (d**2 + d * state.d + state.d**2) / 3.0
        return Reaction(
            after * d,
            after,
            jnp.zeros_like(d),
            ChangingState(t, d),
            -0.5 * (after - before) * mean,
        )

    def earlier(self, state: ChangingState, dt: Array) -> ChangingState:
        """Before the beginning."""
        return state._replace(t=state.t - dt)

    def settled(
        self, state: ChangingState, by: Array, faster: Array, stiffness: Array
    ) -> ChangingState:
        """The same a little further."""
        return state._replace(d=state.d + by)

    def energy(self, d: Array, state: ChangingState) -> Array:
        """Of a spring as stiff as it is now."""
        return 0.5 * self.spring.grown(state.t) * d**2
