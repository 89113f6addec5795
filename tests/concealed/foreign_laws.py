"""Forces that no catalogue names: of a place's deflection and rate, with memories of their own.

Every law is integrated as its equations say, in the steps of `physics.march`.
"""

from collections.abc import Callable

import numpy as np
from concealed.effects import Effect
from concealed.structures import Array

Law = Callable[[Array, Array], Array]
"""Force of a local element per recording, from its deflection and rate per recording."""

PARAMETERS = {
    "softening": ("k", "width"),  # k width tanh(d / width)
    "root_damper": ("c", "rest"),  # c v / sqrt(|v| + rest)
    "smooth_hysteresis": ("k", "slip", "n"),  # Bouc and Wen
    "bristles": ("s0", "s1", "s2", "Fc", "Fs", "vs"),  # Canudas de Wit et al. (1995), LuGre
    "rubbing_freeplay": ("k", "gap", "F"),  # a clearance, and dry friction in it
    "squeezed_damper": ("c",),  # c d^2 v
}


def _smooth_hysteresis(k: Array, slip: Array, n: Array) -> Law:
    """By the classical Runge-Kutta rule over each step, which no turn of z interrupts but once."""
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
    """Exact for a rate that is even over a step: the mean of those at its ends."""
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


def _rubbing_freeplay(k: Array, gap: Array, F: Array) -> Law:
    stretch, last, slip = np.zeros_like(k), np.zeros_like(k), F / k

    def force(d: Array, v: Array) -> Array:
        stretch[:] = np.clip(stretch + d - last, -slip, slip)
        last[:] = d
        return k * stretch + k * (np.maximum(d - gap, 0.0) - np.maximum(-d - gap, 0.0))

    return force


def foreign(effect: Effect, recordings: int, dt: float) -> Law | None:
    """The force of a law that has no name, or None for another kind."""
    values = effect.each(recordings)
    match effect.kind:
        case "softening":
            return lambda d, v: values[0] * values[1] * np.tanh(d / values[1])
        case "root_damper":
            return lambda d, v: values[0] * v / np.sqrt(np.abs(v) + values[1])
        case "squeezed_damper":
            return lambda d, v: values[0] * d**2 * v
        case "smooth_hysteresis":
            return _smooth_hysteresis(*values)
        case "bristles":
            return _bristles(dt, *values)
        case "rubbing_freeplay":
            return _rubbing_freeplay(*values)
    return None
