"""The general law in motion: its dampers, sliders and relaxing springs, and all parts together."""

from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array

from iwanjax.joints.discrete import AbstractDiscrete, Reaction
from iwanjax.joints.maxwell import Relaxing, RelaxingState
from iwanjax.joints.sliders import SliderBank, SliderState
from iwanjax.joints.unnamed_terms import OUTSIDE, RATES, RISE


class Dampers(AbstractDiscrete):
    """Forces of the rate, one also of the deflection.

    Attributes
    ----------
    D, V : array
        Largest deflection and rate that they were fitted to.
    strengths : (dampers,) array
        Force.
    """

    D: Array
    V: Array
    strengths: Array
    rate_dependent: ClassVar[bool] = True

    def force(self, d: Array, v: Array) -> Array:
        """Against the motion whatever it is."""
        u, x = v / self.V, d / self.D
        size = jnp.abs(u)
        rates, count = jnp.asarray(RATES), len(RATES)
        saturating = (1.0 + rates) * u[..., None] / (size[..., None] + rates)
        # Beyond twice the fastest motion on along the tangent.
        b, far, within = OUTSIDE, jnp.maximum(size, OUTSIDE), size < OUTSIDE
        drag = u * jnp.where(within, size, 2.0 * b - b**2 / far)
        cubic = u * jnp.where(within, size**2, 3.0 * b**2 - 2.0 * b**3 / far)
        rising = (1.0 + RISE) * u * size / (size + RISE)
        apart = jnp.minimum(x**2, b**2) * u
        sides = jnp.maximum(u, 0.0), jnp.minimum(u, 0.0)
        others = jnp.stack([*sides, rising, drag, cubic, apart], axis=-1)
        return saturating @ self.strengths[:count] + others @ self.strengths[count:]

    def init(self) -> tuple[Array, Array]:
        """Deflection and rate."""
        return jnp.zeros(()), jnp.zeros(())

    def step(self, d: Array, v: Array, dt: Array, state: tuple[Array, Array]) -> Reaction:
        """The force at d and v; its work by Simpson's rule along the cubic that joins both ends."""
        one, none = jnp.ones_like(d), jnp.zeros_like(d)
        force, by_d = jax.jvp(self.force, (d, v), (one, none))
        _, by_v = jax.jvp(self.force, (d, v), (none, one))
        d_0, v_0 = state
        middle = 1.5 * (d - d_0) / dt - 0.25 * (v_0 + v)
        half = 0.5 * (d + d_0) + 0.125 * dt * (v_0 - v)
        power = [self.force(*at) * at[1] for at in (state, (half, middle), (d, v))]
        lost = dt / 6.0 * (power[0] + 4.0 * power[1] + power[2])
        return Reaction(force, by_d, by_v, (d, v), lost)

    def settled(
        self, state: tuple[Array, Array], by: Array, faster: Array, stiffness: Array
    ) -> tuple[Array, Array]:
        """Further, and faster."""
        return state[0] + by, state[1] + faster

    def haste(self, dt: Array) -> Array:
        """None of their own: it is what they resist that relaxes."""
        return jnp.zeros_like(dt)

    def energy(self, d: Array, state: tuple[Array, Array]) -> Array:
        """None."""
        return jnp.zeros_like(d)


class Sliders(AbstractDiscrete):
    """A bank of sliders that follows where a step is settled.

    Attributes
    ----------
    bank : SliderBank
        Kinetic friction as static.
    """

    bank: SliderBank

    def init(self) -> SliderState:
        """All stick."""
        return self.bank.init()

    def step(self, d: Array, v: Array, dt: Array, state: SliderState) -> Reaction:
        """Move to d."""
        return self.bank.step(d, v, dt, state)

    def settled(
        self, state: SliderState, by: Array, faster: Array, stiffness: Array
    ) -> SliderState:
        """They follow a little further."""
        stretch = jnp.clip(state.stretch + by, -self.bank.phi, self.bank.phi)
        return state._replace(d=state.d + by, stretch=stretch)

    def energy(self, d: Array, state: SliderState) -> Array:
        """Of the springs."""
        return self.bank.energy(d, state)


class RelaxingSprings(AbstractDiscrete):
    """Springs in series with dashpots; they forget, and are left as they are where all is settled.

    Attributes
    ----------
    unit : Relaxing
        Of unit stiffness.
    stiffness : (times,) array
        Force/length.
    """

    unit: Relaxing
    stiffness: Array
    rate_dependent: ClassVar[bool] = True

    def init(self) -> RelaxingState:
        """At rest."""
        return self.unit.init()._replace(d=jnp.zeros(()))

    def step(self, d: Array, v: Array, dt: Array, state: RelaxingState) -> Reaction:
        """Move to d, to arrive at rate v."""
        each = self.unit.step(d, v, dt, state)
        sums = (
            jnp.sum(self.stiffness * x)
            for x in (each.force, each.stiffness, each.damping, each.loss)
        )
        force, stiffness, damping, loss = sums
        return Reaction(force, stiffness, damping, each.state, loss)

    def haste(self, dt: Array) -> Array:
        """Of the fastest that has any strength."""
        return jnp.max(jnp.where(self.stiffness > 0.0, dt / self.unit.c, 0.0))

    def energy(self, d: Array, state: RelaxingState) -> Array:
        """Of the springs."""
        return jnp.sum(self.stiffness * self.unit.energy(d, state))


class SideBySide(AbstractDiscrete):
    """Elements that move alike and whose forces add up.

    Attributes
    ----------
    elements : tuple of AbstractDiscrete
        Each of one force.
    """

    elements: tuple[AbstractDiscrete, ...]
    rate_dependent: ClassVar[bool] = True

    def init(self) -> tuple[Any, ...]:
        """At rest."""
        return tuple(each.init() for each in self.elements)

    def apart(self) -> tuple["SideBySide", Any]:
        """Without inertia, and the one that has it."""
        without, having = zip(*(each.apart() for each in self.elements), strict=True)
        return SideBySide(without), next((each for each in having if each is not None), None)

    def step(self, d: Array, v: Array, dt: Array, state: tuple[Any, ...]) -> Reaction:
        """Move to d, to arrive at rate v."""
        pairs = zip(self.elements, state, strict=True)
        found = [each.step(d, v, dt, own) for each, own in pairs]

        def total(of: str) -> Array:
            return sum((getattr(each, of) for each in found), jnp.zeros_like(d))

        after = tuple(each.state for each in found)
        return Reaction(total("force"), total("stiffness"), total("damping"), after, total("loss"))

    def settled(
        self, state: tuple[Any, ...], by: Array, faster: Array, stiffness: Array
    ) -> tuple[Any, ...]:
        """All follow a little further, as far as they know how to."""
        pairs = zip(self.elements, state, strict=True)
        return tuple(each.settled(own, by, faster, stiffness) for each, own in pairs)

    def haste(self, dt: Array) -> Array:
        """Of the hastiest."""
        return jnp.max(jnp.stack([jnp.zeros_like(dt), *(e.haste(dt) for e in self.elements)]))

    def energy(self, d: Array, state: tuple[Any, ...]) -> Array:
        """Of all."""
        pairs = zip(self.elements, state, strict=True)
        return sum((each.energy(d, own) for each, own in pairs), jnp.zeros_like(d))
