"""Matrices that Abaqus writes as text (``.mtx``), assembled or element by element.

Abaqus Analysis User's Guide, "Generating matrices" (``*MATRIX OUTPUT``, formats MATRIX INPUT and
COORDINATE) and "Defining matrices" (``*MATRIX INPUT``, ``*MATRIX ASSEMBLE``).
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from iwanjax.errors import InputError
from iwanjax.structures.exchange.abaqus_elements import assembled_elements
from iwanjax.structures.exchange.contents import Contents, Matrix, sparse_matrix
from iwanjax.structures.exchange.coordinates import coordinate_matrix, without_diagonal
from iwanjax.structures.exchange.keywords import KeywordBlock, sections
from iwanjax.structures.exchange.matrices import mirrored, one_sided
from iwanjax.structures.exchange.node_map import NodeMap
from iwanjax.structures.exchange.text import NumberTable, number_table, text_lines

# What Abaqus puts on the diagonal of the stiffness for a DOF that a boundary condition holds.
_FIXED = 1e36
_ROLES = {"STIFFNESS": "K", "MASS": "M", "VISCOUS DAMPING": "C"}


def read_abaqus(path: Path) -> Contents:
    """Matrices of an Abaqus ``.mtx`` file.

    * MATRIX INPUT: lines ``node, dof, node, dof, value``; both triangles or one of them. Blocks
      under ``*MATRIX INPUT, NAME=`` keep their names, or M, K, C where ``*MATRIX ASSEMBLE`` says.
    * COORDINATE: lines ``row column value``.
    * ``*ELEMENT MATRIX OUTPUT`` and ``*SUBSTRUCTURE MATRIX OUTPUT``: ``*USER ELEMENT`` and
      ``*MATRIX`` blocks, which are assembled.

    Raises
    ------
    InputError
        Naming the line that is none of these, or an entry that stands twice.
    """
    parts = sections(text_lines(path))
    if any(part.keyword == "USER ELEMENT" for part in parts):
        return assembled_elements(parts)
    names, tables = {}, {}
    for part in parts:
        if part.keyword == "MATRIX ASSEMBLE":
            names |= {
                part.options[option].upper(): role
                for option, role in _ROLES.items()
                if option in part.options
            }
        elif part.keyword in ("", "MATRIX INPUT"):
            if not part.keyword and not any(part.lines):
                continue  # comments above the first keyword
            tables[part.options.get("NAME", "").upper()] = _table(part)
        else:
            raise InputError(f"line {part.start - 1}: *{part.keyword} is no matrix of numbers")
    named = {names.get(name, name): table for name, table in tables.items()}
    if all(table.values.shape[1] == 3 for table in named.values()):
        return Contents({name: coordinate_matrix(table) for name, table in named.items()})
    return _labelled(named)


def _table(part: KeywordBlock) -> NumberTable:
    table = number_table(part.lines, (5, 3), part.start)
    factor = part.options.get("SCALE FACTOR", "1")
    try:
        table.values[:, -1] *= float(factor)
    except ValueError:
        raise InputError(f"line {part.start - 1}: scale factor {factor!r} is no number") from None
    return table


def _labelled(tables: Mapping[str, NumberTable]) -> Contents:
    """Matrices of lines that name node and DOF, all on the DOFs of any of them."""
    pairs = {}
    for name, table in tables.items():
        if table.values.shape[1] != 5:
            raise InputError(f"block {name or 'without a name'} has no node labels, others have")
        ends = [
            np.stack([table.integers(i, "node"), table.integers(i + 1, "DOF", 1)], 1)
            for i in (0, 2)
        ]
        pairs[name] = np.concatenate(ends)
    dofs, places = np.unique(np.concatenate(list(pairs.values())), axis=0, return_inverse=True)
    nodes = NodeMap(dofs[:, 0], dofs[:, 1].tolist())
    matrices: dict[str, Matrix] = {}
    fixed = set()
    start = 0
    for name, table in tables.items():
        count = len(table.values)
        rows, columns = places[start : start + count], places[start + count : start + 2 * count]
        start += 2 * count
        matrix = sparse_matrix(rows, columns, table.values[:, 4], nodes.size)
        # The format lets a symmetric matrix have either triangle, in the order of any node list.
        matrices[name] = mirrored(matrix) if one_sided(matrix) else matrix
        # Lagrange multipliers, which have none, are at internal nodes with negative numbers.
        cut = [i for i in without_diagonal(matrix) if nodes.numbers[i] > 0]
        if cut:
            raise InputError(
                f"{nodes.label(int(cut[0]))} has no diagonal entry; is the file cut short?"
            )
        held = np.flatnonzero(matrix.diagonal() >= _FIXED)
        fixed |= {nodes.labels()[i] for i in held}
    return Contents(matrices, nodes, frozenset(fixed))
