"""The structure of a study: matrices or a builder, and joints on named rows."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from iwanjax.config.builders import Built, built
from iwanjax.config.elements import element_of
from iwanjax.config.faults import one_of
from iwanjax.config.matrices import model_of_matrices
from iwanjax.config.schema import ModelSection
from iwanjax.config.source import Source
from iwanjax.joints import AbstractJoint
from iwanjax.modal_analysis import ModalTest
from iwanjax.structures import JointedStructure, LinearStructure
from iwanjax.structures.model_file import Model, read_model
from iwanjax.structures.systems import damped


def model_of(
    source: Source, section: ModelSection, test: ModalTest | None = None
) -> tuple[Model, JointedStructure]:
    """What a ``model:`` section with files, a builder or a modal test describes."""
    elements = [element_of(source, i, joint) for i, joint in enumerate(section.joints)]
    found = _built(source, section, elements, test)
    model = found.model
    joints = (
        _joints(source, section, elements, model.rows)
        if section.joints
        else {label: (model.rows[label], joint) for label, joint in found.joints.items()}
    )
    with source.blamed("model"):
        # A builder's damping is that of its modes with these joints, not with its own.
        structure = damped(model.structure, joints, found.zeta)
    return replace(model, structure=structure.structure), structure


def _built(
    source: Source,
    section: ModelSection,
    elements: Sequence[AbstractJoint],
    test: ModalTest | None,
) -> Built:
    """The structure without the study's joints."""
    if section.builder is not None:
        return built(source, section.builder, section.options or {}, elements)
    if section.matrices is not None:
        return Built(model_of_matrices(source, section.matrices), {})
    if test is not None:
        with source.blamed("model", "test"):
            return Built(test.model(), {})
    if section.file is None:
        return Built(_alone(section), {})
    with source.blamed("model", "file"):
        return Built(read_model(source.folder / section.file), {})


def _alone(section: ModelSection) -> Model:
    """Joints on their own: each holds a unit mass on a unit spring, which nothing asks for."""
    each = np.eye(len(dict.fromkeys(joint.place for joint in section.joints)))
    rows = dict(zip(dict.fromkeys(joint.place for joint in section.joints), each, strict=True))
    return Model(LinearStructure(each, 0.0 * each, each), rows, {}, {})


def _joints(
    source: Source,
    section: ModelSection,
    elements: Sequence[AbstractJoint],
    rows: Mapping[str, np.ndarray],
) -> dict[str, tuple[np.ndarray, AbstractJoint]]:
    """The joints of the list on their rows."""
    joints: dict[str, tuple[np.ndarray, AbstractJoint]] = {}
    for i, (joint, element) in enumerate(zip(section.joints, elements, strict=True)):
        place = ("model", "joints", i)
        if joint.place not in rows:
            raise source.error(
                (*place, "row" if joint.row else "name"),
                f"the model has no row {joint.place!r}; {one_of(joint.place, rows)}",
            )
        if joint.name in joints:
            raise source.error((*place, "name"), f"got {joint.name!r} again; rename it")
        joints[joint.name] = (rows[joint.place], element)
    return joints
