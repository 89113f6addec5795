"""Columns of the score test: what a little of every effect would change in the residuals."""

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array

from iwanjax.effects.catalogue import sensor_faults_of
from iwanjax.effects.faults import AbstractFault, AbstractForceFault, AbstractSensorFault
from iwanjax.effects.kinds import ForceKind, Kind
from iwanjax.identification import hypotheses
from iwanjax.identification.conditioning import at_ends
from iwanjax.identification.joint_priors import Joint
from iwanjax.identification.kernels import Small, responses, unit_forces
from iwanjax.identification.linearise import innovations, within_memory
from iwanjax.identification.multistart import HypothesisFit
from iwanjax.identification.observer import stepped
from iwanjax.identification.places import Place
from iwanjax.identification.predictor import Data, Predictor
from iwanjax.identification.problem import DIFFERENCE, HistoryProblem, Start
from iwanjax.identification.suspects import Suspects
from iwanjax.signals.comparison_band import passed
from iwanjax.threads import available_threads

# Suspects that a kernel takes at once.
_AT_ONCE = 16


class UnitEffect(NamedTuple):
    """A suspect of one shape before it is tried.

    Attributes
    ----------
    kind, where
        What and at which place or sensor.
    sized : function
        Of a size, where to begin with it.
    row : (modes,) array
        Of the place.
    force : (recordings, steps) array
        What it opposes the motion with at size 1.
    fault : (faults, sensors) array
        Sizes of the sensors' faults.
    ground : (base,) array
        1 where the force is the acceleration of the ground, which acts as a force and carries.
    """

    kind: ForceKind | AbstractFault
    where: str
    sized: Callable[[float], Start]
    row: np.ndarray
    force: np.ndarray
    fault: np.ndarray
    ground: np.ndarray


def columns(
    problem: HistoryProblem, base: HypothesisFit, effects: Sequence[UnitEffect]
) -> np.ndarray:
    """Changes of the residuals for suspects of size 1, linearised at zero.

    The model is linearised once, about what it predicts with the joints as fitted: a force is
    then one that is known beforehand, and a fault one of what was measured.

    Parameters
    ----------
    problem : HistoryProblem
        Predictor and data.
    base : HypothesisFit
        The model with its joints refitted, and the suspects found so far.
    effects : sequence of UnitEffect
        What is suspected.

    Returns
    -------
    (effects, recordings, N, sensors) array
    """
    fixed, at = _about(problem, base)
    shown = jax.device_put(_shown(problem, base))
    threads, at_once = within_memory(problem, available_threads(), _AT_ONCE)

    def run(first: int) -> None:
        own = effects[first : first + at_once]
        padded = [*own, *[own[-1]] * (at_once - len(own))]
        arrays = zip(*((x.row, x.force, x.fault, x.ground) for x in padded), strict=True)
        row, force, fault, ground = jax.device_put(tuple(map(np.stack, arrays)))
        (made,) = responses(*fixed, Small(row, force, fault, ground, shown), *at)
        # Straight to its place: what long recordings make is not held twice.
        found[first : first + len(own)] = np.asarray(made)[: len(own)]

    found = np.zeros((len(effects), *problem.data.response.shape))
    firsts = range(0, len(effects), at_once)
    # The first alone, for two would both compile the kernel.
    for first in firsts[:1]:
        run(first)
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(run, firsts[1:]))
    return found


def _about(
    problem: HistoryProblem, base: HypothesisFit
) -> tuple[tuple[Predictor, tuple[Joint, ...], Suspects], tuple[Array, Array, Data]]:
    """What kernels that linearise about a fit take before and after what they are about."""
    suspects, mean = base.hypothesis.suspects, base.theta.mean(axis=0)[: base.values]
    gain = problem.gains([suspects], mean[None], base.time_constant, slopes=False).gain[0]
    data = problem.data_with(base.hypothesis, base.theta)
    at = (*jax.device_put((base.theta, gain)), data)
    return (problem.predictor, problem.joints, suspects), at


def unit_effects(
    problem: HistoryProblem, base: HypothesisFit, kinds: Sequence[Kind], places: Sequence[Place]
) -> list[UnitEffect]:
    """Forces of size 1 of all kinds at all places, of the shapes on the catalogue's small grids."""
    if not places:
        return []
    fixed, at = _about(problem, base)
    z = base.theta.mean(axis=0)[: problem.parameters]
    grids = [_grid(kind, places) if kind in kinds else [] for kind in problem.predictor.kinds]
    widest = [max(map(len, grid), default=0) for grid in grids]
    padded = tuple(
        np.array([[*row, *[row[-1]] * (w - len(row))] for row in grid]).reshape(len(places), w)
        for grid, w in zip(grids, widest, strict=True)
    )
    rows = np.stack([place.row for place in places])
    blank = np.zeros((len(problem.predictor.faults), len(problem.noise)))
    still = np.zeros(problem.predictor.ground.modes.shape[1])
    forces = map(np.asarray, unit_forces(*fixed, rows, padded, *at))
    return [
        UnitEffect(
            kind,
            place.label,
            partial(hypotheses.force, problem, kind, place.label, place.row, z, shape=shape),
            place.row,
            force[:, :, i, j],
            blank,
            still,
        )
        for kind, grid, force in zip(problem.predictor.kinds, grids, forces, strict=True)
        for i, (place, shapes) in enumerate(zip(places, grid, strict=bool(grid)))
        for j, shape in enumerate(shapes)
    ]


def by_memory(
    problem: HistoryProblem, kinds: Sequence[Kind], places: Sequence[Place]
) -> list[Sequence[Place]]:
    """Places in groups whose unit forces fit into the memory."""
    own = [kind for kind in problem.predictor.kinds if kind in kinds]
    count = sum(max(map(len, _grid(kind, places)), default=0) for kind in own)
    # As a kernel makes them, and as it hands them over.
    one = 2 * 8 * math.prod(problem.data.push.shape[:3])
    size = max(1, problem.settings.memory.kernels // max(1, count * one))
    return [places[i : i + size] for i in range(0, len(places), size)]


def _grid(kind: ForceKind, places: Sequence[Place]) -> list[tuple[float, ...]]:
    """Shapes to be tried at each place."""
    return [kind.shapes(place.scales) if kind.shape else (1.0,) for place in places]


def sensor_faults(
    problem: HistoryProblem, kinds: Sequence[Kind], sensors: Sequence[str], z: np.ndarray
) -> list[UnitEffect]:
    """Faults of size 1 of every sensor."""
    faults = problem.predictor.faults
    row = np.zeros(problem.predictor.joints.shape[1])
    none = np.zeros((problem.recordings, problem.data.push.shape[1] * problem.predictor.substeps))
    still = np.zeros(problem.predictor.ground.modes.shape[1])

    def begun(kind: AbstractSensorFault, i: int, label: str, size: float) -> Start:
        return hypotheses.sensor(problem, kind, i, label, z, min(size, kind.most))

    effects = []
    for kind in sensor_faults_of(kinds):
        if kind.slope(np.zeros((1, 1, len(sensors)))) is None:
            continue
        for i, label in enumerate(sensors):
            fault = np.zeros((len(faults), len(sensors)))
            fault[faults.index(kind), i] = 1.0
            effects.append(
                UnitEffect(kind, label, partial(begun, kind, i, label), row, none, fault, still)
            )
    return effects


def force_faults(
    problem: HistoryProblem, kinds: Sequence[Kind], inputs: Sequence[str], z: np.ndarray
) -> list[UnitEffect]:
    """Faults of every measured force: what force acts more, for each unit of the size at zero."""
    if problem.forces is None:
        return []
    measured, lost, rows = problem.forces.clean, problem.forces.lost, problem.forces.rows
    ground = np.asarray(problem.predictor.ground.inputs)
    blank = np.zeros((len(problem.predictor.faults), len(problem.noise)))

    def begun(kind: AbstractForceFault, i: int, label: str, size: float) -> Start:
        begin = float(np.clip(size, -kind.most, kind.most))
        return hypotheses.channel(problem, kind, i, label, z, begin)

    effects = []
    for kind in kinds:
        if not isinstance(kind, AbstractForceFault) or kind.fixed is not None:
            continue
        for i, label in enumerate(inputs):
            ends = (
                np.stack(
                    [
                        kind.acted(force, size, cut)
                        for force, cut in zip(measured[..., i], lost[..., i], strict=True)
                    ]
                )
                for size in (DIFFERENCE, -DIFFERENCE)
            )
            more = np.subtract(*ends) / (2.0 * DIFFERENCE)
            opposes = -at_ends(more, problem.predictor.substeps)
            # One that never acts, or is not cut anywhere, shows no fault.
            if np.any(opposes):
                own = partial(begun, kind, i, label)
                at = rows[:, i], opposes, blank, ground[i]
                effects.append(UnitEffect(kind, label, own, *at))
    return effects


def _shown(problem: HistoryProblem, base: HypothesisFit) -> np.ndarray:
    """What a fault of size 1 changes in what the sensors show as predicted, for each fault."""
    off = innovations(problem, base.hypothesis, base.theta, base.time_constant)
    shown = np.asarray(problem.data.response) - off
    slopes = [fault.slope(shown) for fault in problem.predictor.faults]
    none = np.zeros_like(shown)
    changes = [none if slope is None else slope for slope in slopes]
    return np.stack(changes, axis=1) if changes else np.zeros((len(shown), 0, *shown.shape[1:]))


def columns_at_rest(
    problem: HistoryProblem, base: HypothesisFit, forces: Sequence[UnitEffect]
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Changes of the residuals for forces of size 1, the joints at their tangents.

    At rest the model is linear and the same at all times, so that a force's response is its
    convolution with the place's own.

    Parameters
    ----------
    problem : HistoryProblem
        Predictor and data.
    base : HypothesisFit
        The model with its joints refitted, and the suspects found so far.
    forces : sequence of UnitEffect
        In any order.

    Yields
    ------
    (effects,), (effects, recordings x N x sensors) array
        Place by place, which of the forces act there and their columns.
    """
    weight = np.moveaxis(np.asarray(problem.data.weight), 1, 2)
    R, _, N = weight.shape
    at: dict[str, list[int]] = {}
    for i, unit in enumerate(forces):
        at.setdefault(unit.where, []).append(i)
    rows = np.stack([forces[which[0]].row for which in at.values()])
    shown = _responses(problem, base, rows[:, : problem.predictor.kept], N)
    band = passed(2 * N)
    for which, after in zip(at.values(), shown, strict=True):
        # Twice as long: what leaves at the end does not come in again at the beginning. Of all
        # places at once spectra would take gigabytes.
        own, found = np.fft.rfft(after, 2 * N) * band, []
        for i in which:
            steps = np.moveaxis(forces[i].force.reshape(R, N, -1), 1, 2)
            of_steps = np.fft.rfft(steps, 2 * N)[:, :, None]
            parts = (of_steps[:, k] * each for k, each in enumerate(own))
            whole = sum(parts, np.zeros(()))
            change = np.fft.irfft(whole, 2 * N)[..., :N] * weight
            found.append(np.ravel(np.moveaxis(change, 2, 1)))
        yield np.array(which), np.stack(found)


def _responses(
    problem: HistoryProblem, base: HypothesisFit, rows: np.ndarray, N: int
) -> np.ndarray:
    """Residuals after a force of 1 at the end of one step, (places, substeps, sensors, N).

    It rises over that step, and falls over the next; one for each step to the first sample.
    """
    predictor, suspects = problem.predictor, base.hypothesis.suspects
    mean = base.theta.mean(axis=0)[None, : base.values]
    gain = problem.gains([suspects], mean, base.time_constant, slopes=False).gain[0]
    A, H = problem.system(suspects, mean[0])
    P, r = rows.shape
    dt, S = float(predictor.dt), predictor.substeps
    # The force and its slope as states too (Van Loan 1978).
    F = np.zeros((2 * r + 2 * P, 2 * r + 2 * P))
    F[: 2 * r, : 2 * r] = A
    F[r : 2 * r, 2 * r : 2 * r + P] = rows.T
    F[2 * r : 2 * r + P, 2 * r + P :] = np.eye(P)
    E = stepped(F, dt)
    step, whole, ramp = E[: 2 * r, : 2 * r], E[: 2 * r, 2 * r : 2 * r + P], E[: 2 * r, 2 * r + P :]
    rising, falling = (ramp / dt).T, (whole - ramp / dt).T
    direct = np.zeros((P, S, len(H)))
    if predictor.quantity == "acceleration":
        direct[:, -1] = rows @ np.asarray(predictor.sensors).T
    z = np.zeros((P, S, 2 * r))
    shown = np.zeros((N, P, S, len(H)))
    for n in range(N):
        for k in range(S):
            z = z @ step.T
            if n == 0:
                z[:, k] += rising
                z[:, k - 1] += falling if k else 0.0
            elif n == 1 and k == 0:
                z[:, -1] += falling
        # It opposes the motion, so that the model shows less.
        shown[n] = z @ H.T + (direct if n == 0 else 0.0)
        z = z - shown[n] @ gain.T
    return np.moveaxis(shown, 0, 3)
