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
from iwanjax.identification.force_noise import mean_and_scatter, moved_by_force_noise
from iwanjax.identification.joint_priors import Joint
from iwanjax.identification.likelihood import left_by_noise
from iwanjax.identification.linearise import innovations
from iwanjax.identification.macroslip import alternatives
from iwanjax.identification.predictor import Predictor
from iwanjax.identification.problem import HistoryProblem, Hypothesis
from iwanjax.identification.recordings import StudyRecording
from iwanjax.identification.step_errors import changed, of_own_motion
from iwanjax.settings.conditioning import CONDITIONING, ConditioningSettings
from iwanjax.settings.histories import HISTORIES, HistorySettings


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
        *,
        held_out: bool = True,
    ) -> "StudyData":
        """All of them for one predictor, the noise of their sensors known.

        Those held out are filled up to the length of those to fit, for one kernel; longer ones
        have kernels of their own, so that no step of a fit runs on through their length. Without
        ``held_out`` those to fit alone, as they are beside the others.
        """
        order = tuple(i for i, each in enumerate(recordings) if each.use == "fit")
        rest = [i for i, each in enumerate(recordings) if each.use == "hold_out"]
        count, directions = len(order), directions_of(recordings, made, settings)
        fitted = max(len(recordings[i].response) for i in order)

        def taken(those: Sequence[int]) -> ConditionedRecordings:
            own = [recordings[i] for i in those]
            length = max([fitted, *(len(each.response) for each in own)])
            return conditioned(own, made, modal, known, length, count, directions, settings)

        rest = rest if held_out else []
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
                "the noise, with the steps between samples that were taken: what is as "
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

    def of_verdict(self, sides: StudyData, shown: RankedFit) -> StudyData:
        """What steps leave of the model that a verdict is on, whatever they leave of others.

        A suspect that is far from the truth may want many more than the law that takes its place.
        """
        problem, fitted, left = shown.problem, shown.fitted, self._left
        model = fitted.hypothesis, fitted.theta
        finer = self._compared(problem, 2 * problem.predictor.substeps)
        seen = of_own_motion(problem, finer, *model, self._same)
        if left * seen.ratio > 1.0:
            # Half a recording from rest may be off by more than all of it.
            seen = changed(problem, finer, *model, self._same)
        return replace(sides, left_by_steps=left * seen.change if left * seen.ratio > 1.0 else 0.0)

    @property
    def _left(self) -> float:
        """What steps leave over what twice as many change."""
        return 1.0 / (1.0 - 0.5**self.settings.steps.order)

    @property
    def _same(self) -> Mapping[float, float]:
        """Differences by finer steps that are none, by the observer's memory."""
        return {
            TIME_CONSTANT: self.settings.steps.same,
            math.inf: self.settings.steps.same_free,
        }

    def _of(self, now: Refined, best: RankedFit) -> Refined:
        fitted = best.fitted
        return self._finer(now, best.problem, fitted.hypothesis, fitted.theta, self._same)

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

        for errors that fall with the power p of the step, and for all that fall faster. What does
        not fall at all is none of the steps: such a model is unstable, and stays so.
        """
        steps, known = now.problem.predictor.substeps, self.settings.steps
        left = self._left
        finer = self._compared(problem, 2 * steps)
        seen = of_own_motion(problem, finer, hypothesis, theta, same)
        if left * seen.ratio <= 1.0:
            return now
        if steps >= known.most:
            return now.leaving(left * seen.change)
        before = math.inf
        while True:
            seen = changed(problem, finer, hypothesis, theta, same)
            if seen.ratio >= before:
                return now.leaving(left * seen.change)
            before = seen.ratio
            enough = max(steps, math.ceil(steps * (left * seen.ratio) ** (1.0 / known.order)))
            # A finer pair tells it more sharply, where errors fall faster than that.
            if enough <= 2 * steps or 2 * steps >= known.most:
                break
            steps, problem = 2 * steps, finer
            finer = self._compared(problem, 2 * steps)
        if enough > known.most:
            left *= (steps / known.most) ** known.order
            return self.with_substeps(known.most).leaving(left * seen.change)
        return now if enough == now.problem.predictor.substeps else self.with_substeps(enough)

    def _compared(self, problem: HistoryProblem, substeps: int) -> HistoryProblem:
        """The same with other steps, as far as residuals ask for it.

        Held-out recordings and the noise of forces wait until it is known which steps do: of long
        recordings they take gigabytes and minutes.
        """
        by, modal = self.made(substeps)
        conditioning = self.settings.conditioning
        own = StudyData.of(
            self.recordings, by, modal, self.noise, conditioning, held_out=False
        ).fitted
        return problem.with_steps_of(
            replace(problem, predictor=by, data=own.data, forces=own.forces)
        )

    def with_substeps(self, substeps: int) -> Refined:
        """With so many steps between samples."""
        by, modal = self.made(substeps)
        sides = StudyData.of(self.recordings, by, modal, self.noise, self.settings.conditioning)
        noise = usual_noise([sides.fitted, *(each for each, _ in sides.held)])
        data = sides.fitted.data
        forces = sides.fitted.forces
        problem = HistoryProblem(by, self.joints, data, noise, sides.order, self.settings, forces)
        draws = self.settings.conditioning.force_draws
        moved = moved_by_force_noise(problem, *_given(problem), TIME_CONSTANT, draws)
        if len(moved):
            problem = replace(problem, driven=float(np.sum(mean_and_scatter(moved)[0])))
        return Refined(sides, problem, modal)


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
