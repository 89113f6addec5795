"""An oscillator driven throughout its recordings, from rest: NumPy only.

The force is a sum of cosines of known phases, so that it is known between samples as well; the
cubic spring acts by half a kick before and half a kick after each exact linear step.
"""

import numpy as np
import scipy.linalg

import iwanjax as ij

RATE = 600.0
STEPS = 8
MASS, FREQUENCY = 2.0, 60.0
STIFFNESS = MASS * (2.0 * np.pi * FREQUENCY) ** 2
CUBIC = 0.4 * STIFFNESS / 1e-3**2
"""At a deflection of 1 mm as stiff again as 0.4 of the linear spring."""
NOISE = 1e-6
BAND = (20.0, 110.0)
ROW = np.ones(1)


def damper(ratio: float) -> float:
    """Coefficient of a share of critical damping."""
    return 2.0 * ratio * MASS * 2.0 * np.pi * FREQUENCY


def force_at(t: np.ndarray, level: float, seed: int) -> np.ndarray:
    """A multisine that begins within a few samples, of root mean square ``level``."""
    random = np.random.default_rng(seed)
    f = np.arange(*BAND, 1.3)
    waves = np.cos(2.0 * np.pi * (np.outer(t, f) + random.random(f.size))) @ np.ones(f.size)
    return level * np.sqrt(2.0 / f.size) * np.tanh(40.0 * t) * waves


def recording(
    samples: int, level: float, seed: int, damping: float = 0.05, cubic: float = CUBIC
) -> tuple[np.ndarray, np.ndarray]:
    """Displacement, with noise, and force, (samples, 1) each."""
    dt = 1.0 / (RATE * STEPS)
    push = force_at(dt * np.arange(samples * STEPS + 1), level, seed).tolist()
    A = np.array([[0.0, 1.0], [-STIFFNESS / MASS, -damper(damping) / MASS]])
    a, b, c, d = np.ravel(scipy.linalg.expm(A * dt)).tolist()
    x, v, half, seen = 0.0, 0.0, 0.5 * dt / MASS, []
    for n in range(samples * STEPS):
        if n % STEPS == 0:
            seen.append(x)
        v += half * (push[n] - cubic * x**3)
        x, v = a * x + b * v, c * x + d * v
        v += half * (push[n + 1] - cubic * x**3)
    noise = NOISE * np.random.default_rng(1000 + seed).standard_normal(samples)
    return (np.array(seen) + noise)[:, None], np.array(push[:-1:STEPS])[:, None]


def linear(damping: float = 0.05) -> ij.LinearStructure:
    """The same without the cubic spring."""
    one = np.ones((1, 1))
    return ij.LinearStructure(MASS * one, damper(damping) * one, STIFFNESS * one)
