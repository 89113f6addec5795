"""Inertia of the general law: a mass, one that grows with the deflection, one that resonates."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.joints.attached_oscillator import Attached, AttachedState
from iwanjax.joints.discrete import AbstractDiscrete, Reaction

# Circular frequency of what holds a mass on its foot, critically damped, over that of the law's
# period. At a frequency w it carries (w / held)^2 more than the mass: 1 % at a tenth.
_HELD = 300.0


class Masses(AbstractDiscrete):
    r"""Masses on feet that move with a place, :math:`y = d` and :math:`y = d^2/2D`.

    The second's kinetic energy :math:`\frac12 m (d/D)^2\dot d^2` is that of a mass that grows with
    the square of the deflection,

    .. math:: F = m\left[(d/D)^2\,\ddot d + d\,\dot d^2/D^2\right] = m\,\ddot y\,\frac{dy}{dd} .

    Each is an :class:`~iwanjax.joints.AttachedOscillator`: forces follow from deflections and rates
    alone, and no history feeds energy. These two are held stiffly, far above the motion; a third
    one, on a foot that moves as the first one's, resonates.

    Attributes
    ----------
    m : (3,) array
        Force x time^2/length.
    D : array
        Deflection at which the second one is m, length.
    held : Attached
        Masses of 1 on their feet, (3,).
    """

    m: Array
    D: Array
    held: Attached
    rate_dependent: ClassVar[bool] = True

    @classmethod
    def of(
        cls, force: Array, deflection: Array, rate: Array, period: Array, resonance: Array
    ) -> "Masses":
        """Of their forces (3,) at the acceleration of a harmonic motion of that period."""
        omega = 2.0 * np.pi / period
        # Held critically damped; the last one as it resonates.
        times, ratio = jnp.array([[_HELD, _HELD, 1.0], [1.0, 1.0, 1.0]])
        own = omega * times.at[2].set(jnp.exp(resonance[0]))
        damped = 2.0 * ratio.at[2].set(jnp.exp(resonance[1])) * own
        held = Attached(jnp.ones_like(own), own**2, damped)
        return cls(force / (rate * omega), deflection, held)

    def init(self) -> AttachedState:
        """At rest; leaves are of all masses, (3, ...)."""
        return jax.vmap(Attached.init)(self.held)

    def step(self, d: Array, v: Array, dt: Array, state: AttachedState) -> Reaction:
        """Move to d, to arrive at rate v."""
        foot, rate, arm = self._feet(d, v)
        found = jax.vmap(Attached.step, (0, 0, 0, None, 0))(self.held, foot, rate, dt, state)
        turned = jnp.stack([jnp.zeros_like(d), jnp.ones_like(d), jnp.zeros_like(d)]) / self.D
        own = found.stiffness * arm + found.damping * turned * v
        return Reaction(
            jnp.sum(self.m * found.force * arm),
            jnp.sum(self.m * (own * arm + found.force * turned)),
            jnp.sum(self.m * found.damping * arm**2),
            found.state,
            jnp.sum(self.m * found.loss),
        )

    def settled(
        self, state: AttachedState, by: Array, faster: Array, stiffness: Array
    ) -> AttachedState:
        """The same step with another end, exact as its feet are."""
        # The first one's foot is where the place is.
        foot, rate, _ = self._feet(state.d[0] + by, state.v[0] + faster)
        settle = jax.vmap(Attached.settled, (0, 0, 0, 0, None))
        return settle(self.held, state, foot - state.d, rate - state.v, jnp.zeros_like(by))

    def apart(self) -> tuple["Masses", "Masses"]:
        """Without those that do not resonate, and all of them."""
        return eqx.tree_at(lambda e: e.m, self, self.m.at[:2].set(0.0)), self

    def haste(self, dt: Array) -> Array:
        """None: their step is exact, and what holds them stiffly is no part of the law."""
        return jnp.zeros_like(dt)

    def force(self, d: Array, v: Array, a: Array) -> Array:
        """Of what is held stiffly, where the acceleration is known: (...,) as all of these."""
        x = d / self.D
        return self.m[0] * a + self.m[1] * x * (x * a + v**2 / self.D)

    def at(self, d: Array) -> Array:
        """What these weigh at a deflection."""
        return self.m[0] + self.m[1] * (d / self.D) ** 2

    def energy(self, d: Array, state: AttachedState) -> Array:
        """Of the masses in motion and of what holds them, force x length."""
        return jnp.sum(self.m * jax.vmap(Attached.energy)(self.held, state.d, state))

    def dissipation(self, d: Array, omega: Array) -> Array:
        """Of the one that resonates in a harmonic cycle of amplitude d."""
        m, k, c = self.m[2], self.held.k[2], self.held.c[2]
        drag = c * omega
        return jnp.pi * d**2 * m * omega**4 * drag / ((k - omega**2) ** 2 + drag**2)

    def _feet(self, d: Array, v: Array) -> tuple[Array, Array, Array]:
        """Deflections and rates of all feet, and by what they move with the place, (3,) each."""
        x = d / self.D
        arm = jnp.stack([jnp.ones_like(x), x, jnp.ones_like(x)])
        return jnp.stack([d, 0.5 * d * x, d]), arm * v, arm
