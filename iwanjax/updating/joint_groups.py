"""A structure's joints as parameters of a fit, alone or in groups that share them."""

from collections.abc import Mapping, Sequence

import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.estimation.parameters import Parameter
from iwanjax.estimation.priors import AbstractPrior, LogNormal, Normal, Uniform
from iwanjax.joints import AbstractJoint
from iwanjax.structures import JointedStructure
from iwanjax.updating.background import background_parameters, modes_of
from iwanjax.updating.problem import unit_of

# Deviation of the logarithm of a strength about the value that the model was given.
_PRIOR_SIGMA = 1.0
_SMALL = 1e-2


def structural_parameters(
    structure: JointedStructure,
    groups: Mapping[str, Sequence[str]] | None = None,
    curves: Sequence[ModalCurves] | None = None,
    modes: Sequence[int] | None = None,
) -> dict[str, Parameter]:
    """Parameters of a fit of a structure, with priors about the values it has.

    Parameters
    ----------
    structure : JointedStructure
        Its joints' values are the starting values and the middles of the priors.
    groups : mapping of str to sequence of str, optional
        Joints that share their parameters, under a common name.
    curves : sequence of ModalCurves, optional
        What will be fitted: with them the damping ratios of the modes beside the joints are
        among the parameters, ``"mode1.zeta_0"`` for elastic mode 1 (lowest 0). A mode that the
        structure's C damps has its ratio as median and starting value; else the prior is
        uniform from zero to the least damping of the curve.
    modes : sequence of int, optional
        The mode of each curve; by default 0, 1, ...

    Returns
    -------
    dict of str to Parameter
        Keyed by joint (or group) and parameter, for instance ``"J1.F_S"``, then by mode.

    Raises
    ------
    InputError
        For groups that name unknown joints, joints twice, or joints of different type; for
        modes that do not exist or do not match the curves.

    Examples
    --------
    >>> import iwanjax as ij
    >>> parameters = ij.structural_parameters(ij.three_mass())
    >>> list(parameters), parameters["J1.F_S"].value
    (['J1.F_S', 'J1.K_T', 'J1.chi', 'J1.beta'], 10.0)
    """
    structure.require_joints("fit")
    found = {}
    for name, labels in owners(structure, groups).items():
        found |= joint_parameters(name, structure.joints[labels[0]])
    if curves is None:
        return found
    return found | background_parameters(structure, curves, modes_of(structure, curves, modes))


def joint_parameters(name: str, joint: AbstractJoint) -> dict[str, Parameter]:
    """The same of one joint, under a name."""
    found = {}
    for info in joint.parameters:
        value = float(getattr(joint, info.name))
        low, high = info.usual or (info.lower, info.upper)
        low, high = min(low, value), max(high, value)
        prior: AbstractPrior
        if np.isfinite(high - low):
            prior = Uniform(low, high)
        elif info.transform == "log":
            # A beta of zero is a value, but no place to start from.
            value = value or _SMALL
            prior = LogNormal(value, _PRIOR_SIGMA)
        else:
            prior = Normal(value, abs(value) or 1.0)
        found[f"{name}.{info.name}"] = Parameter(
            f"{name}.{info.name}",
            value,
            prior,
            unit=unit_of(info.dimension),
            meaning=info.meaning,
            lower=low,
            upper=high,
            transform=info.transform,
        )
    return found


def owners(
    structure: JointedStructure, groups: Mapping[str, Sequence[str]] | None
) -> dict[str, tuple[str, ...]]:
    """Joints by group, those without one on their own."""
    grouped = {name: tuple(labels) for name, labels in (groups or {}).items()}
    seen: list[str] = []
    for name, labels in grouped.items():
        for label in labels:
            if label not in structure.labels:
                raise InputError(
                    f"groups: {name} names joint {label!r}; there are {', '.join(structure.labels)}"
                )
            if label in seen:
                raise InputError(f"groups: joint {label!r} belongs to two groups")
            seen.append(label)
        kinds = {type(structure.joints[label]).__name__ for label in labels}
        if len(kinds) != 1:
            raise InputError(f"groups: {name} holds joints of types {sorted(kinds)}")
    return grouped | {label: (label,) for label in structure.labels if label not in seen}
