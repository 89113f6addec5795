"""Recordings of a study: their forces without noise between pulses, and the noise of sensors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from iwanjax.settings.conditioning import CONDITIONING, ConditioningSettings
from iwanjax.signals.clipping import cut_off
from iwanjax.signals.force_noise import BESIDE_PULSES, InputNoise, of_endless
from iwanjax.signals.noise import (
    NoiseLevel,
    at_rest,
    between_periods,
    of_rounding,
    period_of,
)
from iwanjax.signals.sensor_noise import (
    BEFORE_FORCE,
    BETWEEN_PERIODS,
    GIVEN,
    OUTRIGHT,
    SensorNoise,
    along_motion,
    in_quiet_bands,
    louder,
)
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
    noise : SensorNoise or None
        Of its sensors; None leaves that to its data (:func:`noise_of`). One that was resampled
        does not show it any more.
    force_noise : InputNoise or None
        Of its forces; None likewise (:func:`force_noise_of`).
    lost : (N, inputs) array or None
        What was cut off the peaks of its forces, at a guess; None leaves that to them. One that
        was resampled does not show it any more.
    """

    name: str
    response: Float[np.ndarray, "N sensors"]
    force: Float[np.ndarray, "N inputs"] | None
    use: Literal["fit", "hold_out"] = "fit"
    initial: Initial | None = None
    noise: SensorNoise | None = None
    force_noise: InputNoise | None = None
    lost: Float[np.ndarray, "N inputs"] | None = None

    def cut_off(self, force: Float[np.ndarray, "N inputs"]) -> Float[np.ndarray, "N inputs"]:
        """What was cut off the peaks of its forces, of which ``force`` is what is clean."""
        guessed = map(cut_off, force.T)
        return np.stack(list(guessed), axis=1) if self.lost is None else self.lost

    @property
    def measured(self) -> np.ndarray:
        """Which sensors it has, (sensors,)."""
        return ~np.all(np.isnan(self.response), axis=0)

    @property
    def moving(self) -> bool:
        """Whether it begins in a state that has to be estimated."""
        return self.force is None or self.initial in ("unknown", "periodic")

    @property
    def period(self) -> int | None:
        """Samples of the steady cycle of which it holds several; None where it does not."""
        if self.initial != "periodic" or self.force is None:
            return None
        found = period_of(self.force.astype(float), CONDITIONING.repeats, CONDITIONING.least)
        return found if found < len(self.force) else None

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
        beyond = column[clean[:, i] == 0.0]
        # Of Gaussian noise nine of ten samples are within 1.645 deviations; a spike is no motion.
        cut = float(np.quantile(np.abs(beyond), 0.9)) / 1.645 if beyond.size else 0.0
        if noise[i] > settings.endless * peak or cut > max(
            settings.cut_off * noise[i], settings.pulse_peak * peak
        ):
            # No silence to measure the noise in: a shaker, not a hammer; or an earthquake, of which
            # more than noise would be cut off.
            clean[:, i], noise[i], endless = column, 0.0, True
    if endless:
        first = last = 0
    return CleanForce(clean, min(first, len(force) - 1), min(last, len(force) - 1), noise, endless)


def force_noise_of(
    recording: StudyRecording,
    given: Float[np.ndarray, " inputs"],
    settings: ConditioningSettings = CONDITIONING,
) -> InputNoise | None:
    """Noise of a recording's forces: as given, beside pulses, or of one that never ends.

    Parameters
    ----------
    recording : StudyRecording
        With the state in which it begins.
    given : (inputs,) array
        Deviations that the study gives; NaN where it does not.
    settings : ConditioningSettings
        Of the stage.

    Returns
    -------
    InputNoise or None
        None without a force.
    """
    if recording.force is None:
        return None
    force = recording.force.astype(float)
    clean, period = cleaned(force, settings=settings), recording.period
    found: list[tuple[float, str]] = []
    for column, known, beside in zip(force.T, given, clean.noise, strict=True):
        if not np.any(column):
            found.append((0.0, ""))
        elif np.isfinite(known):
            found.append((float(known), GIVEN))
        elif clean.endless and beside == 0.0:
            found.append(of_endless(column, period, settings))
        else:
            found.append((float(beside), BESIDE_PULSES))
    deviation, source = zip(*found, strict=True)
    return InputNoise(np.array(deviation), source)


def with_force_noise(
    recording: StudyRecording, inputs: Sequence[str], given: Mapping[str, float]
) -> StudyRecording:
    """With the noise of its forces, unless that is known already."""
    if recording.force_noise is not None:
        return recording
    known = np.array([given.get(name, np.nan) for name in inputs])
    return replace(recording, force_noise=force_noise_of(recording, known))


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


def as_given(deviation: np.ndarray) -> SensorNoise:
    """Noise that a study states, (sensors,); NaN where it does not."""
    return SensorNoise.of(NoiseLevel(deviation, np.full(len(deviation), np.inf)), GIVEN)


def common_noise(
    recordings: Sequence[StudyRecording], settings: ConditioningSettings = CONDITIONING
) -> SensorNoise:
    """Noise of each sensor before the forces of all recordings, held-out ones as well.

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
    SensorNoise
        NaN where nothing was measured before a force, or recordings differ: a range that was
        switched between them.
    """
    quiet = [each.quiet for each in recordings if each.noise is None]
    quiet = [each for each in quiet if len(each) >= settings.enough]
    sensors = recordings[0].response.shape[1]
    if not quiet:
        return SensorNoise.of(NoiseLevel(*np.full((2, sensors), np.nan)), BEFORE_FORCE)
    levels = [at_rest(each) for each in quiet]
    variances = np.stack([each.deviation**2 for each in levels])
    seen = np.isfinite(variances)
    freedoms = np.stack([each.freedom for each in levels]) * seen
    largest, least = np.where(seen, variances, 0.0), np.where(seen, variances, np.inf)
    alike = largest.max(axis=0) < settings.other_noise * least.min(axis=0)
    freedom = np.where(alike & np.any(seen, axis=0), freedoms.sum(axis=0), np.nan)
    pooled = np.sqrt(np.sum(freedoms * largest, axis=0) / freedom)
    return SensorNoise.of(NoiseLevel(pooled, freedom), BEFORE_FORCE)


def with_noise(
    recordings: Sequence[StudyRecording],
    given: np.ndarray,
    sensors: Sequence[str],
    settings: ConditioningSettings = CONDITIONING,
) -> tuple[list[StudyRecording], list[str]]:
    """Recordings with the noise of their sensors: given, of all of them, or their own.

    What all of them show before their forces is taken for each that is measured so, and for each
    other one that shows more by itself.

    Parameters
    ----------
    recordings : sequence of StudyRecording
        With the states in which they begin.
    given : (sensors,) array
        Deviations that the study gives; NaN where it does not.
    sensors : sequence of str
        Names.
    settings : ConditioningSettings
        Of the stage.

    Returns
    -------
    (list of StudyRecording, list of str)
        And where two ways of telling the noise contradict each other, in words.
    """
    common = common_noise(recordings, settings)
    known = as_given(given)
    found, told = [], []
    for each in recordings:
        if each.noise is not None:
            found.append(each)
            continue
        own = noise_of(each, settings)
        before = np.array([source == BEFORE_FORCE for source in own.source])
        better = np.isfinite(common.deviation) & (before | (common.deviation < own.deviation))
        own = own.where(better, common).at_least(of_rounding(each.response.astype(float)))
        told += _contradictions(each, own, known, sensors, settings)
        found.append(replace(each, noise=own.where(np.isfinite(given), known)))
    return found, told


def _contradictions(
    recording: StudyRecording,
    own: SensorNoise,
    known: SensorNoise,
    sensors: Sequence[str],
    settings: ConditioningSettings,
) -> list[str]:
    """Where noise is louder than another way of telling it allows; quiet bands may hold motion."""
    found = []
    quiet = in_quiet(recording, settings)
    measured, moved = _outright(recording, settings) or (quiet, np.zeros(len(sensors), bool))
    for i in np.flatnonzero(moved).tolist():
        found.append(
            f"{recording.name}: {measured.source[i]} {sensors[i]} shows {measured.deviation[i]:.2g}"
            f", but {quiet.deviation[i]:.2g} in quiet bands: hum, or motion, is in the former, and "
            f"its noise is taken {own.source[i]}, {own.deviation[i]:.2g}"
        )
    bound = np.array([source not in OUTRIGHT for source in own.source])
    # Where no motion is it is the same noise, whatever its colour.
    allowed = np.where(bound, settings.coloured, np.sqrt(settings.flat))
    more, less = louder(known, own, allowed), louder(own, known, allowed) & ~bound
    for i in np.flatnonzero(more | less).tolist():
        found.append(
            f"{recording.name}: noise of {sensors[i]} is given as {known.deviation[i]:.2g}, but it "
            f"shows {own.deviation[i]:.2g} {own.source[i]}"
        )
    return found


def noise_of(
    recording: StudyRecording, settings: ConditioningSettings = CONDITIONING
) -> SensorNoise:
    """Noise of a recording's sensors by what it shows itself.

    Before its force, where nothing moves yet and it is long enough, and between the periods of a
    steady cycle: all that is not motion, of any colour. Else, and where that is louder than
    coloured noise may be, along the motion
    (:func:`~iwanjax.signals.sensor_noise.along_motion`). At least what rounding to a
    converter's steps makes of it.
    """
    measured, least = _outright(recording, settings), of_rounding(recording.response.astype(float))
    if measured is None:
        return along_motion(*_cleaned(recording, settings), settings).at_least(least)
    found, moved = measured
    if np.any(moved):
        found = found.where(moved, along_motion(*_cleaned(recording, settings), settings))
    return found.at_least(least)


def in_quiet(
    recording: StudyRecording, settings: ConditioningSettings = CONDITIONING
) -> SensorNoise:
    """Noise of a recording's sensors in quiet bands, whatever the structure and its forces do."""
    return in_quiet_bands(*_cleaned(recording, settings), settings)


def _cleaned(
    recording: StudyRecording, settings: ConditioningSettings
) -> tuple[np.ndarray, np.ndarray | None]:
    """A recording's response, and its forces without their noise beside pulses."""
    response, force = recording.response.astype(float), recording.force
    if force is None:
        return response, None
    return response, cleaned(force.astype(float), settings=settings).clean


def _outright(
    recording: StudyRecording, settings: ConditioningSettings
) -> tuple[SensorNoise, np.ndarray] | None:
    """Noise where no motion is, or where it is known to repeat; None where that is nowhere.

    And of which sensors it is not: what is louder than coloured noise may be beside quiet bands,
    unless it is the same in all periods of a cycle.
    """
    quiet, period = recording.quiet, recording.period
    sensors = recording.response.shape[1]
    if len(quiet) >= settings.enough:
        found, steady = SensorNoise.of(at_rest(quiet), BEFORE_FORCE), np.zeros(sensors, bool)
    elif period is None or recording.force is None:
        return None
    else:
        response, force = (x.astype(float) for x in (recording.response, recording.force))
        level, steady = between_periods(response, force, period)
        found = SensorNoise.of(level, BETWEEN_PERIODS)
    return found, louder(found, in_quiet(recording, settings), settings.coloured) & ~steady
