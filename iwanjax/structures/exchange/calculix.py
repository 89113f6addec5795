"""Matrices that CalculiX writes in a ``*FREQUENCY, SOLVER=MATRIXSTORAGE`` step.

CalculiX CrunchiX User's Manual, ``*FREQUENCY``: ``job.sti`` and ``job.mas`` hold the upper
triangle, one ``row column value`` a line; ``job.dof`` one ``node.direction`` a line.
"""

from pathlib import Path

from iwanjax.structures.exchange.contents import Contents, sparse_matrix
from iwanjax.structures.exchange.map_files import beside, checked_size, read_dof
from iwanjax.structures.exchange.text import number_table, text_lines

_NAMES = {".sti": "K", ".mas": "M"}


def read_calculix(path: Path) -> Contents:
    """The stiffness of a ``.sti`` or the mass of a ``.mas`` file, with the ``.dof`` beside it.

    Raises
    ------
    InputError
        Naming the line that is no entry, or a row beyond the DOFs of the ``.dof`` file.
    """
    table = number_table(text_lines(path), (3,))
    rows, columns = (table.integers(i, ("row", "column")[i], 1) - 1 for i in range(2))
    listing = beside(path, ".dof")
    nodes = None if listing is None else read_dof(listing)
    size = checked_size(rows, columns, None if nodes is None else nodes.size)
    matrix = sparse_matrix(rows, columns, table.values[:, 2], size)
    return Contents({_NAMES[path.suffix.lower()]: matrix}, nodes)
