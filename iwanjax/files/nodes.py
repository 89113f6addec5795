"""What a name in a file stands for, whatever kind of file it is."""

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from iwanjax.errors import InputError

# 400 MB as float64; what is larger was sparse for a reason.
_LARGEST_DENSE = 50_000_000


@dataclass(frozen=True)
class Unreadable:
    """What stands in a file where nothing can be read: a function handle, a damaged array.

    Attributes
    ----------
    reason : str
        What is wrong and what to try; goes after the name in a message.
    """

    reason: str


@dataclass(frozen=True)
class TooLarge(Unreadable):
    """A sparse matrix that would not fit with its zeros; its entries are there.

    Attributes
    ----------
    shape : (int, int)
        Rows and columns.
    rows, columns, values : (entries,) array
        Each entry's place, counted from 0, and value.
    """

    shape: tuple[int, int]
    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray


Node: TypeAlias = "np.ndarray | dict[str, Node] | Unreadable"
"""What a name in a file stands for.

An array of numbers or of text (``str``); a dict for a MATLAB struct or an HDF5 group; an
array of objects, each a Node, for a MATLAB cell or an array of structs, in its own shape.
"""


NO_MATLAB = Unreadable(
    "is a MATLAB function or object (table, string, ...); save plain arrays, char or struct"
)


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint at the nearest known name, for the end of a message, or nothing."""
    by_lower = {other.lower(): other for other in known}
    near = difflib.get_close_matches(name.lower(), by_lower, n=1)
    return f"; did you mean {by_lower[near[0]]!r}?" if near else ""


def wanted(held: Iterable[str], names: Sequence[str] | None) -> list[str]:
    """Which names to read, all of them in the file."""
    held = list(held)
    if names is None:
        return held
    for name in names:
        if name not in held:
            raise InputError(
                f"array {name!r} is missing; expected {', '.join(names)}; the file holds "
                f"{', '.join(sorted(held)) or 'nothing'}{nearest(name, held)}"
            )
    return list(names)


def told(error: Exception) -> str:
    """An error of a library on one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def plain(array: np.ndarray) -> Node:
    """Numbers or text as they are, bytes as text, a table as its columns."""
    if array.dtype.names:
        return {name: plain(array[name]) for name in array.dtype.names}
    if array.dtype.kind == "S":
        return np.char.decode(array, "utf-8")
    if array.dtype.kind not in "biufcU":
        return Unreadable(f"is of type {array.dtype}; expected numbers or text")
    return array


def dense(
    shape: tuple[int, int], rows: np.ndarray, columns: np.ndarray, values: np.ndarray
) -> Node:
    """A sparse matrix with its zeros, if it fits."""
    if np.prod(shape, dtype=float) > _LARGEST_DENSE:
        reason = f"is a sparse matrix of shape {shape}, too large; reduce it first"
        return TooLarge(reason, shape, rows, columns, values)
    matrix = np.zeros(shape, np.result_type(values, np.float64))
    matrix[rows, columns] = values
    return matrix


def objects(shape: tuple[int, ...], nodes: Iterable[Node]) -> np.ndarray:
    """Nodes in an array of objects, filled one by one: NumPy must not merge what is in them."""
    found = np.empty(shape, dtype=object)
    for i, node in enumerate(nodes):
        found.flat[i] = node
    return found
