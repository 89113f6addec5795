"""The joints of a fitted model, and its modes within their trust, with deviations."""

import math
from collections.abc import Sequence

import jax
import numpy as np

from iwanjax.discrepancy.findings import Estimate, Refitted
from iwanjax.discrepancy.histories.joint_priors import joints_of
from iwanjax.discrepancy.histories.likelihood import covariance
from iwanjax.discrepancy.histories.multistart import HypothesisFit
from iwanjax.discrepancy.histories.problem import DIFFERENCE, HistoryProblem
from iwanjax.discrepancy.settings import settings
from iwanjax.joints import ParameterInfo


def joints_refitted(
    problem: HistoryProblem, fitted: HypothesisFit, labels: Sequence[str]
) -> tuple[Refitted, ...]:
    """The joints of a fit to time histories; one that drifts at its mean.

    Parameters
    ----------
    problem : HistoryProblem
        That it was fitted with.
    fitted : HypothesisFit
        The model.
    labels : sequence of str
        Of the structure's joints.

    Returns
    -------
    tuple of Refitted
        In the order of the search: one that sticks first, one that was left out last.
    """
    p = problem.parameters
    z = fitted.theta.mean(axis=0)[:p]
    known = np.sqrt(np.maximum(np.diag(covariance(problem, fitted))[:p], 0.0))
    joints, found = joints_of(problem.joints, jax.device_put(z)), []
    first = problem.predictor.errors
    # Two evaluations for each parameter give its slope.
    beside = [joints_of(problem.joints, jax.device_put(z + DIFFERENCE * e)) for e in np.eye(p)]
    for i, (name, joint) in enumerate(zip(ordered(problem, fitted, labels), joints, strict=True)):
        rows = []
        for info in problem.joints[i].given.parameters:
            value = float(getattr(joint, info.name))
            slope = (float(getattr(beside[first][i], info.name)) - value) / DIFFERENCE
            rows.append(Estimate(info, value, abs(slope) * float(known[first])))
            first += 1
        found.append(Refitted(name, tuple(rows)))
    return tuple(found)


# What of a mode is fitted where the linear model is not exact.
_OF_MODE = (
    ParameterInfo("frequency_change", "1", "of the natural frequency, relative"),
    ParameterInfo("damping_change", "1", "of the modal damping, relative"),
)


def modes_refitted(
    problem: HistoryProblem, fitted: HypothesisFit, names: Sequence[str]
) -> tuple[Refitted, ...]:
    """By how much frequencies and damping of the linear model were moved within their trust.

    Parameters
    ----------
    problem : HistoryProblem
        That it was fitted with.
    fitted : HypothesisFit
        The model.
    names : sequence of str
        Of the modes, the lowest first.

    Returns
    -------
    tuple of Refitted
        One for each mode that had a trust; none of an exact model.
    """
    trusted = np.asarray(problem.predictor.uncertain)
    count = trusted.size
    logarithm = trusted * fitted.theta.mean(axis=0)[:count].reshape(2, -1)
    known = np.sqrt(np.maximum(np.diag(covariance(problem, fitted))[:count], 0.0)).reshape(2, -1)
    value = np.expm1(logarithm)
    std = (1.0 + value) * trusted * known
    return tuple(
        Refitted(name, tuple(map(Estimate, _OF_MODE, values.tolist(), deviations.tolist())))
        for name, values, deviations, own in zip(names, value.T, std.T, trusted.T, strict=False)
        if np.any(own)
    )


def beyond_trust(problem: HistoryProblem, fitted: HypothesisFit, names: Sequence[str]) -> list[str]:
    """Modes that were moved farther than they are trusted to be exact, in words."""
    trusted = np.asarray(problem.predictor.uncertain)
    z = fitted.theta.mean(axis=0)[: trusted.size].reshape(2, -1)
    return [
        f"{name} was moved by {100 * math.expm1(own[i] * far[i]):+.2g} % in {what}, beyond its "
        f"trust of {100 * own[i]:.2g} %: look at the linear model there"
        for name, own, far in zip(names, trusted.T, z.T, strict=False)
        for i, what in enumerate(("frequency", "damping"))
        if abs(far[i]) > settings().judgement.clear
    ]


def ordered(problem: HistoryProblem, fitted: HypothesisFit, labels: Sequence[str]) -> list[str]:
    """Labels of a structure's joints in the order of a problem's."""
    names, more = list(labels), len(problem.joints) - len(labels)
    pairs = zip(fitted.hypothesis.kinds, fitted.hypothesis.where, strict=True)
    for kind, where in pairs:
        if kind.name == "stiction":
            names = [where, *(each for each in names if each != where)]
        elif kind.name == "iwan_joint" and more:
            names.append(where)
    return names
