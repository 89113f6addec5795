"""Curves of a structure's modes, with a joint left out at one of its places."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.discrepancy.effects import Kind
from iwanjax.discrepancy.steady.left_out import VALUES, AddedJoint, as_slider
from iwanjax.discrepancy.steady.modes import ModesFit, modes_alone
from iwanjax.discrepancy.steady.one_joint import PlacedForce
from iwanjax.joints import AbstractJoint, Iwan4
from iwanjax.structures import JointedStructure
from iwanjax.updating.parameters import Parameter
from iwanjax.updating.structural import joint_parameters, structural_problem

# What a joint left out is called within the structure: one name, for one kernel.
_LABEL = "left out"
# Stiffnesses to begin with, over that by which a spring would change the modes as much as
# amplitude does; and deflections at which all slips, over the largest there.
_STIFFNESSES, _SLIPS = (1.0, 0.1, 10.0), (1.0, 0.1, 10.0)
_STARTS = 8
# Strengths and betas of a second search over what the first one found: far below macroslip they
# lie in a long valley, along which a search ends anywhere.
_AGAIN = (
    (1.0, 1.0),
    (0.7, 1.0),
    (0.5, 1.0),
    (0.5, 2.0),
    (1.4, 1.0),
    (2.0, 1.0),
    (2.0, 0.5),
    (1.0, 2.0),
)


def modes_with_joint(
    alone: ModesFit,
    kind: Kind,
    place: tuple[str, np.ndarray],
    curves: Sequence[ModalCurves],
    parameters: Sequence[Parameter],
    groups: Mapping[str, Sequence[str]] | None,
    beside: Sequence[ModesFit],
) -> ModesFit | None:
    """The structure with another joint at a place; None where its modes do not move it.

    From joints of some strengths and slips, and from the sliders that were found there: what a
    joint has for its limit never fits better than it.

    Parameters
    ----------
    alone : ModesFit
        The structure's own joints.
    kind : Kind
        What another one is called.
    place : (str, (n,) array)
        Label and row.
    curves : sequence of ModalCurves
        One for each mode.
    parameters : sequence of Parameter
        Of the structure's own joints.
    groups : mapping, optional
        Joints that share their parameters.
    beside : sequence of ModesFit
        Forces at some places.
    """
    label, row = place
    base = alone.problem.base
    structure = base.structure
    inside = np.abs(row @ np.asarray(structure.basis.Phi))[list(base.modes)]
    largest = [float(np.max(q)) * each for q, each in zip(base.levels, inside, strict=True)]
    stiffness = _stiffness(curves, inside)
    if not max(largest) > 0.0 or not 0.0 < stiffness < math.inf:
        return None
    guesses = [
        _joint(stiffness * k, max(largest) * slip)
        for k, slip in itertools.product(_STIFFNESSES, _SLIPS)
    ]
    sliders = [
        as_slider(float(fit.theta[-1]), fit.force.shape)
        for fit in sorted(beside, key=lambda each: each.cost)
        if isinstance(fit.force, PlacedForce)
        and (fit.force.kind.name, fit.force.where) == ("coulomb_friction", label)
    ]
    starts = np.array([*sliders[:2], *guesses][:_STARTS])
    # Its parameters are the last of the joints', before the modes' damping.
    first = len(parameters) - len(base.modes)
    own = np.insert(np.zeros((len(starts), len(parameters))), [first] * VALUES, starts, axis=1)
    own[:, np.delete(np.arange(own.shape[1]), np.arange(first, first + VALUES))] = alone.theta[:-1]
    given = Iwan4(*_joint(stiffness, max(largest)))

    def fitted(given: Iwan4, starts: np.ndarray) -> ModesFit:
        more = JointedStructure(structure.structure, {**_joints(structure), _LABEL: (row, given)})
        others = joint_parameters(_LABEL, given).values()
        both = (*parameters[:first], *others, *parameters[first:])
        base_more = structural_problem(more, curves, both, base.modes, None, groups, base.reference)
        return modes_alone(base_more, starts)

    found = fitted(given, own)
    # About the joint that was found: modes' own damping is worked out where that is stuck.
    again = np.tile(found.theta[:-1], (len(_AGAIN), 1))
    again[:, [first, first + VALUES - 1]] *= _AGAIN
    second = fitted(Iwan4(*found.theta[first : first + VALUES]), again)
    return replace(second, force=AddedJoint(kind, where=label))


def _joints(structure: JointedStructure) -> dict[str, tuple[np.ndarray, AbstractJoint]]:
    """Rows and elements by label."""
    rows = zip(np.asarray(structure.rows), structure.elements, strict=True)
    return dict(zip(structure.labels, rows, strict=True))


def _joint(stiffness: float, phi_max: float) -> np.ndarray:
    """Parameters of a joint that slips altogether at a deflection, in the middle of the others."""
    joint = Iwan4(F_S=stiffness * phi_max, K_T=stiffness, chi=-0.5, beta=1.0)
    share = phi_max / float(joint.phi_max)
    return np.array([float(joint.F_S) * share, stiffness, -0.5, 1.0])


def _stiffness(curves: Sequence[ModalCurves], inside: np.ndarray) -> float:
    """At which a spring at a place would change a mode as much as amplitude changes it."""
    needed = []
    for each, shape in zip(curves, inside, strict=True):
        f, zeta = np.asarray(each.frequency), np.asarray(each.damping)
        change = 2.0 * max(np.ptp(f) / f.max(), np.ptp(zeta)) * (2.0 * math.pi * f.max()) ** 2
        needed.append(change / shape**2 if shape > 0.0 else math.inf)
    return float(min(needed))
