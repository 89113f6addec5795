"""Bounds, priors and values that a study gives to parameters."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from iwanjax.config.elements import check_value
from iwanjax.config.faults import one_of
from iwanjax.config.modal import ModalMode
from iwanjax.config.schema import Sections
from iwanjax.config.source import Place, Source
from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint, ParameterInfo
from iwanjax.structures import JointedStructure

if TYPE_CHECKING:
    from iwanjax.estimation import AbstractPrior, Parameter

_SECTIONS = ("bounds", "priors", "values", "fixed")
_BACKGROUND = ParameterInfo("zeta_0", "1", "damping ratio beside the joint", 0.0, 1.0, "lower")
_OF_A_MODE = (
    ParameterInfo("f_0", "frequency", "natural frequency at vanishing amplitude", lower=0.0),
    _BACKGROUND,
)


@dataclass(frozen=True)
class ParameterChange:
    """What a study says of one parameter.

    Attributes
    ----------
    place : str
        ``file:line: key`` of what it says, for faults that only the data show.
    bounds : (float, float) or None
    prior : AbstractPrior or None
    value : float or None
        Where the search starts, or stays.
    fixed : bool
    """

    place: str
    bounds: tuple[float, float] | None = None
    prior: "AbstractPrior | None" = None
    value: float | None = None
    fixed: bool = False

    def applied(self, default: "Parameter") -> "Parameter":
        """The parameter with what the study says of it.

        A default value outside the study's bounds moves to their middle; a uniform default
        prior becomes that over the study's bounds.

        Raises
        ------
        InputError
            For a value of the study outside bounds that come from the data.
        """
        from iwanjax.estimation import Uniform

        lower, upper = self.bounds or (default.lower, default.upper)
        value = default.value if self.value is None else self.value
        prior, transform = default.prior, default.transform
        if self.bounds is not None:
            transform = "logit"
            if self.value is None and not lower <= value <= upper:
                value = 0.5 * (lower + upper)
            if isinstance(prior, Uniform):
                prior = Uniform(lower, upper)
        try:
            return dataclasses.replace(
                default,
                value=value,
                prior=self.prior or prior,
                lower=lower,
                upper=upper,
                transform=transform,
                fixed=self.fixed,
            )
        except InputError as error:
            raise InputError(f"{self.place}: {error}") from None


@dataclass(frozen=True)
class _Known:
    """A parameter that a study may speak of, what the model says of it and where."""

    info: ParameterInfo
    value: float | None = None
    place: Place = ()

    def range(self, stretched: bool) -> tuple[float, float]:
        """Where a fit looks for it; ``stretched`` to the model's value, as for a structure."""
        low, high = self.info.usual or (self.info.lower, self.info.upper)
        if stretched and self.value is not None:
            return min(low, self.value), max(high, self.value)
        return low, high


def modal_changes(
    source: Source, section: Sections, modal: Sequence[ModalMode]
) -> dict[str, ParameterChange]:
    """What the study says of the parameters of its modes, starting values among it."""
    places = [("model", "modal", i, "joint", "parameters") for i in range(len(modal))]
    known = {
        f"{mode.name}.{info.name}": _Known(info, mode.values.get(info.name), (*place, info.name))
        for mode, place in zip(modal, places, strict=True)
        for info in (*_OF_A_MODE, *mode.kind.parameters)
    }
    _check_keys(source, section, known)
    for name, each in known.items():
        given = section.fixed if name in section.fixed else section.values
        if each.value is not None and name in given:
            key = "fixed" if name in section.fixed else "values"
            raise source.error(
                (key, name), f"the mode's joint gives {each.value:g} already; remove one of them"
            )
    return _changes(source, section, known, stretched=False)


def structural_changes(
    source: Source, section: Sections, structure: JointedStructure
) -> dict[str, ParameterChange]:
    """What the study says of the parameters of its structure's joints or their groups.

    And of the damping ratio of each elastic mode beside them, ``mode1.zeta_0`` for mode 1.
    """
    owners = _owners(source, section.fit.groups, structure)
    group_of = {label: name for name, labels in section.fit.groups.items() for label in labels}
    for key in _SECTIONS:
        for name in getattr(section, key):
            label, _, parameter = name.rpartition(".")
            if label not in owners and label in group_of:
                raise source.error(
                    (key, name),
                    f"joint {label} shares its parameters with its group; expected "
                    f"{group_of[label]}.{parameter}",
                )
    known = {
        f"{owner}.{info.name}": _Known(info, float(getattr(joint, info.name)))
        for owner, joint in owners.items()
        for info in joint.parameters
    }
    elastic = range(structure.basis.omega2.shape[0]) if section.modes is None else section.modes
    known |= {f"mode{mode}.{_BACKGROUND.name}": _Known(_BACKGROUND) for mode in elastic}
    _check_keys(source, section, known)
    for name, bounds in section.bounds.items():
        value = known[name].value
        moved = name in section.values or name in section.fixed
        if value is not None and not moved and not bounds[0] <= value <= bounds[1]:
            raise source.error(
                ("bounds", name),
                f"the model's {value:g} lies outside; widen them, or give a start in values:",
            )
    return _changes(source, section, known, stretched=True)


def _owners(
    source: Source, groups: Mapping[str, Sequence[str]], structure: JointedStructure
) -> dict[str, AbstractJoint]:
    """For each group or joint of its own the joint that its parameters begin from."""
    place: Place = ("fit", "groups")
    joints = structure.joints
    owner: dict[str, str] = {}
    for name, labels in groups.items():
        if name in joints and name not in labels:
            raise source.error((*place, name), "is a joint outside the group; rename the group")
        for i, label in enumerate(labels):
            here = (*place, name, i)
            if label not in joints:
                raise source.error(
                    here, f"the model has no joint {label!r}; {one_of(label, joints)}"
                )
            if label in owner:
                raise source.error(here, f"{label} is in group {owner[label]} already; remove one")
            first, kind = type(joints[labels[0]]), type(joints[label])
            if kind is not first:
                raise source.error(
                    here,
                    f"{label} is {kind.__name__} and {labels[0]} is {first.__name__}; expected "
                    "joints of one type",
                )
            owner[label] = name
    found = {name: joints[labels[0]] for name, labels in groups.items()}
    return found | {label: joint for label, joint in joints.items() if label not in owner}


def _check_keys(source: Source, section: Sections, known: Mapping[str, _Known]) -> None:
    """Refuse unknown names, contradictions, and bounds that no value may reach."""
    for key in _SECTIONS:
        for name in getattr(section, key):
            if name not in known:
                raise source.error((key, name), f"unknown parameter; {one_of(name, known)}")
    for name in section.values:
        if name in section.fixed:
            raise source.error(("values", name), "is fixed as well; remove one of them")
    for name, bounds in section.bounds.items():
        info = known[name].info
        for i, bound in enumerate(bounds):
            if not info.lower <= bound <= info.upper:
                raise source.error(
                    ("bounds", name, i),
                    f"got {bound:g} ({info.meaning}); expected bounds within {info.range}",
                )


def _changes(
    source: Source, section: Sections, known: Mapping[str, _Known], stretched: bool
) -> dict[str, ParameterChange]:
    changes = {}
    for name, each in known.items():
        bounds = section.bounds.get(name)
        value, place = None, each.place
        for key in ("values", "fixed"):
            if name in getattr(section, key):
                value, place = getattr(section, key)[name], (key, name)
        if value is None and not stretched:
            value = each.value
        if value is not None:
            check_value(source, place, each.info, value)
            low, high = bounds or each.range(stretched)
            if not low <= value <= high:
                hint = "" if bounds else f"; for others give bounds: {{{name}: [lower, upper]}}"
                raise source.error(
                    place, f"got {value:g}; expected within its bounds [{low:g}, {high:g}]{hint}"
                )
        prior = section.priors.get(name)
        if value is not None or bounds is not None or prior is not None:
            if value is None:
                place = ("bounds" if bounds is not None else "priors", name)
            changes[name] = ParameterChange(
                source.told(place), bounds, prior, value, name in section.fixed
            )
    return changes
