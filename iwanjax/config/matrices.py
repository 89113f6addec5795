"""``model.matrices``: mass and stiffness from another program, and the places that have names."""

import re
from typing import Annotated, Any, Self, TypeAlias

import numpy as np
from pydantic import Field, PlainValidator, TypeAdapter, model_validator

from iwanjax.config.faults import fault
from iwanjax.config.section import CONFIG, ConfigSection
from iwanjax.config.source import Source
from iwanjax.errors import InputError
from iwanjax.structures.model_file import BASE, Model

_DOF = re.compile(r"(\d+)\s+(\w+)")
_FILES = ("stiffness", "mass", "damping", "nodes")
_NUMBERS = TypeAdapter(tuple[float, ...], config=CONFIG)

Dof: TypeAlias = tuple[int, str]


def _place(raw: Any) -> tuple[Dof, ...] | tuple[float, ...]:
    """A DOF, two of them, or one number for each coordinate."""
    given = raw if isinstance(raw, list) else [raw]
    found = [_DOF.fullmatch(entry) if isinstance(entry, str) else None for entry in given]
    dofs = tuple((int(match[1]), match[2]) for match in found if match is not None)
    if dofs and len(dofs) == len(given) <= 2:
        return dofs
    if dofs or not isinstance(raw, list):
        raise fault(
            "expected a node and its motion, for instance 12 ux; two of them, [12 ux, 40 ux], for "
            "the first relative to the second; or a list of one number for each coordinate"
        )
    return _NUMBERS.validate_python(raw)


Place = Annotated[tuple[Dof, ...] | tuple[float, ...], PlainValidator(_place)]
"""Where something is on imported matrices."""


class NamesSection(ConfigSection):
    """What a file calls its matrices."""

    K: str | None = None
    M: str | None = None
    C: str | None = None
    T: str | None = None


class MatricesSection(ConfigSection):
    """The ``matrices:`` of a model.

    Attributes
    ----------
    stiffness : str
        File of the stiffness, or of all matrices.
    mass, damping, nodes : str or None
        Files of the mass, the viscous damping and the node map, where they are others and do
        not lie beside the first under the names that the program gives them.
    names : NamesSection
        What the file calls K, M, C or T (the recovery of a reduced basis) where that is not plain.
    rows, sensors, inputs : dict of str to Place
        Where joints may sit, what sensors see, where forces act.
    """

    stiffness: str = ""
    mass: str | None = None
    damping: str | None = None
    nodes: str | None = None
    names: NamesSection = NamesSection()
    rows: dict[str, Place] = Field(default_factory=dict)
    sensors: dict[str, Place] = Field(default_factory=dict)
    inputs: dict[str, Place] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _one_file_at_least(self) -> Self:
        if not self.stiffness:
            raise fault("'stiffness' is missing; add for instance stiffness: job.sti, a file")
        return self


def model_of_matrices(source: Source, section: MatricesSection) -> Model:
    """The model of a ``matrices:`` section.

    Raises
    ------
    InputError
        With the line of the file, or of the name, that is at fault.
    """
    from iwanjax.structures.exchange import read_matrices, to_model

    files = {key: source.folder / name for key in _FILES if (name := getattr(section, key))}
    try:
        matrices = read_matrices(
            files["stiffness"],
            files.get("mass"),
            files.get("damping"),
            nodes=files.get("nodes"),
            names=section.names.model_dump(exclude_none=True),
        )
    except InputError as error:
        # The file named last is the one at fault: those before it led there.
        found = {key: str(error).rfind(f"{file}: ") for key, file in files.items()}
        key = max(found, key=found.__getitem__)
        raise source.error(("model", "matrices", key), str(error)) from None
    named: dict[str, dict[str, np.ndarray]] = {}
    for kind in ("rows", "sensors", "inputs"):
        named[kind] = {}
        for name, place in getattr(section, kind).items():
            with source.blamed("model", "matrices", kind, name):
                if (kind, name) == ("inputs", BASE) and isinstance((*place, None)[0], tuple):
                    raise InputError(
                        "is the acceleration of the ground, which acts on all masses; expected the "
                        "row -M r, one number for each coordinate, with r their motion when the "
                        "ground moves by 1"
                    )
                named[kind][name] = _row(matrices, place)
    with source.blamed("model", "matrices"):
        return to_model(matrices, **named)


def _row(matrices: Any, place: tuple[Any, ...]) -> np.ndarray:
    """The (n,) row of a place."""
    if place and isinstance(place[0], tuple):
        return matrices.row(*place)
    if len(place) != matrices.size:
        raise InputError(
            f"got {len(place)} number(s); expected {matrices.size}, one for each coordinate"
        )
    return np.array(place)
