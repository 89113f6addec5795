"""Joint elements from the parameters that a file gives."""

import inspect
from collections.abc import Callable

import numpy as np

from iwanjax.config.schema import JointSection
from iwanjax.config.source import Place, Source
from iwanjax.files import nearest
from iwanjax.joints import (
    DISTRIBUTION_PARAMETERS,
    AbstractJoint,
    ParameterInfo,
    UnnamedLaw,
    joint_type,
)


def element_of(source: Source, i: int, joint: JointSection) -> AbstractJoint:
    """The i-th joint, from its physical parameters or those of its slider distribution."""
    place: Place = ("model", "joints", i, "parameters")
    with source.blamed("model", "joints", i, "type"):
        kind = joint_type(joint.type)
    if issubclass(kind, UnnamedLaw):
        return _saved(source, i, joint)
    if joint.file is not None:
        raise source.error(
            ("model", "joints", i, "file"),
            f"got {joint.file!r}; of {joint.type} expected parameters instead",
        )
    ways = _ways(kind)
    expected = " or ".join(", ".join(infos) for infos, _ in ways)
    given = joint.parameters
    # The set that most of what is given belongs to is the one that was meant.
    infos, make = max(ways, key=lambda way: len(given.keys() & way[0].keys()))
    for name in (name for name in given if name not in infos):
        mixed = any(name in others for others, _ in ways)
        raise source.error(
            (*place, name),
            f"{'mixes two sets of parameters' if mixed else 'unknown parameter'} of {joint.type}; "
            f"expected {expected}{nearest(name, infos)}",
        )
    for name, info in infos.items():
        if name not in given:
            raise source.error(place, f"{name} {_told(info)} is missing; expected {expected}")
        check_value(source, (*place, name), info, given[name])
    with source.blamed(*place):
        return make(**given)


def _saved(source: Source, i: int, joint: JointSection) -> UnnamedLaw:
    """The law of a file, which has no parameters beside it."""
    place: Place = ("model", "joints", i)
    if joint.parameters:
        raise source.error(
            (*place, "parameters"),
            f"got {', '.join(joint.parameters)}; a {joint.type} takes no parameters, only file:",
        )
    if joint.file is None:
        raise source.error(place, f"file is missing; expected that of a saved {joint.type}")
    with source.blamed(*place, "file"):
        return UnnamedLaw.load(source.folder / joint.file)


def check_value(source: Source, place: Place, info: ParameterInfo, value: float) -> None:
    """Refuse a value for which the element's formulas do not hold."""
    if not info.contains(np.asarray(value)):
        raise source.error(place, f"got {value:g} {_told(info)}; expected in {info.range}")


def _told(info: ParameterInfo) -> str:
    return f"({info.meaning}, {info.dimension})"


def _ways(
    kind: type[AbstractJoint],
) -> list[tuple[dict[str, ParameterInfo], Callable[..., AbstractJoint]]]:
    """The sets of parameters that an element can be made of, and what makes it."""
    physical = {info.name: info for info in kind.parameters}
    from_distribution = getattr(kind, "from_distribution", None)
    if from_distribution is None:
        return [(physical, kind)]
    known = physical | {info.name: info for info in DISTRIBUTION_PARAMETERS}
    names = inspect.signature(from_distribution).parameters
    return [(physical, kind), ({name: known[name] for name in names}, from_distribution)]
