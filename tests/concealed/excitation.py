"""Force histories of a laboratory: hammer, random, multisine, sweep, stepped sine, shock.

Each is a function of the times (s) of a fine grid and has the size 1 (rms of what lasts, peak of
what does not); `scale` finds the size that drives the joints as far as a recording shall.
"""

from collections.abc import Sequence

import numpy as np
from concealed.structures import STRUCTURES, Array, Structure
from scipy.fft import next_fast_len
from scipy.linalg import eigh

from iwanjax.trial.structure import tangent_stiffness

Band = tuple[float, float]
RISE = 0.01
"""Time (s) in which a lasting force is switched on."""


def band(structure: Structure) -> Band:
    """Frequencies (Hz) that a lasting excitation holds: all modes of a chain, few of a beam."""
    return _BANDS[structure.name]


def _chain_band(structure: Structure) -> Band:
    f = np.sqrt(eigh(tangent_stiffness(structure), structure.M, eigvals_only=True)) / (2 * np.pi)
    return 0.5 * float(f[0]), 1.3 * float(f[-1])


_BANDS: dict[str, Band] = {
    name: _chain_band(s) for name, s in STRUCTURES.items() if name.startswith("chain")
} | {"lap_beam": (30.0, 950.0), "brake_reuss": (100.0, 750.0)}


def elastic(structure: Structure) -> tuple[Array, Array]:
    """Circular frequencies (rad/s) and shapes of the modes within the band, joints stuck."""
    squared, shapes = eigh(tangent_stiffness(structure), structure.M)
    omega = np.sqrt(squared)
    low, high = (2 * np.pi * edge for edge in band(structure))
    within = (omega > low) & (omega < high)
    return omega[within], shapes[:, within]


def _on(time: Array, start: float) -> Array:
    phase = np.clip((time - start) / RISE, 0.0, 1.0)
    return 0.5 * (1 - np.cos(np.pi * phase))


def _flat(f: Array, edges: Band) -> Array:
    """1 within the band, with cosine flanks of a tenth of either edge inside it."""
    low, high = edges
    up = np.clip((f - low) / (0.1 * low), 0.0, 1.0)
    down = np.clip((high - f) / (0.1 * high), 0.0, 1.0)
    return 0.25 * (1 - np.cos(np.pi * up)) * (1 - np.cos(np.pi * down))


def half_sines(time: Array, hits: Sequence[tuple[float, float, float]]) -> Array:
    """Blows of (start s, width s, peak)."""
    force = np.zeros_like(time)
    for start, width, peak in hits:
        phase = (time - start) / width
        force += np.where((phase > 0) & (phase < 1), peak * np.sin(np.pi * phase), 0.0)
    return force


def coloured(time: Array, start: float, edges: Band, rng: np.random.Generator) -> Array:
    """Random within a band, its spectrum falling as that of a first-order low-pass amid it."""
    n = next_fast_len(len(time), real=True)
    f = np.fft.rfftfreq(n, time[1] - time[0])
    within = np.flatnonzero((f > edges[0]) & (f < edges[1]))
    spectrum = np.zeros(len(f), complex)
    some = f[within]
    shape = _flat(some, edges) / np.sqrt(1 + some**2 / (edges[0] * edges[1]))
    spectrum[within] = shape * (rng.standard_normal((len(some), 2)) @ [1.0, 1.0j])
    signal = np.fft.irfft(spectrum, n)[: len(time)]
    return signal / signal.std() * _on(time, start)


def multisine(steps: int, period: int, dt: float, edges: Band, rng: np.random.Generator) -> Array:
    """Periods of sines of equal size and random phases on all lines in a band; whole steps."""
    f = np.fft.rfftfreq(period, dt)
    within = (f >= edges[0]) & (f <= edges[1])
    spectrum = np.where(within, np.exp(2j * np.pi * rng.uniform(size=len(f))), 0.0)
    signal = np.fft.irfft(spectrum, period)
    return np.resize(signal / signal.std(), steps)


def sweep(time: Array, start: float, end: float, edges: Band) -> Array:
    """A sine whose frequency goes from the one edge to the other exponentially; up or down."""
    length = (end - start) / np.log(edges[1] / edges[0])
    since = np.clip(time - start, 0.0, end - start)
    phase = 2 * np.pi * edges[0] * length * np.expm1(since / length)
    return np.sqrt(2) * np.sin(phase) * _on(time, start) * (time <= end)


def stepped(time: Array, start: float, end: float, frequencies: Array) -> Array:
    """A sine that dwells at each frequency equally long, its phase without jumps."""
    dwell = (end - start) / len(frequencies)
    at = np.clip(((time - start) / dwell).astype(int), 0, len(frequencies) - 1)
    phase = 2 * np.pi * np.cumsum(frequencies[at]) * (time[1] - time[0])
    return np.sqrt(2) * np.sin(phase) * _on(time, start)


def largest(
    structure: Structure, inputs: Array, dt: float, places: Array, periodic: bool = False
) -> float:
    """Largest of |places @ u| under forces (step, input), the joints stuck, by FFT.

    `places` (p, n) are rows; a force that is not periodic is followed by as long a silence.
    """
    n: int = len(inputs) if periodic else next_fast_len(2 * len(inputs), real=True)  # type: ignore[assignment]
    f = np.fft.rfftfreq(n, dt)
    spectrum = np.fft.rfft(inputs, n, axis=0)
    bins = int(np.searchsorted(f, 2.0 * band(structure)[1]))
    spectrum, omega = spectrum[:bins], 2 * np.pi * f[:bins, None, None]
    rows = np.stack(list(structure.inputs.values()))
    stiff = tangent_stiffness(structure)
    dynamic = stiff + 1j * omega * structure.C - omega**2 * structure.M
    moved = np.linalg.solve(dynamic, (spectrum @ rows)[..., None])[..., 0]
    coarse = 8 * bins
    paths = np.fft.irfft(moved @ places.T, coarse, axis=0) * (coarse / n)
    return float(np.abs(paths).max())
