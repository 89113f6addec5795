"""The general law in motion: all its parts side by side over one step."""

from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from iwanjax.joints.attached_oscillator import AttachedState
from iwanjax.joints.discrete import AbstractDiscrete, Reaction
from iwanjax.joints.duhem import DuhemSpring
from iwanjax.joints.maxwell import Relaxing, RelaxingState
from iwanjax.joints.sliders import SliderBank, SliderState
from iwanjax.joints.unnamed_inertia import Masses
from iwanjax.joints.unnamed_parts import Bristles, SplineSpring, YieldingSprings
from iwanjax.joints.unnamed_terms import OUTSIDE, RATES, RISE


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
    w : (bristles,) array
        Shares of their slip of the bristles.
    masses : AttachedState
        Of all masses, (3, ...).
    branch : array
        Share of its force of the spring that yields along a curve.
    """

    d: Array
    v: Array
    sliders: SliderState
    relaxing: RelaxingState
    z: Array
    w: Array
    masses: AttachedState
    branch: Array


class Unnamed(AbstractDiscrete):
    """The general law in motion: its spring, dampers, sliders, relaxation, bristles and masses.

    Attributes
    ----------
    spring : SplineSpring
        The elastic part.
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
    yielding : YieldingSprings
        Springs that yield gradually and unload straight.
    bristles : Bristles
        Springs that yield gradually either way, some the more the faster.
    masses : Masses
        One of constant size, one that grows with the deflection, and one that resonates.
    duhem : DuhemSpring
        A spring that yields along a curve of any shape.
    """

    spring: SplineSpring
    D: Array
    V: Array
    dampers: Array
    bank: SliderBank
    relaxing: Relaxing
    relaxation: Array
    yielding: YieldingSprings
    bristles: Bristles
    masses: Masses
    duhem: DuhemSpring
    rate_dependent: ClassVar[bool] = True

    def init(self) -> UnnamedState:
        """At rest."""
        zero = jnp.zeros(())
        relaxing = self.relaxing.init()._replace(d=zero)
        still = jnp.zeros_like(self.yielding.force), jnp.zeros_like(self.bristles.force)
        carried = self.masses.init()
        return UnnamedState(zero, zero, self.bank.init(), relaxing, *still, carried, zero)

    def apart(self) -> tuple["Unnamed", Masses]:
        """The law without those of its masses that do not resonate, and all of them."""
        resonates = self.masses.m.at[:2].set(0.0)
        return eqx.tree_at(lambda e: e.masses.m, self, resonates), self.masses

    def damper(self, d: Array, v: Array) -> Array:
        """Force of the dampers, against the motion whatever it is."""
        u, x = v / self.V, d / self.D
        size = jnp.abs(u)
        saturating = [(1.0 + e) * u / (size + e) for e in RATES]
        # Beyond twice the fastest motion on along the tangent.
        b, far, within = OUTSIDE, jnp.maximum(size, OUTSIDE), size < OUTSIDE
        drag = u * jnp.where(within, size, 2.0 * b - b**2 / far)
        cubic = u * jnp.where(within, size**2, 3.0 * b**2 - 2.0 * b**3 / far)
        rising = (1.0 + RISE) * u * size / (size + RISE)
        apart = jnp.minimum(x**2, b**2) * u
        sides = jnp.maximum(u, 0.0), jnp.minimum(u, 0.0)
        terms = (*saturating, *sides, rising, drag, cubic, apart)
        pairs = zip(self.dampers, terms, strict=True)
        return sum((strength * term for strength, term in pairs), jnp.zeros_like(u))

    def step(self, d: Array, v: Array, dt: Array, state: UnnamedState) -> Reaction:
        """Move to d, to arrive at rate v."""
        force, stiffness = self.spring.curve(d)
        slid = self.bank.step(d, v, dt, state.sliders)
        relaxed = self.relaxing.step(d, v, dt, state.relaxing)
        carried = self.masses.step(d, v, dt, state.masses)
        share = self.relaxation / self.D
        one, none = jnp.ones_like(d), jnp.zeros_like(d)
        yielding, bristles = self.yielding, self.bristles
        # Of the state's own deflection: what settles a step has moved it.
        moved = d - state.d
        z, slope = jax.jvp(lambda by: yielding.onward(state.z, by), (moved,), (one,))
        duhem = self.duhem
        branch, leaning = jax.jvp(lambda by: duhem.onward(state.branch, by), (moved,), (one,))
        mean = 0.5 * (state.v + v)
        w, bent = jax.jvp(lambda by: bristles.onward(state.w, by, mean), (moved,), (one,))
        _, faded = jax.jvp(lambda v: bristles.onward(state.w, moved, v), (mean,), (0.5 * one,))
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
            + jnp.sum(yielding.force * z)
            + jnp.sum(bristles.force * w)
            + carried.force
            + duhem.force * branch,
            stiffness
            + by_d
            + slid.stiffness
            + jnp.sum(share * relaxed.stiffness)
            + jnp.sum(yielding.force * slope)
            + jnp.sum(bristles.force * bent)
            + carried.stiffness
            + duhem.force * leaning,
            by_v
            + jnp.sum(share * relaxed.damping)
            + jnp.sum(bristles.force * faded)
            + carried.damping,
            UnnamedState(d, v, slid.state, relaxed.state, z, w, carried.state, branch),
            lost
            + slid.loss
            + jnp.sum(share * relaxed.loss)
            + yielding.lost(state.z, z, moved)
            + bristles.lost(state.w, w, moved, mean)
            + carried.loss
            + duhem.lost(state.branch, branch, moved),
        )

    def settled(
        self, state: UnnamedState, by: Array, faster: Array, stiffness: Array
    ) -> UnnamedState:
        """All follow a little further; relaxing springs, which forget, are left as they are."""
        at = state.sliders
        stretch = jnp.clip(at.stretch + by, -self.bank.phi, self.bank.phi)
        z = self.yielding.onward(state.z, by)
        w = self.bristles.onward(state.w, by, state.v)
        sliders = at._replace(d=at.d + by, stretch=stretch)
        masses = self.masses.settled(state.masses, state.d, state.v, by, faster)
        branch = self.duhem.onward(state.branch, by)
        ends = state.d + by, state.v + faster
        return UnnamedState(*ends, sliders, state.relaxing, z, w, masses, branch)

    def haste(self, dt: Array) -> Array:
        """Of the fastest relaxing spring that has any strength."""
        return jnp.max(jnp.where(self.relaxation > 0.0, dt / self.relaxing.c, 0.0))

    def energy(self, d: Array, state: UnnamedState) -> Array:
        """Of the springs of all parts and of the masses in motion."""
        relaxed = jnp.sum(self.relaxation / self.D * self.relaxing.energy(d, state.relaxing))
        pulled = [
            0.5 * jnp.sum(part.force * part.phi * share**2)
            for part, share in ((self.yielding, state.z), (self.bristles, state.w))
        ]
        held = self.bank.energy(d, state.sliders)
        others = self.masses.energy(state.masses) + self.duhem.energy(state.branch)
        return self.spring.energy(d) + held + relaxed + sum(pulled) + others
