"""Cases of ``simulate:`` held against the model and the disk."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import equinox as eqx
import numpy as np

from iwanjax.config.elements import check_value
from iwanjax.config.entries import existing
from iwanjax.config.faults import one_of
from iwanjax.config.names import Names, known, once
from iwanjax.config.simulate import ModalImpact, RecordedForce, SimulateSection
from iwanjax.config.source import Place, Source
from iwanjax.structures import JointedStructure
from iwanjax.structures.model_file import BASE, Model
from iwanjax.types import as_real


@dataclass(frozen=True, eq=False)
class SimulationCase:
    """An entry of ``simulate:``, checked.

    Attributes
    ----------
    name : str
        Unique in the study.
    place : str
        ``file:line: simulate[i]``, for faults that only computing shows.
    settings : SimulateSection
        The entry.
    structure : JointedStructure
        The model with the joints of this case.
    inputs : (inputs, n) array or None
        Rows along which the forces act; None for a mode's impact and for a drive.
    sensors : dict of str to (n,) array
        What is seen.
    joint : str or None
        Which one is driven.
    file : Path or None
        The recording of the forces.
    """

    name: str
    place: str
    settings: SimulateSection
    structure: JointedStructure
    inputs: np.ndarray | None
    sensors: dict[str, np.ndarray]
    joint: str | None
    file: Path | None

    @property
    def carried(self) -> np.ndarray:
        """Accelerations of the sensors by the inputs alone, were all rigid: (inputs, sensors).

        Zero but for that of the ground, which absolute accelerations follow.
        """
        sensors = np.stack(list(self.sensors.values()))
        if self.inputs is None:
            return np.zeros((0, len(sensors)))
        excitation = self.settings.excitation
        # A single direction may be numbers, which are no name.
        labels = (
            excitation.input
            if isinstance(excitation, RecordedForce)
            else [str(getattr(excitation, "input", ""))]
        )
        return carried(self.structure, dict(zip(labels, self.inputs, strict=True)), sensors)

    def on(self, structure: JointedStructure) -> "SimulationCase":
        """The same case on a structure with other joints."""
        return replace(self, structure=_with_values(structure, self.settings.values))


def carried(
    structure: JointedStructure, inputs: Mapping[str, np.ndarray], sensors: np.ndarray
) -> np.ndarray:
    """Accelerations of sensors (sensors, n) by the inputs alone, were all rigid: (inputs, sensors).

    Zero but for that of the ground, which absolute accelerations follow.
    """
    motion = -np.linalg.solve(np.asarray(structure.structure.M), np.stack([*inputs.values()]).T)
    return (sensors @ motion).T * np.array([[label == BASE] for label in inputs])


def simulation_cases(
    source: Source,
    sections: Sequence[SimulateSection],
    names: Names,
    model: Model,
    structure: JointedStructure,
) -> tuple[SimulationCase, ...]:
    """The cases of a study, each name once."""
    n = structure.structure.size
    unnamed = (f"u{i + 1}" for i in range(len(model.coordinates), n))
    coordinates = dict(zip((*model.coordinates, *unnamed), np.eye(n), strict=True))
    sensors = coordinates | model.sensors
    inputs = coordinates | model.rows | model.inputs
    found: dict[str, SimulationCase] = {}
    for i, section in enumerate(sections):
        # A single case need not be in a list: its keys then stand one level higher.
        place: Place = ("simulate", i)
        if section.name in found:
            raise source.error((*place, "name"), f"got {section.name!r} again; rename it")
        once(source, (*place, "sensors"), section.sensors or ())
        once(source, (*place, "keep"), section.keep or ())
        for j, label in enumerate(section.sensors or ()):
            known(source, (*place, "sensors", j), label, sensors, "sensor")
        chosen = section.sensors or tuple(model.sensors or coordinates)
        joint = None
        if section.drive is not None:
            joint = _driven(source, (*place, "drive"), section.drive.joint, structure)
        excitation = section.excitation
        found[section.name] = SimulationCase(
            name=section.name,
            place=source.told(place),
            settings=section,
            structure=_changed(source, (*place, "values"), section.values, structure),
            inputs=_inputs(source, (*place, "excitation"), section, names, inputs),
            sensors={label: sensors[label] for label in chosen},
            joint=joint,
            file=existing(source, (*place, "excitation", "file"), excitation.file)
            if isinstance(excitation, RecordedForce)
            else None,
        )
    return tuple(found.values())


def _driven(source: Source, place: Place, label: str | None, structure: JointedStructure) -> str:
    labels = structure.labels
    if label is not None:
        return known(source, (*place, "joint"), label, labels, "joint")
    if len(labels) != 1:
        raise source.error(place, f"'joint' is missing; which one is driven? {one_of('', labels)}")
    return labels[0]


def _changed(
    source: Source, place: Place, values: Mapping[str, float], structure: JointedStructure
) -> JointedStructure:
    """The structure with other parameters of its joints."""
    parameters = {
        f"{label}.{info.name}": info
        for label, joint in structure.joints.items()
        for info in joint.parameters
        if np.ndim(getattr(joint, info.name)) == 0
    }
    for name, value in values.items():
        if name not in parameters:
            raise source.error((*place, name), f"unknown parameter; {one_of(name, parameters)}")
        check_value(source, (*place, name), parameters[name], value)
    return _with_values(structure, values)


def _with_values(structure: JointedStructure, values: Mapping[str, float]) -> JointedStructure:
    """The structure with values, by joint and parameter, in place of its joints' own."""
    joints = structure.joints
    for full, value in values.items():
        label, _, name = full.rpartition(".")
        joints[label] = eqx.tree_at(
            lambda joint, name=name: getattr(joint, name), joints[label], as_real(value, name)
        )
    return structure.with_joints(joints) if values else structure


def _inputs(
    source: Source,
    place: Place,
    section: SimulateSection,
    names: Names,
    rows: Mapping[str, np.ndarray],
) -> np.ndarray | None:
    """Where the forces act."""
    excitation = section.excitation
    if excitation is None:
        return None
    if isinstance(excitation, ModalImpact):
        names.index(source, (*place, "mode"), excitation.mode)
        return None
    place = (*place, "input")
    if isinstance(excitation, RecordedForce):
        once(source, place, excitation.input)
        for j, label in enumerate(excitation.input):
            known(source, (*place, j), label, rows, "input")
        return np.stack([rows[label] for label in excitation.input])
    given = excitation.input
    if isinstance(given, str):
        return rows[known(source, place, given, rows, "input")][None]
    n = len(next(iter(rows.values())))
    if len(given) != n or not any(given):
        raise source.error(
            place, f"got {len(given)} number(s); expected {n}, one for each coordinate, not all 0"
        )
    return np.array([given])
