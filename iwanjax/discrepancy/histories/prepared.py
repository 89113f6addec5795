"""Recordings and a model made ready for one another: noise, offsets, states, predictor, places."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import jax
import numpy as np

from iwanjax.discrepancy.histories.time_steps import StepRefinement
from iwanjax.effects.catalogue import kinds_in_time, limits_outside, sensor_faults_of
from iwanjax.effects.kinds import ForceKind, Kind
from iwanjax.errors import InputError
from iwanjax.identification.conditioning import require_usable
from iwanjax.identification.initial_state import initial_state, unsteady
from iwanjax.identification.joint_priors import Joint
from iwanjax.identification.offsets import without_offsets
from iwanjax.identification.places import Place, followed, places_of
from iwanjax.identification.predictor import Quantity, predictor
from iwanjax.identification.problem import HistoryProblem
from iwanjax.identification.recordings import StudyRecording, with_force_noise, with_noise
from iwanjax.joints import AbstractJoint
from iwanjax.settings.stages import settings
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
