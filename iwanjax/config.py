"""Study files: every key checked, every fault told with its file, line and key.

The YAML is composed into nodes, which know their lines, and read as plain text; the
schema below turns text into numbers. So YAML 1.1's own ideas of what ``1e5`` (text) or
``no`` (false) mean never enter.
"""

import difflib
import inspect
import re
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias, TypeVar

import numpy as np
import yaml
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationError,
    create_model,
    model_validator,
)
from pydantic_core import ErrorDetails, PydanticCustomError

from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint, ParameterInfo, joint_type
from iwanjax.structures import SYSTEMS, JointedStructure
from iwanjax.structures.model_file import Model, read_model

Place: TypeAlias = tuple[str | int, ...]
"""Keys and list positions that lead to a value."""

Number = Annotated[float, Field(allow_inf_nan=False)]
NonNegative = Annotated[Number, Field(ge=0)]
Text = Annotated[str, Field(min_length=1)]


def _fault(message: str, key: str | int | None = None) -> PydanticCustomError:
    """A fault of a section, or of one key in it, told in our own words."""
    return PydanticCustomError("fault", "{message}", {"message": message, "key": key})


class _Section(BaseModel):
    """A mapping that rejects unknown keys before anything else is complained of."""

    model_config = ConfigDict(frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, raw: Any) -> Any:
        keys = [field.alias or name for name, field in cls.model_fields.items()]
        for key in raw if isinstance(raw, Mapping) else ():
            if key not in keys:
                raise _fault(f"unknown key; expected {_choice(keys)}{_near(key, keys)}", key)
        return raw


S = TypeVar("S", bound=_Section)


class _Ramp(_Section):
    start: Annotated[Number, Field(alias="from", gt=0)]
    to: Number
    count: Annotated[int, Field(ge=2, le=100_000)]

    @model_validator(mode="after")
    def _rises(self) -> Self:
        if self.to <= self.start:
            raise _fault(f"got {self.to:g}; expected more than from = {self.start:g}", "to")
        return self

    @property
    def levels(self) -> np.ndarray:
        return np.geomspace(self.start, self.to, self.count)


def _increasing(values: tuple[float, ...]) -> tuple[float, ...]:
    for i, (low, high) in enumerate(zip((0.0, *values), values, strict=False)):
        if high <= low:
            than = f"more than the level before, {low:g}" if i else "a positive level"
            raise _fault(f"got {high:g}; expected {than}", i)
    return values


def _levels_form(raw: Any) -> str:
    if isinstance(raw, Mapping):
        return "<ramp>"
    nested = isinstance(raw, list) and any(isinstance(entry, Mapping | list) for entry in raw)
    return "<each>" if nested else "<list>"


# Tags appear in pydantic's places of errors; with brackets they cannot be mistaken for keys.
_TaggedRamp = Annotated[_Ramp, Tag("<ramp>")]
_TaggedList = Annotated[
    tuple[Number, ...], Field(min_length=1), AfterValidator(_increasing), Tag("<list>")
]
_OneMode = Annotated[_TaggedRamp | _TaggedList, Discriminator(_levels_form)]
_AllModes = Annotated[
    _TaggedRamp | _TaggedList | Annotated[tuple[_OneMode, ...], Tag("<each>")],
    Discriminator(_levels_form),
]


def _as_list(raw: Any) -> Any:
    return [raw] if isinstance(raw, str) else raw


class QsmaSettings(_Section):
    """The ``qsma:`` section: what :func:`iwanjax.qsma` is asked for.

    Attributes
    ----------
    modes : tuple of int
        Indices among the elastic modes, lowest first.
    alpha : load levels as the file gives them
        Numbers or a geometric range {from, to, count}, for all modes or one each; see
        :attr:`levels`.
    zeta0 : tuple of float or None
        Background damping ratio, one for all modes or one each; None takes the structure's C.
    frequency : {"secant", "first_harmonic"}
        Which frequency a level has.
    """

    modes: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1)] = (0,)
    alpha: _AllModes
    zeta0: Annotated[tuple[NonNegative, ...] | None, BeforeValidator(_as_list)] = None
    frequency: Literal["secant", "first_harmonic"] = "secant"

    @property
    def levels(self) -> np.ndarray:
        """Load levels, (modes, levels), force/mass^(1/2)."""
        return np.broadcast_to(np.stack(self._rows()), (len(self.modes), len(self._rows()[0])))

    @property
    def damping(self) -> np.ndarray | None:
        """Background damping ratio of each mode, (modes,), or None."""
        return None if self.zeta0 is None else np.broadcast_to(self.zeta0, (len(self.modes),))

    def _rows(self) -> list[np.ndarray]:
        entries = self.alpha if isinstance(self.alpha, tuple) else (self.alpha,)
        if isinstance(entries[0], float):
            entries = (entries,)
        return [entry.levels if isinstance(entry, _Ramp) else np.array(entry) for entry in entries]

    @model_validator(mode="after")
    def _one_for_each_mode(self) -> Self:
        count = len(self.modes)
        if len(set(self.modes)) < count:
            raise _fault("holds a mode twice; expected each once", "modes")
        rows = self._rows()
        if len(rows) not in (1, count):
            raise _fault(
                f"got {len(rows)} sets of levels for {count} mode(s); expected one for all or one "
                "each",
                "alpha",
            )
        if len({len(row) for row in rows}) > 1:
            raise _fault(
                f"got {' and '.join(str(len(row)) for row in rows)} levels; expected as many for "
                "every mode",
                "alpha",
            )
        if self.zeta0 is not None and len(self.zeta0) not in (1, count):
            raise _fault(
                f"got {len(self.zeta0)} numbers for {count} mode(s); expected one for all or one "
                "each",
                "zeta0",
            )
        return self


class _Joint(_Section):
    name: Text
    row: Text | None = None
    type: Text
    parameters: dict[str, Number]

    @property
    def place(self) -> str:
        """The row the joint sits on; its name unless the file says otherwise."""
        return self.row or self.name


class _Model(_Section):
    file: Text | None = None
    builder: Text | None = None
    options: dict[str, Any] | None = None
    joints: tuple[_Joint, ...] = ()

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.file is None) == (self.builder is None):
            got = "neither" if self.file is None else "both"
            raise _fault(f"got {got} of file and builder; expected one of them")
        if self.file is not None and self.options is not None:
            raise _fault("got options for a file; only a builder takes options", "options")
        if self.file is not None and not self.joints:
            raise _fault("holds no joints; expected joints: [{name:, row:, type:, parameters:}]")
        names = [joint.name for joint in self.joints]
        for i, name in enumerate(names):
            if name in names[:i]:
                raise _fault(f"joints[{i}]: got the name {name!r} again; rename it", "joints")
        return self


class _Study(_Section):
    name: Text
    model: _Model
    qsma: QsmaSettings | None = None
    recordings: tuple[Any, ...] = ()


@dataclass(frozen=True, eq=False)
class Study:
    """A study file, read and checked.

    Attributes
    ----------
    name : str
        What reports call it.
    path : Path
        The file; paths in it are relative to its folder.
    model : Model
        The structure without joints, its named rows, sensors and inputs.
    structure : JointedStructure
        The structure with its joints at their starting values.
    qsma : QsmaSettings or None
        The ``qsma:`` section.
    recordings : tuple
        The entries of ``recordings:`` as text, not looked into yet.
    """

    name: str
    path: Path
    model: Model
    structure: JointedStructure
    qsma: QsmaSettings | None
    recordings: tuple[Any, ...]


def load_study(path: str | Path) -> Study:
    """Read a study file and the model it names.

    Parameters
    ----------
    path : str or Path
        A YAML file with ``name``, ``model`` (a ``file`` of matrices or a ``builder`` of
        :data:`iwanjax.structures.SYSTEMS`, and ``joints``), optionally ``qsma`` and
        ``recordings``.

    Returns
    -------
    Study

    Raises
    ------
    InputError
        ``file:line: key: what arrived; expected ...`` in one line, for the first fault.
    """
    source = _Source.read(Path(path))
    section = source.validated(_Study, source.content)
    if section.model.file is not None:
        model, joints = _from_file(source, section.model, section.model.file)
    else:
        model, joints = _from_builder(source, section.model, section.model.builder or "")
    try:
        structure = JointedStructure(model.structure, joints)
    except InputError as error:
        raise source.error(("model",), str(error)) from None
    if section.qsma is not None:
        _check_modes(source, section.qsma, structure)
    return Study(
        section.name, source.path, model, structure, section.qsma, tuple(section.recordings)
    )


@dataclass(frozen=True)
class _Source:
    """A YAML file's content as text, and the nodes that know where each key stands."""

    path: Path
    root: yaml.Node
    content: Any

    @classmethod
    def read(cls, path: Path) -> Self:
        try:
            text = path.read_text(encoding="utf-8")
            root = yaml.compose(text, Loader=yaml.SafeLoader)
            content = None if root is None else _content(root, path)
        except OSError as error:
            raise InputError(
                f"{path}: {error.strerror or error}; expected a study file (YAML)"
            ) from None
        except UnicodeDecodeError:
            raise InputError(f"{path}: is not UTF-8 text; expected a study file (YAML)") from None
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            line = mark.line + 1 if mark else 1
            raise InputError(
                f"{path}:{line}: not valid YAML: {error.problem or error.context}; check quotes, "
                "brackets and indentation"
            ) from None
        except yaml.YAMLError as error:
            raise InputError(f"{path}: not valid YAML: {' '.join(str(error).split())}") from None
        except RecursionError:
            raise InputError(f"{path}: nested too deeply; does an alias hold itself?") from None
        if root is None:
            raise InputError(f"{path}:1: the file is empty; expected name: and model:")
        return cls(path, root, content)

    def error(self, place: Place, message: str) -> InputError:
        """One line for a fault at a place."""
        _, line, key = self._find(place)
        return InputError(f"{self.path}:{line}: {key}{': ' if key else ''}{message}")

    def validated(self, kind: type[S], raw: Any, place: Place = ()) -> S:
        """A section of the given kind, or its first fault; unknown keys come first."""
        try:
            return kind.model_validate(raw)
        except ValidationError as error:
            raise self._first(error.errors(), place) from None

    def _first(self, faults: Sequence[ErrorDetails], place: Place) -> InputError:
        def located(fault: ErrorDetails) -> Place:
            key = fault.get("ctx", {}).get("key")
            return (*place, *fault["loc"], *(() if key is None else (key,)))

        first = min(
            faults,
            key=lambda fault: ("unknown key" not in fault["msg"], self._find(located(fault))[1]),
        )
        node, _, _ = self._find(located(first))
        return self.error(located(first), _told(first, node))

    def _find(self, place: Place) -> tuple[yaml.Node, int, str]:
        """Node, line and dotted key of a place; steps that are not in the file are left out."""
        node, line, key = self.root, self.root.start_mark.line + 1, ""
        for step in place:
            if isinstance(node, yaml.MappingNode):
                for name, value in node.value:
                    if name.value == step:
                        node, line = value, name.start_mark.line + 1
                        key += f".{step}" if key else str(step)
                        break
            elif isinstance(node, yaml.SequenceNode) and isinstance(step, int):
                node = node.value[step]
                line = node.start_mark.line + 1
                key += f"[{step}]"
        return node, line, key


def _content(node: yaml.Node, path: Path) -> Any:
    """Mappings, lists, text and None (nothing, ``~`` or ``null``) under a node."""
    if isinstance(node, yaml.MappingNode):
        found = {}
        for key, value in node.value:
            line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode):
                raise InputError(f"{path}:{line}: got {_arrived(key)} for a key; expected text")
            if key.value in found:
                raise InputError(f"{path}:{line}: {key.value}: the key appears twice; remove one")
            found[key.value] = _content(value, path)
        return found
    if isinstance(node, yaml.SequenceNode):
        return [_content(entry, path) for entry in node.value]
    return None if _is_null(node) else node.value


def _is_null(node: yaml.Node) -> bool:
    return isinstance(node, yaml.ScalarNode) and not node.style and node.value in _NULLS


_NULLS = ("", "~", "null")
_EXPECTED = {
    "float_parsing": "a number, without unit",
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_parsing": "a whole number",
    "int_type": "a whole number",
    "string_type": "text",
    "string_too_short": "some text",
    "tuple_type": "a list",
    "dict_type": "a mapping, key: value",
    "model_type": "a mapping, key: value",
    "too_short": "at least one entry",
}
_EXAMPLES = {
    "name": "name: my_study",
    "model": "model: {builder: three_mass}",
    "type": "type: iwan4",
    "parameters": "parameters: {F_S: 10, K_T: 1, chi: -0.5, beta: 5}",
    "alpha": "alpha: {from: 1e-2, to: 1e+2, count: 50}",
}


def _told(fault: ErrorDetails, node: yaml.Node) -> str:
    """What arrived and what was expected, from a fault that pydantic found."""
    kind = fault["type"]
    if kind == "fault":
        return fault["msg"]
    if kind == "missing":
        name = str(fault["loc"][-1])
        return f"{name!r} is missing; add for instance {_EXAMPLES.get(name, f'{name}: 1.0')}"
    if kind == "tuple_type" and fault["loc"][-1] == "<list>":
        expected = "a list of numbers, or {from: 1e-2, to: 1e+2, count: 50}"
    else:
        expected = _EXPECTED.get(kind, fault["msg"].removeprefix("Input should be "))
    expected = re.sub("^(greater|less) than", r"a value \g<0>", expected)
    return f"got {_arrived(node)}; expected {expected}"


def _arrived(node: yaml.Node) -> str:
    if isinstance(node, yaml.ScalarNode):
        return "nothing" if _is_null(node) else repr(node.value)
    return "a mapping" if isinstance(node, yaml.MappingNode) else f"a list of {len(node.value)}"


def _choice(known: Iterable[str]) -> str:
    names = list(known)
    shown = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    return f"one of {shown}" if len(names) > 1 else shown or "none"


def _near(name: str, known: Iterable[str]) -> str:
    """A hint at the nearest known name, or nothing."""
    by_lower = {other.lower(): other for other in known}
    near = difflib.get_close_matches(name.lower(), by_lower, n=1)
    return f"; did you mean {by_lower[near[0]]!r}?" if near else ""


_Joints: TypeAlias = dict[str, tuple[np.ndarray, AbstractJoint]]


def _from_file(source: _Source, section: _Model, file: str) -> tuple[Model, _Joints]:
    """The model of a file, and the joints on its rows."""
    try:
        model = read_model(source.path.parent / file)
    except InputError as error:
        raise source.error(("model", "file"), str(error)) from None
    joints = {}
    for i, joint in enumerate(section.joints):
        row = model.rows[_known_row(source, i, joint, model.rows)]
        joints[joint.name] = (row, _element(source, i, joint))
    return model, joints


def _from_builder(source: _Source, section: _Model, name: str) -> tuple[Model, _Joints]:
    """A system by name, and its joints, some of them replaced."""
    builder = SYSTEMS.get(name)
    if builder is None:
        raise source.error(
            ("model", "builder"), f"got {name!r}; expected {_choice(SYSTEMS)}{_near(name, SYSTEMS)}"
        )
    elements = [_element(source, i, joint) for i, joint in enumerate(section.joints)]
    system = _built(source, section, builder, elements)
    rows = dict(zip(system.labels, np.asarray(system.rows), strict=True))
    replaced = {}
    for i, joint in enumerate(section.joints):
        label = _known_row(source, i, joint, rows)
        if label in replaced:
            raise source.error(("model", "joints", i), f"the joint {label!r} is replaced twice")
        replaced[label] = (joint.name, elements[i])
    joints = {}
    for label, old in system.joints.items():
        new_name, element = replaced.get(label, (label, old))
        joints[new_name] = (rows[label], element)
    return Model(system.structure, rows, {}, {}), joints


def _built(
    source: _Source,
    section: _Model,
    builder: Callable[..., JointedStructure],
    elements: Sequence[AbstractJoint],
) -> JointedStructure:
    """The system of a builder, its options held against the builder's signature."""
    arguments = dict(inspect.signature(builder).parameters)
    joint = arguments.pop("joint", None)
    hints = typing.get_type_hints(builder)
    fields: dict[str, Any] = {
        name: (
            Number if hints[name] is float else hints[name],
            ... if argument.default is argument.empty else argument.default,
        )
        for name, argument in arguments.items()
    }
    options_type = create_model("_Options", __base__=_Section, **fields)
    options = source.validated(options_type, section.options or {}, ("model", "options"))
    given = options.model_dump()
    # A builder that cannot do without its joint gets it; the others' joints are replaced later.
    if joint is not None and joint.default is joint.empty:
        if not elements:
            raise source.error(
                ("model", "builder"),
                f"{section.builder} needs its joint; add joints: [{{name: J1, type: iwan4, "
                "parameters: {F_S: 10, K_T: 1, chi: -0.5, beta: 5}}]",
            )
        given["joint"] = elements[0]
    try:
        return builder(**given)
    except InputError as error:
        named = [name for name in fields if f"{name} = " in str(error)]
        raise source.error(("model", "options", *named[:1]), str(error)) from None


def _known_row(source: _Source, i: int, joint: _Joint, rows: Mapping[str, Any]) -> str:
    """The row a joint sits on, if there is one of that name."""
    if joint.place not in rows:
        raise source.error(
            ("model", "joints", i, "row" if joint.row else "name"),
            f"the model has no row {joint.place!r}; expected {_choice(rows)}"
            f"{_near(joint.place, rows)}",
        )
    return joint.place


# What a distribution may be given by beside the physical parameters (thesis Eqs. A.3 to A.5).
_DISTRIBUTION = (
    ParameterInfo("R", "force/length^(chi+2)", "strength of the power law", lower=0.0),
    ParameterInfo("S", "force/length", "strength of the Dirac slider", 0.0, closed="lower"),
    ParameterInfo("phi_max", "length", "deflection at macroslip", lower=0.0),
)


def _element(source: _Source, i: int, joint: _Joint) -> AbstractJoint:
    """The joint element, from its physical parameters or those of its slider distribution."""
    place: Place = ("model", "joints", i)
    try:
        kind = joint_type(joint.type)
    except InputError as error:
        raise source.error((*place, "type"), str(error)) from None
    place = (*place, "parameters")
    sets: list[tuple[Callable[..., AbstractJoint], dict[str, ParameterInfo]]] = [
        (kind, {info.name: info for info in kind.parameters})
    ]
    from_distribution = getattr(kind, "from_distribution", None)
    if from_distribution is not None:
        known = {info.name: info for info in (*kind.parameters, *_DISTRIBUTION)}
        names = inspect.signature(from_distribution).parameters
        sets.append((from_distribution, {name: known[name] for name in names}))
    expected = " or ".join(", ".join(infos) for _, infos in sets)
    everything = [name for _, infos in sets for name in infos]
    given = joint.parameters
    for name in given:
        if name not in everything:
            raise source.error(
                (*place, name),
                f"unknown parameter of {joint.type}; expected {expected}{_near(name, everything)}",
            )
    # The set that most of what is given belongs to is the one that was meant.
    make, infos = max(sets, key=lambda each: len(given.keys() & each[1].keys()))
    for name in given:
        if name not in infos:
            raise source.error((*place, name), f"mixes two sets of parameters; expected {expected}")
    for name, info in infos.items():
        if name not in given:
            raise source.error(
                place, f"{name} ({info.meaning}, {info.dimension}) is missing; expected {expected}"
            )
        if not info.contains(np.asarray(given[name])):
            raise source.error(
                (*place, name),
                f"got {given[name]:g} ({info.meaning}); expected in {info.range}",
            )
    try:
        return make(**given)
    except InputError as error:
        raise source.error(place, str(error)) from None


def _check_modes(source: _Source, settings: QsmaSettings, structure: JointedStructure) -> None:
    count = structure.basis.omega2.shape[0]
    for i, mode in enumerate(settings.modes):
        if mode >= count:
            raise source.error(
                ("qsma", "modes", i),
                f"got {mode}; expected 0 to {count - 1}: the structure has {count} elastic "
                "mode(s), counted from 0, lowest first",
            )
