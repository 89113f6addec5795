"""The Maxwell element: a spring in series with a dashpot."""

from typing import Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.joints.abstract import Law, ParameterInfo, named
from iwanjax.joints.dashpot import Dashpot
from iwanjax.joints.discrete import AbstractDiscrete, Reaction
from iwanjax.joints.force_law import (
    AbstractForceLaw,
    NestedLaw,
    PlaceMotion,
    Scales,
    stiffness_alone,
)
from iwanjax.joints.springs import LinearSpring
from iwanjax.types import ArrayLike, real

# Below this many relaxation times a step's integrals are summed as power series: their closed
# forms are differences of near equals divided by the step.
_SHORT = 0.5
_POWERS = np.arange(18)
_FACTORIALS = np.cumprod(np.arange(1.0, 20.0))
# Of -x in (1 - exp(-x))/x, and in the integral of ((1 - exp(-x s))/x)^2 over s in (0, 1).
_RISE = 1.0 / _FACTORIALS[:-1]
_SQUARE = (2.0 ** (_POWERS + 2) - 2.0) / (_FACTORIALS[1:] * (_POWERS + 3))


class Maxwell(AbstractForceLaw):
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
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("k", "force/length", "stiffness of the spring", lower=0.0, transform="log"),
        ParameterInfo(
            "c", "force*time/length", "viscous coefficient in series", lower=0.0, transform="log"
        ),
    )
    # Of the deflection at rest its force is none at all.
    linear: ClassVar[bool] = True

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
        r"""The spring's stretch, exact for a rate that changes evenly to that at the step's end.

        :class:`Relaxing` has the rate constant instead, so that its loss is closed: from step to
        step of an observer, whose rates are known, the damper would lag by half a step.
        """
        x = motion.dt * self.k / self.c
        whole = -jnp.expm1(-x) / x
        ramp = (1.0 - whole) / x
        share = 2.0 * (whole - ramp)
        stretch = jnp.exp(-x) * memory + share * motion.moved
        stretch = stretch + (whole - share) * motion.dt * motion.v
        return self.k * stretch, stretch

    @property
    def initial_stiffness(self) -> Array:
        """Zero: at rest the dashpot has yielded."""
        return jnp.zeros_like(self.k * self.c)

    @property
    def limit_stiffness(self) -> Array:
        """Zero."""
        return jnp.zeros_like(self.k * self.c)

    def discrete(self, sliders: int | None = None) -> "Relaxing":
        """The force relaxes while it is built up."""
        return Relaxing(self.k, self.c)

    def law(self) -> Law:
        """No force and no tangent in quasi-static loading."""
        zero = self.initial_stiffness
        return lambda d: (zero * d, zero * d)

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
        if omega is None:
            raise InputError("Maxwell.dissipation needs omega= (rad/s): its loss depends on rate")
        ratio = real(omega) * self.c / self.k
        return jnp.pi * self.k * ratio / (1.0 + ratio**2) * real(d) ** 2

    def loading(self, d: ArrayLike, d_0: ArrayLike) -> Float[Array, "..."]:
        """The in-phase part of the quasi-static loop: zero."""
        return self.backbone(d)


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
    r"""Maxwell's element in motion, exact for a constant rate over each step.

    With :math:`x = k\Delta t/c` and :math:`\varphi(x) = (1 - e^{-x})/x`:

    .. math:: F_1 = e^{-x}F_0 + k\varphi(x)(d_1 - d_0), \qquad
              \text{loss} = \frac{1}{c}\int_0^{\Delta t} F^2\,dt

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

    def step(self, d: Array, v: Array, dt: Array, state: RelaxingState) -> Reaction:
        """Move to d at a constant rate."""
        x = self.k * dt / self.c
        elastic = self.k * (d - state.d)
        rise, square = _integrals(x)
        force = jnp.exp(-x) * state.force + rise * elastic
        mean_square = (
            _integrals(2.0 * x)[0] * state.force**2
            + rise**2 * state.force * elastic
            + square * elastic**2
        )
        return Reaction(
            force,
            self.k * rise,
            jnp.zeros_like(force),
            RelaxingState(force, d),
            dt / self.c * mean_square,
        )

    def energy(self, d: Array, state: RelaxingState) -> Array:
        """Of the spring."""
        return 0.5 * state.force**2 / self.k


def _integrals(x: Array) -> tuple[Array, Array]:
    r"""Of a force that is built up, :math:`r(s) = (1 - e^{-xs})/x`: r(1), and r^2 over (0, 1)."""
    short = x < _SHORT
    small, large = jnp.where(short, x, 0.0), jnp.where(short, 1.0, x)
    rise = -jnp.expm1(-large) / large
    square = ((1.0 - rise) / large - 0.5 * rise**2) / large
    return (
        jnp.where(short, _series(_RISE, -small), rise),
        jnp.where(short, _series(_SQUARE, -small), square),
    )


def _series(coefficients: np.ndarray, x: Array) -> Array:
    return jnp.polyval(jnp.asarray(coefficients[::-1], x.dtype), x, unroll=coefficients.size)
