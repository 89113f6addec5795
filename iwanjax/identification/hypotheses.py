"""Hypotheses of one suspect each, as the search takes them."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Generic, NamedTuple, TypeVar

import equinox as eqx
import jax
import numpy as np

from iwanjax.effects.faults import (
    AbstractAddedFault,
    AbstractFault,
    AbstractForceFault,
    AbstractSensorFault,
)
from iwanjax.effects.kinds import ForceKind, JointKind, UnnamedKind
from iwanjax.identification.joint_priors import Joint, located, unknown
from iwanjax.identification.places import Place
from iwanjax.identification.problem import HistoryProblem, Hypothesis, Start
from iwanjax.identification.suspects import Suspects
from iwanjax.joints import AbstractJoint, Iwan4, Iwan5

Law = TypeVar("Law", bound=AbstractJoint, covariant=True)


def force(
    problem: HistoryProblem,
    kind: ForceKind,
    label: str,
    row: np.ndarray,
    z: np.ndarray,
    size: float,
    shape: float,
) -> Start:
    """A force of some size and shape at a place, the joints at z."""
    suspects = problem.empty()
    scale = max(abs(size), 1e-300)
    one = np.zeros(suspects.force.shape)
    one[0, problem.predictor.kinds.index(kind)] = scale
    logarithmic = np.array([float(kind.positive)])
    suspects = Suspects(*jax.device_put((row[None], one, suspects.chain, logarithmic)))
    hypothesis = Hypothesis(
        (kind,), (label,), suspects, (True,), (kind.shape is not None,), None, (scale,)
    )
    begin = 0.0 if kind.positive else math.copysign(1.0, size)
    return Start(hypothesis, np.concatenate([z, [begin, math.log(shape)]]))


def shrunk(problem: HistoryProblem, start: Start, share: float) -> Start:
    """The same with a share of every size that is fitted."""
    theta = start.theta.copy()
    for slot, fitted in enumerate(start.hypothesis.sizes):
        at = problem.map.size(slot)
        if fitted and start.hypothesis.logarithmic(slot):
            theta[..., at] += start.hypothesis.toward_none(slot) * math.log(1.0 / share)
        elif fitted:
            theta[..., at] *= share
    return Start(start.hypothesis, theta)


def sensor(
    problem: HistoryProblem,
    kind: AbstractSensorFault,
    which: int,
    label: str,
    z: np.ndarray,
    size: float,
) -> Start:
    """A fault of a sensor, with a size in its unit; the only one where nothing is fitted."""
    one = np.zeros(problem.empty().chain.shape)
    one[0, problem.predictor.faults.index(kind), which] = 1.0
    return _fault(problem, kind, label, z, size, one)


def channel(
    problem: HistoryProblem,
    kind: AbstractForceFault,
    which: int,
    label: str,
    z: np.ndarray,
    size: float,
) -> Start:
    """A fault of the channel of a measured force, with a size in its unit."""
    start = _fault(problem, kind, label, z, size, np.zeros(problem.empty().chain.shape))
    return start._replace(hypothesis=replace(start.hypothesis, channels=(which,)))


def added(
    problem: HistoryProblem, kind: AbstractAddedFault, which: int, label: str, z: np.ndarray
) -> Start:
    """Something that is added to what a sensor shows."""
    hypothesis = replace(
        problem.nothing(),
        kinds=(kind,),
        where=(label,),
        channels=(which,),
        sizes=(kind.told is not None,),
    )
    return Start(hypothesis, problem.map.given(z))


def _fault(
    problem: HistoryProblem,
    kind: AbstractFault,
    label: str,
    z: np.ndarray,
    size: float,
    chain: np.ndarray,
) -> Start:
    fitted = kind.fixed is None
    logarithmic = kind.positive and fitted
    suspects = problem.empty()._replace(
        chain=jax.device_put(chain), logarithmic=jax.device_put(np.array([float(logarithmic)]))
    )
    unit = kind.unit(float(problem.predictor.dt) * problem.predictor.substeps)
    hypothesis = Hypothesis((kind,), (label,), suspects, (fitted,), (False,), None, (unit,))
    begin = size if kind.fixed is None else kind.fixed
    begin = math.log(max(begin, 1e-6)) if logarithmic else begin
    return Start(hypothesis, np.concatenate([z, [begin, 0.0]]))


def drift(problem: HistoryProblem, kind: JointKind, joint: int, label: str, z: np.ndarray) -> Start:
    """A joint whose strength changes from recording to recording."""
    hypothesis = replace(problem.nothing(), kinds=(kind,), where=(label,), drifting=joint)
    return Start(hypothesis, problem.map.given(z))


def joined(problem: HistoryProblem, starts: Sequence[Start]) -> Start:
    """Several suspects at once, each in slots of its own, the joints as in the first."""
    first, p = starts[0], problem.parameters
    hypotheses = [start.hypothesis for start in starts]
    drifting = [h.drifting for h in hypotheses if h.drifting is not None]
    arrays = zip(*(h.suspects for h in hypotheses), strict=True)
    suspects = Suspects(*(jax.device_put(np.concatenate(parts)) for parts in arrays))
    return Start(
        Hypothesis(
            tuple(kind for h in hypotheses for kind in h.kinds),
            tuple(where for h in hypotheses for where in h.where),
            suspects,
            tuple(x for h in hypotheses for x in h.sizes),
            tuple(x for h in hypotheses for x in h.shapes),
            drifting[0] if drifting else None,
            tuple(x for h in hypotheses for x in h.scales),
            tuple(x for h in hypotheses for x in h.channels),
        ),
        np.concatenate([first.common[:p], *(start.common[p:] for start in starts)]),
    )


def alone(problem: HistoryProblem, start: Start, slot: int) -> Start:
    """One of several suspects without the others, all values as they are."""
    h, p = start.hypothesis, problem.parameters
    part, kind = slice(slot, slot + 1), h.kinds[slot]
    drifts = isinstance(kind, JointKind)
    return Start(
        Hypothesis(
            h.kinds[part],
            h.where[part],
            Suspects(*(jax.device_put(np.asarray(x)[part]) for x in h.suspects)),
            h.sizes[part],
            h.shapes[part],
            h.drifting if drifts else None,
            h.scales[part],
            h.channels[part],
        ),
        np.concatenate([start.common[:p], start.common[problem.map.slot(slot)]]),
    )


def with_stiction(
    problem: HistoryProblem,
    kind: JointKind,
    joint: int,
    label: str,
    thetas: Sequence[float],
    z: np.ndarray,
    beside: Start | None = None,
) -> tuple[HistoryProblem, list[Start]]:
    """A joint whose kinetic friction is theta of the static one, and the search it takes.

    Alone or beside a suspect. The joint comes first, so that one compiled kernel serves all.
    """
    order = [joint, *(i for i in range(len(problem.joints)) if i != joint)]
    given = problem.joints[joint].given
    values = {info.name: getattr(given, info.name) for info in given.parameters}
    loose = np.append(problem.joints[joint].loose, problem.settings.joint_faults.loose_theta)
    stuck = Joint(Iwan5(**values, theta=thetas[0]), jax.device_put(loose))
    joints = (stuck, *(problem.joints[i] for i in order[1:]))
    predictor = eqx.tree_at(
        lambda p: (p.joints, p.stiffness, p.within),
        problem.predictor,
        tuple(
            jax.device_put(np.asarray(x)[order])
            for x in (
                problem.predictor.joints,
                problem.predictor.stiffness,
                problem.predictor.within,
            )
        ),
    )
    other = replace(problem, predictor=predictor, joints=joints, compiled=set(), _process={})
    errors = problem.predictor.errors
    ends = errors + np.cumsum([each.count for each in problem.joints])
    linear, *parts = np.split(z, [errors, *ends[:-1]])
    starts = []
    for theta in thetas:
        # As much force in macroslip as before.
        strength = float(values["F_S"]) / theta
        own = np.append(parts[joint], 0.0) + located(stuck, {"F_S": strength, "theta": theta})
        moved = np.concatenate([linear, own, *(parts[i] for i in order[1:])])
        start = _as_nothing(other, kind, label, moved)
        if beside is not None:
            start = joined(other, [start, _moved(beside, problem.parameters, moved)])
        starts.append(start)
    return other, starts


class JointStart(NamedTuple):
    """Where to begin with a joint: its stiffness, its slip, the other joints' z, and its beta."""

    stiffness: float
    slip: float
    z: np.ndarray
    beta: float = 1.0


def with_joint(
    problem: HistoryProblem,
    kind: JointKind,
    place: Place,
    guesses: Sequence[JointStart],
    beside: Start | None = None,
) -> tuple[HistoryProblem, list[Start]]:
    """One Iwan element more at a place, beside a suspect or alone, and the search it takes."""
    first = guesses[0]
    strength = first.stiffness * first.slip
    given = Iwan4(F_S=strength, K_T=first.stiffness, chi=-0.5, beta=first.beta)
    more = Joint(given, jax.device_put(np.array(problem.settings.joint_faults.loose_joint)))
    begun = []
    for guess in guesses:
        strength = guess.stiffness * guess.slip
        values = {"F_S": strength, "K_T": guess.stiffness, "beta": guess.beta}
        begun.append(np.concatenate([guess.z, located(more, values)]))
    return _with_element(problem, kind, place, more, begun, beside)


class LawStart(NamedTuple, Generic[Law]):
    """Where to begin with an element of any law: the element, and the other joints' z."""

    law: Law
    z: np.ndarray


def with_law(
    problem: HistoryProblem,
    kind: JointKind | UnnamedKind,
    place: Place,
    guesses: Sequence[LawStart[AbstractJoint]],
) -> tuple[HistoryProblem, list[Start]]:
    """An element of any law more at a place, and the search it takes.

    What may be of either sign is loose by the size that it has in the last of the guesses.
    """
    more = unknown(guesses[-1].law)
    begun = []
    for law, z in guesses:
        values = {info.name: float(getattr(law, info.name)) for info in law.parameters}
        begun.append(np.concatenate([z, located(more, values)]))
    return _with_element(problem, kind, place, more, begun)


def weakened(joint: AbstractJoint, share: float) -> AbstractJoint:
    """An element with a share of its force."""
    return joint.with_parameters(
        **{
            info.name: getattr(joint, info.name)
            * (share if info.dimension.startswith(("force", "mass")) else 1.0)
            for info in joint.parameters
        }
    )


def _with_element(
    problem: HistoryProblem,
    kind: JointKind | UnnamedKind,
    place: Place,
    more: Joint,
    begun: Sequence[np.ndarray],
    beside: Start | None = None,
) -> tuple[HistoryProblem, list[Start]]:
    """One joint more, the last one, and where to begin with all of them."""
    predictor = eqx.tree_at(
        lambda p: (p.joints, p.stiffness, p.within),
        problem.predictor,
        (
            jax.device_put(np.vstack([problem.predictor.joints, place.row])),
            jax.device_put(np.append(problem.predictor.stiffness, 0.0)),
            jax.device_put(np.append(problem.predictor.within, float(kind.within))),
        ),
    )
    other = replace(
        problem, predictor=predictor, joints=(*problem.joints, more), compiled=set(), _process={}
    )
    starts = []
    for z in begun:
        start = _as_nothing(other, kind, place.label, z)
        if beside is not None:
            start = joined(other, [start, _moved(beside, problem.parameters, z)])
        starts.append(start)
    return other, starts


def _moved(start: Start, parameters: int, z: np.ndarray) -> Start:
    """A suspect among other joints than the ones it was found with."""
    return start._replace(theta=np.concatenate([z, start.common[parameters:]]))


def _as_nothing(
    problem: HistoryProblem, kind: JointKind | UnnamedKind, label: str, z: np.ndarray
) -> Start:
    """A kind that is in the joints themselves."""
    hypothesis = replace(problem.nothing(), kinds=(kind,), where=(label,))
    return Start(hypothesis, problem.map.given(z))
