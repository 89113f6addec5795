"""Matrices that CalculiX writes in a ``*FREQUENCY, SOLVER=MATRIXSTORAGE`` step.

CalculiX CrunchiX User's Manual, ``*FREQUENCY``: ``job.sti`` and ``job.mas`` hold the upper
triangle, one ``row column value`` a line; ``job.dof`` one ``node.direction`` a line.
"""

from pathlib import Path

from iwanjax.errors import InputError
from iwanjax.structures.exchange.contents import Contents
from iwanjax.structures.exchange.coordinates import coordinate_matrix
from iwanjax.structures.exchange.map_files import beside, read_dof
from iwanjax.structures.exchange.text import number_table, text_lines

_NAMES = {".sti": "K", ".mas": "M"}


def read_calculix(path: Path) -> Contents:
    """The stiffness of a ``.sti`` or the mass of a ``.mas`` file, with the ``.dof`` beside it.

    Raises
    ------
    InputError
        Naming the line that is no entry, a row beyond the DOFs of the ``.dof`` file, or one
        without its diagonal entry, as a file cut short has it.
    """
    matrix = coordinate_matrix(number_table(text_lines(path), (3,)))
    listing = beside(path, ".dof")
    nodes = None if listing is None else read_dof(listing)
    size = matrix.shape[0]
    if nodes is not None and nodes.size != size:
        doubled = (
            " (cyclic symmetry doubles the size: not supported)" if size == 2 * nodes.size else ""
        )
        raise InputError(
            f"entries reach row {size} but {listing} has {nodes.size} rows{doubled}; do they come "
            "from one run?"
        )
    return Contents({_NAMES[path.suffix.lower()]: matrix}, nodes)
