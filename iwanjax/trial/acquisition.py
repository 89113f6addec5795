"""What a recorder makes of the true accelerations and forces.

The measurement chain, in its order: the transducer with its faults (gain, polarity, delay,
high-pass), the anti-alias filter, noise, the converter's limit. The anti-alias filter is linear,
so that it need not know what comes before it.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from iwanjax.trial.effects import Effect
from iwanjax.trial.physics import FILTER_SPAN
from iwanjax.trial.structure import Array, TrialStructure


def decimate(signal: Array, samples: int, oversampling: int, first: int = 0) -> Array:
    """Zero-phase anti-alias filter at 0.4 of the sampling rate; its samples from `first` on."""
    from scipy.signal import firwin, upfirdn  # here, because they take long to import

    taps = firwin(2 * FILTER_SPAN * oversampling + 1, 0.8 / oversampling, window=("kaiser", 8.0))  # type: ignore[arg-type]
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
    from scipy.signal import bilinear, lfilter

    return lfilter(*bilinear([1.0, 0.0], [1.0, 2 * np.pi * corner], rate), signal, axis=0)  # type: ignore[return-value]


def transduced(
    channel: str,
    labels: Sequence[str],
    effects: Sequence[Effect],
    signal: Array,
    structure: TrialStructure,
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
