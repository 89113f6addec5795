"""``model.builder``: structures of the literature by name, with their options and own joints."""

import contextlib
import inspect
import re
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field, create_model

from iwanjax.config.faults import one_of
from iwanjax.config.names import known
from iwanjax.config.section import ConfigSection, Count, OneOrMore, Positive
from iwanjax.config.source import Place, Source
from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint
from iwanjax.structures import SYSTEMS, JointedStructure
from iwanjax.structures.model_file import Model
from iwanjax.structures.reduced_model import ReducedModel

_OPTIONS: Place = ("model", "options")
_NotNegative = Annotated[float, Field(ge=0)]


@dataclass(frozen=True, eq=False)
class Built:
    """A structure before the study's joints are put on it.

    Attributes
    ----------
    model : Model
        The structure and its named rows, sensors and inputs.
    joints : mapping of str to joint
        What sits on rows of these names where the study lists no joints.
    zeta : tuple of float
        Damping ratio of each elastic mode with the joints at rest, lowest mode first; the last
        is that of all higher ones too.
    """

    model: Model
    joints: Mapping[str, AbstractJoint]
    zeta: tuple[float, ...] = (0.0,)


class BeamOptions(ConfigSection):
    """``options:`` of a finite element beam.

    Attributes
    ----------
    size : float or None
        Largest side of an element, length.
    modes : int or None
        Fixed-interface modes that are kept.
    springs : dict of str to float or None
        Stiffness beside the joints by row, force/length; the thesis's where not given.
    zeta : tuple of float
        As :attr:`Built.zeta`.
    """

    size: Positive | None = None
    modes: Count | None = None
    springs: dict[str, _NotNegative] | None = None
    zeta: Annotated[tuple[_NotNegative, ...], Field(min_length=1), OneOrMore] = (0.0,)


class _Beam(NamedTuple):
    """A beam of the thesis: how it is reduced, its springs, and its joints by row."""

    reduced: Callable[..., ReducedModel]
    springs: Mapping[str, float]
    joints: Mapping[str, AbstractJoint]


def _brake_reuss_beam() -> _Beam:
    from iwanjax.structures.fem import brake_reuss as beam

    return _Beam(beam.brake_reuss_beam, beam.brake_reuss_springs("y"), beam.brake_reuss_joints())


def _sumali_beam() -> _Beam:
    from iwanjax.structures.fem import sumali as beam

    return _Beam(beam.sumali_beam, beam.sumali_springs(), beam.sumali_joints())


# Imported when they are named: they bring in sparse matrices.
_BEAMS: dict[str, Callable[[], _Beam]] = {
    "brake_reuss_beam": _brake_reuss_beam,
    "sumali_beam": _sumali_beam,
}


def built(
    source: Source, name: str, options: Mapping[str, Any], elements: Sequence[AbstractJoint]
) -> Built:
    """What a builder makes of its options.

    Parameters
    ----------
    source : Source
        The study file.
    name : str
        The builder.
    options : mapping
        As the file gives them.
    elements : sequence of joint
        The study's joints, for a builder that cannot do without.

    Raises
    ------
    InputError
        For a builder or an option that does not exist or cannot be, with its line.
    """
    if name in _BEAMS:
        return _beam(source, _BEAMS[name], options)
    if name in SYSTEMS:
        return _system(source, name, options, elements)
    raise source.error(("model", "builder"), f"got {name!r}; {one_of(name, [*SYSTEMS, *_BEAMS])}")


def _beam(source: Source, kind: Callable[[], _Beam], options: Mapping[str, Any]) -> Built:
    given = source.validated(BeamOptions, options, _OPTIONS)
    beam = kind()
    with _told(source, options):
        reduced = beam.reduced(**given.model_dump(include={"size", "modes"}, exclude_none=True))
    springs = beam.springs if given.springs is None else given.springs
    for row in springs:
        known(source, (*_OPTIONS, "springs", row), row, reduced.rows, "row")
    return Built(reduced.model(springs), beam.joints, given.zeta)


def _system(
    source: Source, name: str, options: Mapping[str, Any], elements: Sequence[AbstractJoint]
) -> Built:
    builder = SYSTEMS[name]
    arguments = dict(inspect.signature(builder).parameters)
    joint = arguments.pop("joint", None)
    hints = typing.get_type_hints(builder)
    fields: dict[str, Any] = {
        option: (hints[option], ... if argument.default is argument.empty else argument.default)
        for option, argument in arguments.items()
    }
    kind = create_model("_Options", __base__=ConfigSection, **fields)
    given = source.validated(kind, options, _OPTIONS).model_dump()
    # A builder that cannot do without its joint gets it; others' joints are replaced later.
    if joint is not None and joint.default is joint.empty:
        if len(elements) != 1:
            raise source.error(
                ("model", "builder"),
                f"{name} needs its joint, got {len(elements)}; expected joints: [{{name: J1, "
                "type: iwan4, parameters: {F_S: 10, K_T: 1, chi: -0.5, beta: 5}}]",
            )
        given["joint"] = elements[0]
    with _told(source, options):
        system: JointedStructure = builder(**given)
    rows = dict(zip(system.labels, np.asarray(system.rows), strict=True))
    zeta = (given.get("zeta", 0.0),)
    return Built(Model(system.structure, rows, {}, {}), system.joints, zeta)


@contextlib.contextmanager
def _told(source: Source, options: Mapping[str, Any]) -> Iterator[None]:
    """What a builder refuses, told as a fault of the option that it speaks of, if of any."""
    try:
        yield
    except InputError as error:
        named = [option for option in options if re.search(rf"\b{option}\b", str(error))]
        place = (*_OPTIONS, named[0]) if named else ("model", "builder")
        raise source.error(place, str(error)) from None
