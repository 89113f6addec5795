"""Physical parameters of a fitted hypothesis, with deviations, and whether a size is determined."""

import math
from collections.abc import Callable

import jax
import numpy as np

from iwanjax.effects.estimate import Estimate
from iwanjax.effects.faults import AbstractAddedFault
from iwanjax.effects.kinds import ForceKind, JointKind, UnnamedKind
from iwanjax.identification.added import moved, size_of_added, span
from iwanjax.identification.free_values import free_values, rates
from iwanjax.identification.joint_priors import joints_of, of_logarithm
from iwanjax.identification.likelihood import covariance
from iwanjax.identification.multistart import HypothesisFit
from iwanjax.identification.problem import DIFFERENCE, HistoryProblem
from iwanjax.settings.stages import settings


def estimates(problem: HistoryProblem, fitted: HypothesisFit, slot: int) -> tuple[Estimate, ...]:
    """Physical parameters of a suspect with deviations, as the residual's own size has them."""
    hypothesis, kind = fitted.hypothesis, fitted.hypothesis.kinds[slot]
    known = covariance(problem, fitted)
    own = free_values(problem, hypothesis)
    theta = fitted.theta.mean(axis=0)
    at = problem.map

    def deviation(value: int) -> float:
        if value not in own:
            return math.nan
        return math.sqrt(max(float(known[own.index(value), own.index(value)]), 0.0))

    if isinstance(kind, UnnamedKind):
        return ()
    if isinstance(kind, JointKind):
        return _of_joint(problem, fitted, kind, deviation)
    if isinstance(kind, AbstractAddedFault):
        found = (Estimate(kind.size, *_added(problem, fitted, slot)),)
        if kind.told is not None:
            value, unit = moved(problem, hypothesis, theta, slot).value(span(problem))
            found += (Estimate(kind.told, value, unit * deviation(at.size(slot))),)
        return found
    value, shape = hypothesis.physical(theta, at, slot)
    spread = abs(value) if hypothesis.logarithmic(slot) else hypothesis.scales[slot]
    found = (Estimate(kind.size, value, spread * deviation(at.size(slot))),)
    if isinstance(kind, ForceKind) and kind.shape is not None:
        found += (Estimate(kind.shape, shape, shape * deviation(at.shape(slot))),)
    return found


def _added(problem: HistoryProblem, fitted: HypothesisFit, slot: int) -> tuple[float, float]:
    each = fitted.hypothesis, fitted.theta, fitted.time_constant
    return size_of_added(problem, *each, slot)


def determined(problem: HistoryProblem, fitted: HypothesisFit) -> bool:
    """Whether the sizes of all suspects of a fit are known to be other than none.

    A free decay has no absolute scale, so that a sensor's gain is anything: what gains by it are
    the joints. The size counts as if the shape were known: a slider that slips from the first has
    a force, though neither its stiffness nor its slip is known.

    Parameters
    ----------
    problem : HistoryProblem
        That it was fitted with.
    fitted : HypothesisFit
        The model.
    """
    # What evidence counts: an error of the model's own widens what is stated, not what is there.
    known = covariance(problem, fitted, False)
    return bool(np.all(np.isfinite(known))) and all(
        _determined(problem, fitted, slot, known) for slot in range(len(fitted.hypothesis.kinds))
    )


def _determined(
    problem: HistoryProblem, fitted: HypothesisFit, slot: int, known: np.ndarray
) -> bool:
    hypothesis, kind = fitted.hypothesis, fitted.hypothesis.kinds[slot]
    if isinstance(kind, JointKind):
        if kind.name == "joint_drift":
            # Its size is that of every recording, not of the line through them alone.
            return True
        # Of friction the share that is lost, of a joint its strength or its stiffness.
        found = estimates(problem, fitted, slot)
        off = [1.0 - each.value if kind.name == "stiction" else each.value for each in found[:2]]
        return any(
            abs(x) > settings().judgement.sure * each.std
            for x, each in zip(off, found, strict=False)
        )
    if isinstance(kind, AbstractAddedFault):
        added, std = _added(problem, fitted, slot)
        return added > settings().judgement.sure * std
    own = free_values(problem, hypothesis)
    at, both = problem.map.size(slot), (problem.map.size(slot), problem.map.shape(slot))
    places = [own.index(value) for value in both if value in own]
    if not places:
        return True
    precision = np.linalg.pinv(known[np.ix_(places, places)])[0, 0]
    deviation = 1.0 / math.sqrt(max(float(precision), 1e-300))
    logarithmic = at not in own or hypothesis.logarithmic(slot)
    # A logarithm is known by so many deviations of the size itself.
    size = 1.0 if logarithmic else abs(float(fitted.theta.mean(axis=0)[at]))
    return bool(size > settings().judgement.sure * deviation)


def _of_joint(
    problem: HistoryProblem,
    fitted: HypothesisFit,
    kind: JointKind,
    deviation: Callable[[int], float],
) -> tuple[Estimate, ...]:
    theta = fitted.theta.mean(axis=0)
    if kind.name == "joint_drift":
        known = covariance(problem, fitted)
        span = problem.order[-1] - problem.order[0]
        assert fitted.hypothesis.drifting is not None
        drifting = problem.joints[fitted.hypothesis.drifting].given
        own, found = {info.name: info for info in drifting.parameters}, []
        for info, rate in zip(kind.parameters, rates(problem, fitted.hypothesis), strict=True):
            each = of_logarithm(own[info.name.removesuffix("_change")]) / span
            std = math.sqrt(max(float(known[rate, rate]), 0.0))
            found.append(Estimate(info, each * float(fitted.x[rate]), each * std))
        return tuple(found)
    stuck = kind.name == "stiction"
    places = (
        [problem.predictor.errors + 4]
        if stuck
        else list(range(problem.parameters - len(kind.parameters), problem.parameters))
    )
    joints = joints_of(problem.joints, jax.device_put(theta[: problem.parameters]))
    joint = joints[0 if stuck else -1]
    found = []
    for info, place in zip(kind.parameters, places, strict=True):
        moved = theta[: problem.parameters].copy()
        moved[place] += DIFFERENCE
        other = joints_of(problem.joints, jax.device_put(moved))[0 if stuck else -1]
        value = float(getattr(joint, info.name))
        slope = (float(getattr(other, info.name)) - value) / DIFFERENCE
        found.append(Estimate(info, value, abs(slope) * deviation(place)))
    return tuple(found)
