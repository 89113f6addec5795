"""Forces that no catalogue names: of a place's deflection and rate, with memories of their own.

Every law is integrated as its equations say, in the steps of `physics.march`.
"""

from collections.abc import Callable, Mapping

import numpy as np

from iwanjax.trial.effects import Effect
from iwanjax.trial.structure import Array

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


def _pinched(dt: float, k: Array, slip: Array, deep: Array, at: Array, wide: Array) -> Law:
    """Bouc and Wen's with the exponent 1, pinched where it grows again (Baber and Noori 1985)."""
    z, last = np.zeros_like(k), np.zeros_like(k)

    def rate(z: Array, moved: Array) -> Array:
        share = np.sign(moved) * z / slip
        open_to = 1.0 - deep * np.exp(-(((share - at) / wide) ** 2))
        return moved * open_to * (1.0 - np.maximum(share, 0.0))

    def force(d: Array, v: Array) -> Array:
        moved = d - last
        last[:] = d
        half = z + 0.5 * rate(z, moved)
        z[:] = z + rate(half, moved)
        return k * z

    return force


def _fractional_damper(dt: float, c: Array, order: Array) -> Law:
    """A derivative of an order between 0 and 1, as springs that relax within 1e-6 to 1e3 s."""
    times = np.geomspace(1e-6, 1e3, 190)[:, None]
    of_each = np.sin(np.pi * order) / np.pi * times**-order * np.log(times[1] / times[0])
    stretch, last = np.zeros((len(times), c.size)), np.zeros_like(c)
    decay = np.exp(-dt / times)
    gain = times / dt * (1.0 - decay)

    def force(d: Array, v: Array) -> Array:
        stretch[:] = decay * stretch + gain * (d - last)
        last[:] = d
        return c * np.sum(of_each * stretch, axis=0)

    return force


def _attached_mass(dt: float, m: Array, omega: Array, ratio: Array) -> Law:
    """A mass on a spring and a damper, by the implicit midpoint rule."""
    y, rate, before = np.zeros_like(m), np.zeros_like(m), [np.zeros_like(m), np.zeros_like(m)]
    k, c = omega**2, 2.0 * ratio * omega

    def force(d: Array, v: Array) -> Array:
        base, carried = 0.5 * (before[0] + d), 0.5 * (before[1] + v)
        before[:] = [d.copy(), v.copy()]
        pull = k * (base - y - 0.5 * dt * rate) + c * (carried - rate)
        change = dt * pull / (1.0 + 0.5 * dt * c + 0.25 * dt**2 * k)
        y[:] = y + dt * (rate + 0.5 * change)
        rate[:] = rate + change
        return m * (k * (d - y) + c * (v - rate))

    return force


LAWS: Mapping[str, Callable[..., Law]] = {
    "softening": _softening,
    "root_damper": _root_damper,
    "smooth_hysteresis": _smooth_hysteresis,
    "bristles": _bristles,
    "rubbing_freeplay": _rubbing_freeplay,
    "squeezed_damper": _squeezed_damper,
    "growing_inertia": _growing_inertia,
    "pinched": _pinched,
    "fractional_damper": _fractional_damper,
    "attached_mass": _attached_mass,
}
"""By kind: of the step and the values, one number per recording each."""
SUM_OF: Mapping[str, tuple[str, ...]] = {"rubbing_freeplay": ("coulomb_friction", "gap_contact")}
"""Named kinds whose forces add up to a law's: all of them together are no wrong name for it."""


def foreign(effect: Effect, recordings: int, dt: float) -> Law | None:
    """The force of a law that has no name, or None for another kind."""
    law = LAWS.get(effect.kind)
    return None if law is None else law(dt, *effect.each(recordings))
