"""Matrix Market files (NIST; Boisvert, Pozo and Remington, NISTIR 5935, 1996)."""

from pathlib import Path

import scipy.io
import scipy.sparse as sp

from iwanjax.errors import InputError
from iwanjax.structures.exchange.contents import Contents

_BANNER = "%%matrixmarket"


def is_matrix_market(path: Path) -> bool:
    """Whether a file starts with the banner of the format; Abaqus uses ``.mtx`` too."""
    with path.open("rb") as file:
        return file.read(len(_BANNER)).lower() == _BANNER.encode()


def read_matrix_market(path: Path) -> Contents:
    """The one matrix of a Matrix Market file, coordinate or array, symmetric or general.

    Raises
    ------
    InputError
        For patterns without values and for files cut short.
    """
    *_, kind, _symmetry = scipy.io.mminfo(path)
    if kind not in ("real", "integer"):
        raise InputError(f"holds {kind} entries; expected real ones")
    matrix = scipy.io.mmread(path, spmatrix=False)
    return Contents({"": sp.csr_array(matrix) if sp.issparse(matrix) else matrix})
