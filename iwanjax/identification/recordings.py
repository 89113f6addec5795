"""Recordings of a study: their forces without noise between pulses, and the noise of sensors."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from iwanjax.settings.histories import CONDITIONING, ConditioningSettings
from iwanjax.signals.comparison_band import END
from iwanjax.types import Initial


@dataclass(frozen=True, eq=False)
class StudyRecording:
    """One recording, with the force that made it or as a free decay.

    Parameters
    ----------
    name : str
        For reports.
    response : (N, sensors) array
        As measured, the sensors of all recordings in one order; NaN throughout for a sensor that
        this one lacks.
    force : (N, inputs) array or None
        As measured, zero for inputs that were not hit; None for a free decay, which begins
        when nothing touches the structure any more.
    use : {"fit", "hold_out"}
        Whether a fit may see it.
    initial : {"rest", "unknown", "periodic"} or None
        The state in which it begins; None leaves that to its data.
    noise : (sensors,) array or None
        Standard deviation of each sensor's noise where the samples do not show it any more, as
        in a recording that was resampled.
    """

    name: str
    response: Float[np.ndarray, "N sensors"]
    force: Float[np.ndarray, "N inputs"] | None
    use: Literal["fit", "hold_out"] = "fit"
    initial: Initial | None = None
    noise: Float[np.ndarray, " sensors"] | None = None

    @property
    def measured(self) -> np.ndarray:
        """Which sensors it has, (sensors,)."""
        return ~np.all(np.isnan(self.response), axis=0)

    @property
    def moving(self) -> bool:
        """Whether it begins in a state that has to be estimated."""
        return self.force is None or self.initial in ("unknown", "periodic")

    @property
    def quiet(self) -> np.ndarray:
        """Samples before any force and any motion, (n, sensors)."""
        if self.moving or self.force is None:
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


def common_noise(
    recordings: Sequence[StudyRecording], settings: ConditioningSettings = CONDITIONING
) -> np.ndarray:
    """Standard deviation of each sensor's noise over all recordings, held-out ones as well.

    Some dozens of samples before a trigger leave a deviation open by a tenth, and with it how
    much of a residual is noise.

    Parameters
    ----------
    recordings : sequence of StudyRecording
        Their sensors in one order.
    settings : ConditioningSettings
        Of the stage.

    Returns
    -------
    (sensors,) array
        NaN where nothing was measured before a force, or recordings differ: a range that was
        switched between them.
    """
    quiet = [each.quiet for each in recordings if each.noise is None]
    quiet = [each for each in quiet if len(each) >= settings.enough]
    if not quiet:
        return np.full(recordings[0].response.shape[1], np.nan)
    variances = np.stack([np.var(each, axis=0, ddof=1) for each in quiet])
    seen = ~np.isnan(variances)
    freedoms = np.array([len(each) - 1.0 for each in quiet])
    largest, least = np.where(seen, variances, 0.0), np.where(seen, variances, np.inf)
    alike = largest.max(axis=0) < settings.other_noise * least.min(axis=0)
    count = np.where(alike & np.any(seen, axis=0), freedoms @ seen, np.nan)
    return np.sqrt(freedoms @ largest / count)


def quietest(response: np.ndarray, settings: ConditioningSettings = CONDITIONING) -> np.ndarray:
    r"""Noise of sensors that are never at rest, by where the structure moves them least.

    .. math:: \sigma^2 = \tfrac{1}{2} f_s \min_B S_B

    with the mean S_B of the one-sided spectral density (Welch 1967) over each of some bands up to
    the highest frequency that is compared. What is left of the motion there makes it an upper
    bound; noise that is not white may exceed it elsewhere.
    """
    from scipy.signal import welch

    f, density = welch(response, nperseg=min(settings.segment, len(response)), axis=0)
    values = int(2.0 * END * len(response))
    count = min(settings.noise_bands, max(1, values // settings.noise_values))
    which = np.floor(f * count / END).astype(int)
    found = [np.mean(density[which == band], axis=0) for band in range(count)]
    return np.sqrt(0.5 * np.min(found, axis=0))


def own_noise(
    recording: StudyRecording, settings: ConditioningSettings = CONDITIONING
) -> np.ndarray:
    """Of a recording's sensors by itself, (sensors,); NaN for one that it lacks."""
    response = recording.response.astype(float)
    if recording.force is None:
        return noise_of(response, 0, settings)
    force = cleaned(recording.force.astype(float), settings=settings)
    if force.endless or recording.moving:
        return quietest(response, settings)
    return noise_of(response, force.first, settings)


def noise_of(
    response: np.ndarray, first: int, settings: ConditioningSettings = CONDITIONING
) -> np.ndarray:
    """Of the sensors before the first force; else of third differences at the end."""
    before = before_force(response, first, settings)
    if len(before) >= settings.enough:
        return np.std(before, axis=0, ddof=1)
    least = settings.enough + settings.spoilt
    tail = response[-max(len(response) // 8, least) : -settings.spoilt]
    # Third differences of white noise have twenty times its variance.
    return np.std(np.diff(tail, 3, axis=0), axis=0) / np.sqrt(20.0)
