"""What a diagnosis is made of: suspects with their sizes, errors, scores, forces, sentences."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from iwanjax.effects.estimate import Estimate
from iwanjax.effects.kinds import Kind
from iwanjax.effects.wording import share
from iwanjax.identification.recordings import StudyRecording
from iwanjax.joints import UnnamedLaw
from iwanjax.settings.stages import settings
from iwanjax.signals.sensor_noise import SensorNoise


class Refitted(NamedTuple):
    """A joint, or a mode with its joint, as refitted.

    Attributes
    ----------
    name : str
        Its label in the study, or the mode's name.
    parameters : tuple of Estimate
        With deviations; NaN for what was not fitted.
    """

    name: str
    parameters: tuple[Estimate, ...]


class MeasuredNoise(NamedTuple):
    """What was taken for the noise of a sensor in a recording.

    Attributes
    ----------
    recording, sensor : str
        Their names.
    deviation, std : float
        Standard deviation, and that of its estimate: zero where the study gives it.
    source : str
        How it was estimated: as given, before the force, between periods, over the whole band,
        one step ahead, in quiet bands, or beside the fitted model.
    lower, upper : float
        Deviations between which it is. Where they differ, what is above the lower one may be noise
        that passes through the structure, or what no linear model does; noise floors are lower
        bounds then.
    """

    recording: str
    sensor: str
    deviation: float
    std: float
    source: str
    lower: float
    upper: float


class ForceNoise(NamedTuple):
    """What was taken for the noise of a measured force in a recording.

    Attributes
    ----------
    recording, input : str
        Their names.
    deviation : float or None
        Standard deviation; None where nothing shows it. It counts as none in noise floors then,
        which are lower bounds.
    source : str
        As given, beside its pulses, between periods, in quiet bands, or not known.
    """

    recording: str
    input: str
    deviation: float | None
    source: str


def sensor_noise(
    recordings: Sequence[StudyRecording], sensors: Sequence[str]
) -> tuple[MeasuredNoise, ...]:
    """What was taken for the noise of each sensor, recording by recording."""
    return tuple(
        MeasuredNoise(each.name, name, s, s / math.sqrt(2.0 * freedom), *rest)
        for each in recordings
        if each.noise is not None
        for name, s, freedom, *rest in zip(sensors, *_as_floats(each.noise), strict=True)
        if math.isfinite(s)
    )


def _as_floats(noise: SensorNoise) -> tuple[Sequence[Any], ...]:
    """Its arrays as lists."""
    return tuple(x.tolist() if isinstance(x, np.ndarray) else x for x in noise)


def force_noise(
    recordings: Sequence[StudyRecording], inputs: Sequence[str]
) -> tuple[ForceNoise, ...]:
    """What was taken for the noise of each force that acts, recording by recording."""
    return tuple(
        ForceNoise(each.name, name, float(s) if math.isfinite(s) else None, source)
        for each in recordings
        if each.force_noise is not None
        for name, s, source in zip(inputs, *each.force_noise, strict=True)
        if source
    )


class Observable(NamedTuple):
    """One mode in one recording.

    Attributes
    ----------
    recording : str
        Its name.
    mode : int
        Among the model's elastic modes, the lowest first from zero.
    quantity : {"frequency", "damping"}
        What differs.
    amplitude : (float, float)
        Range of the sensor's amplitude that was compared.
    difference_percent : float
        Model less measured over measured, the median over that range.
    name : str
        What the mode is called.
    """

    recording: str
    mode: int
    quantity: str
    amplitude: tuple[float, float]
    difference_percent: float
    name: str


@dataclass(frozen=True, eq=False)
class RestoringForce:
    """A recovered force at a place in the hardest recording, and laws that may explain it.

    Attributes
    ----------
    kind, where : str
        Chosen suspect; where several are at the place all of them, joined by " + ".
    over : str
        What the force is shown over: "deflection", "rate" or "acceleration".
    x, force : (N,) array
        Samples, opposing a growing deflection.
    centre, middle, spread : (bins,) array
        Medians of the force in bins of x, and deviations of a sample about them.
    deviation : (bins,) array
        By how much the medians may be off the force that acted, one deviation: that of a
        sample, as errors of neighbours are alike.
    laws : dict of str to (bins,) array
        Medians, in the same bins, of what the chosen kind and its rivals there would do in the
        same motion.
    """

    kind: str
    where: str
    over: str
    x: np.ndarray = field(repr=False)
    force: np.ndarray = field(repr=False)
    centre: np.ndarray = field(repr=False)
    middle: np.ndarray = field(repr=False)
    spread: np.ndarray = field(repr=False)
    deviation: np.ndarray = field(repr=False)
    laws: dict[str, np.ndarray] = field(repr=False)


@dataclass(frozen=True, eq=False)
class UnnamedForce:
    """A force that no name fits: the general law that makes it, and what that is like.

    Attributes
    ----------
    where : str
        Label of its place.
    law : UnnamedLaw
        As fitted: a joint, with ``save()``.
    description : str
        What it does, in words.
    nearest : dict of str to float
        Named kinds with the probability that the law is one of them; what is missing to 1 is that
        it is none.
    terms : float
        How many of its terms the recordings determine.
    path : (2, N) array
        Deflection and force in the recording of the largest deflection.
    backbone : (2, points) array
        Virgin curve: deflections as far as it was fitted, and forces.
    deviation : (points,) array
        Of the forces of the virgin curve.
    """

    where: str
    law: UnnamedLaw
    description: str
    nearest: dict[str, float]
    terms: float
    path: np.ndarray = field(repr=False)
    backbone: np.ndarray = field(repr=False)
    deviation: np.ndarray = field(repr=False)


class Prediction(Protocol):
    """A model against recordings of some kind: time histories, or curves of a mode."""

    def by_recording(self) -> Mapping[str, float]:
        """Relative errors."""
        ...

    def floors(self) -> Mapping[str, float]:
        """The same of a perfect model."""
        ...

    def floors_95(self) -> Mapping[str, float]:
        """What a perfect model exceeds in one case of twenty."""
        ...


class Suspect(NamedTuple):
    """What may be missing: one row of a verdict.

    Attributes
    ----------
    kind : Kind
        Of the catalogue.
    where : str
        Label of the place, sensor or joint.
    probability : float
        Among all that were tried, nothing, and something that was not tried.
    log_evidence : float
        Of the data with it, less that of the best.
    parameters : tuple of Estimate
        Its size, and its shape where it has one.
    joint_with : tuple of str
        Labels kind@where of what acts together with it.
    """

    kind: Kind
    where: str
    probability: float
    log_evidence: float
    parameters: tuple[Estimate, ...]
    joint_with: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """kind@where."""
        return f"{self.kind.name}@{self.where}"


class Refused(NamedTuple):
    """What explains the fitted recordings, but predicts those held out worse.

    Attributes
    ----------
    label : str
        kind@where, joined by " + " where several act at once.
    before, after : float
        Errors of the held-out recordings without and with it; infinite where it diverges.
    """

    label: str
    before: float
    after: float

    def __str__(self) -> str:
        off = f"is {share(self.after)} off on" if math.isfinite(self.after) else "diverges on"
        return (
            f"{self.label} explains the fitted recordings, but {off} the held-out ones, where the "
            f"model without it is {share(self.before)} off: it is refused"
        )


class Report(NamedTuple):
    """A diagnosis in plain sentences; empty where there is nothing to say.

    Attributes
    ----------
    verdict : str
        At most three sentences.
    improvement : str
        How much better predictions get.
    doubt : str
        What speaks against it, and what is odd.
    next : str
        What to measure next.
    """

    verdict: str
    improvement: str
    doubt: str
    next: str

    @classmethod
    def of(cls, *parts: Sequence[str]) -> "Report":
        """Of the sentences of each part, with or without their full stops."""
        return cls(*(" ".join(map(_ended, part)) for part in parts))

    @property
    def measure_next(self) -> str:
        """The last part with what it is, where it follows others."""
        return f"Measure next: {self.next[:1].lower()}{self.next[1:]}"

    def statement(self) -> str:
        """All parts in one paragraph."""
        return " ".join(filter(None, (*self[:-1], self.measure_next)))


def _ended(line: str) -> str:
    return line if line.endswith(".") else f"{line}."


class Errors(NamedTuple):
    """Root mean square of predicted less measured over that of measured; NaN without data."""

    fit: float
    hold_out: float


class Score(NamedTuple):
    """What one suspect would take off the residual, judged at size zero.

    Attributes
    ----------
    kind, where : str
        Which.
    drop : float
        Share of the squared residual, the joints refitted.
    """

    kind: str
    where: str
    drop: float


class PlaceEvidence(NamedTuple):
    """How much speaks for something that acts at a place, whatever it is.

    Attributes
    ----------
    where : str
        Label of the place, sensor, input or joint.
    probability : float
        That something acts there, if it does so at one place only.
    reduction : float
        Share of the squared residual that all laws there take off together, the joints refitted.
    columns : int
        In how many independent directions they do.
    log_evidence : float
        With something there, less that of nothing.
    """

    where: str
    probability: float
    reduction: float
    columns: int
    log_evidence: float


def alike(what: Sequence[Suspect]) -> tuple[tuple[str, str], ...]:
    """The first suspect with each whose evidence is as good within a margin."""
    margin = settings().judgement.alike
    return tuple(
        (what[0].label, other.label)
        for other in what[1:]
        if other.log_evidence > what[0].log_evidence - margin
        and other.label not in what[0].joint_with
        and other.label != what[0].label
    )
