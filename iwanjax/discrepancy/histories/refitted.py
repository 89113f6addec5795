"""The joints of a fitted model, with deviations."""

from collections.abc import Sequence

import jax
import numpy as np

from iwanjax.discrepancy.findings import Estimate, Refitted
from iwanjax.discrepancy.histories.joint_priors import joints_of
from iwanjax.discrepancy.histories.likelihood import covariance
from iwanjax.discrepancy.histories.multistart import HypothesisFit
from iwanjax.discrepancy.histories.problem import DIFFERENCE, HistoryProblem


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
    joints, found, first = joints_of(problem.joints, jax.device_put(z)), [], 0
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
