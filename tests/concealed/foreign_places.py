"""Cases whose physics is in no catalogue: forces that depend on rate and deflection, at one place.

`python tests/concealed/foreign_places.py OUT [--only NAME ...]` writes them as `study.py` does.
A law's size is such that the hardest recording changes by `CHANGE`.
"""

import argparse
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from concealed import physics
from concealed.acquisition import measure
from concealed.effects import Effect, Force, element
from concealed.plan import Case
from concealed.plan import _case as drawn
from concealed.structures import Array
from concealed.study import write

CHANGE = 0.3
"""Of the response by the effect, rms over rms, in the hardest recording."""
_SLOW, _SMALL = 0.02, 5e-5
"""Rates (m/s) and deflections (m) that are low where the chains are hit."""

Law = Callable[[Array, Array, Array, float], Array]
"""Force of size 1 by deflection, its rate, the element's memory and the step."""


def root_damper(d: Array, v: Array, memory: Array, dt: float) -> Array:
    """c sign(v) sqrt|v|, smooth within a hundredth of a low rate."""
    return v / np.sqrt(np.abs(v) + 0.01 * _SLOW)


def lugre(d: Array, v: Array, memory: Array, dt: float) -> Array:
    """Bristles that bend (Canudas de Wit 1995), kinetic over static friction 0.7."""
    z = memory[0]
    level = 0.7 + 0.3 * np.exp(-((v / _SLOW) ** 2))
    rate = np.abs(v) / (_SMALL * level)
    # Exact for a rate that is constant within the step.
    memory[0] = z * np.exp(-rate * dt) + v * dt * np.where(
        rate > 0, -np.expm1(-rate * dt) / np.where(rate > 0, rate * dt, 1.0), 1.0
    )
    return memory[0] / _SMALL + 0.1 * v / _SLOW


def displaced_damper(d: Array, v: Array, memory: Array, dt: float) -> Array:
    """A damper that grows with the square of the deflection."""
    return d**2 * v


def freeplay_with_friction(d: Array, v: Array, memory: Array, dt: float) -> Array:
    """A slider, and a spring beyond the play on either side."""
    memory[0] = np.clip(memory[0] + v * dt, -_SMALL, _SMALL)
    beyond = np.sign(d) * np.maximum(np.abs(d) - 4.0 * _SMALL, 0.0)
    return 0.5 * memory[0] + beyond


def nonlinear_inertia(d: Array, v: Array, memory: Array, dt: float) -> Array:
    """Of a mass m d^2: the force m (d^2 a + d v^2), by d/dt (d^2 v) - d v^2."""
    momentum = d**2 * v
    force = (momentum - memory[1]) / dt - d * v**2
    memory[1] = momentum
    return force


def tanh_spring(d: Array, v: Array, memory: Array, dt: float) -> Array:
    """A spring that softens to a limit."""
    return np.tanh(d / (2.0 * _SMALL))


LAWS: dict[str, tuple[Law, str]] = {
    "root_damper": (root_damper, "m3-m4"),
    "lugre": (lugre, "m2-m3"),
    "displaced_damper": (displaced_damper, "m4-m5"),
    "freeplay_with_friction": (freeplay_with_friction, "m5-ground"),
    "nonlinear_inertia": (nonlinear_inertia, "m3-ground"),
    "tanh_spring": (tanh_spring, "m3-m4"),
}


def _element(effect: Effect, recordings: int, dt: float) -> Force | None:
    """As of the other cases, or one of these laws; its rate is that of the step before."""
    if effect.kind not in LAWS:
        return element(effect, recordings, dt)
    law, _ = LAWS[effect.kind]
    (size,) = effect.each(recordings)
    memory, last = np.zeros((2, recordings)), np.zeros(recordings)

    def force(d: Array) -> Array:
        found = size * law(d, (d - last) / dt, memory, dt)
        last[:] = d
        return found

    return force


def case(name: str, number: int) -> Case:
    """A chain of six with one of the laws, sized."""
    planned = drawn(number, "chain6", ())
    where = LAWS[name][1]
    without, _ = measure(planned.structure, planned.true, (), [planned.hardest])

    def change(size: float) -> float:
        effect = Effect(name, where, (size,))
        with np.errstate(all="ignore"):
            found, _ = measure(planned.structure, planned.true, (effect,), [planned.hardest])
            off = math.sqrt(np.mean((found - without) ** 2) / np.mean(without**2))
        return off if math.isfinite(off) else math.inf

    low, high = -9.0, 15.0
    while high - low > 0.02:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if change(10.0**middle) < CHANGE else (low, middle)
    return replace(planned, effects=(Effect(name, where, (10.0**low,)),))


def main(arguments: list[str] | None = None) -> None:
    """Write the chosen cases into folders OUT/NAME."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("--only", nargs="+", choices=tuple(LAWS))
    chosen = parser.parse_args(arguments)
    with mock.patch.object(physics, "element", _element):
        for number, name in enumerate(LAWS, 700):
            if not chosen.only or name in chosen.only:
                write(case(name, number), chosen.out / name)


if __name__ == "__main__":
    main()
