"""Recordings and a model made ready for one another, and searched in the modes of its joints."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import jax
import numpy as np

from iwanjax.discrepancy.histories.ranking import STEPS, TIME_CONSTANT, RankedFit, Scope, again
from iwanjax.discrepancy.histories.restarts import FAR, nominal_fit
from iwanjax.discrepancy.histories.selection import ModelSelection, run
from iwanjax.discrepancy.histories.time_steps import Refined, StepRefinement
from iwanjax.effects.catalogue import kinds_in_time, limits_outside, sensor_faults_of
from iwanjax.effects.kinds import ForceKind, Kind
from iwanjax.errors import InputError
from iwanjax.identification.conditioning import require_usable
from iwanjax.identification.initial_state import initial_state, unsteady
from iwanjax.identification.joint_priors import Joint, joints_of
from iwanjax.identification.likelihood import left_by_noise
from iwanjax.identification.linearise import innovations
from iwanjax.identification.multistart import HypothesisFit, multistart
from iwanjax.identification.offsets import without_offsets
from iwanjax.identification.places import Place, followed, places_of
from iwanjax.identification.predictor import Quantity, predictor
from iwanjax.identification.problem import HistoryProblem
from iwanjax.identification.recordings import StudyRecording, with_force_noise, with_noise
from iwanjax.joints import AbstractJoint
from iwanjax.settings.stages import settings
from iwanjax.signals.noise import of_rounding
from iwanjax.signals.sensor_noise import BESIDE_MODEL, SensorNoise, beside_model, like_others
from iwanjax.structures import JointedStructure, LinearTrust
from iwanjax.structures.checks import finite_array
from iwanjax.structures.model_file import BASE
from iwanjax.types import ArrayLike


@dataclass(frozen=True, eq=False)
class PreparedStudy:
    """A model and recordings that can be compared with it.

    Attributes
    ----------
    structure : JointedStructure
        Joints at their starting values.
    recordings : sequence of StudyRecording
        Without offsets, their noise and the states they begin in known.
    sampling_rate : float
        Hz.
    rows, sensors, inputs : mapping of str to (n,) array
        Where a force may be missing, what the sensors see, where forces act.
    quantity : {"acceleration", "velocity", "displacement"}
        What the sensors measure.
    kinds : tuple of Kind
        To be tried.
    noise : (sensors,) array
        Deviations that the study gives; NaN where it does not.
    trust : LinearTrust or None
        How exact the linear model is.
    warnings : tuple of str
        What was taken off the recordings, and what contradicts itself in them.
    """

    structure: JointedStructure
    recordings: Sequence[StudyRecording]
    sampling_rate: float
    rows: Mapping[str, np.ndarray]
    sensors: Mapping[str, np.ndarray]
    inputs: Mapping[str, np.ndarray]
    quantity: Quantity
    kinds: tuple[Kind, ...]
    noise: np.ndarray
    trust: LinearTrust | None
    warnings: tuple[str, ...]

    @cached_property
    def outside(self) -> tuple[ForceKind, ...]:
        """Kinds that are not to be tried, but that some which are become."""
        return limits_outside(self.kinds)

    @cached_property
    def resolution(self) -> StepRefinement:
        """The recordings with any number of steps between samples."""
        return self.about(self.structure.elements)

    def about(self, elements: Sequence[AbstractJoint]) -> StepRefinement:
        """The same in the modes that the structure has where these joints stick, not its own.

        What is trusted of frequencies and damping is trusted of these modes. What is known of the
        joints beforehand stays as it is.

        Parameters
        ----------
        elements : sequence of AbstractJoint
            One for each of the structure's joints, in their order.
        """
        given = self.structure
        own = zip(np.asarray(given.rows), elements, strict=True)
        joints = dict(zip(given.labels, own, strict=True))
        structure = JointedStructure(given.structure, joints)
        ones = (Joint(j, jax.device_put(np.ones(len(j.parameters)))) for j in given.elements)
        rows_in, rows_out = (_rows(each) for each in (self.inputs, self.sensors))
        made = partial(
            predictor,
            structure,
            jax.device_put(rows_in),
            jax.device_put(rows_out),
            self.sampling_rate,
            self.quantity,
            (*(kind for kind in self.kinds if isinstance(kind, ForceKind)), *self.outside),
            trust=self.trust,
            faults=sensor_faults_of(self.kinds),
            base=list(self.inputs).index(BASE) if BASE in self.inputs else None,
        )
        return StepRefinement(made, tuple(ones), self.recordings, self.noise, settings().histories)

    def places(self, problem: HistoryProblem, shapes: np.ndarray) -> tuple[Place, ...]:
        """Places that move in some mode, with what they did; (coordinates, modes) shapes."""
        moving = {name: row @ shapes for name, row in self.rows.items() if np.any(row @ shapes)}
        return places_of(problem, followed(problem), moving)


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
    (nominal,) = multistart(
        moved.problem, [begun.nominal.start], TIME_CONSTANT, STEPS, in_time=scope.in_time
    )
    return Begun(study, resolution, moved, nominal)


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
    told = []
    for i, residual in zip(problem.order, left, strict=True):
        each, conditioning = recordings[i], problem.settings.conditioning
        own = np.where(each.measured, residual[: len(each.response)], np.nan)
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
    """The competition, with modes and noise as the model that fits best has them.

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
        Recordings in these modes and with this noise, what may be suspected where, how it ended.
    """
    now = study.resolution.of_model()
    scope.progress("refitting the joints")
    begun = Begun(study, study.resolution, now, nominal_fit(now.problem, scope, seed))
    moved = about_fitted_joints(begun, RankedFit(now.problem, begun.nominal), scope)
    if moved.nominal.cost < begun.nominal.cost:
        begun = moved
    scope, table = _competed(begun, scope, seed)
    if not scope.in_time():
        return begun, scope, table
    best, quieter = table.best, with_noise_left(begun, table.best)
    if quieter is not begun:
        begun, own = quieter, best.problem.with_steps_of(quieter.now.problem)
        (best,) = again([replace(best, problem=own)], [], TIME_CONSTANT, scope)
    if _left(best) < settings().histories.selection.misfit:
        return begun, scope, table
    # Joints that were bent without it may be those of the structure beside what was found.
    moved = about_fitted_joints(begun, best, scope)
    if moved is begun:
        return begun, scope, table
    scope.progress("searching again in the modes of the joints that were found")
    again_scope, renewed = _competed(moved, scope, seed)
    better = _left(renewed.best) < _left(best)
    return (moved, again_scope, renewed) if better else (begun, scope, table)


def _competed(begun: Begun, scope: Scope, seed: int) -> tuple[Scope, ModelSelection]:
    """Suspects compared at the places that move in these modes."""
    modal, problem = begun.now.modal, begun.now.problem
    scope = replace(scope, places=begun.study.places(problem, np.asarray(modal.Phi)))
    return scope, run(problem, begun.nominal, scope, seed)


def _left(entry: RankedFit) -> float:
    """Squares that a model leaves, over those of the noise."""
    return entry.fitted.cost / left_by_noise(entry.problem)


def prepared(
    structure: JointedStructure,
    recordings: Sequence[StudyRecording],
    sampling_rate: float,
    *,
    rows: Mapping[str, ArrayLike],
    sensors: Mapping[str, ArrayLike],
    inputs: Mapping[str, ArrayLike],
    quantity: Quantity = "acceleration",
    hypotheses: tuple[str, ...] = (),
    noise: Mapping[str, float] | None = None,
    trust: LinearTrust | None = None,
) -> PreparedStudy:
    """Offsets taken off, states at the beginning looked at, noise estimated where it is not given.

    Parameters
    ----------
    structure, recordings, sampling_rate, rows, sensors, inputs, quantity, hypotheses, noise, trust
        As for :func:`~iwanjax.discrepancy.histories.diagnose_histories`.

    Raises
    ------
    InputError
        For recordings whose force is zero or that do not fit the model, unknown hypotheses.
    """
    kinds = kinds_in_time(hypotheses)
    places = {name: finite_array(row, name) for name, row in rows.items()}
    for what, named in (("inputs", inputs), ("sensors", sensors)):
        if not named:
            raise InputError(
                f"diagnose: no {what}; expected {{name: row}} for at least one; the force of free "
                "decays is zero at any input"
            )
    rows_in, rows_out = (
        {name: finite_array(row, name) for name, row in named.items()}
        for named in (inputs, sensors)
    )
    _check(recordings, len(rows_in), len(rows_out))
    for each in recordings:
        require_usable(each)
    lacking = np.flatnonzero(~np.any([each.measured for each in recordings], axis=0))
    if lacking.size:
        name = tuple(sensors)[lacking[0]]
        raise InputError(f"diagnose: no recording has sensor {name}; leave it out")
    rigid = len(structure.basis.omega2) < structure.structure.size
    modes = np.sqrt(np.asarray(structure.basis.omega2)) / (2.0 * math.pi * sampling_rate)
    recordings, taken_off = without_offsets(
        recordings, list(sensors), list(inputs), quantity, rigid, modes
    )
    recordings = [replace(each, initial=initial_state(each)) for each in recordings]
    given = np.array([(noise or {}).get(name, math.nan) for name in sensors])
    conditioning = settings().histories.conditioning
    recordings, contradictions = with_noise(recordings, given, tuple(sensors), conditioning)
    of_inputs = {name: s for name, s in (noise or {}).items() if name not in sensors}
    recordings = [with_force_noise(each, list(inputs), of_inputs) for each in recordings]
    warnings = [*taken_off, *contradictions, *filter(None, map(unsteady, recordings))]
    if BASE in inputs and quantity != "acceleration":
        warnings.append(f"The ground moves: each {quantity} was taken to be relative to it")
    return PreparedStudy(
        structure,
        recordings,
        sampling_rate,
        places,
        rows_out,
        rows_in,
        quantity,
        kinds,
        given,
        trust,
        tuple(warnings),
    )


def _rows(named: Mapping[str, np.ndarray]) -> np.ndarray:
    return np.stack(list(named.values()))


def _check(recordings: Sequence[StudyRecording], inputs: int, sensors: int) -> None:
    if not any(each.use == "fit" for each in recordings):
        raise InputError("diagnose: no recording to fit; give at least one use: fit")
    for each in recordings:
        if each.response.ndim != 2 or each.response.shape[1] != sensors:
            raise InputError(
                f"{each.name}: response has shape {each.response.shape}; expected (N, {sensors}), "
                "a column for each sensor"
            )
        if each.force is not None and each.force.shape != (len(each.response), inputs):
            raise InputError(
                f"{each.name}: force has shape {each.force.shape}; expected "
                f"({len(each.response)}, {inputs})"
            )
