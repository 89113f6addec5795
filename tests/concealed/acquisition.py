"""What a recorder makes of the true accelerations and forces.

The measurement chain, in its order: the transducer with its faults (gain, polarity, delay,
high-pass), the anti-alias filter, what is added (hum, offset that wanders, noise), the converter
(limit, steps).
The anti-alias filter is linear, so that it need not know what comes before it.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from concealed.effects import Effect
from concealed.physics import FILTER_SPAN, Hit, integrate
from concealed.structures import Array, Iwan, Structure
from numpy.typing import NDArray
from scipy.signal import bilinear, firwin, lfilter, upfirdn

BITS = 16
WANDER = 3
"""Half turns of the fastest part of a wandering offset within a recording."""


def decimate(signal: Array, samples: int, oversampling: int, first: int = 0) -> Array:
    """Zero-phase anti-alias filter at 0.4 of the sampling rate; its samples from `first` on."""
    taps = firwin(2 * FILTER_SPAN * oversampling + 1, 0.8 / oversampling, window=("kaiser", 8.0))
    begin = FILTER_SPAN + first
    return upfirdn(taps, signal, down=oversampling, axis=0)[begin : begin + samples]


def _delayed(signal: Array, steps: NDArray[np.int64]) -> Array:
    """Shift each recording's history (step, recording) by its own number of fine steps."""
    late = np.zeros_like(signal)
    for i, by in enumerate(steps):
        late[by:, i] = signal[: len(signal) - by, i]
    return late


def high_passed(signal: Array, corner: float, rate: float) -> Array:
    """Signal (step, ...) after AC coupling: s / (s + 2 pi corner), at rest before."""
    return lfilter(*bilinear([1.0, 0.0], [1.0, 2 * np.pi * corner], rate), signal, axis=0)  # type: ignore[return-value]


def transduced(
    channel: str,
    labels: Sequence[str],
    effects: Sequence[Effect],
    signal: Array,
    structure: Structure,
    oversampling: int,
) -> Array:
    """Histories (step, recording, label) as faulty channels see them: sensors, or forces."""
    signal = signal.copy()
    for effect in effects:
        if not effect.kind.startswith(channel):
            continue
        at, values = list(labels).index(effect.where), effect.each(signal.shape[1])
        match effect.kind.removeprefix(f"{channel}_"):
            case "gain":
                signal[..., at] *= values[0]
            case "polarity":
                signal[..., at] *= -1.0
            case "delay":
                shift = np.rint(values[0] * oversampling).astype(int)
                signal[..., at] = _delayed(signal[..., at], shift)
            case "high_pass":
                rate = structure.rate * oversampling
                signal[..., at] = high_passed(signal[..., at], float(values[0][0]), rate)
    return signal


def measure(
    structure: Structure,
    joints: Mapping[str, Iwan],
    effects: Sequence[Effect],
    hits: Sequence[Hit],
    oversampling: int | None = None,
    thrown: Array | None = None,
) -> tuple[Array, Array]:
    """Responses (sample, recording, sensor) and forces (sample, recording) to hammer blows.

    Free of noise, and before the converter (see `saturate`).
    """
    oversampling = oversampling or structure.steps
    fine = integrate(structure, joints, effects, hits, oversampling, thrown=thrown)
    seen = transduced(
        "sensor", list(structure.sensors), effects, fine.response, structure, oversampling
    )
    return (
        decimate(seen, structure.samples, oversampling),
        decimate(fine.force, structure.samples, oversampling),
    )


def saturate(
    channel: str, labels: Sequence[str], effects: Sequence[Effect], signal: Array
) -> Array:
    """Clip the overloaded channels of signals (sample, recording, label)."""
    signal = signal.copy()
    for effect in effects:
        if effect.kind == f"{channel}_saturation":
            at = list(labels).index(effect.where)
            limit = effect.each(signal.shape[1])[0]
            signal[..., at] = np.clip(signal[..., at], -limit, limit)
    return signal


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
