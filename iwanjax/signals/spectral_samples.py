"""Force and response spectra of hits, periods, blocks or decays, on one axis of frequency."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Complex, Float

from iwanjax.errors import InputError
from iwanjax.signals.comparison_band import END
from iwanjax.signals.recording import Recording

Excitation: TypeAlias = Literal["auto", "transient", "periodic", "random", "decay"]
"""How a structure was driven; ``decay``: not at all while it was recorded."""

# A force repeats itself where its periods correlate to this much: they differ by 14 % (rms), more
# than where a shaker is disturbed by the structure's own motion, less than noise ever does.
_REPEATS = 0.99
# A force that has lasted for less than half of a record, all but this share of its energy beyond
# the noise of the record's last tenth, is a hit or a burst.
_LEFT_OF_HIT = 1e-2
# The force channel shows contact where it is this many deviations of that noise off zero.
_CONTACT = 5.0
# An exponential window falls to this by the end of a record: what a mode without damping would lose
# there, as share of itself.
_LEFT_AT_END = 1e-2
# Blocks of a random record, half overlapping: 15 averages.
_BLOCKS = 8
# Leading periods that differ from the last half's mean by more than this many of its own
# deviations still hold the transient of the start.
_SETTLED = 3.0


@dataclass(frozen=True, eq=False)
class SpectralSamples:
    """Spectra that belong together, n of them.

    Attributes
    ----------
    frequency : (F,) array
        Hz, of the band.
    force : (n, F, i) array
        Fourier transforms of the forces at s = sigma + i omega; of decays one at the decay's
        own column, which stands for its beginning.
    response : (n, F, s) array
        Of the responses.
    sensors, inputs : tuple of str
        Names of columns.
    quantities : tuple of str
        What each sensor measures.
    window : float
        sigma, 1/s: of the exponential window exp(-sigma t) on forces and responses alike.
    excitation : {"transient", "periodic", "random", "decay"}
        How the structure was driven.
    """

    frequency: Float[np.ndarray, " F"]
    force: Complex[np.ndarray, "n F i"]
    response: Complex[np.ndarray, "n F s"]
    sensors: tuple[str, ...]
    inputs: tuple[str, ...]
    quantities: tuple[str, ...]
    window: float
    excitation: Excitation


def spectral_samples(
    recordings: Sequence[Recording],
    band: tuple[float, float] | None = None,
    *,
    excitation: Excitation = "auto",
    period: float | None = None,
    block: float | None = None,
    window: float | None = None,
) -> SpectralSamples:
    r"""Spectra of all recordings.

    An exponential window takes forces and responses to :math:`s = \sigma + i\omega`, exactly:

    .. math:: \int f(t) e^{-\sigma t} e^{-i\omega t} dt = F(\sigma + i\omega)

    Parameters
    ----------
    recordings : sequence of Recording
        Of one sampling rate and the same sensors.
    band : (f_1, f_2), optional
        Hz; by default where forces, of decays the responses, have a thousandth of their largest
        energy, up to where recorders fade out.
    excitation : {"auto", "transient", "periodic", "random", "decay"}
        Hits from rest, one in each recording; periods of a steady state; stationary noise; or
        free decays. By default what the forces show.
    period : float, optional
        Of a periodic force, s; by default the shortest that the force repeats itself after.
    block : float, optional
        Length of the blocks that random records are cut into, s.
    window : float, optional
        sigma of the exponential window of hits and decays, 1/s; by default it falls to a
        hundredth by the end of the shortest recording.

    Raises
    ------
    InputError
        For recordings of several rates, sensors or kinds, and a band without lines.
    """
    first = recordings[0]
    for each in recordings[1:]:
        if not math.isclose(each.sampling_rate, first.sampling_rate, rel_tol=1e-6):
            raise InputError(
                f"{each.name}: has {each.sampling_rate:g} Hz, {first.name} {first.sampling_rate:g} "
                "Hz; expected one sampling rate; resample it"
            )
        if [c.name for c in each.channels] != [c.name for c in first.channels]:
            raise InputError(
                f"{each.name}: sensors are {', '.join(c.name for c in each.channels)}, of "
                f"{first.name} {', '.join(c.name for c in first.channels)}; expected the same in "
                "the same order"
            )
    kinds: dict[str, Excitation] = {
        each.name: _kind(each, excitation, period) for each in recordings
    }
    kind = kinds[first.name]
    if other := [name for name, each in kinds.items() if each != kind]:
        raise InputError(
            f"{first.name} is {_NAMES[kind]} but {other[0]} {_NAMES[kinds[other[0]]]}; expected "
            "one kind; leave some out, or say excitation:"
        )
    if kind == "decay":
        inputs = tuple(f"decay {i + 1}" for i in range(len(recordings)))
    else:
        inputs = tuple(dict.fromkeys(c.name for each in recordings for c in each.inputs))
    sigma, step = 0.0, 1.0 / first.sampling_rate
    if kind in ("transient", "decay"):
        count = max(each.size for each in recordings)
        sigma = -math.log(_LEFT_AT_END) / (_shortest(recordings) * step)
        sigma = sigma if window is None else window
        parts = [[(_contact(each), each.response)] for each in recordings]
        taper = np.exp(-sigma * step * np.arange(count))
    else:
        counts = [_period(each, period) if kind == "periodic" else 0 for each in recordings]
        count = counts[0]
        if kind == "random":
            length = _shortest(recordings) // _BLOCKS if block is None else block / step
            count = round(length)
        elif set(counts) != {count}:
            raise InputError(
                f"recordings have periods of {', '.join(map(str, counts))} samples; expected one "
                "period; give period:"
            )
        parts = [_cut(each, count, kind) for each in recordings]
        taper = np.hanning(count + 1)[:-1] if kind == "random" else np.ones(count)
    frequency = np.fft.rfftfreq(count, step)
    if band is None:
        band = _band(recordings, frequency, kind)
    lines = (frequency >= band[0]) & (frequency <= band[1])
    if np.count_nonzero(lines) < _FEWEST_LINES:
        raise InputError(
            f"the band {band[0]:g} to {band[1]:g} Hz has {np.count_nonzero(lines)} lines, "
            f"{1.0 / (count * step):g} Hz apart; expected {_FEWEST_LINES} at least: widen it, or "
            "use longer recordings"
        )

    def spectrum(x: np.ndarray) -> np.ndarray:
        return step * np.fft.rfft(x * taper[: len(x), None], n=count, axis=0)[lines]

    forces, responses = [], []
    for j, (recording, cut) in enumerate(zip(recordings, parts, strict=True)):
        columns = [inputs.index(c.name) for c in recording.inputs] if kind != "decay" else [j]
        for force, response in cut:
            found = np.zeros((np.count_nonzero(lines), len(inputs)), complex)
            found[:, columns] = 1.0 if force is None or kind == "decay" else spectrum(force)
            forces.append(found)
            responses.append(spectrum(response))
    return SpectralSamples(
        frequency[lines],
        np.stack(forces),
        np.stack(responses),
        tuple(c.name for c in first.channels),
        inputs,
        tuple(c.quantity for c in first.channels),
        sigma,
        kind,
    )


_NAMES = {
    "transient": "a hit",
    "periodic": "periodic",
    "random": "stationary",
    "decay": "a free decay",
}
# Fewer lines than this hold no mode: a frequency, damping and two residual terms, complex each.
_FEWEST_LINES = 8


def _band(
    recordings: Sequence[Recording], frequency: np.ndarray, kind: Excitation
) -> tuple[float, float]:
    """Where there is energy."""
    rate, count = recordings[0].sampling_rate, 2 * (len(frequency) - 1)
    energy = np.zeros(len(frequency))
    for each in recordings:
        x = each.response if kind == "decay" or each.force is None else each.force
        whole = len(x) // count * count if kind != "transient" and kind != "decay" else len(x)
        blocks = (
            x[:whole].reshape(-1, count, x.shape[1])
            if whole
            and kind
            in (
                "periodic",
                "random",
            )
            else x[None]
        )
        energy += np.sum(np.abs(np.fft.rfft(blocks, 2 * (len(frequency) - 1), axis=1)) ** 2, (0, 2))
    below = (frequency > 0.0) & (frequency <= END * rate)
    strong = np.flatnonzero(below & (energy >= _ENERGY * np.max(energy[below])))
    return float(frequency[strong[0]]), float(frequency[strong[-1]])


# Share of the largest energy per line: 30 dB below it.
_ENERGY = 1e-3


def _shortest(recordings: Sequence[Recording]) -> int:
    return min(each.size for each in recordings)


def _kind(recording: Recording, given: Excitation, period: float | None) -> Excitation:
    """What the force shows, or what is said."""
    if recording.force is None:
        if given not in ("auto", "decay"):
            raise InputError(f"{recording.name}: has no force; expected excitation decay, or auto")
        return "decay"
    if given != "auto":
        return given
    if period is not None:
        return "periodic"
    square = np.sum(recording.force**2, axis=1)
    beyond = np.cumsum(square - np.mean(square[-(recording.size // 10) :]))
    over = int(np.argmax(beyond >= (1.0 - _LEFT_OF_HIT) * beyond[-1]))
    if beyond[-1] > 0.5 * np.sum(square) and over < recording.size // 2:
        return "transient"
    return "random" if _repeats_after(recording) is None else "periodic"


def _repeats_after(recording: Recording) -> int | None:
    """Samples after which the forces repeat themselves, the fewest; None where they do not."""
    assert recording.force is not None
    f = recording.force - recording.force.mean(axis=0)
    n = len(f)
    spectra = np.abs(np.fft.rfft(f, 2 * n, axis=0)) ** 2
    correlation = np.fft.irfft(np.sum(spectra, axis=1))[:n]
    energy = np.r_[0.0, np.cumsum(np.sum(f**2, axis=1))]
    lags = np.arange(1, n // 2 + 1)
    # Of the part that is there twice: n - lag samples at either end.
    overlap = np.sqrt(energy[n - lags] * (energy[n] - energy[lags]))
    alike = correlation[lags] / np.maximum(overlap, np.finfo(float).tiny)
    below = np.flatnonzero(alike < 0.0)
    if not below.size:
        return None
    alike[: below[0]] = 0.0
    best = int(np.argmax(alike))
    if alike[best] < _REPEATS:
        return None
    # Two periods are alike too: the first lag that is as good as the best.
    least = 1.0 - max(2.0 * (1.0 - alike[best]), float(np.sqrt(np.finfo(float).eps)))
    good = np.flatnonzero(alike >= least)
    first = good[good <= good[0] + below[0]]
    return int(lags[first[np.argmax(alike[first])]])


def _period(recording: Recording, given: float | None) -> int:
    """Samples of a period."""
    if given is None:
        found = _repeats_after(recording)
        if found is None:
            raise InputError(f"{recording.name}: its force repeats nothing; give period:, s")
        return found
    count = round(given * recording.sampling_rate)
    if not 0 < count <= recording.size:
        raise InputError(
            f"{recording.name}: period = {given:g} s is {count} samples; the recording has "
            f"{recording.size}"
        )
    return count


def _cut(recording: Recording, count: int, kind: Excitation) -> list[tuple[np.ndarray, np.ndarray]]:
    """Whole periods after the start's transient, or blocks that overlap by half."""
    assert recording.force is not None
    stride = count if kind == "periodic" else count // 2
    starts = range(0, recording.size - count + 1, max(stride, 1))
    if not starts:
        raise InputError(
            f"{recording.name}: has {recording.size} samples, fewer than one block of {count}"
        )
    found = [(recording.force[i : i + count], recording.response[i : i + count]) for i in starts]
    if kind == "random":
        return found
    return found[_settled(np.stack([response for _, response in found])) :]


def _settled(periods: Float[np.ndarray, "n N s"]) -> int:
    """The first period without the start's transient, in the first half."""
    half = len(periods) // 2
    if not half:
        return 0
    last = periods[half:]
    away = np.sqrt(np.mean((periods - last.mean(axis=0)) ** 2, axis=(1, 2)))
    return int(np.argmax(away <= _SETTLED * np.median(away[half:])))


def _contact(recording: Recording) -> np.ndarray | None:
    """The force while it acts: what its channel shows after the last contact is noise."""
    if recording.force is None:
        return None
    noise = np.std(recording.force[-(recording.size // 10) :], axis=0)
    acts = np.any(np.abs(recording.force) > _CONTACT * noise, axis=1)
    if not acts.any():
        raise InputError(f"{recording.name}: its force is noise throughout; was it hit?")
    first, last = np.flatnonzero(acts)[[0, -1]]
    # As long again on either side, where the force rises and ceases.
    width = last - first + 1
    force = recording.force.copy()
    force[: max(first - width, 0)] = 0.0
    force[last + 1 + width :] = 0.0
    return force
