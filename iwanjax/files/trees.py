"""Objects made of arrays, numbers and words, in one ``.npz`` file.

The arrays are the file's own; how they belong together stands beside them as JSON. Classes are
named, never stored: reading executes nothing that a file holds and calls no constructor.
"""

import dataclasses
import enum
import importlib
import json
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from iwanjax.errors import InputError
from iwanjax.files.arrays import existing_file
from iwanjax.files.whole import whole_file
from iwanjax.types import warn_single_precision

_TREE = "iwanjax"
"""Name of the array that holds the JSON."""

_Name = list[str]
"""Module and qualified name of a class."""


def write_tree(path: str | Path, tree: Any) -> Path:
    """Write an object to a file, whole or not at all.

    Parameters
    ----------
    path : str or Path
        Ends in ``.npz``; what stands there is replaced.
    tree : object
        Dataclasses, equinox modules, named tuples and enumerations, of arrays, numbers, words,
        classes, and tuples, lists and dictionaries of these.

    Returns
    -------
    Path

    Raises
    ------
    InputError
        For another ending, a folder that takes no file, and an object that holds something else,
        with the place of it.
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise InputError(f"{path}: results are saved as .npz; name the file so")
    arrays: dict[str, np.ndarray] = {}
    stored = {"version": _version(), "tree": _packed(tree, type(tree).__name__, arrays)}
    arrays[_TREE] = np.array(json.dumps(stored))
    try:
        with whole_file(path) as file:
            np.savez(file, allow_pickle=False, **arrays)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror or error}); expected a folder that "
            "exists, with room and permission"
        ) from None
    return path


def read_tree(path: str | Path) -> Any:
    """Read what :func:`write_tree` wrote.

    Parameters
    ----------
    path : str or Path
        An ``.npz`` file.

    Returns
    -------
    object
        As it was saved, arrays as they were: NumPy's or JAX's.

    Raises
    ------
    InputError
        For a file that is missing, damaged or of another origin, and for classes that are not
        known here or have other fields.
    """
    path = existing_file(path)
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = dict(stored)
    except (OSError, ValueError, EOFError, TypeError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(f"{path}: cannot be read ({error}); is it cut short?") from None
    try:
        content = json.loads(arrays[_TREE].item())
        version, tree = content["version"], content["tree"]
    except (KeyError, ValueError, TypeError, AttributeError):
        raise InputError(
            f"{path}: is no result that iwanjax saved; expected a file written by save()"
        ) from None
    try:
        return _unpacked(tree, arrays)
    except InputError as error:
        raise InputError(
            f"{path}: {error} (saved by iwanjax {version}; this is {_version()})"
        ) from None
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: damaged ({type(error).__name__}: {error})") from None


def _version() -> str:
    """The package's, which is loaded before any of its modules is."""
    return sys.modules["iwanjax"].__version__


def _packed(value: Any, place: str, arrays: dict[str, np.ndarray]) -> Any:
    """A value as JSON; arrays go beside it, by name."""

    def beside(array: np.ndarray) -> str:
        if array.dtype.hasobject:
            raise InputError(f"{place}: an array of Python objects cannot be saved")
        name = f"a{len(arrays)}"
        arrays[name] = array
        return name

    def packed(each: Any, name: object) -> Any:
        return _packed(each, f"{place}.{name}", arrays)

    if isinstance(value, enum.Enum):
        return {"enum": [_name(type(value), place), value.name]}
    if value is None or isinstance(value, bool | int | float | str):
        # A number type of NumPy's that is Python's too would come back as Python's.
        return {"scalar": beside(np.asarray(value))} if isinstance(value, np.generic) else value
    if isinstance(value, np.generic):
        return {"scalar": beside(np.asarray(value))}
    if isinstance(value, complex):
        return {"complex": [value.real, value.imag]}
    if isinstance(value, np.ndarray):
        return {"numpy" if value.flags.writeable else "fixed": beside(value)}
    if isinstance(value, jax.Array):
        return {"jax": beside(np.asarray(value))}
    if isinstance(value, type):
        return {"type": _name(value, place)}
    if isinstance(value, Path):
        return {"path": str(value)}
    names = _field_names(type(value))
    if names is not None:
        fields = {name: packed(getattr(value, name), name) for name in names}
        return {"object": [_name(type(value), place), fields]}
    if isinstance(value, tuple | list):
        items = [packed(each, i) for i, each in enumerate(value)]
        return {type(value).__name__: items}
    if isinstance(value, dict):
        items = [[packed(key, "keys"), packed(each, key)] for key, each in value.items()]
        return {"dict": items}
    raise InputError(f"{place} is a {type(value).__name__}, which cannot be saved")


def _unpacked(node: Any, arrays: dict[str, np.ndarray]) -> Any:
    """The value of what :func:`_packed` made."""
    if not isinstance(node, dict):
        return node

    def all_of(nodes: Any) -> list[Any]:
        return [_unpacked(each, arrays) for each in nodes]

    ((kind, content),) = node.items()
    readers: dict[str, Callable[[Any], Any]] = {
        "enum": lambda pair: _class(pair[0])[pair[1]],  # pyright: ignore[reportIndexIssue]
        "scalar": lambda name: arrays[name][()],
        "complex": lambda parts: complex(*parts),
        "numpy": lambda name: arrays[name],
        "fixed": lambda name: _read_only(arrays[name]),
        "jax": lambda name: _as_jax(arrays[name]),
        "type": _class,
        "path": Path,
        "object": lambda pair: _object(_class(pair[0]), pair[1], arrays),
        "tuple": lambda items: tuple(all_of(items)),
        "list": all_of,
        "dict": lambda items: dict(all_of(pair) for pair in items),
    }
    return readers[kind](content)


def _read_only(array: np.ndarray) -> np.ndarray:
    array.flags.writeable = False
    return array


def _as_jax(array: np.ndarray) -> jax.Array:
    if array.dtype.itemsize > np.dtype(np.float32).itemsize:
        warn_single_precision()
    return jnp.asarray(array)


def _object(kind: type, fields: dict[str, Any], arrays: dict[str, np.ndarray]) -> Any:
    names = _field_names(kind)
    if names is None or set(names) != set(fields):
        changed = sorted(set(names or ()) ^ set(fields))
        raise InputError(f"{kind.__name__} has other fields here: {', '.join(changed)}")
    values = {name: _unpacked(fields[name], arrays) for name in names}
    if issubclass(kind, tuple):
        return tuple.__new__(kind, values.values())
    # As equinox and copy do: what was checked when it was made is not checked again.
    found = object.__new__(kind)
    for name, value in values.items():
        object.__setattr__(found, name, value)
    return found


def _field_names(kind: type) -> tuple[str, ...] | None:
    """Fields of a dataclass, an equinox module or a named tuple; None for other classes."""
    if dataclasses.is_dataclass(kind):
        return tuple(each.name for each in dataclasses.fields(kind))
    return getattr(kind, "_fields", None) if issubclass(kind, tuple) else None


def _name(kind: type, place: str) -> _Name:
    """Where a class is found again."""
    name = [kind.__module__, kind.__qualname__]
    try:
        found = _class(name)
    except InputError:
        found = None
    if found is not kind:
        raise InputError(
            f"{place}: {kind.__qualname__} cannot be found by its name; define the class in a "
            "module, not in a function"
        )
    return name


def _class(name: _Name) -> type:
    """The class of a name: of this package, or of a module that is imported already."""
    module, qualified = name
    own = module.partition(".")[0] == "iwanjax"
    try:
        found: Any = importlib.import_module(module) if own else sys.modules[module]
        for part in qualified.split("."):
            found = getattr(found, part)
    except (ImportError, KeyError, AttributeError):
        found = None
    if not isinstance(found, type):
        raise InputError(
            f"the class {module}.{qualified} is not known here"
            + ("" if own else f"; import {module} first")
        )
    return found
