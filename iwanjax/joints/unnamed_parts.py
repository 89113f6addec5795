"""Parts of the general law: a spring whose slope changes at knots, and springs that yield."""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.joints import duhem
from iwanjax.joints.discrete import AbstractDiscrete, Reaction
from iwanjax.joints.duhem import YieldedState
from iwanjax.joints.unnamed_terms import INTERVALS, KNOTS, OUTSIDE

CYCLE = 128
"""Steps that losses of a cycle are summed over: exact for powers of the rate to 1e-4."""


class SplineSpring(AbstractDiscrete):
    """Polynomials of the spring between its knots, in d/D.

    Attributes
    ----------
    D : array
        Length.
    c : (5, knots - 1) array
        Energy over D, force, slope, its derivative and that one's, at each interval's left knot.
    """

    D: Array
    c: Array

    @classmethod
    def of(cls, strengths: Array, D: Array) -> "SplineSpring":
        """Of the strengths of its terms, force."""
        return cls(D, jnp.asarray(INTERVALS) @ strengths)

    def _at(self, d: Array) -> tuple[Array, tuple[Array, ...], Array]:
        x = d / self.D
        inside = jnp.clip(x, -OUTSIDE, OUTSIDE)
        i = jnp.clip(jnp.searchsorted(KNOTS, inside, side="right") - 1, 0, len(KNOTS) - 2)
        return inside - jnp.asarray(KNOTS)[i], tuple(self.c[j][i] for j in range(5)), x - inside

    def curve(self, d: Array) -> tuple[Array, Array]:
        """Force and tangent, force/length."""
        t, (_, f, s, m, q), beyond = self._at(d)
        slope = s + t * (m + 0.5 * q * t)
        force = f + t * (s + t * (m / 2.0 + q * t / 6.0))
        return force + slope * beyond, slope / self.D

    def init(self) -> tuple[()]:
        """Nothing."""
        return ()

    def step(self, d: Array, v: Array, dt: Array, state: tuple[()]) -> Reaction:
        """The curve at d."""
        force, stiffness = self.curve(d)
        none = jnp.zeros_like(force)
        return Reaction(force, stiffness, none, (), none)

    def energy(self, d: Array, state: tuple[()]) -> Array:
        """Stored, force x length."""
        t, (e, f, s, m, q), beyond = self._at(d)
        stored = e + t * (f + t * (s / 2.0 + t * (m / 6.0 + q * t / 24.0)))
        force = f + t * (s + t * (m / 2.0 + q * t / 6.0))
        slope = s + t * (m + 0.5 * q * t)
        return self.D * (stored + beyond * (force + 0.5 * slope * beyond))


class YieldingSprings(AbstractDiscrete):
    """Bouc and Wen's springs with the exponent 2, z the force over that at the slip.

    Attributes
    ----------
    force : (springs,) array
        At the slip.
    phi : (springs,) array
        Slip, length.
    """

    force: Array
    phi: Array

    def onward(self, z: Array, moved: Array) -> Array:
        """Shares after a monotonic step: straight to zero where they fall, from there the tanh."""
        way = jnp.where(moved < 0.0, -1.0, 1.0)
        w, u = way * z, jnp.abs(moved) / self.phi
        left = jnp.minimum(w, 0.0) + u
        begin, grown = jnp.maximum(w, 0.0), jnp.tanh(jnp.maximum(left, 0.0))
        return way * jnp.where(left < 0.0, left, (begin + grown) / (1.0 + begin * grown))

    def lost(self, z: Array, after: Array, moved: Array) -> Array:
        r"""Energy of such a step, force x length: work less what the springs store.

        From the share w on over u slips the work is :math:`\ln(\cosh u + w\sinh u)`; none is lost
        where a share falls.
        """
        way = jnp.where(moved < 0.0, -1.0, 1.0)
        begin, end = (jnp.maximum(way * x, 0.0) for x in (z, after))
        u = jnp.maximum(jnp.minimum(way * z, 0.0) + jnp.abs(moved) / self.phi, 0.0)
        work = u + jnp.log(0.5 * (1.0 + begin) + 0.5 * (1.0 - begin) * jnp.exp(-2.0 * u))
        lost = jnp.maximum(work - 0.5 * (end - begin) * (end + begin), 0.0)
        return jnp.sum(self.force * self.phi * lost, axis=-1)

    def init(self) -> YieldedState:
        """At rest."""
        return YieldedState.none(self.force)

    def step(self, d: Array, v: Array, dt: Array, state: YieldedState) -> Reaction:
        """Move to d, to arrive at rate v."""
        # Of the state's own deflection: what settles a step has moved it.
        moved, begun = d - state.d, state.share
        z, slope = jax.jvp(lambda by: self.onward(begun, by), (moved,), (jnp.ones_like(d),))
        return Reaction(
            jnp.sum(self.force * z),
            jnp.sum(self.force * slope),
            jnp.zeros_like(d),
            YieldedState(d, v, z),
            self.lost(begun, z, moved),
        )

    def settled(
        self, state: YieldedState, by: Array, faster: Array, stiffness: Array
    ) -> YieldedState:
        """They follow a little further."""
        return YieldedState(state.d + by, state.v + faster, self.onward(state.share, by))

    def energy(self, d: Array, state: YieldedState) -> Array:
        """Of the springs."""
        return 0.5 * jnp.sum(self.force * self.phi * state.share**2)

    def curve(self, d: Array) -> tuple[Array, Array]:
        """Virgin force and tangent."""
        z = jnp.tanh(d[..., None] / self.phi)
        slope = self.force / self.phi * (1.0 - z) * (1.0 + z)
        return jnp.sum(self.force * z, axis=-1), jnp.sum(slope, axis=-1)

    def _tip(self, amplitude: Array) -> Array:
        """Of a steady cycle the y of the share tanh y at its tip: tanh y + y = 2 d/phi."""
        reach = 2.0 * amplitude[..., None] / self.phi
        y = reach
        for _ in range(30):
            w = jnp.tanh(y)
            y = jnp.maximum(y - (w + y - reach) / (2.0 - w**2), 0.5 * reach)
        return y

    def tip_stiffness(self, amplitude: Array) -> Array:
        """Of a slow decay, force/length."""
        w, u = jnp.tanh(self._tip(amplitude)), amplitude[..., None] / self.phi
        onward = (1.0 - w) * (1.0 + w)
        each = duhem.tip_stiffness(w, onward, jnp.ones_like(w), u, self.force / self.phi)
        return jnp.sum(each, axis=-1)

    def cycle(self, amplitude: Array) -> Array:
        """Energy lost in a steady cycle, force x length."""
        y = self._tip(amplitude)
        work = 2.0 * (y + jnp.log1p(jnp.exp(-2.0 * y)) - np.log(2.0))
        return jnp.sum(self.force * self.phi * (work - jnp.tanh(y) ** 2), axis=-1)

    def loading(self, d: Array, amplitude: Array) -> Array:
        """Force on the loading branch of a steady cycle."""
        z = self.onward(-jnp.tanh(self._tip(amplitude)), (d + amplitude)[..., None])
        return jnp.sum(self.force * z, axis=-1)


class Bristles(AbstractDiscrete):
    r"""Springs that yield gradually either way, w the force over that at the slip.

    .. math:: \phi\dot w = v - |v|\,w/g, \qquad g = \frac{1 + 2e^{-(av)^2}}{3}

    Dahl's friction (1976) where a is zero; else it weakens with the rate, as that of Canudas de
    Wit et al. (IEEE Trans. Automat. Contr. 40, 1995) without its dampers. The springs store
    :math:`F\phi w^2/2` and lose :math:`F|v|w^2/g`, which no rate makes negative.

    Attributes
    ----------
    force : (bristles,) array
        At the slip, slowly.
    phi : (bristles,) array
        Slip, length.
    a : (bristles,) array
        Time/length.
    """

    force: Array
    phi: Array
    a: Array
    rate_dependent: ClassVar[bool] = True

    def init(self) -> YieldedState:
        """At rest."""
        return YieldedState.none(self.force)

    def step(self, d: Array, v: Array, dt: Array, state: YieldedState) -> Reaction:
        """Move to d, to arrive at rate v."""
        moved, mean, begun = d - state.d, 0.5 * (state.v + v), state.share
        one = jnp.ones_like(d)
        w, bent = jax.jvp(lambda by: self.onward(begun, by, mean), (moved,), (one,))
        _, faded = jax.jvp(lambda v: self.onward(begun, moved, v), (mean,), (0.5 * one,))
        return Reaction(
            jnp.sum(self.force * w),
            jnp.sum(self.force * bent),
            jnp.sum(self.force * faded),
            YieldedState(d, v, w),
            self.lost(begun, w, moved, mean),
        )

    def settled(
        self, state: YieldedState, by: Array, faster: Array, stiffness: Array
    ) -> YieldedState:
        """They follow a little further."""
        after = self.onward(state.share, by, state.v)
        return YieldedState(state.d + by, state.v + faster, after)

    def haste(self, dt: Array) -> Array:
        """None: a rate only weakens them."""
        return jnp.zeros_like(dt)

    def energy(self, d: Array, state: YieldedState) -> Array:
        """Of the springs."""
        return 0.5 * jnp.sum(self.force * self.phi * state.share**2)

    def limit(self, v: Array) -> Array:
        """Of steady slip, over that of a slow one."""
        return (1.0 + 2.0 * jnp.exp(-((self.a * v) ** 2))) / 3.0

    def onward(self, w: Array, moved: Array, v: Array) -> Array:
        """Shares after a monotonic step at a mean rate, exact for an even one."""
        limit, way = self.limit(v), jnp.where(moved < 0.0, -1.0, 1.0)
        end = way * limit
        return end + (w - end) * jnp.exp(-jnp.abs(moved) / (self.phi * limit))

    def lost(self, w: Array, after: Array, moved: Array, v: Array) -> Array:
        """Energy of such a step, force x length: work less what the springs store."""
        limit, way, far = self.limit(v), jnp.where(moved < 0.0, -1.0, 1.0), jnp.abs(moved)
        within = self.phi * limit
        begun = way * w - limit
        work = limit * far - begun * within * jnp.expm1(-far / within)
        stored = 0.5 * self.phi * (after - w) * (after + w)
        return jnp.sum(self.force * jnp.maximum(work - stored, 0.0), axis=-1)

    def curve(self, d: Array) -> tuple[Array, Array]:
        """Virgin force and tangent, slowly."""
        x = jnp.abs(d[..., None]) / self.phi
        force = -jnp.sign(d) * jnp.sum(self.force * jnp.expm1(-x), axis=-1)
        return force, jnp.sum(self.force / self.phi * jnp.exp(-x), axis=-1)

    def tip_stiffness(self, amplitude: Array) -> Array:
        r"""Of a slow decay, :math:`F\,[1 - \tanh^2(d/\phi)]\tanh(d/\phi)/d`, force/length."""
        u = amplitude[..., None] / self.phi
        w = jnp.tanh(u)
        each = duhem.tip_stiffness(w, 1.0 - w, 1.0 + w, u, self.force / self.phi)
        return jnp.sum(each, axis=-1)

    def loading(self, d: Array, amplitude: Array) -> Array:
        """Force on the loading branch of a steady slow cycle."""
        begun = -jnp.tanh(amplitude[..., None] / self.phi)
        w = self.onward(begun, (d + amplitude)[..., None], jnp.zeros(()))
        return jnp.sum(self.force * w, axis=-1)

    def cycle(self, amplitude: Array, omega: Array) -> Array:
        """Energy lost in a steady harmonic cycle, force x length: twice that of its third half."""
        phase = np.pi * np.arange(3 * CYCLE) / CYCLE
        begun = -jnp.tanh(amplitude[..., None] / self.phi)

        def step(w: Array, at: Array) -> tuple[Array, Array]:
            begin, end = -jnp.cos(at), -jnp.cos(at + np.pi / CYCLE)
            moved = (amplitude * (end - begin))[..., None]
            v = (omega * amplitude * jnp.sin(at + 0.5 * np.pi / CYCLE))[..., None]
            after = self.onward(w, moved, v)
            return after, self.lost(w, after, moved, v)

        lost = jax.lax.scan(step, begun, jnp.asarray(phase))[1]
        return 2.0 * jnp.sum(lost[-CYCLE:], axis=0)
