"""Element matrices that Abaqus and CalculiX write as ``*USER ELEMENT`` blocks, assembled.

Abaqus Analysis User's Guide, "User-defined elements", and Keywords Guide, ``*USER ELEMENT``,
``*MATRIX``: variables go node by node; a symmetric matrix is written by columns from the first
row to the diagonal, an unsymmetric one by whole columns.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from iwanjax.errors import InputError
from iwanjax.structures.exchange.contents import Contents
from iwanjax.structures.exchange.keywords import KeywordBlock
from iwanjax.structures.exchange.node_map import Dof, NodeMap, dof_name, in_order
from iwanjax.structures.exchange.text import number_table

_ROLES = {"STIFFNESS": "K", "MASS": "M", "VISCOUS DAMPING": "C"}
_NUMBER = re.compile(r"ELEMENT NUMBER\s+(\d+)", re.IGNORECASE)


@dataclass(frozen=True)
class _Element:
    """An element's number and the DOFs that its matrices go by."""

    number: str
    dofs: list[Dof]


def assembled_elements(parts: Sequence[KeywordBlock]) -> Contents:
    """M and K summed over the elements of a file.

    Raises
    ------
    InputError
        For an element without nodes or with too few or many numbers, and for one whose
        matrix is there twice, as a file of several steps or increments has it.
    """
    element: _Element | None = None
    number = "1"
    added: set[tuple[str, str]] = set()
    blocks: dict[str, list[tuple[list[Dof], np.ndarray]]] = {}
    for part in parts:
        if part.keyword == "USER ELEMENT":
            element = _Element(number, _dofs(part))
        elif part.keyword == "MATRIX":
            role = _ROLES.get(part.options.get("TYPE", "").upper())
            if role is None:
                raise InputError(
                    f"line {part.start - 1}: *MATRIX is of type {part.options.get('TYPE', '')!r}; "
                    f"expected TYPE={', '.join(_ROLES)}; is the file cut short?"
                )
            if element is None:
                raise InputError(f"line {part.start - 1}: *MATRIX stands before any *USER ELEMENT")
            if (element.number, role) in added:
                raise InputError(
                    f"line {part.start - 1}: element {element.number} has its {role} twice; write "
                    "one step and increment only"
                )
            added.add((element.number, role))
            blocks.setdefault(role, []).append((element.dofs, _square(part, element)))
        # Comments that name an element stand above its keyword.
        for _, comment in part.comments:
            if match := _NUMBER.search(comment):
                number = match[1]
    if not blocks:
        raise InputError("holds *USER ELEMENT but no *MATRIX, TYPE=STIFFNESS or MASS")
    labels = in_order({dof for each in blocks.values() for dofs, _ in each for dof in dofs})
    places = {dof: i for i, dof in enumerate(labels)}
    matrices = {role: _assembled(each, places) for role, each in blocks.items()}
    return Contents(matrices, NodeMap.of(labels))


def _dofs(part: KeywordBlock) -> list[Dof]:
    """DOFs of an element: its nodes from the comments, the active motions from the data."""
    nodes: list[int] = []
    below = False
    for _, comment in part.comments:
        fields = comment.replace(",", " ").split()
        if below and fields and all(field.isdigit() for field in fields):
            nodes += map(int, fields)
        else:
            below = "ELEMENT NODES" in comment.upper()
    said = part.options.get("NODES", "")
    if not nodes or (said.isdigit() and int(said) != len(nodes)):
        raise InputError(
            f"line {part.start - 1}: *USER ELEMENT of {said or 'unknown'} nodes has {len(nodes)} "
            "node numbers under ** ELEMENT NODES"
        )
    active: list[str] = []
    changes: dict[int, list[str]] = {}
    for number, line in enumerate(part.lines, part.start):
        fields = line.replace(",", " ").split()
        if not all(field.isdigit() for field in fields):
            raise InputError(f"line {number}: {line!r} is no list of DOF numbers")
        if fields:
            # The first list is of the first node; later ones name the node where they begin.
            first = 1 if not changes else int(fields.pop(0))
            changes[first] = [dof_name(field) for field in fields]
    dofs = []
    for position, node in enumerate(nodes, 1):
        active = changes.get(position, active)
        dofs += [(node, name) for name in active]
    if not dofs:
        raise InputError(f"line {part.start}: *USER ELEMENT lists no DOFs")
    return dofs


def _square(part: KeywordBlock, element: _Element) -> np.ndarray:
    """An element matrix from its numbers, which are a triangle or all of it."""
    n = len(element.dofs)
    fields = [line for text in part.lines for line in text.replace(",", " ").split()]
    values = number_table(fields, (1,), part.start).values[:, 0] if fields else np.empty(0)
    if len(values) == n * n and n > 1:
        return values.reshape(n, n).T
    if len(values) != n * (n + 1) // 2:
        raise InputError(
            f"line {part.start}: element {element.number} has {len(values)} numbers for {n} DOFs; "
            f"expected {n * (n + 1) // 2} (symmetric) or {n * n}; is the file cut short?"
        )
    matrix = np.zeros((n, n))
    # Columns down to the diagonal are rows up to it.
    matrix[np.tril_indices(n)] = values
    return matrix + matrix.T - np.diag(matrix.diagonal())


def _assembled(
    blocks: Sequence[tuple[list[Dof], np.ndarray]], places: dict[Dof, int]
) -> sp.csr_array:
    rows, columns, values = [], [], []
    for dofs, matrix in blocks:
        own = np.array([places[dof] for dof in dofs])
        rows.append(np.repeat(own, len(own)))
        columns.append(np.tile(own, len(own)))
        values.append(matrix.ravel())
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sp.csr_array(sp.coo_array(entries, shape=(len(places), len(places))))
