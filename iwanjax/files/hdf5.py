"""HDF5 files, those among them that MATLAB v7.3 has written included.

MATLAB says by attributes what each dataset was; numbers stand transposed, and cells and
arrays of structs are references into the group ``#refs#``.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

import h5py
import numpy as np

from iwanjax.files.nodes import (
    NO_MATLAB,
    Node,
    Unreadable,
    dense,
    objects,
    plain,
    told,
    wanted,
)

_Entry: TypeAlias = h5py.Group | h5py.Dataset


def is_hdf5(path: Path) -> bool:
    """Whether a file is HDF5, whatever its extension."""
    return bool(h5py.is_hdf5(str(path)))


def read_hdf5(path: Path, names: Sequence[str] | None) -> dict[str, Node]:
    """Nodes of an HDF5 file; see :func:`iwanjax.files.read_arrays`."""
    with h5py.File(path, "r") as file:
        # MATLAB keeps what cells and structs refer to in #refs#, objects in #subsystem#.
        held = (name for name in map(str, file) if not name.startswith("#"))
        return {name: _member(file, name, ()) for name in wanted(held, names)}


def _member(group: h5py.Group, name: Any, above: tuple[_Entry, ...]) -> Node:
    """What a name, or a reference, in a group stands for; ``above`` is all that it is in."""
    try:
        entry = group[name]
        if entry in above:
            return Unreadable("holds itself")
        if isinstance(entry, h5py.Group):
            return _group(entry, (*above, entry))
        if isinstance(entry, h5py.Dataset):
            return _dataset(entry, (*above, entry))
    except Exception as error:
        return Unreadable(f"cannot be read ({told(error)}); is the file damaged?")
    return Unreadable("is no array but an HDF5 type; expected a dataset")


def _group(group: h5py.Group, above: tuple[_Entry, ...]) -> Node:
    if _class(group) == "function_handle":
        return NO_MATLAB
    if "MATLAB_sparse" in group.attrs:
        return _sparse(group)
    fields = [name for name in _fields(group) if name in group] or list(map(str, group))
    columns = {name: group.get(name) for name in fields}
    arrays = {name: c for name, c in columns.items() if isinstance(c, h5py.Dataset)}
    of_each = [_class(array) == "" and _refers(array) for array in arrays.values()]
    if _class(group) != "struct" or len(arrays) < len(fields) or not fields or not all(of_each):
        return {name: _member(group, name, above) for name in fields}
    # An array of structs: each field is an array of references, one per struct.
    entries = {name: _cell(array, above) for name, array in arrays.items()}
    first = entries[fields[0]]
    structs = ({name: nodes.flat[i] for name, nodes in entries.items()} for i in range(first.size))
    return objects(first.shape, structs)


def _dataset(entry: h5py.Dataset, above: tuple[_Entry, ...]) -> Node:
    kind = _class(entry)
    if "MATLAB_empty" in entry.attrs:
        shape = tuple(int(n) for n in entry[()])
        if kind == "char":
            return np.empty(shape[:1], dtype="<U1")
        return np.empty(shape, dtype=object if kind in ("cell", "struct") else float)
    if "MATLAB_object_decode" in entry.attrs or kind in ("function_handle", "string"):
        return NO_MATLAB
    if kind == "cell":
        return _cell(entry, above)
    if entry.shape is None:
        return np.empty(0)
    if h5py.check_string_dtype(entry.dtype) is not None:
        return np.asarray(entry.asstr()[()], dtype=str)
    array = np.asarray(entry[()])
    if not kind:
        return plain(array)
    array = array.T  # MATLAB writes columns first
    if kind == "char":
        rows = np.atleast_2d(array).astype("<u2")
        return np.array([row.tobytes().decode("utf-16-le") for row in rows], dtype=str)
    if array.dtype.names == ("real", "imag"):
        return array["real"] + 1j * array["imag"]
    return plain(array)


def _cell(entry: h5py.Dataset, above: tuple[_Entry, ...]) -> np.ndarray:
    references = np.asarray(entry[()]).T
    return objects(references.shape, (_member(entry.file, one, above) for one in references.flat))


def _sparse(group: h5py.Group) -> Node:
    """MATLAB's compressed columns: values, their rows, and where each column starts."""
    if "data" not in group:  # no entry differs from zero
        values, rows = np.empty(0), np.empty(0, dtype=int)
    else:
        values, rows = np.asarray(group["data"]), np.asarray(group["ir"])
    starts = np.asarray(group["jc"])
    size = (int(np.asarray(group.attrs["MATLAB_sparse"])), len(starts) - 1)
    columns = np.repeat(np.arange(size[1]), np.diff(starts.astype(np.int64)))
    return dense(size, rows, columns, values)


def _fields(group: h5py.Group) -> list[str]:
    """Names of a struct's fields in their order in MATLAB; HDF5 sorts them."""
    fields = group.attrs.get("MATLAB_fields", ())
    return [b"".join(letters).decode() for letters in fields]


def _class(entry: _Entry) -> str:
    kind = entry.attrs.get("MATLAB_class", b"")
    return kind.decode() if isinstance(kind, bytes) else str(kind)


def _refers(entry: h5py.Dataset) -> bool:
    return h5py.check_ref_dtype(entry.dtype) is not None
