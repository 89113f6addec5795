"""The structure as a verdict has it: joints refitted, and what was missing where it was missing."""

from collections.abc import Mapping

import jax
import numpy as np
from jaxtyping import Array

from iwanjax.discrepancy.effects import ForceKind
from iwanjax.discrepancy.histories.estimates import estimates
from iwanjax.discrepancy.histories.joint_priors import joints_of
from iwanjax.discrepancy.histories.predictor import Predictor
from iwanjax.discrepancy.histories.ranking import RankedFit
from iwanjax.discrepancy.histories.refitted import ordered
from iwanjax.dynamics.coordinates import ModalCoordinates
from iwanjax.joints import Dashpot, Inertia, LinearSpring
from iwanjax.structures import JointedStructure, LinearStructure

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
    same of C and K; any other law is a joint more, called kind@place. Faults of sensors change
    nothing here, and a joint that drifts has the mean of its values.

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
    joints |= {f"iwan_joint@{where}": (rows[where], joint) for where, joint in added}
    linear = structure.structure
    matrices = {name: np.array(getattr(linear, name)) for name in "MCK"}
    if problem.predictor.errors:
        more = _changes(problem.predictor, np.asarray(z), matrices["M"] @ np.asarray(modal.Phi))
        matrices |= {name: matrices[name] + change for name, change in more.items()}
    hypothesis = fitted.hypothesis
    for slot, (kind, where) in enumerate(zip(hypothesis.kinds, hypothesis.where, strict=True)):
        if not isinstance(kind, ForceKind):
            continue
        row, values = rows[where], [each.value for each in estimates(problem, fitted, slot)]
        if kind.law in _MATRIX:
            matrices[_MATRIX[kind.law]] += values[0] * np.outer(row, row)
        else:
            size, shape = [*values, 1.0][:2]
            law = kind.law.scaled(size, shape, **dict(kind.held))
            joints[f"{kind.name}@{where}"] = (row, law)
    return JointedStructure(LinearStructure(**matrices), joints)


def _changes(predictor: Predictor, z: np.ndarray, shapes: np.ndarray) -> dict[str, np.ndarray]:
    """What errors of the modes change in stiffness and damping; ``shapes`` is M Phi."""
    there = predictor.with_errors(jax.device_put(z))
    kept = shapes[:, : predictor.kept]

    def change(now: Array, given: Array) -> np.ndarray:
        by = np.asarray(now) - np.asarray(given)
        return kept @ (np.diag(by) if by.ndim == 1 else by) @ kept.T

    return {
        "K": change(there.omega2, predictor.omega2),
        "C": change(there.C, predictor.C),
    }
