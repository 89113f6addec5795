"""A law for what has no name: springs, dampers, sliders, relaxation and yield side by side."""

from pathlib import Path
from typing import ClassVar, NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.files.trees import read_tree, write_tree
from iwanjax.joints.abstract import AbstractJoint, Law, ParameterInfo, named
from iwanjax.joints.discrete import AbstractDiscrete, Reaction
from iwanjax.joints.masing import masing_loading
from iwanjax.joints.maxwell import Relaxing, RelaxingState
from iwanjax.joints.sliders import SliderBank, SliderState
from iwanjax.joints.unnamed_parts import SplineSpring, YieldingSprings
from iwanjax.joints.unnamed_terms import (
    ELASTIC,
    PARTS,
    RATES,
    RISE,
    SHARES,
    SLIPS,
    TERMS,
    TIMES,
    YIELDS,
)
from iwanjax.types import ArrayLike, as_real, is_traced, real

_HARMONIC = 128
"""Samples of a cycle that a damper's loss is summed over: exact for powers of the rate to 1e-4."""


class UnnamedLaw(AbstractJoint):
    r"""A general law of a place's own motion: a spring, dampers, sliders, relaxation and yield.

    With :math:`x = d/D` and :math:`u = v/V`

    .. math:: F = S(x) + R(x, u) + \sum_j s_j\,\frac{\sigma_j}{\phi_j}
              + \sum_m r_m\,\frac{q_m}{D} + \sum_l y_l\,\frac{z_l}{\phi_l}

    S is a cubic spline through the origin whose slope may change at each knot, R a sum of dampers
    :math:`u/(|u| + \epsilon)`, of both sides of u, :math:`u|u|/(|u| + 0.1)`, :math:`u|u|`,
    :math:`u^3` and :math:`x^2 u`;
    :math:`\sigma_j` are the stretches of sliders that slip at :math:`\phi_j`, and
    :math:`\dot q_m + q_m/\tau_m = v`, and the springs :math:`z_l` yield as those of Bouc and Wen
    with the exponent 2, :math:`\dot z = v\,[1 - (z/\phi)^2]` where that grows and :math:`v` where
    it falls: they unload straight, which no bank of sliders does. Beyond D the spring goes on
    straight, beyond V the quadratic and the cubic damper. All but the spring's strengths are at
    least zero, so that no closed cycle feeds energy.

    Parameters
    ----------
    strengths : (terms,) array_like
        Force of each term at x = 1 or u = 1, in the order of
        :data:`~iwanjax.joints.unnamed_terms.TERMS`.
    deflection, rate : float
        D, length, and V, length/time: the largest that it was fitted to.
    period : float
        T, time: of the motion it was fitted to, by which relaxation times are chosen.

    Raises
    ------
    InputError
        For other numbers of strengths, negative ones but of the spring, and scales of zero.
    """

    # A law that was fitted as a whole is no parameter of a fit to curves. Strengths are leaves of
    # their own: one with an axis would be taken for a batch of parameter sets.
    parameters: ClassVar[tuple[ParameterInfo, ...]] = ()

    strengths: tuple[Array, ...] = eqx.field(converter=lambda x: _row(x))
    deflection: Array = eqx.field(converter=named("deflection"))
    rate: Array = eqx.field(converter=named("rate"))
    period: Array = eqx.field(converter=named("period"))

    @classmethod
    def blank(cls, deflection: float, rate: float, period: float) -> Self:
        """The law without any force, for a place of these largest motions."""
        return cls(np.zeros(len(TERMS)), deflection, rate, period)

    def with_strengths(self, strengths: ArrayLike) -> Self:
        """The same with other strengths, (terms,)."""
        return type(self)(strengths, self.deflection, self.rate, self.period)

    def alone(self, part: str) -> Self:
        """One of the parts by itself, by its name in ``unnamed_terms.PARTS``."""
        kept = np.zeros(len(TERMS))
        kept[PARTS[part]] = 1.0
        return self.with_strengths(jnp.asarray(kept) * jnp.stack(self.strengths))

    def save(self, path: str | Path) -> Path:
        """Write the law to an ``.npz`` file, which studies name by ``file:``."""
        return write_tree(path, self)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what :meth:`save` wrote.

        Raises
        ------
        InputError
            For a file that is missing or damaged, or that holds something else.
        """
        found = read_tree(path)
        if not isinstance(found, cls) or len(found.strengths) != len(TERMS):
            held = f"a {type(found).__name__}"
            raise InputError(f"{path}: holds {held}; expected an {cls.__name__} saved by save()")
        return found

    @property
    def initial_stiffness(self) -> Array:
        """Of the spring and the sliders at rest, force/length."""
        return self.law()(jnp.zeros(()))[1]

    @property
    def limit_stiffness(self) -> Array:
        """Mean of the slopes that the spring goes on with, force/length."""
        ends = self.deflection * jnp.array([-2.0, 2.0])
        return jnp.mean(_spring(self).curve(ends)[1])

    def discrete(self, sliders: int | None = None) -> "Unnamed":
        """All parts in motion."""
        return Unnamed.of(self)

    def law(self) -> Law:
        """Virgin curve d -> (force, tangent): the spring and the sliders."""
        spring, bank, yielding = _spring(self), _bank(self), _yielding(self)

        def evaluate(d: Array) -> tuple[Array, Array]:
            (force, tangent), (held, stuck) = spring.curve(d), _virgin(bank, d)
            pulled, elastic = yielding.curve(d)
            return force + held + pulled, tangent + stuck + elastic

        return evaluate

    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """Slope from tip to tip of the quasi-static cycle, force/length."""
        amplitude = jnp.abs(real(d))
        at_rest = amplitude == 0
        safe = jnp.where(at_rest, 1.0, amplitude)
        tips = self.loading(safe, safe) - self.loading(-safe, safe)
        return jnp.where(at_rest, self.initial_stiffness, 0.5 * tips / safe)

    def tip_stiffness(self, d: ArrayLike) -> Float[Array, "..."]:
        """Secant of the spring, tangent of the sliders, force/length."""
        amplitude = jnp.abs(real(d))
        # A yielding spring unloads straight from both tips.
        elastic = _yielding(self).curve(jnp.zeros_like(amplitude))[1]
        return self.alone("spring").secant(d) + _virgin(_bank(self), amplitude)[1] + elastic

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        r"""Energy lost in a steady harmonic cycle of amplitude |d|, force x length.

        Sliders lose :math:`4k\phi(|d| - \phi)_+` each, relaxing springs
        :math:`\pi k d^2\omega\tau/(1 + \omega^2\tau^2)`, dampers :math:`\oint R\,dd`, yielding
        springs :math:`-k\phi^2[\ln(1 - w^2) + w^2]` to the share w of their slip at the tip.

        Parameters
        ----------
        d : array_like
            Amplitude, length.
        omega : array_like, optional
            Circular frequency, rad/s; without it that of ``period``.
        """
        amplitude = jnp.abs(real(d))
        w = 2.0 * jnp.pi / self.period if omega is None else real(omega)
        bank, all_of = _bank(self), Unnamed.of(self)
        slipped = jnp.maximum(amplitude[..., None] - bank.phi, 0.0)
        lost = 4.0 * jnp.sum(bank.k * bank.phi * slipped, axis=-1)
        lost = lost + _yielding(self).cycle(amplitude)
        angle = w * all_of.relaxing.c
        stored = all_of.relaxation * angle / (1.0 + angle**2)
        lost = lost + jnp.pi * jnp.sum(stored) / self.deflection * amplitude**2
        phase = 2.0 * np.pi * (np.arange(_HARMONIC) + 0.5) / _HARMONIC
        phase = phase.reshape(-1, *(1,) * amplitude.ndim)
        v = w * amplitude * np.cos(phase)
        power = all_of.damper(amplitude * np.sin(phase), v) * v
        return lost + 2.0 * jnp.pi / w * jnp.mean(power, axis=0)

    def loading(self, d: ArrayLike, d_0: ArrayLike) -> Float[Array, "..."]:
        """Loading branch of the quasi-static loop: the spring, the sliders by Masing's rule."""
        to, bank = real(d), _bank(self)
        amplitude = jnp.abs(real(d_0))
        held = masing_loading(lambda x: _virgin(bank, x), to, amplitude)
        return _spring(self).curve(to)[0] + held + _yielding(self).loading(to, amplitude)

    def __repr__(self) -> str:
        """How far it was fitted."""
        scales = (self.deflection, self.rate)
        if is_traced(self.strengths, scales):
            return "UnnamedLaw(traced)"
        return f"UnnamedLaw(to |d| = {float(scales[0]):.3g}, |v| = {float(scales[1]):.3g})"

    def __check_init__(self) -> None:
        """Refuse what is no law, or would feed energy."""
        if len(self.strengths) != len(TERMS):
            raise InputError(
                f"UnnamedLaw: strengths has {len(self.strengths)} numbers; expected {len(TERMS)}, "
                "one for each term"
            )
        if is_traced(self.strengths, self.deflection, self.rate, self.period):
            return
        for name in ("deflection", "rate", "period"):
            if not np.all(np.asarray(getattr(self, name)) > 0.0):
                raise InputError(
                    f"UnnamedLaw: {name} = {getattr(self, name)}; expected a positive number"
                )
        for name, strength in list(zip(TERMS, self.strengths, strict=True))[ELASTIC:]:
            if np.any(np.asarray(strength) < 0.0):
                raise InputError(
                    f"UnnamedLaw: the strength of {name} is {float(strength):g}; expected at least "
                    "0: less would feed energy"
                )


def _row(values: ArrayLike | tuple[Array, ...]) -> tuple[Array, ...]:
    """The numbers of a row, one by one."""
    row = as_real(values, "strengths")
    # One by one by JAX, each place would be a compilation of its own.
    if is_traced(row):
        return tuple(part[0] for part in jnp.split(row, row.shape[0]))
    return tuple(jax.device_put(list(np.asarray(row))))


def _spring(law: UnnamedLaw) -> SplineSpring:
    return SplineSpring.of(jnp.stack(law.strengths[:ELASTIC]), law.deflection)


def _yielding(law: UnnamedLaw) -> YieldingSprings:
    force = jnp.stack(law.strengths[PARTS["yielding"]])
    return YieldingSprings(force, law.deflection * YIELDS)


def _bank(law: UnnamedLaw) -> SliderBank:
    """The sliders: each node's strength shared among those about it."""
    phi = law.deflection * SLIPS
    force = jnp.asarray(SHARES) @ jnp.stack(law.strengths[PARTS["sliders"]])
    return SliderBank(phi, force / phi)


def _virgin(bank: SliderBank, d: Array) -> tuple[Array, Array]:
    stretch = jnp.clip(d[..., None], -bank.phi, bank.phi)
    stuck = jnp.where(jnp.abs(d)[..., None] < bank.phi, bank.k, 0.0)
    return jnp.sum(bank.k * stretch, axis=-1), jnp.sum(stuck, axis=-1)


class UnnamedState(NamedTuple):
    """What the law remembers.

    Attributes
    ----------
    d, v : array
        Deflection and rate at the end of the last step.
    sliders : SliderState
        Of the bank.
    relaxing : RelaxingState
        Of relaxing springs of unit stiffness.
    z : (springs,) array
        Shares of their slip of the yielding springs.
    """

    d: Array
    v: Array
    sliders: SliderState
    relaxing: RelaxingState
    z: Array


class Unnamed(AbstractDiscrete):
    """The general law in motion: its spring, dampers, sliders, relaxing and yielding springs.

    Attributes
    ----------
    spring : array
        Polynomials between the knots.
    D, V : array
        Largest deflection and rate that it was fitted to.
    dampers : (dampers,) array
        Strengths, force.
    bank : SliderBank
        The sliders.
    relaxing : Relaxing
        Springs of unit stiffness in series with dashpots.
    relaxation : (times,) array
        Their strengths, force at D.
    yielding : (2, springs) array
        Force at the slip of the yielding springs, and the slip, length.
    """

    spring: Array
    D: Array
    V: Array
    dampers: Array
    bank: SliderBank
    relaxing: Relaxing
    relaxation: Array
    yielding: Array
    rate_dependent: ClassVar[bool] = True

    @classmethod
    def of(cls, law: UnnamedLaw) -> "Unnamed":
        """The constants of a law worked out once."""
        tau = law.period / (2.0 * np.pi) * jnp.asarray(TIMES)
        return cls(
            _spring(law).c,
            law.deflection,
            law.rate,
            jnp.stack(law.strengths[PARTS["damper"]]),
            _bank(law),
            Relaxing(jnp.ones_like(tau), tau),
            jnp.stack(law.strengths[PARTS["relaxation"]]),
            jnp.stack(_yielding(law)),
        )

    def init(self) -> UnnamedState:
        """At rest."""
        zero = jnp.zeros(())
        relaxing = self.relaxing.init()._replace(d=zero)
        still = jnp.zeros_like(self.yielding[0])
        return UnnamedState(zero, zero, self.bank.init(), relaxing, still)

    def damper(self, d: Array, v: Array) -> Array:
        """Force of the dampers, against the motion whatever it is."""
        u, x = v / self.V, d / self.D
        size = jnp.abs(u)
        saturating = [(1.0 + e) * u / (size + e) for e in RATES]
        far = jnp.maximum(size, 1.0)
        drag = u * jnp.where(size < 1.0, size, 2.0 - 1.0 / far)
        cubic = u * jnp.where(size < 1.0, size**2, 3.0 - 2.0 / far)
        rising = (1.0 + RISE) * u * size / (size + RISE)
        apart = jnp.minimum(x**2, 1.0) * u
        sides = jnp.maximum(u, 0.0), jnp.minimum(u, 0.0)
        terms = (*saturating, *sides, rising, drag, cubic, apart)
        pairs = zip(self.dampers, terms, strict=True)
        return sum((strength * term for strength, term in pairs), jnp.zeros_like(u))

    def step(self, d: Array, v: Array, dt: Array, state: UnnamedState) -> Reaction:
        """Move to d, to arrive at rate v."""
        spring = SplineSpring(self.D, self.spring)
        force, stiffness = spring.curve(d)
        slid = self.bank.step(d, v, dt, state.sliders)
        relaxed = self.relaxing.step(d, v, dt, state.relaxing)
        share = self.relaxation / self.D
        one, none = jnp.ones_like(d), jnp.zeros_like(d)
        yielding = YieldingSprings(*self.yielding)
        # Of the state's own deflection: what settles a step has moved it.
        moved = d - state.d
        z, slope = jax.jvp(lambda by: yielding.onward(state.z, by), (moved,), (one,))
        drag, by_d = jax.jvp(self.damper, (d, v), (one, none))
        _, by_v = jax.jvp(self.damper, (d, v), (none, one))
        # Simpson's rule along the cubic that joins both ends.
        middle = 1.5 * (d - state.d) / dt - 0.25 * (state.v + v)
        half = 0.5 * (d + state.d) + 0.125 * dt * (state.v - v)
        ends = ((state.d, state.v), (half, middle), (d, v))
        power = [self.damper(*at) * at[1] for at in ends]
        lost = dt / 6.0 * (power[0] + 4.0 * power[1] + power[2])
        return Reaction(
            force
            + drag
            + slid.force
            + jnp.sum(share * relaxed.force)
            + jnp.sum(yielding.force * z),
            stiffness
            + by_d
            + slid.stiffness
            + jnp.sum(share * relaxed.stiffness)
            + jnp.sum(yielding.force * slope),
            by_v + jnp.sum(share * relaxed.damping),
            UnnamedState(d, v, slid.state, relaxed.state, z),
            lost + slid.loss + jnp.sum(share * relaxed.loss) + yielding.lost(state.z, z, moved),
        )

    def settled(self, state: UnnamedState, by: Array, stiffness: Array) -> UnnamedState:
        """Sliders follow a little further; relaxing springs, which forget, are left as they are."""
        at = state.sliders
        stretch = jnp.clip(at.stretch + by, -self.bank.phi, self.bank.phi)
        z = YieldingSprings(*self.yielding).onward(state.z, by)
        sliders = at._replace(d=at.d + by, stretch=stretch)
        return state._replace(d=state.d + by, sliders=sliders, z=z)

    def haste(self, dt: Array) -> Array:
        """Of the fastest relaxing spring that has any strength."""
        return jnp.max(jnp.where(self.relaxation > 0.0, dt / self.relaxing.c, 0.0))

    def energy(self, d: Array, state: UnnamedState) -> Array:
        """Of the spring, the sliders' springs, the relaxing and the yielding ones."""
        relaxed = jnp.sum(self.relaxation / self.D * self.relaxing.energy(d, state.relaxing))
        spring = SplineSpring(self.D, self.spring).energy(d)
        force, phi = self.yielding
        pulled = 0.5 * jnp.sum(force * phi * state.z**2)
        return spring + self.bank.energy(d, state.sliders) + relaxed + pulled
