"""Recordings of a plan, and those that might be added to it, each on its own."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from iwanjax.discrepancy.histories.prepared import PreparedStudy
from iwanjax.discrepancy.histories.ranking import STEPS, Scope
from iwanjax.discrepancy.histories.restarts import FAR, nominal_fit
from iwanjax.identification.likelihood import left_by_noise
from iwanjax.identification.linearise import innovations
from iwanjax.identification.multistart import HypothesisFit, multistart
from iwanjax.identification.places import Place
from iwanjax.identification.problem import HistoryProblem, Start
from iwanjax.identification.recordings import StudyRecording
from iwanjax.signals.force_noise import InputNoise
from iwanjax.signals.sensor_noise import GIVEN, SensorNoise
from iwanjax.structures.model_file import BASE

LEVELS = (0.5, 1.0, 2.0)
"""Peaks of an added force over that of the hardest one."""
# Difference of two peaks' logarithms below which a recording is one that there is already.
_SAME = 0.2
# Cosine of the angle between two rows from which on they are the same sensor's.
_PARALLEL = 0.999


@dataclass(frozen=True, eq=False)
class PlanBase:
    """What all recordings of a plan are linearised about.

    Attributes
    ----------
    study : PreparedStudy
        With a sensor more at every place that has none.
    present : int
        How many sensors there are already; they come first.
    z : (values,) array
        Joints and errors of the linear model.
    substeps : int
        Steps between samples.
    places : tuple of Place
        Where forces may act, and what has moved there.
    problem : HistoryProblem
        Of all fitted recordings and the sensors that there are.
    explained : bool
        Whether the model explains the recordings; where not, joints are those given.
    """

    study: PreparedStudy
    present: int
    z: np.ndarray
    substeps: int
    places: tuple[Place, ...]
    problem: HistoryProblem
    explained: bool

    @classmethod
    def of(cls, study: PreparedStudy, seed: int) -> "PlanBase":
        """The joints refitted, if that explains the recordings."""
        now = study.resolution.of_model()
        problem = now.problem
        places = study.places(problem, np.asarray(now.modal.Phi))
        nobody = Scope((), (), (), (), lambda: True, lambda line: None)
        fitted = nominal_fit(problem, nobody, seed)
        explained = fitted.cost < FAR * left_by_noise(problem)
        z = fitted.theta.mean(axis=0)[: problem.parameters]
        z = z if explained else problem.with_given_joints(z)
        sensors = {**study.sensors, **_more_sensors(study)}
        wider = replace(
            study,
            sensors=sensors,
            noise=np.append(study.noise, np.full(len(sensors) - len(study.sensors), np.nan)),
        )
        substeps = problem.predictor.substeps
        return cls(wider, len(study.sensors), z, substeps, places, problem, explained)

    @property
    def more_sensors(self) -> tuple[str, ...]:
        """Places of the sensors that might be added."""
        return tuple(self.study.sensors)[self.present :]

    def with_present_sensors(self) -> "PlanBase":
        """The same by the sensors that there are."""
        sensors = dict(itertools.islice(self.study.sensors.items(), self.present))
        noise = self.study.noise[: self.present]
        return replace(self, study=replace(self.study, sensors=sensors, noise=noise))

    def alone(
        self, recording: StudyRecording, time_constant: float = math.inf
    ) -> tuple[HistoryProblem, HypothesisFit]:
        """One recording, and what the model predicts of it, its state refitted."""
        recording = _narrowed(recording, len(self.study.sensors))
        own = replace(self.study, recordings=[replace(recording, use="fit")])
        problem = own.resolution.with_substeps(self.substeps).problem
        start = Start(problem.nothing(), problem.map.given(self.z))
        (found,) = multistart(problem, [start], time_constant, STEPS if recording.moving else 0)
        return problem, found

    def planned(self) -> Iterator[StudyRecording]:
        """Recordings to fit, with what the sensors that might be added would show.

        Of a state that has to be estimated nobody knows what they would show of it: they are
        counted in recordings from rest only.
        """
        for each in self.study.recordings:
            if each.use == "fit":
                wider = self._widened(each)
                seen = each.moving or not self.more_sensors
                yield wider if seen else self._predicted(wider, self.present)

    def added(self) -> Iterator[tuple[str, StudyRecording]]:
        """The hardest force from rest at every input, at some levels, where that is not planned."""
        forced = [e for e in self.study.recordings if e.use == "fit" and not e.moving]
        peaks = [np.max(np.abs(e.force), axis=0) for e in forced if e.force is not None]
        if not peaks:
            return
        hardest = forced[int(np.argmax([p.max() for p in peaks]))]
        assert hardest.force is not None
        assert hardest.force_noise is not None
        which = int(np.argmax(np.max(np.abs(hardest.force), axis=0)))
        column, peak = hardest.force[:, which], max(p.max() for p in peaks)
        known = hardest.force_noise
        for i, label in enumerate(self.study.inputs):
            for level in LEVELS:
                there = any(_same(level * peak, p[i]) for p in peaks)
                if label == BASE or there:
                    continue
                force = np.zeros_like(hardest.force)
                force[:, i] = level * column
                silent, source = np.zeros(len(known.deviation)), [""] * len(known.source)
                silent[i], source[i] = known.deviation[which], known.source[which]
                noise = InputNoise(silent, tuple(source))
                name = f"{label}, peak {level * peak:.3g}"
                other = replace(hardest, name=name, force=force, force_noise=noise)
                yield name, self._predicted(self._widened(other))

    def _widened(self, recording: StudyRecording) -> StudyRecording:
        """With columns for the sensors that might be added."""
        more, noise = len(self.more_sensors), recording.noise
        assert noise is not None
        # Something to begin with, where it is predicted.
        first = recording.response[:, np.flatnonzero(recording.measured)[:1]]
        usual = float(np.median(noise.deviation[recording.measured]))
        unseen = np.repeat(first * (np.nan if recording.moving else 1.0), more, axis=1)
        deviation, lower, upper = (
            np.append(x, np.full(more, usual)) for x in (noise.deviation, noise.lower, noise.upper)
        )
        freedom = np.append(noise.freedom, np.full(more, np.inf))
        source = (*noise.source, *[GIVEN] * more)
        return replace(
            recording,
            response=np.hstack([recording.response, unseen]),
            noise=SensorNoise(deviation, freedom, source, lower, upper),
        )

    def _predicted(self, recording: StudyRecording, first: int = 0) -> StudyRecording:
        """With what the model predicts of the sensors from the first of them on."""
        problem, at = self.alone(recording)
        off = innovations(problem, at.hypothesis, at.theta, np.inf)
        shown = (np.asarray(problem.data.response) - off)[0, : len(recording.response)]
        response = recording.response.copy()
        response[:, first:] = shown[:, first:]
        return replace(recording, response=response)


def _narrowed(recording: StudyRecording, count: int) -> StudyRecording:
    """By its first few sensors."""
    noise = recording.noise
    assert noise is not None
    return replace(recording, response=recording.response[:, :count], noise=noise.first(count))


def _more_sensors(study: PreparedStudy) -> dict[str, np.ndarray]:
    """A sensor at each place that none sees yet."""
    present = [np.asarray(row) / np.linalg.norm(row) for row in study.sensors.values()]
    found = {}
    for name, row in study.rows.items():
        size = np.linalg.norm(row)
        if size > 0 and all(abs(row @ other) < _PARALLEL * size for other in present):
            found[name] = row
    return found


def _same(a: float, b: float) -> bool:
    return b > 0.0 and abs(np.log(a / b)) < _SAME
