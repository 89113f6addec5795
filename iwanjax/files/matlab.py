"""MATLAB ``.mat`` files: v4 to v7 by SciPy, v7.3 as the HDF5 that they are."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque, MatReadWarning

from iwanjax.files.hdf5 import is_hdf5, read_hdf5
from iwanjax.files.nodes import NO_MATLAB, Node, Unreadable, dense, objects, plain, wanted


def read_mat(path: Path, names: Sequence[str] | None) -> dict[str, Node]:
    """Nodes of a MATLAB file; see :func:`iwanjax.files.read_arrays`."""
    if is_hdf5(path):
        return read_hdf5(path, names)
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
