"""How far away macroslip may lie where no fitted recording has reached it."""

import math
from typing import NamedTuple

import jax
import numpy as np

from iwanjax.identification.free_values import values_measured
from iwanjax.identification.joint_priors import Joint, joints_of, located
from iwanjax.identification.likelihood import scale
from iwanjax.identification.linearise import squares_at
from iwanjax.identification.multistart import HypothesisFit, moved
from iwanjax.identification.problem import HistoryProblem
from iwanjax.joints import Iwan4


class Alternative(NamedTuple):
    """A joint with the same microslip as fitted, but another macroslip.

    Attributes
    ----------
    farther : float
        Logarithm of where macroslip begins, over where it does in the fit.
    change : (parameters,) array
        Of z.
    weight : float
        Its probability among those of the same joint, by the fitted recordings and the prior.
    """

    farther: float
    change: np.ndarray
    weight: float


def in_the_middle(problem: HistoryProblem, fitted: HypothesisFit) -> HypothesisFit:
    """The fit with each joint's macroslip at the median of where it may begin.

    Parameters
    ----------
    problem : HistoryProblem
        That it was fitted with.
    fitted : HypothesisFit
        The model.
    """
    change = np.zeros(problem.parameters)
    for own in _by_joint(problem, fitted):
        left = 0.5
        # From the farthest on: below half of all probability lies the median.
        for other in reversed(own):
            left -= other.weight
            if left < 0 and other.farther > 0:
                change += other.change
                break
    return moved(problem, fitted, change) if np.any(change) else fitted


def alternatives(problem: HistoryProblem, fitted: HypothesisFit) -> list[Alternative]:
    """Joints whose macroslip begins elsewhere, and how likely they are.

    While no slider of a four-parameter joint's last, strongest ones has moved, only K_T, chi and
    R show: F_S and beta are open as long as these stay. A fit then ends where the prior has
    pulled them, often just where macroslip would begin to show, so that second derivatives there
    say nothing of it.

    Parameters
    ----------
    problem : HistoryProblem
        That it was fitted with.
    fitted : HypothesisFit
        The model.
    """
    return [each for own in _by_joint(problem, fitted) for each in own]


def _by_joint(problem: HistoryProblem, fitted: HypothesisFit) -> list[list[Alternative]]:
    """Alternatives of each joint that has some, the nearest macroslip first."""
    p = problem.parameters
    z = fitted.theta.mean(axis=0)[:p]
    made, first, found = joints_of(problem.joints, jax.device_put(z)), problem.predictor.errors, []
    for fit, joint in zip(made, problem.joints, strict=True):
        count = joint.count
        own = slice(first, first + count)
        first += count
        if not isinstance(fit, Iwan4) or not float(joint.given.beta) > 0:  # type: ignore[attr-defined]
            continue
        changes, little = {}, problem.settings.joint_faults.macroslip_difference
        for farther in (*_farther(problem), -little):
            there = with_later_macroslip(joint, fit, z[own], farther)
            if there is not None:
                changes[farther] = np.zeros(p)
                changes[farther][own] = there - z[own]
        slope = changes.pop(-little) / -little
        found.append(_weighed(problem, fitted, changes, slope))
    return found


def _farther(problem: HistoryProblem) -> list[float]:
    """Logarithms of the deflections at which macroslip may begin, over that of the fit."""
    known = problem.settings.joint_faults
    steps = range(-known.macroslip_before, known.macroslip_beyond + 1)
    return [known.macroslip_step * i for i in steps if i]


def with_later_macroslip(
    joint: Joint, fit: Iwan4, z: np.ndarray, farther: float
) -> np.ndarray | None:
    """The z at which R, K_T and chi are the same and phi_max is e^farther times larger."""
    F_S, chi, beta = (float(getattr(fit, name)) for name in ("F_S", "chi", "beta"))
    strongest = (1.0 + beta) * np.exp(-farther * (1.0 + chi)) - 1.0
    if strongest <= 0:
        return None

    def share(beta: float) -> float:
        return (beta + (chi + 1.0) / (chi + 2.0)) / (1.0 + beta)

    force = F_S * np.exp(farther) * share(strongest) / share(beta)
    names = [info.name for info in joint.given.parameters]
    there = located(joint, {"F_S": force, "beta": strongest})
    found = z.copy()
    for name in ("F_S", "beta"):
        found[names.index(name)] = there[names.index(name)]
    return found


def _weighed(
    problem: HistoryProblem,
    fitted: HypothesisFit,
    changes: dict[float, np.ndarray],
    slope: np.ndarray,
) -> list[Alternative]:
    """Each with its probability, the fit itself being among them.

    Where macroslip has just begun to show it is known so well there that a fit's probability is
    a peak's, higher than what lies beyond and much narrower than a step.
    """
    if not changes:
        return []
    p = problem.parameters
    points = []
    for change in changes.values():
        theta = fitted.theta.copy()
        theta[:, :p] += change
        points.append((fitted.hypothesis, theta))
    z = fitted.theta.mean(axis=0)[:p]
    misfit = squares_at(problem, points, fitted.time_constant)
    # A peak by the loudest moments alone may be an error of the model's own, though it be no larger
    # than a right model's.
    allowed = max(float(fitted.misfit.sum()), values_measured(problem))
    unit = scale(problem, fitted, left=allowed)
    worse = (np.array(misfit) - fitted.misfit.sum()) / unit
    prior = np.array([(z + change) @ (z + change) - z @ z for change in changes.values()])
    # At most as likely as the fit: where it is not the best, that is a peak of no width.
    odds = np.exp(np.minimum(-0.5 * (worse + prior), 0.0))
    curvature = slope @ fitted.normal[:p, :p] @ slope / unit
    # Half of the fit's own step lies before it: where that is unlikely, the fit is at the edge.
    step = problem.settings.joint_faults.macroslip_step
    peak = min(1.0, math.sqrt(2.0 * math.pi / max(curvature, 1e-300)) / step)
    before = dict(zip(changes, odds, strict=True)).get(-step, 0.0)
    peak = 0.5 * (peak + min(peak, before))
    weight = odds / (peak + odds.sum())
    rows = zip(changes, changes.values(), weight.tolist(), strict=True)
    return [Alternative(*each) for each in rows]
