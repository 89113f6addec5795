"""Inertia of the general law: a mass, and one that grows with the square of the deflection."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.joints.attached_oscillator import Attached, AttachedState
from iwanjax.joints.discrete import Reaction

# Circular frequency of what holds a mass on its foot, critically damped, over that of the law's
# period. At a frequency w it carries (w / held)^2 more than the mass: 1 % at a tenth.
_HELD = 300.0


class Masses(NamedTuple):
    r"""Masses held stiffly on feet that move with a place, :math:`y = d` and :math:`y = d^2/2D`.

    The second's kinetic energy :math:`\frac12 m (d/D)^2\dot d^2` is that of a mass that grows with
    the square of the deflection,

    .. math:: F = m\left[(d/D)^2\,\ddot d + d\,\dot d^2/D^2\right] = m\,\ddot y\,\frac{dy}{dd} .

    Each is an :class:`~iwanjax.joints.AttachedOscillator` far above the motion: forces follow from
    deflections and rates alone, and no history feeds energy.

    Attributes
    ----------
    m : (2,) array
        Force x time^2/length.
    D : array
        Deflection at which the second one is m, length.
    held : Attached
        A mass of 1 on its foot.
    """

    m: Array
    D: Array
    held: Attached

    @classmethod
    def of(cls, force: Array, deflection: Array, rate: Array, period: Array) -> "Masses":
        """Of their forces (2,) at the acceleration of a harmonic motion of that period."""
        omega = 2.0 * np.pi / period
        one = jnp.ones_like(omega)
        held = Attached(one, (_HELD * omega) ** 2, 2.0 * _HELD * omega)
        return cls(force / (rate * omega), deflection, held)

    def init(self) -> AttachedState:
        """At rest; leaves are of both masses, (2, ...)."""
        return jax.tree.map(lambda x: jnp.stack([x, x]), self.held.init())

    def step(self, d: Array, v: Array, dt: Array, state: AttachedState) -> Reaction:
        """Move to d, to arrive at rate v."""
        foot, rate, arm = self._feet(d, v)
        found = jax.vmap(self.held.step, (0, 0, None, 0))(foot, rate, dt, state)
        turned = jnp.stack([jnp.zeros_like(d), jnp.ones_like(d)]) / self.D
        own = found.stiffness * arm + found.damping * turned * v
        return Reaction(
            jnp.sum(self.m * found.force * arm),
            jnp.sum(self.m * (own * arm + found.force * turned)),
            jnp.sum(self.m * found.damping * arm**2),
            found.state,
            jnp.sum(self.m * found.loss),
        )

    def settled(
        self, state: AttachedState, d: Array, v: Array, by: Array, faster: Array
    ) -> AttachedState:
        """The same step from a state at d and v with another end, exact as its feet are."""
        foot, rate, _ = self._feet(d + by, v + faster)
        settle = jax.vmap(self.held.settled, (0, 0, 0, None))
        return settle(state, foot - state.d, rate - state.v, jnp.zeros_like(d))

    def force(self, d: Array, v: Array, a: Array) -> Array:
        """Where the acceleration is known: (...,) as the deflection, its rate and that."""
        x = d / self.D
        return self.m[0] * a + self.m[1] * x * (x * a + v**2 / self.D)

    def energy(self, state: AttachedState) -> Array:
        """Of the masses in motion and of what holds them, force x length."""
        return jnp.sum(self.m * jax.vmap(self.held.energy)(state.d, state))

    def _feet(self, d: Array, v: Array) -> tuple[Array, Array, Array]:
        """Deflections and rates of both feet, and by what they move with the place, (2,) each."""
        x = d / self.D
        arm = jnp.stack([jnp.ones_like(x), x])
        return jnp.stack([d, 0.5 * d * x]), arm * v, arm
