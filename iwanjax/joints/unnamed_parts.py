"""Parts of the general law: a spring whose slope changes at knots, and springs that yield."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.joints.unnamed_terms import INTERVALS, KNOTS


class SplineSpring(NamedTuple):
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
        inside = jnp.clip(x, -1.0, 1.0)
        i = jnp.clip(jnp.searchsorted(KNOTS, inside, side="right") - 1, 0, len(KNOTS) - 2)
        return inside - jnp.asarray(KNOTS)[i], tuple(self.c[j][i] for j in range(5)), x - inside

    def curve(self, d: Array) -> tuple[Array, Array]:
        """Force and tangent, force/length."""
        t, (_, f, s, m, q), beyond = self._at(d)
        slope = s + t * (m + 0.5 * q * t)
        force = f + t * (s + t * (m / 2.0 + q * t / 6.0))
        return force + slope * beyond, slope / self.D

    def energy(self, d: Array) -> Array:
        """Stored, force x length."""
        t, (e, f, s, m, q), beyond = self._at(d)
        stored = e + t * (f + t * (s / 2.0 + t * (m / 6.0 + q * t / 24.0)))
        force = f + t * (s + t * (m / 2.0 + q * t / 6.0))
        slope = s + t * (m + 0.5 * q * t)
        return self.D * (stored + beyond * (force + 0.5 * slope * beyond))


class YieldingSprings(NamedTuple):
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

    def cycle(self, amplitude: Array) -> Array:
        """Energy lost in a steady cycle, force x length."""
        y = self._tip(amplitude)
        work = 2.0 * (y + jnp.log1p(jnp.exp(-2.0 * y)) - np.log(2.0))
        return jnp.sum(self.force * self.phi * (work - jnp.tanh(y) ** 2), axis=-1)

    def loading(self, d: Array, amplitude: Array) -> Array:
        """Force on the loading branch of a steady cycle."""
        z = self.onward(-jnp.tanh(self._tip(amplitude)), (d + amplitude)[..., None])
        return jnp.sum(self.force * z, axis=-1)
