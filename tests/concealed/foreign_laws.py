"""Forces that no catalogue names: of a place's deflection and rate, with memories of their own.

Every law is integrated as its equations say, in the steps of `physics.march`.
"""

from collections.abc import Callable, Mapping

import numpy as np
from concealed.effects import Effect
from concealed.structures import Array

Law = Callable[[Array, Array], Array]
"""Force of a local element per recording, from its deflection and rate per recording."""


def _softening(dt: float, k: Array, width: Array) -> Law:
    """A spring that softens to a limit."""
    return lambda d, v: k * width * np.tanh(d / width)


def _root_damper(dt: float, c: Array, rest: Array) -> Law:
    """By the root of the rate, smooth about a low one."""
    return lambda d, v: c * v / np.sqrt(np.abs(v) + rest)


def _squeezed_damper(dt: float, c: Array) -> Law:
    """A damper that grows with the square of the deflection."""
    return lambda d, v: c * d**2 * v


def _growing_inertia(dt: float, m: Array) -> Law:
    """Of a mass m d^2: the force m (d^2 a + d v^2), by d/dt (d^2 v) - d v^2."""
    last = np.zeros_like(m)

    def force(d: Array, v: Array) -> Array:
        momentum = m * d**2 * v
        found = (momentum - last) / dt - m * d * v**2
        last[:] = momentum
        return found

    return force


def _smooth_hysteresis(dt: float, k: Array, slip: Array, n: Array) -> Law:
    """Bouc and Wen's, by Runge and Kutta's rule over each step, in which z turns once at most."""
    z, last = np.zeros_like(k), np.zeros_like(k)

    def rate(z: Array, moved: Array) -> Array:
        return moved * (1.0 - np.where(moved * z > 0, np.abs(z / slip) ** n, 0.0))

    def force(d: Array, v: Array) -> Array:
        moved = d - last
        last[:] = d
        first = rate(z, moved)
        second = rate(z + 0.5 * first, moved)
        third = rate(z + 0.5 * second, moved)
        z[:] = z + (first + 2.0 * second + 2.0 * third + rate(z + third, moved)) / 6.0
        return k * z

    return force


def _bristles(dt: float, s0: Array, s1: Array, s2: Array, *friction: Array) -> Law:
    """LuGre friction (Canudas de Wit et al. 1995): s0, s1, s2, then Fc, Fs and vs.

    Exact for a rate that is even over a step: the mean of those at its ends.
    """
    Fc, Fs, vs = friction
    z, before = np.zeros_like(s0), np.zeros_like(s0)

    def force(d: Array, v: Array) -> Array:
        mean = 0.5 * (v + before)
        before[:] = v
        g = (Fc + (Fs - Fc) * np.exp(-((mean / vs) ** 2))) / s0
        end = np.sign(mean) * g
        z[:] = end + (z - end) * np.exp(-np.abs(mean) * dt / g)
        return s0 * z + s1 * (v - np.abs(v) * z / g) + s2 * v

    return force


def _rubbing_freeplay(dt: float, k: Array, gap: Array, F: Array) -> Law:
    """A clearance, and dry friction in it."""
    stretch, last, slip = np.zeros_like(k), np.zeros_like(k), F / k

    def force(d: Array, v: Array) -> Array:
        stretch[:] = np.clip(stretch + d - last, -slip, slip)
        last[:] = d
        return k * stretch + k * (np.maximum(d - gap, 0.0) - np.maximum(-d - gap, 0.0))

    return force


LAWS: Mapping[str, Callable[..., Law]] = {
    "softening": _softening,
    "root_damper": _root_damper,
    "smooth_hysteresis": _smooth_hysteresis,
    "bristles": _bristles,
    "rubbing_freeplay": _rubbing_freeplay,
    "squeezed_damper": _squeezed_damper,
    "growing_inertia": _growing_inertia,
}
"""By kind: of the step and the values, one number per recording each."""


def foreign(effect: Effect, recordings: int, dt: float) -> Law | None:
    """The force of a law that has no name, or None for another kind."""
    law = LAWS.get(effect.kind)
    return None if law is None else law(dt, *effect.each(recordings))
