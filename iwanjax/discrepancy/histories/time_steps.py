"""As many steps between samples as change no residual any more."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import numpy as np

from iwanjax.discrepancy.histories.ranking import TIME_CONSTANT, RankedFit
from iwanjax.discrepancy.histories.validation import FreeRun, free_run
from iwanjax.dynamics.coordinates import ModalCoordinates
from iwanjax.errors import InputError, attempted
from iwanjax.identification.conditioning import (
    ConditionedRecordings,
    conditioned,
    directions_of,
    usual_noise,
)
from iwanjax.identification.joint_priors import Joint
from iwanjax.identification.likelihood import left_by_noise
from iwanjax.identification.linearise import innovations, residuals_at
from iwanjax.identification.macroslip import alternatives
from iwanjax.identification.predictor import Data, Predictor
from iwanjax.identification.problem import HistoryProblem, Hypothesis
from iwanjax.identification.recordings import StudyRecording
from iwanjax.settings.histories import (
    CONDITIONING,
    HISTORIES,
    ConditioningSettings,
    HistorySettings,
)

# Errors of a free run that grow with time are so much larger over twice a time than they were over
# its second half: mean squares of 4/3 and 7/12.
_GROWN = math.sqrt(16.0 / 7.0)


@dataclass(frozen=True, eq=False)
class StudyData:
    """Recordings to fit, and those held out in batches of the same size.

    Attributes
    ----------
    fitted : ConditionedRecordings
        Recordings to fit.
    order : tuple of int
        Their places in the study.
    held : tuple of (ConditionedRecordings, tuple of int)
        The same of those held out.
    left_by_steps : float, deviations of the noise
        What steps between samples may leave in residuals, where that is more than is allowed.
    """

    fitted: ConditionedRecordings
    order: tuple[int, ...]
    held: tuple[tuple[ConditionedRecordings, tuple[int, ...]], ...]
    left_by_steps: float = 0.0

    @classmethod
    def of(
        cls,
        recordings: Sequence[StudyRecording],
        made: Predictor,
        modal: ModalCoordinates,
        known: np.ndarray,
        settings: ConditioningSettings = CONDITIONING,
    ) -> "StudyData":
        """All of them for one predictor, the noise of their sensors known.

        Those held out are filled up to the length of those to fit, for one kernel; longer ones
        have kernels of their own, so that no step of a fit runs on through their length.
        """
        order = tuple(i for i, each in enumerate(recordings) if each.use == "fit")
        rest = [i for i, each in enumerate(recordings) if each.use == "hold_out"]
        count, directions = len(order), directions_of(recordings, made, settings)
        fitted = max(len(recordings[i].response) for i in order)

        def taken(those: Sequence[int]) -> ConditionedRecordings:
            own = [recordings[i] for i in those]
            length = max([fitted, *(len(each.response) for each in own)])
            return conditioned(own, made, modal, known, length, count, directions, settings)

        held = [tuple(rest[i : i + count]) for i in range(0, len(rest), count)]
        return cls(taken(order), order, tuple((taken(those), those) for those in held))

    def free(
        self, entry: RankedFit, failures: list[str], *, replaced: bool = False
    ) -> tuple[FreeRun, FreeRun | None]:
        """Free runs against both; without those held out where their run fails.

        Of a model that another one replaces nobody asks how unsure macroslip leaves it.
        """
        other = [] if replaced else alternatives(entry.problem, entry.fitted)
        fitted = free_run(entry.problem, entry.fitted, other, [(self.fitted, self.order)])
        if not self.held:
            return fitted, None
        return fitted, attempted(
            "predicting the held-out recordings",
            lambda: free_run(entry.problem, entry.fitted, other, self.held),
            None,
            failures,
        )

    def warnings(self) -> list[str]:
        """What a verdict on so little may miss."""
        told = []
        if not self.held:
            told.append("No recording was held out, so nothing shows that the verdict holds")
        if len(self.order) == 1:
            told.append("One recording alone tells little of amplitude, and nothing of repetition")
        if self.left_by_steps > 0.0:
            told.append(
                f"Errors of the time integration may reach {self.left_by_steps:.2g} deviations of "
                "the noise, with as many steps between samples as are taken at most: what is as "
                "small as that may be no missing physics; measure with a higher sampling rate"
            )
        return told


class Refined(NamedTuple):
    """Recordings and what fits them, with some number of steps between samples.

    Attributes
    ----------
    sides : StudyData
        Recordings to fit, and those held out.
    problem : HistoryProblem
        Of the former.
    modal : ModalCoordinates
        Modes that both are in.
    """

    sides: StudyData
    problem: HistoryProblem
    modal: ModalCoordinates

    def leaving(self, left: float) -> "Refined":
        """The same, where steps leave so many deviations, if that is more than was known."""
        if left <= self.sides.left_by_steps:
            return self
        return self._replace(sides=replace(self.sides, left_by_steps=left))


@dataclass(frozen=True, eq=False)
class StepRefinement:
    """Recordings that can be taken with any number of steps between samples.

    Attributes
    ----------
    made : function
        Steps between samples -> predictor and modes.
    joints : tuple of Joint
        About their given values.
    recordings : sequence of StudyRecording
        All of them.
    noise : (sensors,) array
        Deviations.
    settings : HistorySettings
        Tuned numbers of all stages.
    """

    made: Callable[[int], tuple[Predictor, ModalCoordinates]]
    joints: tuple[Joint, ...]
    recordings: Sequence[StudyRecording]
    noise: np.ndarray
    settings: HistorySettings = HISTORIES

    def of_model(self) -> Refined:
        """With steps that do while suspects of the model as given are compared.

        Raises
        ------
        InputError
            Where units seem to be mixed up.
        """
        coarse = self.with_substeps(self.settings.steps.fewest)
        _require_same_units(coarse.problem)
        same = {TIME_CONSTANT: self.settings.steps.compared}
        return self._finer(coarse, coarse.problem, *_given(coarse.problem), same)

    def of_free_run(self, now: Refined, best: RankedFit) -> Refined:
        """With steps that do for a free run as well: ``now`` itself, where these are enough."""
        return self._of(now, best)

    def of_fit(self, now: Refined, best: RankedFit) -> Refined:
        """With steps that do for a fit: ``now`` itself, where these are enough.

        A stiff suspect may want more than the model without it.
        """
        known = self.settings.steps
        left = best.fitted.cost / left_by_noise(best.problem)
        more = now.problem.predictor.substeps < known.most and left > known.more_than_noise
        return self._of(now, best) if more else now

    def _of(self, now: Refined, best: RankedFit) -> Refined:
        fitted, known = best.fitted, self.settings.steps
        same = {TIME_CONSTANT: known.same, math.inf: known.same_free}
        return self._finer(now, best.problem, fitted.hypothesis, fitted.theta, same)

    def _finer(
        self,
        now: Refined,
        problem: HistoryProblem,
        hypothesis: Hypothesis,
        theta: np.ndarray,
        same: Mapping[float, float],
    ) -> Refined:
        r"""With the fewest steps that are enough, by what doubling them changes.

        Where doubling k steps changes :math:`\delta`, k' of them leave no more than

        .. math:: \frac{(k/k')^p}{1-2^{-p}}\, \delta, \qquad k' \geq k

        for errors that fall with the power p of the step, and for all that fall faster.
        """
        steps, known = now.problem.predictor.substeps, self.settings.steps
        left = 1.0 / (1.0 - 0.5**known.order)
        finer = problem.with_steps_of(self.with_substeps(2 * steps).problem)
        seen = of_own_motion(problem, finer, hypothesis, theta, same)
        if left * seen.ratio <= 1.0:
            return now
        if steps >= known.most:
            return now.leaving(left * seen.change)
        while True:
            seen = changed(problem, finer, hypothesis, theta, same)
            enough = max(steps, math.ceil(steps * (left * seen.ratio) ** (1.0 / known.order)))
            # A finer pair tells it more sharply, where errors fall faster than that.
            if enough <= 2 * steps or 2 * steps >= known.most:
                break
            steps, problem = 2 * steps, finer
            finer = problem.with_steps_of(self.with_substeps(2 * steps).problem)
        if enough > known.most:
            left *= (steps / known.most) ** known.order
            return self.with_substeps(known.most).leaving(left * seen.change)
        return now if enough == now.problem.predictor.substeps else self.with_substeps(enough)

    def with_substeps(self, substeps: int) -> Refined:
        """With so many steps between samples."""
        by, modal = self.made(substeps)
        sides = StudyData.of(self.recordings, by, modal, self.noise, self.settings.conditioning)
        noise = usual_noise([sides.fitted, *(each for each, _ in sides.held)])
        data = sides.fitted.data
        forces = sides.fitted.forces
        problem = HistoryProblem(by, self.joints, data, noise, sides.order, self.settings, forces)
        return Refined(sides, problem, modal)


class Change(NamedTuple):
    """What finer steps change in residuals.

    Attributes
    ----------
    change : float, deviations
        Root mean square of the recording that changes most.
    ratio : float
        That over what is allowed.
    """

    change: float
    ratio: float

    @classmethod
    def most(cls, changes: Mapping[float, float], same: Mapping[float, float]) -> "Change":
        """Of some time constants the one for which it counts most."""
        each = (cls(change, change / same[key]) for key, change in changes.items())
        return max(each, key=lambda one: one.ratio)


def changed(
    problem: HistoryProblem,
    finer: HistoryProblem,
    hypothesis: Hypothesis,
    theta: np.ndarray,
    same: Mapping[float, float],
) -> Change:
    """What finer steps change in the residuals of the recording that changes most.

    Parameters
    ----------
    problem, finer : HistoryProblem
        With fewer and with more steps between samples.
    hypothesis, theta
        Whose residuals.
    same : mapping of float to float
        Observer's time constants in cycles, and the change that each allows.
    """
    points, changes = [(hypothesis, theta)], {}
    for time_constant in same:
        off = (
            residuals_at(finer, points, time_constant)[0]
            - residuals_at(problem, points, time_constant)[0]
        )
        changes[time_constant] = float(np.max(np.sqrt(np.mean(off**2, axis=(1, 2)))))
    return Change.most(changes, same)


def of_own_motion(
    problem: HistoryProblem,
    twice: HistoryProblem,
    hypothesis: Hypothesis,
    theta: np.ndarray,
    same: Mapping[float, float],
) -> Change:
    """What steps leave of recordings that the model itself makes with twice as many.

    Without another kernel, which takes seconds to compile: half a recording with twice as many
    steps has as many as the whole. So each half is made from rest, from where its force begins,
    and predicted from there; the half that is off most counts. What an observer's corrections
    add in a model that is far from the recording is not in it, and small beside what that is off.
    A sensor's fault, whose delay counts samples, is left out.

    Parameters
    ----------
    problem, twice : HistoryProblem
        With any number of steps between samples, and with twice as many.
    hypothesis, theta, same
        As for :func:`changed`.
    """
    data, steps = problem.data, problem.predictor.substeps
    push, weight = np.asarray(data.push), np.asarray(data.weight)
    finer = np.asarray(twice.data.push).reshape(len(push), -1, *push.shape[2:])
    begin, size = np.argmax(np.any(push != 0.0, axis=(2, 3)), axis=1), push.shape[1]
    # Samples at full weight; in a pulse they hardly count.
    peak = np.max(weight, axis=1, keepdims=True)
    full = np.divide(weight, peak, out=np.zeros_like(weight), where=peak > 0.0) ** 2
    chain = jax.device_put(np.zeros(hypothesis.suspects.chain.shape))
    faultless = replace(hypothesis, suspects=hypothesis.suspects._replace(chain=chain))
    halved = replace(twice, predictor=replace(twice.predictor, substeps=steps))
    silent, off = np.zeros_like(weight), {time_constant: [] for time_constant in same}
    for half in range(2):
        edges = np.minimum(begin[:, None] + size // 2 * np.array([half, half + 1]), size)
        made, own = np.zeros_like(push), np.zeros_like(push)
        for i, (a, b) in enumerate(edges):
            made[i, : 2 * (b - a)] = finer[i, 2 * a : 2 * b]
            own[i, a:b] = push[i, a:b]
        run = replace(halved, data=_of_itself(data, made, silent))
        exact = -innovations(run, faultless, theta, math.inf)
        there = replace(problem, data=_of_itself(data, own, silent))
        # Beyond its end each half goes on as predicted, lest the band's filter sees an end.
        response = -innovations(there, faultless, theta, math.inf)
        for i, (a, b) in enumerate(edges):
            response[i, a:b] = exact[i, 1 : 2 * (b - a) : 2]
        there = replace(problem, data=_of_itself(data, own, response))
        for time_constant, found in off.items():
            e = residuals_at(there, [(faultless, theta)], time_constant)[0]
            for i, (a, b) in enumerate(edges):
                found += _root_mean_square(e[i, a:b], full[i, a:b])
                if math.isinf(time_constant):
                    middle = (a + b) // 2
                    later = _root_mean_square(e[i, middle:b], full[i, middle:b])
                    found += [_GROWN * each for each in later]
    return Change.most({key: max(found, default=math.inf) for key, found in off.items()}, same)


def _root_mean_square(e: np.ndarray, full: np.ndarray) -> list[float]:
    """Of residuals over the samples that count; none where these are none."""
    count = float(np.sum(full))
    return [math.sqrt(float(np.sum(e**2)) / count)] if count > 0.0 else []


def _of_itself(data: Data, push: np.ndarray, response: np.ndarray) -> Data:
    """What a model would measure itself, whose state is certain."""
    push, response, kick = jax.device_put((push, response, np.zeros(data.kick.shape)))
    return data._replace(push=push, response=response, kick=kick)


def _given(problem: HistoryProblem) -> tuple[Hypothesis, np.ndarray]:
    """The model with its joints as given."""
    return problem.nothing(), problem.still(problem.map.given())


def _require_same_units(problem: HistoryProblem) -> None:
    """Refuse recordings that are of quite another size than the forces can have caused."""
    quantity = problem.predictor.quantity
    seen = np.asarray(problem.data.weight) > 0
    measured = np.asarray(problem.data.response)[seen]
    predicted = measured - innovations(_from_rest(problem), *_given(problem), math.inf)[seen]
    ratio = math.sqrt(float(np.mean(measured**2) / np.mean(predicted**2)))
    most = problem.settings.steps.other_units
    if math.isfinite(ratio) and not 1.0 / most < ratio < most:
        raise InputError(
            f"recordings: the measured {quantity} is {ratio:.2g} times what the model predicts "
            "from the forces; are forces, responses and matrices in one system of units?"
        )


def _from_rest(problem: HistoryProblem) -> HistoryProblem:
    """Recordings with a force, without the state that was estimated from their responses."""
    push = np.array(problem.data.push)
    forced = np.any(push[:, 1:] != 0, axis=(1, 2, 3))
    push[forced, 0] = 0.0
    return replace(problem, data=problem.data._replace(push=jax.device_put(push)))
