"""What a recorder adds: hum, offsets that wander, noise of colours, the steps of its converter."""

import numpy as np

from iwanjax.trial.structure import Array

BITS = 16
WANDER = 3
"""Half turns of the fastest part of a wandering offset within a recording."""


def hum(time: Array, amplitude: float, frequency: float, third: float, phase: float) -> Array:
    """Mains pick-up: the line's frequency and its third harmonic."""
    turn = 2 * np.pi * frequency * time + phase
    return amplitude * (np.sin(turn) + third * np.sin(3 * turn))


def wander(samples: int, rng: np.random.Generator) -> Array:
    """An offset that wanders, of unit rms and no mean: a trend and slow turns of random size."""
    s = np.linspace(0.0, 1.0, samples)
    turns = np.cos(np.pi * np.outer(np.arange(1, WANDER + 1), s))
    path = (rng.standard_normal(WANDER) / np.arange(1, WANDER + 1)) @ turns
    path = path + rng.choice([-1.0, 1.0]) * s
    path -= path.mean()
    return path / np.sqrt(np.mean(path**2))


def white(samples: int, channels: int, rng: np.random.Generator) -> Array:
    """White noise (sample, channel) of unit standard deviation."""
    return rng.standard_normal((samples, channels))


def pink(samples: int, channels: int, rng: np.random.Generator) -> Array:
    """Noise (sample, channel) of unit standard deviation: half its power white, half as 1 / f."""
    f = np.fft.rfftfreq(samples)
    shape = np.zeros_like(f)
    shape[1:] = f[1:] ** -0.5
    spectrum = np.fft.rfft(white(samples, channels, rng), axis=0) * shape[:, None]
    coloured = np.fft.irfft(spectrum, samples, axis=0)
    coloured /= coloured.std(axis=0)
    return np.sqrt(0.5) * (coloured + white(samples, channels, rng))


def quantised(signal: Array, full_scale: Array | float) -> Array:
    """Signal in the steps of a 16-bit converter from -full_scale to full_scale."""
    step = full_scale / 2 ** (BITS - 1)
    return np.rint(signal / step) * step
