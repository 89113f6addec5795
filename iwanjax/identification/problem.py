"""Hypotheses, and what a search for their values rests on: predictor, data, observers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, TypeAlias

import equinox as eqx
import jax
import numpy as np

from iwanjax.effects.catalogue import sensor_faults_of
from iwanjax.effects.faults import AbstractAddedFault, AbstractForceFault
from iwanjax.effects.kinds import ForceKind, Kind
from iwanjax.identification.conditioning import MeasuredForces
from iwanjax.identification.joint_priors import Joint, parameters_of, tangents
from iwanjax.identification.observer import observer_gain, process_noise, stepped
from iwanjax.identification.predictor import Data, Predictor
from iwanjax.identification.suspects import ParameterMap, Suspects
from iwanjax.settings.histories import HISTORIES, HistorySettings

DIFFERENCE = 1e-4
"""Change of a parameter, in deviations of its prior, by which derivatives are taken."""
# Members of a batch whose size compiled kernels are made for.
_BATCH = 64
# Largest logarithm whose exponential is a number.
_LARGEST = 700.0


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """What might be missing: one suspect in each slot, or a joint that drifts.

    Attributes
    ----------
    kinds : tuple of Kind
        Of the suspects; none is the model as it is.
    where : tuple of str
        Labels of their places, sensors or joints.
    suspects : Suspects
        As arrays.
    sizes, shapes : tuple of bool
        Which of the slots' sizes and shapes are fitted.
    drifting : int or None
        Joint whose strength changes between recordings.
    scales : tuple of float
        Units of the slots' sizes.
    channels : tuple of int
        Of each slot the input whose force is faulty, or the sensor that something is added to;
        -1 without such a fault.
    """

    kinds: tuple[Kind, ...]
    where: tuple[str, ...]
    suspects: Suspects
    sizes: tuple[bool, ...] = (False,)
    shapes: tuple[bool, ...] = (False,)
    drifting: int | None = None
    scales: tuple[float, ...] = (1.0,)
    channels: tuple[int, ...] = (-1,)

    @property
    def of_forces(self) -> list[int]:
        """Slots with a fault of a measured force: what came last is undone first."""
        slots = [i for i, kind in enumerate(self.kinds) if isinstance(kind, AbstractForceFault)]
        return sorted(slots, key=lambda i: not getattr(self.kinds[i], "last", False))

    @property
    def added(self) -> dict[int, AbstractAddedFault]:
        """What is added to sensors, by slots."""
        pairs = enumerate(self.kinds)
        return {slot: kind for slot, kind in pairs if isinstance(kind, AbstractAddedFault)}

    def logarithmic(self, slot: int) -> bool:
        """Whether a slot's size is the exponential of its value in theta."""
        return bool(np.asarray(self.suspects.logarithmic)[slot] > 0)

    def toward_none(self, slot: int) -> float:
        """Sign of the change of a size's logarithm that leaves less of its suspect."""
        return 1.0 if getattr(self.kinds[slot], "none_at_infinity", False) else -1.0

    def physical(self, theta: np.ndarray, at: ParameterMap, slot: int) -> tuple[float, float]:
        """Size and shape of a slot, of which the latter counts where the kind has one."""
        size, shape = (min(float(each), _LARGEST) for each in theta[at.slot(slot)])
        factor = math.exp(size) if self.logarithmic(slot) else float(theta[at.size(slot)])
        return self.scales[slot] * factor, math.exp(shape)

    @property
    def label(self) -> str:
        """kind@where of all suspects."""
        pairs = zip(self.kinds, self.where, strict=True)
        return " + ".join(f"{kind.name}@{where}" for kind, where in pairs) or "nothing"

    @property
    def twice_the_same(self) -> bool:
        """Whether two suspects at one place are of one kind."""
        pairs = [(kind.name, where) for kind, where in zip(self.kinds, self.where, strict=True)]
        return len(set(pairs)) < len(pairs)

    @property
    def variant(self) -> "Variant":
        """Kinds with their places and forms, in no order: what tells one from all others."""
        pairs = zip(self.kinds, self.where, strict=True)
        return frozenset((kind.name, where, getattr(kind, "variant", "")) for kind, where in pairs)


Variant: TypeAlias = frozenset[tuple[str, str, str]]


class Start(NamedTuple):
    """A hypothesis and where to begin.

    Attributes
    ----------
    hypothesis : Hypothesis
        Which.
    theta : (values,) or (recordings, values) array
        Joint parameters, sizes and shapes; by recording where a joint drifts, and where errors
        of the state, which come last, are known.
    """

    hypothesis: Hypothesis
    theta: np.ndarray

    @property
    def common(self) -> np.ndarray:
        """What the recordings have in common, (values,)."""
        return self.theta if self.theta.ndim == 1 else self.theta.mean(axis=0)


@dataclass(frozen=True, eq=False)
class HistoryProblem:
    """What fits need: predictor, joints, data, and the sensors' noise for the observer.

    Attributes
    ----------
    predictor : Predictor
        Of the structure.
    joints : tuple of Joint
        About their given values.
    data : Data
        To be fitted.
    noise : (sensors,) array
        Deviations.
    order : tuple of int
        Places of the recordings in the study, by which a joint's drift is told.
    settings : HistorySettings
        Tuned numbers of all stages.
    forces : MeasuredForces, optional
        That act in the data; without them none can be faulty.
    driven : float
        Squared residual that the noise of forces leaves which act throughout, with the memory that
        fits are compared at.
    compiled : set of (str, int, int)
        Kernels that there are already, for how many slots and samples.
    """

    predictor: Predictor
    joints: tuple[Joint, ...]
    data: Data
    noise: np.ndarray
    order: tuple[int, ...]
    settings: HistorySettings = field(default=HISTORIES, repr=False)
    forces: MeasuredForces | None = field(default=None, repr=False)
    driven: float = 0.0
    compiled: set[tuple[str, int, int]] = field(default_factory=set, repr=False)
    _process: dict[float, float] = field(default_factory=dict, repr=False)

    @cached_property
    def parameters(self) -> int:
        """Number of errors of the linear model and joint parameters."""
        return self.predictor.errors + parameters_of(self.joints)

    def with_given_joints(self, z: np.ndarray) -> np.ndarray:
        """The linear model at z, the joints as given."""
        found = np.zeros_like(z)
        found[: self.predictor.errors] = z[: self.predictor.errors]
        return found

    def begun_beside(self, z: np.ndarray) -> list[np.ndarray]:
        """Where to begin what comes beside the joints: from z, and from the joints as given.

        Joints that are bent to explain something else are a bad place to begin from.
        """
        return [z, self.with_given_joints(z)] if self.joints else [z]

    @property
    def map(self) -> ParameterMap:
        """Where values stand in theta."""
        return ParameterMap(self.parameters)

    @property
    def directions(self) -> int:
        """In how many the state of a recording is uncertain."""
        return self.data.unsure.shape[-1]

    @property
    def recordings(self) -> int:
        """Number of recordings."""
        return self.data.response.shape[0]

    def with_steps_of(self, other: "HistoryProblem") -> "HistoryProblem":
        """These joints on another search for the same recordings, with its steps and its noise."""
        predictor = eqx.tree_at(
            lambda p: (p.joints, p.stiffness, p.within),
            other.predictor,
            (self.predictor.joints, self.predictor.stiffness, self.predictor.within),
        )
        return replace(
            self,
            predictor=predictor,
            data=other.data,
            noise=other.noise,
            forces=other.forces,
            driven=other.driven,
            compiled=set(),
            _process={},
        )

    def of_kinds(self, kinds: Sequence[Kind]) -> "HistoryProblem":
        """The same of other forces and faults of sensors: hypotheses of this one are none of it."""
        predictor = replace(
            self.predictor,
            kinds=tuple(kind for kind in kinds if isinstance(kind, ForceKind)),
            faults=sensor_faults_of(kinds),
        )
        return replace(self, predictor=predictor, compiled=set(), _process={})

    def data_with(self, hypothesis: Hypothesis, theta: np.ndarray) -> Data:
        """The data with the forces that acted, where a hypothesis has faults of their channels.

        Parameters
        ----------
        hypothesis : Hypothesis
            What is missing.
        theta : (recordings, values) array
            Sizes of faults are the same in all recordings.
        """
        if not hypothesis.of_forces:
            return self.data
        assert self.forces is not None
        dt = float(self.predictor.dt) * self.predictor.substeps
        acted = self.forces.clean.copy()
        for slot in hypothesis.of_forces:
            fault, which = hypothesis.kinds[slot], hypothesis.channels[slot]
            assert isinstance(fault, AbstractForceFault)
            size = hypothesis.physical(theta.mean(axis=0), self.map, slot)[0] / fault.unit(dt)
            for force, lost in zip(acted, self.forces.lost, strict=True):
                force[:, which] = fault.acted(force[:, which], size, lost[:, which])
        return self.forces.acting(self.predictor, self.data, acted - self.forces.clean)

    def nothing(self, slots: int = 1) -> Hypothesis:
        """The model as it is."""
        return Hypothesis(
            (),
            (),
            self.empty(slots),
            (False,) * slots,
            (False,) * slots,
            None,
            (1.0,) * slots,
            (-1,) * slots,
        )

    def empty(self, slots: int = 1) -> Suspects:
        """No suspects in so many slots."""
        return self.predictor.blank(slots)

    def still(self, theta: np.ndarray) -> np.ndarray:
        """The same values for all recordings, or those of each, with no error of the state."""
        rows = np.broadcast_to(theta, (self.recordings, theta.shape[-1]))
        return np.hstack([rows, np.zeros((self.recordings, self.directions))])

    def gains(
        self,
        suspects: Sequence[Suspects],
        theta: np.ndarray,
        time_constant: float,
        slopes: bool = True,
    ) -> "Gains":
        """Observers designed for these very parameters, and how they change with them."""
        dt = float(self.predictor.dt) * self.predictor.substeps
        batch, values = theta.shape
        if time_constant not in self._process:
            A, H = self.rest()
            self._process[time_constant] = process_noise(
                stepped(A, dt), H / self.noise[:, None], dt, time_constant
            )
        size = self._process[time_constant]
        states, sensors = 2 * self.predictor.kept, len(self.noise)
        found = Gains(
            np.zeros((batch, states, sensors)), np.zeros((batch, values, states, sensors))
        )
        if size == 0.0:
            return found
        moved, owners = _neighbours(self, suspects, theta) if slopes else (theta[:0], [])
        rows = np.concatenate([theta, moved])
        which = [*range(batch), *(member for member, _ in owners)]
        # With the modes as given: a gain is a choice, and its slopes along their errors cost more
        # than they are worth.
        systems = self._systems([suspects[i] for i in which], rows, [None] * len(which))
        A, H = (np.stack(x) for x in zip(*systems, strict=True))
        broken = ~np.all(np.isfinite(A), axis=(1, 2))
        A[broken] = 0.0
        gains = observer_gain(stepped(A, dt), H / self.noise[:, None], dt, size) / self.noise
        found.gain[:] = gains[:batch]
        for (member, value), gain in zip(owners, gains[batch:], strict=True):
            found.slope[member, value] = (gain - gains[member]) / DIFFERENCE
        return found

    def rest(self) -> tuple[np.ndarray, np.ndarray]:
        """State matrix and what the sensors see, of the model as given."""
        return self.system(self.empty(), self.map.given())

    def system(self, suspects: Suspects, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """State matrix and what the sensors see, with other values and beside suspects."""
        return self._systems([suspects], values[None], values[None])[0]

    def opposed(
        self, row: np.ndarray, suspects: Suspects, values: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """What a force of 1 that opposes a place's deflection does to state and sensors."""
        return self.predictor.opposed(row, suspects, self._sizes(suspects, values))

    def _systems(
        self,
        suspects: Sequence[Suspects],
        theta: np.ndarray,
        of_modes: Sequence[np.ndarray | None] | np.ndarray,
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """State matrices and what the sensors see, one for each row of values and modes' errors."""
        p = self.parameters
        stiffness = []
        for first in range(0, len(theta), _BATCH):
            part = theta[first : first + _BATCH, :p]
            padded = np.vstack([part, np.zeros((_BATCH - len(part), p))])
            stiffness.append(np.asarray(tangents(self.joints, jax.device_put(padded)))[: len(part)])
        found = []
        rows = zip(suspects, theta, np.concatenate(stiffness), of_modes, strict=True)
        for own, row, k, errors in rows:
            found.append(self.predictor.linear(k, own, self._sizes(own, row), errors))
        return found

    def _sizes(self, suspects: Suspects, values: np.ndarray) -> np.ndarray:
        size = values[self.map.sizes(suspects.row.shape[0])]
        logarithmic = np.asarray(suspects.logarithmic) > 0
        return np.where(logarithmic, np.exp(np.minimum(size, 50.0)), size)


class Gains(NamedTuple):
    """Observers of some batch.

    Attributes
    ----------
    gain : (batch, states, sensors) array
        Of the correction after each sample.
    slope : (batch, values, states, sensors) array
        Their derivatives.
    """

    gain: np.ndarray
    slope: np.ndarray


def _neighbours(
    problem: HistoryProblem, suspects: Sequence[Suspects], theta: np.ndarray
) -> tuple[np.ndarray, list[tuple[int, int]]]:
    """Values beside those of each member, along all that a linear system depends on."""
    rows, owners = [], []
    stiff = [
        problem.predictor.errors + i
        for i, info in enumerate(
            info for joint in problem.joints for info in joint.given.parameters
        )
        if info.dimension == "force/length"
    ]
    for member, own in enumerate(suspects):
        sizes = [problem.map.size(slot) for slot in range(own.row.shape[0])]
        scaled = np.asarray(own.chain)[:, [fault.scales for fault in problem.predictor.faults]]
        active = np.any(np.asarray(own.force) != 0, axis=1) | np.any(scaled != 0, axis=(1, 2))
        for value in [*stiff, *(i for i, on in zip(sizes, active, strict=True) if on)]:
            beside = theta[member].copy()
            beside[value] += DIFFERENCE
            rows.append(beside)
            owners.append((member, value))
    return np.array(rows).reshape(-1, theta.shape[1]), owners
