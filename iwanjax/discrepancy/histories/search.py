"""The search, with steps between samples, modes and noise as the best model so far has them."""

import math
from dataclasses import replace
from typing import NamedTuple

import jax
import numpy as np

from iwanjax.discrepancy.histories.prepared import PreparedStudy
from iwanjax.discrepancy.histories.ranking import STEPS, TIME_CONSTANT, RankedFit, Scope, least
from iwanjax.discrepancy.histories.restarts import FAR, nominal_fit
from iwanjax.discrepancy.histories.screening import (
    Screened,
    moved,
    screened,
    with_first_fits,
)
from iwanjax.discrepancy.histories.selection import ModelSelection, run
from iwanjax.discrepancy.histories.time_steps import Refined, StepRefinement
from iwanjax.identification.joint_priors import joints_of
from iwanjax.identification.likelihood import left_by_noise
from iwanjax.identification.linearise import innovations
from iwanjax.identification.multistart import HypothesisFit, multistart
from iwanjax.identification.recordings import StudyRecording
from iwanjax.settings.stages import settings
from iwanjax.signals.noise import of_rounding
from iwanjax.signals.sensor_noise import BESIDE_MODEL, SensorNoise, beside_model, like_others


class Begun(NamedTuple):
    """A model and recordings in some modes, with what a search of suspects begins from.

    Attributes
    ----------
    study : PreparedStudy
        Recordings and their noise.
    resolution : StepRefinement
        The same with any number of steps between samples.
    now : Refined
        With some number of them.
    nominal : HypothesisFit
        The model with its joints refitted.
    """

    study: PreparedStudy
    resolution: StepRefinement
    now: Refined
    nominal: HypothesisFit


def about_fitted_joints(begun: Begun, fitted: RankedFit, scope: Scope) -> Begun:
    """Errors of the linear part are those of the modes in which the joints of a fit stick.

    What a linear test shows, and what a model's frequencies are trusted for, are modes in which
    joints stick, whatever stiffness they have. With that of joints as given these modes have other
    shapes, and no errors of their frequencies make up for it. All stays where no such errors are
    fitted, and where joints are bent to explain something else.

    Parameters
    ----------
    begun : Begun
        Recordings in other modes.
    fitted : RankedFit
        The model with its joints refitted, whatever else it has.
    scope : Scope
        How long there is time.
    """
    study, now, own = begun.study, begun.now, fitted.problem
    bent = fitted.fitted.cost > FAR * left_by_noise(own)
    if bent or not (own.predictor.errors and own.joints and scope.in_time()):
        return begun
    z = jax.device_put(fitted.fitted.theta.mean(axis=0)[: own.parameters])
    # A joint that only a hypothesis has comes after those of the model.
    resolution = study.about(joints_of(own.joints, z)[: len(study.structure.elements)])
    moved = resolution.with_substeps(now.problem.predictor.substeps)
    moved = moved.leaving(now.sides.left_by_steps)
    return _refitted(Begun(study, resolution, moved, begun.nominal), scope)


def with_noise_left(begun: Begun, best: RankedFit) -> Begun:
    """Noise of sensors is what the best model leaves of them, where that is like noise.

    A sensor of a held-out recording has the noise that it has beside the model in the others, as
    far as that recording allows it.

    Parameters
    ----------
    begun : Begun
        With noise as told by the recordings alone; itself where the model tells no more of it.
    best : RankedFit
        The model that fits them best.
    """
    problem, fitted, recordings = best.problem, best.fitted, list(begun.study.recordings)
    if not any(np.any(_noise(recordings[i]).open) for i in problem.order):
        return begun
    # In the free run: a memory corrects slow noise as it corrects motion.
    left = innovations(problem, fitted.hypothesis, fitted.theta, math.inf)
    # What is added to a sensor is still in what is left of it.
    added = [fitted.hypothesis.channels[slot] for slot in fitted.hypothesis.added]
    as_it_is = ~np.isin(np.arange(left.shape[2]), added)
    told = []
    for i, residual in zip(problem.order, left, strict=True):
        each, conditioning = recordings[i], problem.settings.conditioning
        own = np.where(each.measured & as_it_is, residual[: len(each.response)], np.nan)
        told.append(beside_model(_noise(each), own, conditioning))
        recordings[i] = replace(each, noise=told[-1])
    if not any(BESIDE_MODEL in noise.source for noise in told):
        return begun
    for i, each in enumerate(recordings):
        if each.use == "hold_out":
            recordings[i] = replace(each, noise=like_others(_noise(each), told))
    rounded = (of_rounding(each.response.astype(float)) for each in recordings)
    pairs = zip(recordings, rounded, strict=True)
    found = [replace(each, noise=_noise(each).at_least(least)) for each, least in pairs]
    resolution = replace(begun.resolution, recordings=found)
    now = resolution.with_substeps(begun.now.problem.predictor.substeps)
    return Begun(
        replace(begun.study, recordings=found),
        resolution,
        now.leaving(begun.now.sides.left_by_steps),
        begun.nominal,
    )


def _noise(recording: StudyRecording) -> SensorNoise:
    """As it was told when the study was prepared."""
    assert recording.noise is not None
    return recording.noise


def searched(study: PreparedStudy, scope: Scope, seed: int) -> tuple[Begun, Scope, ModelSelection]:
    """The competition, with steps, noise and modes as the model that fits best has them.

    Parameters
    ----------
    study : PreparedStudy
        With its joints as given.
    scope : Scope
        What may be suspected, without places.
    seed : int
        Of the starts.

    Returns
    -------
    begun, scope, table
        Recordings as they were compared, what may be suspected where, how it ended.
    """
    now = study.resolution.of_model()
    scope.progress("refitting the joints")
    begun = Begun(study, study.resolution, now, nominal_fit(now.problem, scope, seed))
    other = about_fitted_joints(begun, RankedFit(now.problem, begun.nominal), scope)
    bent = other is begun
    if other.nominal.cost < begun.nominal.cost:
        begun = other
    within, seen = _screened(begun, scope)
    other = with_steps_for(begun, _best(begun, seen))
    if other is not begun and scope.in_time():
        begun = _refitted(other, scope)
        seen = moved(seen, begun.now.problem, scope)
    if bent and _left(_best(begun, seen)) > settings().histories.selection.misfit:
        # Joints that were bent without it may be those of the structure beside what was found.
        other = about_fitted_joints(begun, _best(begun, seen), scope)
        if other is not begun:
            there = _screened(other, scope)
            if _left(_best(other, there[1])) < _left(_best(begun, seen)):
                begun, (within, seen) = other, there
    table = run(begun.now.problem, begun.nominal, seen, within, seed)
    # Not before: a sensor's drift is like noise as well.
    begun = with_noise_left(begun, table.best)
    return begun, within, table.on(begun.now.problem)


def with_steps_for(begun: Begun, best: RankedFit) -> Begun:
    """As many steps between samples as the best model needs, where it leaves more than noise."""
    now = begun.resolution.of_fit(begun.now, best)
    return begun if now is begun.now else begun._replace(now=now)


def _screened(begun: Begun, scope: Scope) -> tuple[Scope, Screened]:
    """Suspects at the places that move in these modes."""
    modal, problem = begun.now.modal, begun.now.problem
    scope = replace(scope, places=begun.study.places(problem, np.asarray(modal.Phi)))
    scope, seen = screened(problem, begun.nominal, scope)
    return scope, with_first_fits(problem, begun.nominal, seen, scope)


def _best(begun: Begun, seen: Screened) -> RankedFit:
    """The model that fits best so far."""
    problem = begun.now.problem
    return RankedFit(problem, least(begun.nominal, seen.entries))


def _refitted(begun: Begun, scope: Scope) -> Begun:
    """The nominal model where steps or modes have changed."""
    (nominal,) = multistart(
        begun.now.problem, [begun.nominal.start], TIME_CONSTANT, STEPS, in_time=scope.in_time
    )
    return begun._replace(nominal=nominal)


def _left(entry: RankedFit) -> float:
    """Squares that a model leaves, over those of the noise."""
    return entry.fitted.cost / left_by_noise(entry.problem)
