"""What a force, or another mode, does to one mode over a steady motion: stiffness and loss."""

import abc
import math
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.effects.kinds import ForceKind
from iwanjax.identification.steady.fit import PlacedEffect
from iwanjax.joints import AbstractJoint, Iwan4
from iwanjax.joints.force_law import PlaceMotion
from iwanjax.joints.sliders import SliderBank
from iwanjax.quasistatic.coupled import TwoMotionTable, window_of
from iwanjax.quasistatic.modal import Beside, ModalOscillator, about
from iwanjax.quasistatic.single_harmonic import AbstractCyclic
from iwanjax.settings.stages import settings
from iwanjax.signals.interpolate import cubic

# Of a sum over a cycle, over its largest term.
_ROUNDING = 1e-10
# Steps of a motion of two modes come in blocks, so that modes of about the same ratio share a
# kernel.
_BLOCK = 256


def beside(kind: ForceKind, shape: float, q: np.ndarray, omega: float | np.ndarray) -> Beside:
    r"""A force of unit size under :math:`d = q\sin\omega t`, for a mode's curves.

    .. math:: k_1 = \frac{1}{\pi q}\oint F\sin\omega t\,\mathrm{d}(\omega t), \qquad
              D = \oint F\,\mathrm{d}d

    by the rectangle rule over the second cycle, which for smooth forces is exact to rounding
    and for sliders to the square of a step. An offset that a one-sided force causes is left
    out: it counts to the second order of the force.

    Parameters
    ----------
    kind : ForceKind
        The force.
    shape : float
        Its shape parameter, where it has one.
    q : (3, ..., levels) array
        Amplitudes a little below, at and a little above those wanted.
    omega : float or (..., 1) array
        Circular frequency, rad/s.

    Returns
    -------
    Beside
        k_1 at all q; stiffness at the tips, and D, at those wanted.
    """
    steps = settings().steady.cycle
    return _beside(kind, steps, jnp.asarray(shape), jnp.asarray(q), jnp.asarray(omega))


@partial(jax.jit, static_argnums=(0, 1))
def _beside(kind: ForceKind, steps: int, shape: Array, q: Array, omega: Array) -> Beside:
    # In the first of two cycles sliders and dashpots settle.
    phases = 2.0 * math.pi * np.arange(1, 2 * steps + 1) / steps
    dt = 2.0 * math.pi / (steps * omega)

    def step(memory: Array, phase: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        sine, cosine, before = phase
        d, v, moved = q * sine, q * omega * cosine, q * (sine - before)
        force, memory = kind.unit_force(
            PlaceMotion(d, v, -(omega**2) * d, moved, dt), shape, memory
        )
        return memory, jnp.broadcast_to(force, q.shape)

    sine, cosine = np.sin(phases), np.cos(phases)
    rows = (jnp.asarray(sine), jnp.asarray(cosine), jnp.asarray(np.append(0.0, sine[:-1])))
    memory, force = jax.lax.scan(step, jnp.zeros(q.shape), rows)
    last = force[-steps:]
    # At both ends of the cycle: a one-sided force has another slope at either.
    tip = 0.5 * (last[steps // 4 - 1] - last[3 * steps // 4 - 1])
    # What remembers is taken for a Masing element's, what does not for elastic: see tip_stiffness.
    tip = jnp.where(memory[1] == 0.0, tip[1] / q[1], (tip[2] - tip[0]) / (q[2] - q[0]))
    # What cancels over a cycle is nothing, not the rounding that is left of it.
    peak = jnp.max(jnp.abs(last), axis=0)

    def told(x: Array, largest: Array) -> Array:
        return jnp.where(jnp.abs(x) > _ROUNDING * largest, x, 0.0)

    return Beside(
        told(2.0 * jnp.einsum("s...,s->...", last, sine[-steps:]) / (steps * q), peak / q),
        told(tip, peak[1] / q[1]),
        told(
            2.0 * math.pi * q[1] * jnp.einsum("s...,s->...", last[:, 1], cosine[-steps:]) / steps,
            peak[1] * q[1],
        ),
    )


def shows(unit: Beside, q: np.ndarray) -> bool:
    """Whether a force changes with amplitude what a mode alone would have at every amplitude."""
    # What is the same at all of them a mode's own frequency and damping at rest take up.
    seen = (np.asarray(unit.stiffness)[1], np.asarray(unit.loss) / q[1] ** 2)
    largest = max(float(np.max(np.abs(each))) for each in (*seen, unit.tip))
    return any(float(np.ptp(each)) > settings().steady.negligible * largest for each in seen)


class CyclicForce(AbstractCyclic):
    """A force of some size, from what one of unit size does at some amplitudes.

    Attributes
    ----------
    level : (curves, deflections) array
        Logarithms of the amplitudes, rising; beyond them the ends' values hold.
    unit : Beside
        In-phase stiffness, stiffness at the tip, and loss over d^2, (curves, deflections) each.
    size : array
        Its size.
    """

    level: Float[Array, "curves deflections"]
    unit: Beside
    size: Array

    def stiffness(self, d: Array) -> Array:
        """In-phase first harmonic over d."""
        return self._told(self.unit.stiffness, d)

    def tip(self, d: Array) -> Array:
        """Stiffness at the tips that a free decay shrinks by."""
        return self._told(self.unit.tip, d)

    def loss(self, d: Array, omega: Array) -> Array:
        """Energy that it takes from a cycle; its unit is at the curve's own frequency."""
        return self._told(self.unit.loss, d) * d**2

    def _told(self, values: Array, d: Array) -> Array:
        level = self.level
        at = jnp.log(jnp.maximum(jnp.abs(d), jnp.exp(level[:, :1])))
        return self.size * jax.vmap(cubic)(jnp.minimum(at, level[:, -1:]), level, values)


def moved_by_both(
    joint: AbstractJoint,
    q: Float[Array, " N"],
    other: Float[Array, " N"],
    omega: Float[Array, " 2"],
    steps: int,
    samples: int,
    sliders: int,
) -> Beside:
    r"""What a second motion changes of a joint's first harmonic and loss in the first.

    .. math:: d = q\cos\theta + Q\cos\Theta, \qquad
              C = 2\,\langle F\,e^{-i\theta}\rangle, \qquad
              k_1 = \frac{\mathrm{Re}\,C}{q}, \qquad D = \pi q\,\mathrm{Im}\,C,

    less the same with Q = 0: averages over one long motion of the joint's sliders, weighted by
    a smooth window (Das et al. 2017), as for :func:`iwanjax.coupled_modes`.

    Parameters
    ----------
    joint : AbstractJoint
        Per unit modal mass.
    q, other : (N,) array
        Amplitudes of the joint's deflection, q and Q.
    omega : (2,) array
        Circular frequencies of both, rad/s.
    steps, samples, sliders : int
        Of the motion, of a cycle of the faster one, and of the joint.

    Returns
    -------
    Beside
        (N,) each; of the slope at the tip the change is taken to be that of k_1.
    """
    element = joint.discrete(sliders)
    dt = 2.0 * math.pi / (samples * jnp.max(omega))
    settling, window = window_of(steps)
    # Of the other motion at the start, of a turn: the golden ratio is no simple share of one.
    phase = 0.5 * (math.sqrt(5.0) - 1.0)

    def average(one: Array, two: Array) -> Array:
        def advance(state, k):
            theta, Theta = omega[0] * dt * k, omega[1] * dt * k + 2.0 * math.pi * phase
            d = one * jnp.cos(theta) + two * jnp.cos(Theta)
            v = -one * omega[0] * jnp.sin(theta) - two * omega[1] * jnp.sin(Theta)
            reaction = element.step(d, v, dt, state[0])
            turn = jnp.stack([jnp.cos(theta), -jnp.sin(theta)])
            return (reaction.state, state[1] + window[k] * reaction.force * turn), None

        start = (element.init(), jnp.zeros(2))
        return jax.lax.scan(advance, start, jnp.arange(settling + steps))[0][1]

    both, own = (jax.vmap(average)(q, Q) for Q in (other, jnp.zeros_like(other)))
    return _changed(q, (both - own).T / q)


def _changed(q: Array, harmonic: Float[Array, "2 N"]) -> Beside:
    """Changes of a stiffness and of a loss factor, as what acts beside an oscillator."""
    k = harmonic[0]
    return Beside(jnp.broadcast_to(k, (3, *k.shape)), k, math.pi * q**2 * harmonic[1])


class InteractingMode(NamedTuple):
    """Another mode that moved while one rang down.

    Attributes
    ----------
    name : str
        Its own.
    frequency : float
        Hz.
    amplitude : tuple of (levels,) arrays
        Displacement at the same sensor while each curve of the one was at each of its levels, in
        the order of the curves, those held out last.
    """

    name: str
    frequency: float
    amplitude: tuple[np.ndarray, ...]


class AbstractActing(eqx.Module):
    """What an effect does to a mode's oscillator at some levels."""

    @abc.abstractmethod
    def further(
        self, values: Float[Array, " values"], oscillator: ModalOscillator, q: Float[Array, " N"]
    ) -> tuple[Beside, Array | float]:
        """At amplitudes q, and the stiffness that is part of f_0."""

    @abc.abstractmethod
    def at(
        self, effect: PlacedEffect | None, q: Array, which: int, omega: float
    ) -> "AbstractActing":
        """The same at the amplitudes of the curve of this number, in cycles of omega (rad/s)."""


class ActingForce(AbstractActing):
    """A force: what one of unit size does."""

    unit: Beside

    def further(
        self, values: Float[Array, " 1"], oscillator: ModalOscillator, q: Float[Array, " N"]
    ) -> tuple[Beside, float]:
        """In proportion to the size."""
        return jax.tree.map(lambda each: values[0] * each, self.unit), 0.0

    def at(self, effect: PlacedEffect | None, q: Array, which: int, omega: float) -> "ActingForce":
        """At other amplitudes, or of another shape."""
        return ActingForce(unit_on(effect, q, omega))


class ActingJoint(AbstractActing):
    """A joint left out, stuck in f_0."""

    def further(
        self, values: Float[Array, " 4"], oscillator: ModalOscillator, q: Float[Array, " N"]
    ) -> tuple[Beside, Array]:
        """Its slip."""
        joint = Iwan4(*values)
        slip = Beside(
            joint.harmonic_stiffness(about(q)) - joint.K_T,
            joint.tip_stiffness(q) - joint.K_T,
            joint.dissipation(q),
        )
        return slip, joint.K_T

    def at(self, effect: PlacedEffect | None, q: Array, which: int, omega: float) -> "ActingJoint":
        """Everywhere."""
        return self


class ActingMode(AbstractActing):
    """Another mode that moves the joint, values times its amplitude.

    Attributes
    ----------
    other : (N,) array
        Amplitude of the other mode at each level.
    omega : (2,) array
        Circular frequencies of the mode and of the other, rad/s.
    amplitude : tuple of (levels,) arrays
        As of :class:`InteractingMode`.
    table : TwoMotionTable
        For joints that are made of sliders; others are moved along the whole motion.
    steps, samples, sliders : int
        Of the motion that is averaged over, of a cycle of the faster mode, and of the joint.
    """

    other: Float[Array, " N"]
    omega: Float[Array, " 2"]
    amplitude: tuple[Array, ...]
    table: TwoMotionTable
    steps: int = eqx.field(static=True)
    samples: int = eqx.field(static=True)
    sliders: int = eqx.field(static=True)

    def further(
        self, values: Float[Array, " 1"], oscillator: ModalOscillator, q: Float[Array, " N"]
    ) -> tuple[Beside, float]:
        """What the joint does more while both move."""
        joint, other = oscillator.joint, values[0] * self.other
        bank = joint.discrete(self.sliders)
        if isinstance(bank, SliderBank) and bank.theta is None:
            both, own = (self.table.of_sliders(bank, q, Q) for Q in (other, jnp.zeros_like(other)))
            return _changed(q, both - own), 0.0
        return moved_by_both(joint, q, other, self.omega, *self.sizes), 0.0

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Of a motion that is worked out by itself."""
        return self.steps, self.samples, self.sliders

    @classmethod
    def of(cls, interacting: InteractingMode, omega: float, curves: int) -> "ActingMode":
        """At the levels of the first so many curves of a mode of circular frequency omega."""
        amplitude = tuple(map(jnp.asarray, interacting.amplitude))
        both = np.array([omega, 2.0 * math.pi * interacting.frequency])
        known = settings().steady
        blocks = math.ceil(known.averaged * known.samples * both.max() / both.min() / _BLOCK)
        steps, other = _BLOCK * blocks, jnp.concatenate(amplitude[:curves])
        table = TwoMotionTable.of(both, steps, known.samples)
        return cls(other, jnp.asarray(both), amplitude, table, steps, known.samples, known.sliders)

    def at(self, effect: PlacedEffect | None, q: Array, which: int, omega: float) -> "ActingMode":
        """While the other mode had the amplitude that it had then."""
        return eqx.tree_at(lambda each: each.other, self, self.amplitude[which])


def unit_on(effect: PlacedEffect | None, q: Array, omega: float) -> Beside:
    """What a force of unit size does; nothing without one."""
    if effect is None:
        nothing = jnp.zeros(q.shape)
        return Beside(jnp.zeros((3, *q.shape)), nothing, nothing)
    assert isinstance(effect.kind, ForceKind)
    return beside(effect.kind, effect.shape, np.asarray(about(q)), omega)
