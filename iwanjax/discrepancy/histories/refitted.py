"""The model of a verdict: joints and modes as refitted, and the structure with what was missing."""

import math
from collections.abc import Mapping, Sequence

import jax
import numpy as np
from jaxtyping import Array

from iwanjax.discrepancy.findings import Refitted
from iwanjax.discrepancy.histories.ranking import RankedFit
from iwanjax.dynamics.coordinates import ModalCoordinates
from iwanjax.effects.estimate import Estimate
from iwanjax.effects.kinds import ForceKind, JointKind, Kind, UnnamedKind
from iwanjax.identification.estimates import estimates
from iwanjax.identification.joint_priors import FreeLaw, joints_of
from iwanjax.identification.likelihood import covariance
from iwanjax.identification.multistart import HypothesisFit
from iwanjax.identification.predictor import Predictor
from iwanjax.identification.problem import DIFFERENCE, HistoryProblem
from iwanjax.joints import Dashpot, Inertia, LinearSpring, ParameterInfo
from iwanjax.settings.stages import settings
from iwanjax.structures import JointedStructure, LinearStructure


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
        for info in problem.joints[i].parameters:
            value = float(getattr(joint, info.name))
            slope = (float(getattr(beside[first][i], info.name)) - value) / DIFFERENCE
            rows.append(Estimate(info, value, abs(slope) * float(known[first])))
            first += 1
        # A general law has too many terms for a list, and none of them has a name.
        if rows or not isinstance(problem.joints[i], FreeLaw):
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
    made = problem.predictor
    trusted, count = np.asarray(made.uncertain), made.errors
    logarithm = trusted * made.of_modes(fitted.theta.mean(axis=0))
    variance = np.diag(covariance(problem, fitted))[:count]
    known = np.asarray(made.of_modes(np.sqrt(np.maximum(variance, 0.0))))
    value = np.expm1(np.asarray(logarithm))
    std = (1.0 + value) * trusted * known
    return tuple(
        Refitted(name, tuple(map(Estimate, _OF_MODE, values.tolist(), deviations.tolist())))
        for name, values, deviations, own in zip(names, value.T, std.T, trusted.T, strict=False)
        if np.any(own)
    )


def beyond_trust(problem: HistoryProblem, fitted: HypothesisFit, names: Sequence[str]) -> list[str]:
    """Modes that were moved farther than they are trusted to be exact, in words."""
    trusted = np.asarray(problem.predictor.uncertain)
    z = np.asarray(problem.predictor.of_modes(fitted.theta.mean(axis=0)))
    return [
        f"{name} was moved by {100 * math.expm1(own[i] * far[i]):+.2g} % in {what}, beyond its "
        f"trust of {100 * own[i]:.2g} %: look at the linear model there"
        for name, own, far in zip(names, trusted.T, z.T, strict=False)
        for i, what in enumerate(("frequency", "damping"))
        if abs(far[i]) > settings().judgement.clear
    ]


def _a_joint_more(kind: Kind) -> bool:
    """Whether a fit has it as a joint of its own, the last one."""
    return isinstance(kind, UnnamedKind) or (isinstance(kind, JointKind) and kind.more)


def ordered(problem: HistoryProblem, fitted: HypothesisFit, labels: Sequence[str]) -> list[str]:
    """Labels of a structure's joints in the order of a problem's."""
    names, more = list(labels), len(problem.joints) - len(labels)
    pairs = zip(fitted.hypothesis.kinds, fitted.hypothesis.where, strict=True)
    for kind, where in pairs:
        if kind.name == "stiction":
            names = [where, *(each for each in names if each != where)]
        elif _a_joint_more(kind) and more:
            names.append(where)
    return names


# Laws that a linear structure's own matrices take, of either sign.
_MATRIX = {Inertia: "M", Dashpot: "C", LinearSpring: "K"}


def corrected_model(
    structure: JointedStructure,
    best: RankedFit,
    rows: Mapping[str, np.ndarray],
    modal: ModalCoordinates,
) -> JointedStructure:
    r"""The structure with the joints of a fit and the laws that it adds.

    Modes \Phi whose frequencies and damping were fitted move K by
    :math:`M\Phi\,\Delta(\omega^2)\,\Phi^T M`, and C likewise; their shapes stay.

    A mass, a damper or a spring at a row b goes into the matrices, :math:`M + m\,bb^T` and the
    same of C and K; any other law is a joint more, called kind@place. What K held of its stiffness
    at rest is taken out, :math:`K - k_0\,bb^T`. Faults of sensors change nothing here, and a joint
    that drifts has the mean of its values.

    Parameters
    ----------
    structure : JointedStructure
        As it was given.
    best : RankedFit
        What to correct it by.
    rows : mapping of str to (n,) array
        Of the places where a force may be missing.
    modal : ModalCoordinates
        That the fit is in.

    Returns
    -------
    JointedStructure
    """
    problem, fitted = best.problem, best.fitted
    z = jax.device_put(fitted.theta.mean(axis=0)[: problem.parameters])
    names = ordered(problem, fitted, structure.labels)
    elements = list(zip(names, joints_of(problem.joints, z), strict=True))
    # A joint that was left out comes last, perhaps where there is one already.
    added = elements[len(structure.labels) :]
    refitted = dict(elements[: len(structure.labels)])
    given = zip(structure.labels, np.asarray(structure.rows), strict=True)
    joints = {name: (row, refitted[name]) for name, row in given}
    kinds = [kind.name for kind in best.fitted.hypothesis.kinds if _a_joint_more(kind)]
    joints |= {
        f"{kind}@{where}": (rows[where], joint)
        for kind, (where, joint) in zip(kinds, added, strict=True)
    }
    linear = structure.structure
    matrices = {name: np.array(getattr(linear, name)) for name in "MCK"}
    if problem.predictor.errors:
        more = _changes(problem.predictor, np.asarray(z), matrices["M"] @ np.asarray(modal.Phi))
        matrices |= {name: matrices[name] + change for name, change in more.items()}
    hypothesis = fitted.hypothesis
    for slot, (kind, where) in enumerate(zip(hypothesis.kinds, hypothesis.where, strict=True)):
        if isinstance(kind, JointKind) and kind.within:
            held = float(added[-1][1].initial_stiffness)
            matrices["K"] -= held * np.outer(rows[where], rows[where])
        if not isinstance(kind, ForceKind):
            continue
        row, values = rows[where], [each.value for each in estimates(problem, fitted, slot)]
        if kind.law in _MATRIX:
            matrices[_MATRIX[kind.law]] += values[0] * np.outer(row, row)
        else:
            size, shape = [*values, 1.0][:2]
            law = kind.law.scaled(size, shape, **dict(kind.held))
            joints[f"{kind.name}@{where}"] = (row, law)
            if kind.within:
                matrices["K"] -= float(law.initial_stiffness) * np.outer(row, row)
    return JointedStructure(LinearStructure(**matrices), joints)


def _changes(predictor: Predictor, z: np.ndarray, shapes: np.ndarray) -> dict[str, np.ndarray]:
    """What errors of the modes change in stiffness and damping; ``shapes`` is M Phi."""
    omega2, C = predictor.modes_at(z)
    kept = shapes[:, : predictor.kept]

    def change(now: Array, given: Array) -> np.ndarray:
        by = np.asarray(now) - np.asarray(given)
        return kept @ (np.diag(by) if by.ndim == 1 else by) @ kept.T

    return {
        "K": change(omega2, predictor.omega2),
        "C": change(C, predictor.C),
    }
