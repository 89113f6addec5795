"""Matrices of several files brought to one order of rows."""

from collections.abc import Mapping, Set

import numpy as np
import scipy.sparse as sp

from iwanjax.errors import InputError
from iwanjax.structures.exchange.contents import Matrix
from iwanjax.structures.exchange.matrices import ImportedMatrices, completed, real_matrix
from iwanjax.structures.exchange.node_map import Dof, NodeMap, in_order, listed, told


def joined(
    parts: Mapping[str, tuple[Matrix, NodeMap | None]],
    given: NodeMap | None,
    fixed: Set[Dof],
    sources: tuple[str, ...],
) -> ImportedMatrices:
    """Matrices on the DOFs of all their node maps, less those that are held.

    Parameters
    ----------
    parts : mapping of str to (matrix, NodeMap or None)
        K, M, C and T by these names, each with what its rows stand for.
    given : NodeMap or None
        The user's own map, instead of all others.
    fixed : set of (int, str)
        DOFs to leave out.
    sources : tuple of str
        Files, for the result.

    Raises
    ------
    InputError
        As :class:`ImportedMatrices`.
    """
    T = parts["T"][0] if "T" in parts else None
    matrices = {role: matrix for role, (matrix, _) in parts.items() if role != "T"}
    maps = {role: nodes for role, (_, nodes) in parts.items() if nodes is not None}
    if given is not None and fixed:
        raise InputError("the rows are named in the file itself; leave nodes= out")
    labels = [nodes.labels() for nodes in maps.values()]
    same = all(own == labels[0] for own in labels)
    if given is not None or T is not None or len(maps) < len(parts) or (same and not fixed):
        nodes = given if given is not None else next(iter(maps.values()), None)
        return ImportedMatrices(**matrices, T=T, nodes=nodes, sources=sources)
    everything = labels[0] if same else in_order(set().union(*labels))
    union = NodeMap.of([dof for dof in everything if dof not in fixed])
    notes = []
    if fixed:
        held = listed([told(dof) for dof in in_order(fixed)])
        notes.append(
            f"{len(fixed)} DOF(s) that the program holds by a boundary condition (1e36 on the "
            f"diagonal) are left out: {held}."
        )
    for role, matrix in matrices.items():
        # In another order a triangle would be none.
        whole, note = completed(real_matrix(matrix, role), role)
        notes += [note] if note else []
        matrices[role] = _moved(whole, maps[role], union)
    return ImportedMatrices(**matrices, nodes=union, sources=sources, notes=tuple(notes))


def _moved(matrix: Matrix, own: NodeMap, union: NodeMap) -> Matrix:
    """A matrix with its rows and columns where the joint node map has them."""
    if own.size != matrix.shape[0]:
        raise InputError(
            f"node map has {own.size} rows; expected {matrix.shape[0]} like its matrix"
        )
    if own.labels() == union.labels():
        return matrix
    places = {dof: i for i, dof in enumerate(union.labels())}
    target = np.array([places.get(dof, -1) for dof in own.labels()])
    kept = np.flatnonzero(target >= 0)
    choose = sp.csr_array((np.ones(len(kept)), (target[kept], kept)), shape=(union.size, own.size))
    return sp.csr_array(choose @ sp.csr_array(matrix) @ choose.T)
