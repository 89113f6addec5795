"""Nastran OUTPUT4 and OUTPUT2 files, by pyyeti (extra ``nastran``).

MSC Nastran DMAP Programmer's Guide, modules OUTPUT4 and OUTPUT2. Data blocks keep their
names: KAA, MAA, KGG, MGG, KXX, MXX, ...
"""

import warnings
from pathlib import Path
from types import ModuleType

import scipy.sparse as sp

from iwanjax.errors import InputError
from iwanjax.structures.exchange.contents import Contents

# 400 MB as float64.
_LARGEST_DENSE = 50_000_000


def read_op4(path: Path) -> Contents:
    """Matrices of an OUTPUT4 file: text or binary, dense or sparse (BIGMAT or not).

    Raises
    ------
    InputError
        When pyyeti is not installed or the file is cut short.
    """
    op4, _ = _pyyeti()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # What a file cut short gives can still be read, in part.
        warnings.filterwarnings("error", message="Premature end-of-file")
        found = op4.read(str(path), sparse=(None, sp.csr_array))
    return Contents({name.upper(): matrix for name, matrix in found.items()})


def read_op2(path: Path) -> Contents:
    """Matrices of an OUTPUT2 file; its tables are passed over.

    Raises
    ------
    InputError
        When pyyeti is not installed, the file is cut short, or a matrix is too large to
        be held with its zeros, as pyyeti does.
    """
    _, op2 = _pyyeti()
    with op2.OP2(str(path)) as file:
        for block in file.dblist:
            columns, rows = block.trailer[1:3]
            if block.dbtype == 1 and columns * rows > _LARGEST_DENSE:
                raise InputError(
                    f"{block.name} is {rows} by {columns}, too large for an OP2 file, which is "
                    "read with its zeros; write it by OUTPUT4 with BIGMAT instead"
                )
        return Contents(file.rdop2mats())


def _pyyeti() -> tuple[ModuleType, ModuleType]:
    try:
        from pyyeti.nastran import op2, op4  # takes seconds: it loads pandas
    except ImportError:
        raise InputError(
            "Nastran files are read by pyyeti, which is not installed; pip install iwanjax[nastran]"
        ) from None
    return op4, op2
