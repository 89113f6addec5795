"""What describes a study, and where each key stands: YAML that knows its lines, or Python's values.

A file is composed into nodes and read as text; the schema turns text into numbers. So
YAML 1.1's own ideas of what ``1e5`` (text) or ``no`` (false) mean never enter.
"""

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, TypeAlias, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from iwanjax.config.faults import told
from iwanjax.errors import InputError

Place: TypeAlias = tuple[str | int, ...]
"""Keys and list positions that lead to a value."""

S = TypeVar("S", bound=BaseModel)


@dataclass(frozen=True)
class Source:
    """What describes a study, for messages that say where a fault is.

    Attributes
    ----------
    label : str
        What messages begin with: the file, or the study's name.
    content : object
        Mappings, lists and values; of a file as text.
    path : Path or None
        The file; None for a study made in Python.
    root : yaml.Node or None
        The file's nodes, which know their lines.
    """

    label: str
    content: Any
    path: Path | None = None
    root: yaml.Node | None = None

    @classmethod
    def given(cls, label: str, content: Mapping[str, Any]) -> Self:
        """What a program says, arrays as lists as a file would have them."""
        return cls(label, _plain(content))

    @property
    def folder(self) -> Path:
        """Where relative paths begin: the file's folder, else the working one."""
        return self.path.parent if self.path else Path()

    @classmethod
    def read(cls, path: Path) -> Self:
        """The content of a file, whatever its keys."""
        try:
            root = yaml.compose(path.read_bytes(), Loader=yaml.SafeLoader)
            if root is None:
                raise InputError(f"{path}:1: the file is empty; expected name: and model:")
            return cls(str(path), _content(root, path), path, root)
        except OSError as error:
            what = error.strerror or error
            raise InputError(f"{path}: {what}; expected a study file (YAML)") from None
        except yaml.MarkedYAMLError as error:
            line = f":{error.problem_mark.line + 1}" if error.problem_mark else ""
            raise InputError(
                f"{path}{line}: not valid YAML: {error.problem}; check quotes, brackets and "
                "indentation"
            ) from None
        except yaml.YAMLError as error:
            what = " ".join(str(error).split())
            raise InputError(f"{path}: not valid YAML in UTF-8: {what}") from None
        except RecursionError:
            raise InputError(f"{path}: nested too deeply; does an alias hold itself?") from None

    def error(self, place: Place, message: str) -> InputError:
        """One line for a fault at a place."""
        return InputError(f"{self.told(place)}: {message}")

    def told(self, place: Place) -> str:
        """File, line and dotted key of a place, as messages begin."""
        _, line, key = self._find(place)
        return f"{self.label}{line}{': ' if key else ''}{key}"

    @contextlib.contextmanager
    def blamed(self, *place: str | int) -> Iterator[None]:
        """What the library refuses in the block, told as a fault of the place."""
        try:
            yield
        except InputError as error:
            raise self.error(place, str(error)) from None

    def validated(self, kind: type[S], raw: Any, place: Place = ()) -> S:
        """What the schema makes of the raw section at a place, or the first fault in it."""
        try:
            return kind.model_validate(raw)
        except ValidationError as error:
            first = error.errors()[0]
            key = first.get("ctx", {}).get("key")
            place = (*place, *first["loc"], *(() if key is None else (key,)))
            node = self._find(place)[0]
            arrived = repr(first["input"]) if node is None else _arrived(node)
            raise self.error(place, told(first, arrived)) from None

    def _find(self, place: Place) -> tuple[yaml.Node | None, str, str]:
        """Node, line and dotted key of a place; steps that are not in the file are left out."""
        if self.root is None:
            steps = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in place)
            return None, "", "".join(steps).lstrip(".")
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
        return node, f":{line}", key


def _plain(value: Any) -> Any:
    """Mappings with keys of text, lists, numbers and text; objects as they are."""
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return value.tolist() if hasattr(value, "tolist") else value


def _content(node: yaml.Node, path: Path) -> Any:
    """Mappings, lists, text and None (nothing, ``~`` or ``null``) under a node."""
    if isinstance(node, yaml.SequenceNode):
        return [_content(entry, path) for entry in node.value]
    if isinstance(node, yaml.ScalarNode):
        return None if _is_null(node) else node.value
    found = {}
    for key, value in node.value:
        line = key.start_mark.line + 1
        if not isinstance(key, yaml.ScalarNode):
            raise InputError(f"{path}:{line}: got {_arrived(key)} for a key; expected text")
        if key.value in found:
            raise InputError(f"{path}:{line}: {key.value}: the key appears twice; remove one")
        found[key.value] = _content(value, path)
    return found


def _is_null(node: yaml.ScalarNode) -> bool:
    return not node.style and node.value in ("", "~", "null")


def _arrived(node: yaml.Node) -> str:
    if isinstance(node, yaml.ScalarNode):
        return "nothing" if _is_null(node) else repr(node.value)
    return "a mapping" if isinstance(node, yaml.MappingNode) else f"a list of {len(node.value)}"
