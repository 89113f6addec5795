"""The structure of a study: matrices or a builder, and joints on named rows."""

import inspect
import typing
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import create_model

from iwanjax.config.elements import element_of
from iwanjax.config.faults import one_of
from iwanjax.config.schema import ModelSection
from iwanjax.config.section import Section
from iwanjax.config.source import Source
from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint
from iwanjax.structures import SYSTEMS, JointedStructure
from iwanjax.structures.model_file import Model, read_model
from iwanjax.structures.systems import damped


def model_of(source: Source, section: ModelSection) -> tuple[Model, JointedStructure]:
    """What a ``model:`` section with a file or a builder describes."""
    elements = [element_of(source, i, joint) for i, joint in enumerate(section.joints)]
    model, own, zeta = _model(source, section, elements)
    joints = _joints(source, section, elements, model.rows, own)
    with source.blamed("model"):
        # A builder's damping is that of its modes with these joints, not with its own.
        structure = damped(model.structure, joints, zeta)
    return replace(model, structure=structure.structure), structure


def _model(
    source: Source, section: ModelSection, elements: Sequence[AbstractJoint]
) -> tuple[Model, Mapping[str, AbstractJoint], float]:
    """The model, the joints that a builder has put on its rows, and its damping ratio."""
    if section.file is not None:
        with source.blamed("model", "file"):
            return read_model(source.path.parent / section.file), {}, 0.0
    name = section.builder or ""
    builder = SYSTEMS.get(name)
    if builder is None:
        raise source.error(("model", "builder"), f"got {name!r}; {one_of(name, SYSTEMS)}")
    arguments = dict(inspect.signature(builder).parameters)
    joint = arguments.pop("joint", None)
    hints = typing.get_type_hints(builder)
    fields: dict[str, Any] = {
        option: (hints[option], ... if argument.default is argument.empty else argument.default)
        for option, argument in arguments.items()
    }
    kind = create_model("_Options", __base__=Section, **fields)
    options = source.validated(kind, section.options or {}, ("model", "options")).model_dump()
    # A builder that cannot do without its joint gets it; others' joints are replaced later.
    if joint is not None and joint.default is joint.empty:
        if len(elements) != 1:
            raise source.error(
                ("model", "builder"),
                f"{name} needs its joint, got {len(elements)}; expected joints: [{{name: J1, "
                "type: iwan4, parameters: {F_S: 10, K_T: 1, chi: -0.5, beta: 5}}]",
            )
        options["joint"] = elements[0]
    try:
        system = builder(**options)
    except InputError as error:
        named = [option for option in fields if f"{option} = " in str(error)]
        raise source.error(("model", "options", *named[:1]), str(error)) from None
    rows = dict(zip(system.labels, np.asarray(system.rows), strict=True))
    return Model(system.structure, rows, {}, {}), system.joints, options.get("zeta", 0.0)


def _joints(
    source: Source,
    section: ModelSection,
    elements: Sequence[AbstractJoint],
    rows: Mapping[str, np.ndarray],
    own: Mapping[str, AbstractJoint],
) -> dict[str, tuple[np.ndarray, AbstractJoint]]:
    """The joints of the list on their rows, and a builder's own ones on the other rows."""
    listed = {joint.place for joint in section.joints}
    joints = {label: (rows[label], joint) for label, joint in own.items() if label not in listed}
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
