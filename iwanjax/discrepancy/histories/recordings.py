"""Recordings of a study, their forces without the noise between pulses."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from iwanjax.discrepancy.history_settings import CONDITIONING, ConditioningSettings


@dataclass(frozen=True, eq=False)
class StudyRecording:
    """One recording, with the force that made it or as a free decay.

    Parameters
    ----------
    name : str
        For reports.
    response : (N, sensors) array
        As measured, all recordings with the same sensors in the same order.
    force : (N, inputs) array or None
        As measured, zero for inputs that were not hit; None for a free decay, which begins
        when nothing touches the structure any more.
    use : {"fit", "hold_out"}
        Whether a fit may see it.
    """

    name: str
    response: Float[np.ndarray, "N sensors"]
    force: Float[np.ndarray, "N inputs"] | None
    use: Literal["fit", "hold_out"] = "fit"

    @property
    def quiet(self) -> np.ndarray:
        """Samples before any force, (n, sensors)."""
        if self.force is None:
            return self.response[:0].astype(float)
        return before_force(self.response, cleaned(self.force.astype(float)).first)

    @property
    def released(self) -> int:
        """Sample from which on no force acts any more; their number where one always does."""
        if self.force is None:
            return 0
        force = cleaned(self.force.astype(float))
        return len(self.response) if force.endless else force.last


@dataclass(frozen=True, eq=False)
class CleanForce:
    """A measured force, zero outside its pulses.

    Attributes
    ----------
    clean : (N, inputs) array
        Of it.
    first, last : int
        Samples between which it acts.
    noise : (inputs,) array
        Standard deviation.
    endless : bool
        Whether one never ends, as a shaker's.
    """

    clean: np.ndarray
    first: int
    last: int
    noise: np.ndarray
    endless: bool


def cleaned(
    force: Float[np.ndarray, "N inputs"],
    beside: int | None = None,
    settings: ConditioningSettings = CONDITIONING,
) -> CleanForce:
    """Forces without the noise beyond so many samples beside their pulses."""
    beside = settings.beside if beside is None else beside
    clean, noise = np.zeros_like(force), np.zeros(force.shape[1])
    first, last, endless = len(force), 0, False
    for i, column in enumerate(force.T):
        peak = np.max(np.abs(column))
        if peak == 0:
            continue
        tail = column[-(len(column) // 4) :]
        noise[i] = 1.4826 * np.median(np.abs(tail - np.median(tail)))
        acts = np.abs(column) > max(settings.pulse_noise * noise[i], settings.pulse_peak * peak)
        acts[:1] = acts[-settings.spoilt :] = False
        for start, end in _runs(acts, settings.fewest):
            part = slice(max(0, start - beside), end + beside)
            clean[part, i] = column[part]
            first, last = min(first, start), max(last, end + beside)
        if noise[i] > settings.endless * peak:
            # No silence to measure the noise in: a shaker, not a hammer.
            clean[:, i], noise[i], endless = column, 0.0, True
    if endless:
        first = last = 0
    return CleanForce(clean, min(first, len(force) - 1), min(last, len(force) - 1), noise, endless)


def _runs(acts: np.ndarray, fewest: int) -> list[tuple[int, int]]:
    """First samples of the pulses, and those after their last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], acts.astype(int), [0]])))
    pairs = [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
    return [(a, b) for a, b in pairs if b - a >= fewest]


def before_force(
    response: np.ndarray, first: int, settings: ConditioningSettings = CONDITIONING
) -> np.ndarray:
    """Samples that nothing moves in yet."""
    spoilt = settings.spoilt
    return response[spoilt : max(spoilt, first - spoilt)].astype(float)
