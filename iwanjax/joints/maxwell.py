"""The Maxwell element: a spring in series with a dashpot."""

from typing import Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.joints.abstract import ParameterInfo, named
from iwanjax.joints.dashpot import Dashpot
from iwanjax.joints.discrete import AbstractDiscrete, Reaction
from iwanjax.joints.force_law import (
    AbstractForceLaw,
    EffectName,
    NestedLaw,
    PlaceMotion,
    Scales,
    stiffness_alone,
)
from iwanjax.joints.motion_only import AbstractMotionOnly
from iwanjax.joints.springs import LinearSpring
from iwanjax.types import ArrayLike, real

# Below this many relaxation times a step's integrals are summed as power series: their closed
# forms are differences of near equals divided by the step.
_SHORT = 0.5
_POWERS = np.arange(18)
_FACTORIALS = np.cumprod(np.arange(1.0, 20.0))
# Of -x in the two last integrals of a unit rate's ramp.
_MEAN = 1.0 / (_FACTORIALS[1:] * (_POWERS + 3.0))
_MOMENT = 1.0 / (_FACTORIALS[1:] * (_POWERS + 4.0))


class Maxwell(AbstractMotionOnly, AbstractForceLaw):
    r"""Maxwell element: spring k in series with a dashpot c.

    With the relaxation time :math:`\tau = c/k`

    .. math:: \dot F + F/\tau = k\dot d, \qquad
              K(\omega) = k\,\frac{i\omega\tau}{1 + i\omega\tau}

    as of an elastomer, a seal or a bungee. Quasi-statically it carries nothing: what it adds to
    the stiffness of a cycle depends on frequency, :meth:`secant` gives it where that is known.
    Without, as in :func:`iwanjax.qsma`, only its loss counts.

    Parameters
    ----------
    k : float or array
        Stiffness of the spring, force/length.
    c : float or array
        Viscous coefficient of the dashpot, force x time/length.

    Examples
    --------
    >>> import iwanjax as ij
    >>> element = ij.Maxwell(k=2.0, c=1.0)
    >>> round(float(element.secant(1.0, omega=2.0)), 4)  # k / 2 where omega = k / c
    1.0
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("k", "force/length", "stiffness of the spring", lower=0.0, transform="log"),
        ParameterInfo(
            "c", "force*time/length", "viscous coefficient in series", lower=0.0, transform="log"
        ),
    )
    effect: ClassVar[EffectName | None] = EffectName(
        "viscoelastic",
        "elastomer, bungee, seal",
        "damping and stiffness that depend on frequency, not on amplitude",
        "a viscoelastic element (Maxwell)",
    )

    k: Array = eqx.field(converter=named("k"))
    c: Array = eqx.field(converter=named("c"))

    @classmethod
    def searched(cls) -> tuple[ParameterInfo, ...]:
        """Stiffness and relaxation time: with the latter alone the force's form changes."""
        tau = ParameterInfo("tau", "time", "relaxation time", lower=0.0, transform="log")
        return cls.parameters[0], tau

    @classmethod
    def scaled(cls, size: ArrayLike, shape: ArrayLike, **held: Any) -> Self:
        """Of stiffness ``size`` and relaxation time ``shape``."""
        return cls(k=size, c=real(size) * real(shape))

    @classmethod
    def starts(cls, seen: Scales) -> tuple[float, ...]:
        """Relaxation within a period, and beyond."""
        return 0.4 * seen.period, 2.0 * seen.period

    @classmethod
    def nested(cls, **held: Any) -> tuple[NestedLaw, ...]:
        """One that hardly relaxes is a spring; one that does at once, a damper."""
        return (
            NestedLaw(
                LinearSpring,
                stiffness_alone,
                lambda spring, seen, share: (*spring, seen.period / share),
            ),
            NestedLaw(
                Dashpot,
                lambda values: ((values[0] * values[1],),),
                lambda damper, seen, share: (
                    damper[0] / (share * seen.period),
                    share * seen.period,
                ),
            ),
        )

    def follow(self, motion: PlaceMotion, memory: Array) -> tuple[Array, Array]:
        """The spring's stretch, exact for a rate that changes evenly to that at the step's end."""
        after = Relaxing(self.k, self.c).step(
            motion.moved,
            motion.v,
            motion.dt,
            RelaxingState(self.k * memory, jnp.zeros_like(motion.d)),
        )
        return after.force, after.force / self.k

    def discrete(self, sliders: int | None = None) -> "Relaxing":
        """The force relaxes while it is built up."""
        return Relaxing(self.k, self.c)

    def secant(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        r"""Storage stiffness :math:`k(\omega\tau)^2/(1+(\omega\tau)^2)`, force/length.

        Parameters
        ----------
        d : array_like
            Amplitude, length; it does not matter.
        omega : array_like, optional
            Circular frequency, rad/s; without it the quasi-static limit, zero.
        """
        if omega is None:
            return self.backbone(d)
        ratio = real(omega) * self.c / self.k
        return self.k * ratio**2 / (1.0 + ratio**2) * jnp.ones_like(real(d))

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        r"""Energy per cycle :math:`\pi d^2 k\,\omega\tau/(1+(\omega\tau)^2)`, force x length.

        Parameters
        ----------
        d : array_like
            Amplitude, length.
        omega : array_like
            Circular frequency, rad/s.

        Raises
        ------
        InputError
            When omega is not given.
        """
        ratio = self._rate(omega) * self.c / self.k
        return jnp.pi * self.k * ratio / (1.0 + ratio**2) * real(d) ** 2


class RelaxingState(NamedTuple):
    """What a relaxing spring remembers.

    Attributes
    ----------
    force : array
        In spring and dashpot.
    d : array
        Deflection of both.
    """

    force: Array
    d: Array


class Relaxing(AbstractDiscrete):
    r"""Maxwell's element in motion, exact for a rate that changes evenly over each step.

    With :math:`x = k\Delta t/c` and the rates :math:`v_0 = 2(d_1 - d_0)/\Delta t - v_1` and
    :math:`v_1` at the ends of the step, at the share s of it

    .. math:: F(s) = e^{-xs}F_0 + k\Delta t\,[v_0\varphi_1(s) + (v_1 - v_0)\varphi_2(s)], \quad
              \varphi_1 = \frac{1 - e^{-xs}}{x}, \quad \varphi_2 = \frac{s - \varphi_1}{x}

    and what is lost is the work done less what the spring stores,
    :math:`\Delta t\int F v\,ds - (F_1^2 - F_0^2)/2k`.

    Parameters
    ----------
    k, c : array
        Stiffness, force/length, and viscous coefficient, force x time/length.
    """

    k: Array
    c: Array
    rate_dependent: ClassVar[bool] = True

    def init(self) -> RelaxingState:
        """No force at d = 0."""
        zero = jnp.zeros_like(self.k * self.c)
        return RelaxingState(zero, zero)

    def haste(self, dt: Array) -> Array:
        """Relaxation times within a step."""
        return self.k * dt / self.c

    def step(self, d: Array, v: Array, dt: Array, state: RelaxingState) -> Reaction:
        """Move to d, at a rate that becomes v."""
        by = _integrals(self.k * dt / self.c)
        moved, arriving = d - state.d, dt * v
        # v_0 dt is twice what was moved less v_1 dt.
        steady, late = 2.0 * (by.level - by.ramp), 2.0 * by.ramp - by.level
        force = by.decay * state.force + self.k * (steady * moved + late * arriving)
        leaving = 2.0 * moved - arriving
        rise = arriving - leaving
        mean = by.level * state.force + self.k * (leaving * by.ramp + rise * by.ramp_mean)
        moment = by.moment * state.force + self.k * (
            leaving * by.ramp_moment + rise * by.bend_moment
        )
        work = leaving * mean + rise * moment
        return Reaction(
            force,
            self.k * steady,
            self.k * late * dt,
            RelaxingState(force, d),
            work - 0.5 * (force**2 - state.force**2) / self.k,
        )

    def energy(self, d: Array, state: RelaxingState) -> Array:
        """Of the spring."""
        return 0.5 * state.force**2 / self.k


class _Integrals(NamedTuple):
    r"""Of a step of x relaxation times, s from 0 to 1.

    Attributes
    ----------
    decay, level, moment : array
        :math:`e^{-x}`, :math:`\int e^{-xs}ds = \varphi_1(1)` and :math:`\int s\,e^{-xs}ds`.
    ramp, ramp_moment : array
        :math:`\int\varphi_1 ds = \varphi_2(1)` and :math:`\int s\varphi_1 ds`.
    ramp_mean, bend_moment : array
        :math:`\int\varphi_2 ds` and :math:`\int s\varphi_2 ds`.
    """

    decay: Array
    level: Array
    moment: Array
    ramp: Array
    ramp_moment: Array
    ramp_mean: Array
    bend_moment: Array


def _integrals(x: Array) -> _Integrals:
    """By recursion: upwards from the exponential, or for short steps down from power series."""
    short = x < _SHORT
    small, large = jnp.where(short, x, 0.0), jnp.where(short, 1.0, x)
    decay = jnp.exp(-x)
    level = -jnp.expm1(-large) / large
    ramp = (1.0 - level) / large
    moment = (level - jnp.exp(-large)) / large
    ramp_moment = (0.5 - moment) / large
    up = (level, moment, ramp, ramp_moment, (0.5 - ramp) / large, (1.0 / 3.0 - ramp_moment) / large)
    ramp_mean, bend_moment = _series(_MEAN, -small), _series(_MOMENT, -small)
    ramp = 0.5 - small * ramp_mean
    ramp_moment = 1.0 / 3.0 - small * bend_moment
    down = (
        1.0 - small * ramp,
        0.5 - small * ramp_moment,
        ramp,
        ramp_moment,
        ramp_mean,
        bend_moment,
    )
    return _Integrals(decay, *(jnp.where(short, a, b) for a, b in zip(down, up, strict=True)))


def _series(coefficients: np.ndarray, x: Array) -> Array:
    return jnp.polyval(jnp.asarray(coefficients[::-1], x.dtype), x, unroll=coefficients.size)
