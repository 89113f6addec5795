"""Named arrays out of NumPy, MATLAB and HDF5 files, sparse ones among them."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from iwanjax.errors import InputError
from iwanjax.files import Node, TooLarge, read_arrays
from iwanjax.structures.exchange.contents import Contents, Matrix
from iwanjax.structures.exchange.node_map import NodeMap

# What scipy.sparse.save_npz always writes.
_SPARSE_NPZ = {"format", "shape", "data"}


def read_container(path: Path) -> Contents:
    """Matrices of an ``.npz``, ``.mat``, ``.h5`` or ``.hdf5`` file by their names.

    Arrays ``nodes`` (n,) and ``dofs`` (n,), where they are there, say what the rows stand
    for: node numbers, and motions as text (``ux``) or 1 to 6. An ``.npz`` of
    ``scipy.sparse.save_npz`` is one matrix without a name.

    Raises
    ------
    InputError
        As :func:`iwanjax.files.read_arrays`, and for a node map of wrong kind.
    """
    found = read_arrays(path)
    if path.suffix.lower() == ".npz" and found.keys() >= _SPARSE_NPZ:
        return Contents({"": sp.csr_array(sp.load_npz(path))})
    matrices = {
        name: matrix for name, node in found.items() if (matrix := _matrix(node)) is not None
    }
    return Contents(matrices, _node_map(found))


def _matrix(node: Node) -> Matrix | None:
    """A numeric matrix, or nothing for whatever else a file holds."""
    if isinstance(node, TooLarge):
        return sp.csr_array((node.values, (node.rows, node.columns)), shape=node.shape)
    if isinstance(node, np.ndarray) and node.ndim == 2 and node.dtype.kind != "O":
        return node
    return None


def _node_map(found: Mapping[str, Node]) -> NodeMap | None:
    numbers, dofs = found.get("nodes"), found.get("dofs")
    if numbers is None and dofs is None:
        return None
    if not isinstance(numbers, np.ndarray) or not isinstance(dofs, np.ndarray):
        raise InputError(
            "a node map is the two arrays nodes and dofs: node numbers and motions, one for each "
            "row"
        )
    # MATLAB's vectors have two axes, and its cells hold one array of text each.
    return NodeMap(np.ravel(numbers), [np.asarray(item).item() for item in np.ravel(dofs)])
