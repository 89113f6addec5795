"""MATLAB ``.mat`` files: v4 to v7 by SciPy, v7.3 as the HDF5 that they are."""

import enum
import math
import struct
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque, MatReadWarning

from iwanjax.errors import InputError
from iwanjax.files.hdf5 import is_hdf5, read_hdf5
from iwanjax.files.nodes import NO_MATLAB, Node, Unreadable, dense, objects, plain, wanted


class _Type(enum.IntEnum):
    """Types of data elements of a file of version 5 that say how they are built."""

    INT32 = 5
    UINT32 = 6
    MATRIX = 14
    COMPRESSED = 15


class _Class(enum.IntEnum):
    """Classes of arrays that hold something other than one row of numbers or letters."""

    CELL = 1
    STRUCT = 2
    OBJECT = 3
    CHAR = 4
    SPARSE = 5
    LAST_NUMERIC = 15


# NumPy's letters of the types of values, by their number; dots are none.
_LETTERS = ".bBhHiIf.d..qQ..BHI"


class _Bytes(enum.IntEnum):
    """Of the header, the last two being the byte order, and at the beginning of an element."""

    HEADER = 128
    TAG = 8


def read_mat(path: Path, names: Sequence[str] | None) -> dict[str, Node]:
    """Nodes of a MATLAB file; see :func:`iwanjax.files.read_arrays`."""
    if is_hdf5(path):
        return read_hdf5(path, names)
    _refuse_damaged(path)
    with warnings.catch_warnings():
        # A variable that cannot be read comes out as the reason, and is told as such below.
        warnings.simplefilter("ignore", MatReadWarning)
        held = (name for name, _, _ in scipy.io.whosmat(path) if not name.startswith("__"))
        chosen = wanted(held, names)
        content = scipy.io.loadmat(path, variable_names=chosen, spmatrix=False)
    return {name: _node(content[name]) for name in chosen}


def _node(value: Any) -> Node:
    if value is None:  # a struct without fields
        return {}
    if hasattr(value, "toarray"):
        if hasattr(value, "check_format"):
            value.check_format(full_check=True)  # indices beyond the size crash the interpreter
        entries = value.tocoo()
        return dense(entries.shape, entries.row, entries.col, entries.data)
    if isinstance(value, MatlabFunction | MatlabObject | MatlabOpaque):
        return NO_MATLAB
    if not isinstance(value, np.ndarray):
        return Unreadable(f"cannot be read ({value}); is the file damaged?")
    if value.dtype.names:
        structs = objects(value.shape, (_struct(entry) for entry in value.flat))
        return structs.item() if structs.size == 1 else structs
    if value.dtype.kind == "O":
        return objects(value.shape, map(_node, value.flat))
    return plain(value)


def _struct(entry: np.void) -> dict[str, Node]:
    return {name: _node(entry[name]) for name in entry.dtype.names or ()}


def _refuse_damaged(path: Path) -> None:
    """Refuse a file of version 5 whose elements do not fit into each other: SciPy crashes on some.

    MAT-File Format (The MathWorks), chapter 1. What is compressed has a checksum.
    """
    content = memoryview(path.read_bytes())
    order = {b"IM": "<", b"MI": ">"}.get(bytes(content[_Bytes.HEADER - 2 : _Bytes.HEADER]))
    if order is None:  # version 4, or no MATLAB file at all
        return
    for kind, first, stop in _elements(content, order, _Bytes.HEADER, len(content)):
        if kind == _Type.MATRIX:
            _check_matrix(content, order, first, stop)
        elif kind != _Type.COMPRESSED:
            raise InputError(_DAMAGED.format(f"an element of type {kind}"))


_DAMAGED = "is damaged: {} stands where an array was expected; export it again"


def _elements(
    content: memoryview, order: str, first: int, stop: int
) -> Iterator[tuple[int, int, int]]:
    """Type, first byte and end of each data element between two places."""
    while first < stop:
        if first + _Bytes.TAG > stop:
            raise InputError("is cut short or damaged; export it again")
        kind, size = struct.unpack_from(f"{order}2I", content, first)
        small, kind = divmod(kind, 1 << 16)
        begin = first + _Bytes.TAG // 2 if small else first + _Bytes.TAG
        end = begin + (small or size)
        if end > stop or (small and small > _Bytes.TAG // 2):
            raise InputError("is cut short or damaged; export it again")
        yield kind, begin, end
        # Elements begin at multiples of 8, but for compressed ones.
        first = (
            end
            if kind == _Type.COMPRESSED
            else begin + (_Bytes.TAG // 2 if small else -(-size // _Bytes.TAG) * _Bytes.TAG)
        )


def _check_matrix(content: memoryview, order: str, first: int, stop: int) -> None:
    """Hold an array's parts against what its class and its shape say."""
    if first == stop:  # an empty cell
        return
    parts = list(_elements(content, order, first, stop))
    kinds = [kind for kind, _, _ in parts]
    whole = {_Type.UINT32, _Type.INT32}
    if (
        kinds[:1] != [_Type.UINT32]
        or not {*kinds[1:2]} <= whole
        or len(kinds) < 3
        or parts[0][2] - parts[0][1] != _Bytes.TAG
    ):
        raise InputError(_DAMAGED.format(f"elements of types {kinds[:2]}"))
    flags = struct.unpack_from(f"{order}I", content, parts[0][1])[0]
    of_class, complex_ = flags & 0xFF, bool(flags & 0x800)
    begin, end = parts[1][1:]
    shape = struct.unpack_from(f"{order}{(end - begin) // 4}i", content, begin)
    count = math.prod(shape)
    rest = parts[3:]
    if min(shape, default=0) < 0:
        raise InputError(_DAMAGED.format(f"an array of shape {shape}"))
    if of_class in (_Class.CELL, _Class.STRUCT, _Class.OBJECT):
        if of_class != _Class.CELL:
            names = rest[:2] if of_class == _Class.STRUCT else rest[1:3]
            rest = rest[len(names) if of_class == _Class.STRUCT else 1 + len(names) :]
            count *= _fields(content, order, names)
        if len(rest) != count or any(kind != _Type.MATRIX for kind, _, _ in rest):
            raise InputError(_DAMAGED.format(f"{len(rest)} of {count} entries"))
        for _, begin, end in rest:
            _check_matrix(content, order, begin, end)
    elif of_class == _Class.SPARSE:
        if len(rest) != 3 + complex_:
            raise InputError(_DAMAGED.format(f"a sparse matrix of {len(rest)} parts"))
    elif _Class.CHAR <= of_class <= _Class.LAST_NUMERIC:
        sizes = [(end - begin) // _bytes(kind) for kind, begin, end in rest]
        # Letters outside ASCII take several bytes.
        fits = [size == count or of_class == _Class.CHAR for size in sizes]
        if len(rest) != 1 + complex_ or not all(fits):
            raise InputError(_DAMAGED.format(f"{sizes} of {count} values"))


def _bytes(kind: int) -> int:
    """Of a value of a data element's type."""
    letter = _LETTERS[kind] if kind < len(_LETTERS) else "."
    if letter == ".":
        raise InputError(_DAMAGED.format(f"an element of type {kind}"))
    return np.dtype(letter).itemsize


def _fields(content: memoryview, order: str, parts: list[tuple[int, int, int]]) -> int:
    """How many fields a struct has: their names are of one length."""
    if len(parts) != 2 or parts[0][0] != _Type.INT32:
        raise InputError(_DAMAGED.format("a struct without names"))
    length = struct.unpack_from(f"{order}i", content, parts[0][1])[0]
    if length <= 0:
        raise InputError(_DAMAGED.format("a struct without names"))
    return (parts[1][2] - parts[1][1]) // length
