"""Modes without a structure: one oscillator with a joint for each."""

from collections.abc import Sequence
from dataclasses import dataclass

from iwanjax.config.elements import check_value
from iwanjax.config.faults import one_of
from iwanjax.config.schema import ModalSection
from iwanjax.config.source import Place, Source
from iwanjax.joints import AbstractJoint, joint_type


@dataclass(frozen=True)
class ModalMode:
    """A mode that is one oscillator of unit modal mass.

    Attributes
    ----------
    name : str
        What recordings and parameters call it.
    band : (float, float)
        Where it lies, Hz.
    kind : type
        Class of its joint.
    values : dict of str to float
        Starting values of the joint's parameters, those that are given.
    """

    name: str
    band: tuple[float, float]
    kind: type[AbstractJoint]
    values: dict[str, float]


def modal_modes(source: Source, sections: Sequence[ModalSection]) -> tuple[ModalMode, ...]:
    """The modes of the list, each name once."""
    found: dict[str, ModalMode] = {}
    for i, section in enumerate(sections):
        place: Place = ("model", "modal", i)
        if section.name in found:
            raise source.error((*place, "name"), f"got {section.name!r} again; rename it")
        with source.blamed(*place, "joint", "type"):
            kind = joint_type(section.joint.type)
        infos = {info.name: info for info in kind.parameters}
        for name, value in section.joint.parameters.items():
            here: Place = (*place, "joint", "parameters", name)
            if name not in infos:
                raise source.error(
                    here, f"unknown parameter of {section.joint.type}; {one_of(name, infos)}"
                )
            check_value(source, here, infos[name], value)
        found[section.name] = ModalMode(
            section.name, section.band, kind, dict(section.joint.parameters)
        )
    return tuple(found.values())
