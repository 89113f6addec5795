"""Recordings of a study, their forces without the noise between pulses."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from iwanjax.types import Initial

# A pulse reaches as far as a force exceeds so many deviations of its noise, or this share of
# its peak, and some samples beyond; a burst of fewer samples is noise.
_ABOVE_NOISE, _ABOVE_PEAK, BESIDE, _FEWEST = 6.0, 1e-3, 3, 2

# A force whose last quarter scatters by this share of its peak never ends: it is taken as it is.
_ALWAYS = 0.05

# Samples before the first force that a sensor's noise is measured on, and those beside it that
# a sensor's own filter may spoil.
ENOUGH, SPOILT = 20, 8
FEWEST = ENOUGH + 2 * SPOILT
"""Samples that a recording needs."""


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
    initial : {"rest", "unknown", "periodic"} or None
        The state in which it begins; None leaves that to its data.
    """

    name: str
    response: Float[np.ndarray, "N sensors"]
    force: Float[np.ndarray, "N inputs"] | None
    use: Literal["fit", "hold_out"] = "fit"
    initial: Initial | None = None

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


def cleaned(force: Float[np.ndarray, "N inputs"], beside: int = BESIDE) -> CleanForce:
    """Forces without the noise beyond so many samples beside their pulses."""
    clean, noise = np.zeros_like(force), np.zeros(force.shape[1])
    first, last, endless = len(force), 0, False
    for i, column in enumerate(force.T):
        peak = np.max(np.abs(column))
        if peak == 0:
            continue
        tail = column[-(len(column) // 4) :]
        noise[i] = 1.4826 * np.median(np.abs(tail - np.median(tail)))
        acts = np.abs(column) > max(_ABOVE_NOISE * noise[i], _ABOVE_PEAK * peak)
        acts[:1] = acts[-SPOILT:] = False
        for start, end in _runs(acts):
            part = slice(max(0, start - beside), end + beside)
            clean[part, i] = column[part]
            first, last = min(first, start), max(last, end + beside)
        if noise[i] > _ALWAYS * peak:
            # No silence to measure the noise in: a shaker, not a hammer.
            clean[:, i], noise[i], endless = column, 0.0, True
    if endless:
        first = last = 0
    return CleanForce(clean, min(first, len(force) - 1), min(last, len(force) - 1), noise, endless)


def _runs(acts: np.ndarray) -> list[tuple[int, int]]:
    """First samples of the pulses, and those after their last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], acts.astype(int), [0]])))
    pairs = [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
    return [(a, b) for a, b in pairs if b - a >= _FEWEST]


def before_force(response: np.ndarray, first: int) -> np.ndarray:
    """Samples that nothing moves in yet."""
    return response[SPOILT : max(SPOILT, first - SPOILT)].astype(float)
