"""The attached oscillator: a mass on a spring and a dashpot that a place carries along."""

import math
from typing import Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.joints.abstract import ParameterInfo, named
from iwanjax.joints.dashpot import Dashpot
from iwanjax.joints.discrete import AbstractDiscrete, Reaction
from iwanjax.joints.force_law import NestedLaw, Scales
from iwanjax.joints.inertia import Inertia
from iwanjax.joints.motion_only import AbstractMotionOnly
from iwanjax.types import ArrayLike, real

# Of starting values: masses over what moves at the place, half a decade apart; octaves from one
# frequency to the next, and the damping ratio. From a tenth of it one as heavy as the place was not
# found, from a hundredth none of 0.3 % of it that left ten times the noise.
_MASSES, _OCTAVES, _DAMPED = (10.0 ** (-0.5 * np.arange(8))).tolist(), 0.25, 0.1
# Below it a cosine and sine of an angle's root are those of a power series' first terms.
_SMALL = 1e-8
# Below it, of stiffness and damper over the mass in units of the step, so many terms are summed.
_SHORT, _TERMS = 0.5, 14


class AttachedOscillator(AbstractMotionOnly):
    r"""Attached oscillator: a mass m on a spring k and a dashpot c, as a cable or a fixture.

    The deflection d is that of its foot, y that of the mass:

    .. math:: m\ddot y = F, \qquad F = k(d - y) + c(\dot d - \dot y), \qquad
              K(\omega) = -m\omega^2\,\frac{k + ic\omega}{k - m\omega^2 + ic\omega}

    (Den Hartog, Mechanical Vibrations, Sec. 3.2). Far below its frequency it is the mass, far
    above nothing but a damped spring to rest. Quasi-statically it carries nothing, and no mode of
    the structure it is attached to knows of it: it is for motions in time.

    Parameters
    ----------
    m : float or array
        Mass, force x time^2/length.
    k : float or array
        Stiffness of its spring, force/length.
    c : float or array
        Viscous coefficient, force x time/length.

    Examples
    --------
    >>> from iwanjax.joints import AttachedOscillator
    >>> element = AttachedOscillator(m=0.1, k=1000.0, c=0.2)
    >>> round(float(element.secant(1.0, omega=1.0)), 3)  # -m omega^2 far below 100 rad/s
    -0.1
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("m", "mass", "mass", lower=0.0, transform="log"),
        ParameterInfo("k", "force/length", "stiffness of its spring", lower=0.0, transform="log"),
        ParameterInfo("c", "force*time/length", "viscous coefficient", lower=0.0, transform="log"),
    )

    m: Array = eqx.field(converter=named("m"))
    k: Array = eqx.field(converter=named("k"))
    c: Array = eqx.field(converter=named("c"))

    @classmethod
    def begun(cls, seen: Scales, **held: Any) -> tuple[Self, ...]:
        """Oscillators to begin a search with: over the band of the modes, light and heavy.

        Two octaves beyond it they are masses held stiffly, and nothing else.
        """
        octaves = math.log2(seen.highest / (0.5 * seen.lowest)) + 2.0
        return tuple(
            cls(m, m * w**2, 2.0 * _DAMPED * m * w)
            for w in (0.5 * seen.lowest * 2.0 ** np.arange(0.0, octaves, _OCTAVES)).tolist()
            for m in (share * seen.mass for share in _MASSES)
        )

    def discrete(self, sliders: int | None = None) -> "Attached":
        """The mass moves on its own."""
        return Attached(self.m, self.k, self.c)

    def secant(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        r"""Real part of :math:`K(\omega)`, force/length.

        Parameters
        ----------
        d : array_like
            Amplitude, length; it does not matter.
        omega : array_like, optional
            Circular frequency, rad/s; without it the quasi-static limit, zero.
        """
        if omega is None:
            return self.backbone(d)
        return self._stiffness(omega)[0] * jnp.ones_like(real(d))

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        r"""Energy per cycle :math:`\pi d^2\,\mathrm{Im}\,K(\omega)`, force x length.

        Parameters
        ----------
        d : array_like
            Amplitude of the foot, length.
        omega : array_like
            Circular frequency, rad/s.

        Raises
        ------
        InputError
            When omega is not given.
        """
        return jnp.pi * self._stiffness(self._rate(omega))[1] * real(d) ** 2

    @classmethod
    def nested_whole(cls, **held: Any) -> tuple[NestedLaw, ...]:
        """On a spring that is stiff enough it is a mass; one that stays at rest holds a damper."""
        return (
            NestedLaw(
                Inertia,
                lambda values: ((values[0],),),
                lambda mass, seen, share: (
                    mass[0],
                    mass[0] * (2.0 * np.pi / (share * seen.period)) ** 2,
                    mass[0] * 2.0 * np.pi / (share * seen.period),
                ),
            ),
            NestedLaw(
                Dashpot,
                lambda values: (values[2:],),
                lambda damper, seen, share: (
                    damper[0] * seen.period / (2.0 * np.pi * share),
                    share * damper[0] * 2.0 * np.pi / seen.period,
                    damper[0],
                ),
            ),
        )

    def _stiffness(self, omega: ArrayLike) -> tuple[Array, Array]:
        """Real and imaginary part of K."""
        w = real(omega)
        inertia, drag = self.m * w**2, self.c * w
        off = self.k - inertia
        scale = -inertia / (off**2 + drag**2)
        return scale * (self.k * off + drag**2), -scale * drag * inertia


class AttachedState(NamedTuple):
    """What an attached oscillator remembers.

    Attributes
    ----------
    d, v : array
        Deflection and rate of its foot.
    r, s : array
        Deflection and rate of the mass against the foot.
    ways : (2, 2) array
        What more of d and of v at the end of the step adds to each of them.
    """

    d: Array
    v: Array
    r: Array
    s: Array
    ways: Array


class _Free(NamedTuple):
    """Of free vibration over one step, in its units.

    Attributes
    ----------
    early, late : (2,) tuple of array
        Deflection and rate after a deflection, and after a rate of 1.
    level, ramp : array
        Integrals of the deflection after a rate of 1, once and twice.
    """

    early: tuple[Array, Array]
    late: tuple[Array, Array]
    level: Array
    ramp: Array


def _free(stiff: Array, damped: Array) -> _Free:
    """Of stiffness and damper over the mass, by the step's square and the step."""
    square = stiff - 0.25 * damped**2
    size = jnp.abs(square)
    tiny = size < _SMALL
    w = jnp.sqrt(jnp.where(tiny, 1.0, size))
    decay = jnp.exp(-0.5 * damped)
    cosine = jnp.where(square > 0.0, jnp.cos(w), jnp.cosh(w))
    sine = jnp.where(square > 0.0, jnp.sin(w), jnp.sinh(w)) / w
    cosine = decay * jnp.where(tiny, 1.0 - 0.5 * square, cosine)
    sine = decay * jnp.where(tiny, 1.0 - square / 6.0, sine)
    half = 0.5 * damped * sine
    # Closed forms of the integrals are small differences in short steps.
    short = stiff + damped < _SHORT
    safe = jnp.where(short, 1.0, stiff)
    level = (1.0 - (cosine - half) - damped * sine) / safe
    ramp = (1.0 - sine - damped * level) / safe
    terms = [jnp.zeros_like(stiff), jnp.ones_like(stiff)]
    for n in range(2, _TERMS):
        terms.append(-(damped * (n - 1) * terms[-1] + stiff * terms[-2]) / (n * (n - 1)))
    once = sum((x / (n + 1) for n, x in enumerate(terms)), jnp.zeros_like(stiff))
    twice = sum((x / ((n + 1) * (n + 2)) for n, x in enumerate(terms)), jnp.zeros_like(stiff))
    return _Free(
        (cosine + half, -stiff * sine),
        (sine, cosine - half),
        jnp.where(short, once, level),
        jnp.where(short, twice, ramp),
    )


class Attached(AbstractDiscrete):
    r"""An attached oscillator in motion, exact where its foot follows a cubic over each step.

    That is the cubic that joins deflections and rates at both ends; against the foot the mass
    moves by :math:`\ddot r + (c/m)\dot r + (k/m) r = -\ddot d`, whose right side is linear in
    time: free vibration carries what it does.

    Parameters
    ----------
    m, k, c : array
        Mass, stiffness and viscous coefficient.
    """

    m: Array
    k: Array
    c: Array
    rate_dependent: ClassVar[bool] = True

    def init(self) -> AttachedState:
        """At rest."""
        zero = jnp.zeros_like(self.m * self.k * self.c)
        return AttachedState(zero, zero, zero, zero, jnp.zeros((2, 2)) * zero[..., None, None])

    def step(self, d: Array, v: Array, dt: Array, state: AttachedState) -> Reaction:
        """Move the foot to d, to arrive at rate v."""
        # In units of the step.
        free = _free(self.k * dt**2 / self.m, self.c * dt / self.m)
        moved, left, right = d - state.d, state.v * dt, v * dt
        # Accelerations of the foot at both ends.
        begun = 6.0 * moved - 4.0 * left - 2.0 * right
        behind, slower = self._onward(begun, -begun - 2.0 * (left - right), free)
        r = free.early[0] * state.r + free.late[0] * state.s * dt + behind
        s = free.early[1] * state.r + free.late[1] * state.s * dt + slower
        ways = [self._onward(*ends, free) for ends in ((6.0, -6.0), (-2.0, 4.0))]
        force = -(self.k * r + self.c * s / dt)
        by = jnp.array([[1.0, dt], [1.0 / dt, 1.0]]) * jnp.array(ways).T
        stiffness, damping = -(self.k * by[0] + self.c * by[1])
        middle = 1.5 * (r - state.r) - 0.25 * (state.s * dt + s)
        speeds = (state.s * dt) ** 2 + 4.0 * middle**2 + s**2
        lost = self.c / dt * speeds / 6.0
        return Reaction(force, stiffness, damping, AttachedState(d, v, r, s / dt, by), lost)

    def settled(
        self, state: AttachedState, by: Array, faster: Array, stiffness: Array
    ) -> AttachedState:
        """The same step with another end, exact as all is linear."""
        r, s = state.ways @ jnp.stack([by, faster])
        return state._replace(d=state.d + by, v=state.v + faster, r=state.r + r, s=state.s + s)

    def haste(self, dt: Array) -> Array:
        """Of what damps it."""
        return self.c * dt / self.m

    def energy(self, d: Array, state: AttachedState) -> Array:
        """Of the spring and of the mass in motion."""
        return 0.5 * self.k * state.r**2 + 0.5 * self.m * (state.v + state.s) ** 2

    @staticmethod
    def _onward(begun: Array | float, ended: Array | float, free: _Free) -> tuple[Array, Array]:
        """What the mass lags behind after a foot's accelerations from one to the other."""
        rise = ended - begun
        return (
            -(begun * free.level + rise * free.ramp),
            -(begun * free.late[0] + rise * free.level),
        )
