"""Named arrays from a file of any kind."""

import zipfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np

from iwanjax.errors import InputError
from iwanjax.files.nodes import Node, Unreadable, plain, told, wanted

_Reader: TypeAlias = Callable[[Path, Sequence[str] | None], dict[str, Node]]


def read_arrays(path: str | Path, names: Sequence[str] | None = None) -> dict[str, Node]:
    """Read named arrays from a NumPy, MATLAB (v4 to v7.3) or HDF5 file.

    Arrays have the shape that the file's own program shows, MATLAB's vectors and numbers
    thus two axes. MATLAB char arrays are arrays of ``str``, one per row; sparse matrices
    come out dense.

    Parameters
    ----------
    path : str or Path
        The file; its extension says how it is read.
    names : sequence of str, optional
        What to read; all of it when not given.

    Returns
    -------
    dict of str to Node
        In the order of ``names``, or of the file. What cannot be read is
        :class:`Unreadable` unless it was asked for by name.

    Raises
    ------
    InputError
        One line naming the file and the array: file missing, damaged or of unknown kind;
        a name that is not in it or that holds no plain array.
    """
    path = existing_file(path)
    try:
        found = _READERS[path.suffix.lower()](path, names)
        for name in names or ():
            node = found[name]
            if isinstance(node, Unreadable):
                raise InputError(f"{name} {node.reason}")
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except PermissionError:
        raise InputError(f"{path}: may not be read; check the file's permissions") from None
    except Exception as error:  # the three libraries raise a dozen kinds for damaged files
        raise InputError(
            f"{path}: cannot be read as {path.suffix} ({told(error)}); is it cut short? export "
            "it again"
        ) from None
    return found


def existing_file(path: str | Path, more: Iterable[str] = ()) -> Path:
    """A path to a file of known kind.

    Parameters
    ----------
    path : str or Path
        What the user gave.
    more : iterable of str
        Extensions that the caller reads itself, with their dots.

    Raises
    ------
    InputError
        When there is no such file or its extension is unknown.
    """
    path = Path(path)
    *most, last = (*more, *_READERS)
    known = f"{', '.join(most)} or {last}"
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "does not exist"
        raise InputError(f"{path}: {what}; expected a file, {known}")
    if path.suffix.lower() not in (*most, last):
        raise InputError(f"{path}: extension {path.suffix!r} is unknown; expected {known}")
    return path


def _npz(path: Path, names: Sequence[str] | None) -> dict[str, Node]:
    if not zipfile.is_zipfile(path):
        raise InputError(
            "is not a zip archive, as every .npz file is; is it cut short? write it again with "
            "numpy.savez"
        )
    with np.load(path, allow_pickle=False) as file:
        return {name: _npz_array(file, name) for name in wanted(file.files, names)}


def _npz_array(file: np.lib.npyio.NpzFile, name: str) -> Node:
    try:
        array = file[name]
    except Exception as error:
        if "allow_pickle" in str(error):
            return Unreadable(
                "holds pickled Python objects, which are never loaded; save plain numbers, and "
                "labels as numpy.array([...], dtype=str)"
            )
        return Unreadable(f"cannot be read ({told(error)}); is the file damaged?")
    if not isinstance(array, np.ndarray):
        return Unreadable("is no NumPy array; write the file with numpy.savez")
    return plain(array)


def _mat(path: Path, names: Sequence[str] | None) -> dict[str, Node]:
    # Here, because SciPy's readers and h5py take longer to import than the rest of iwanjax's own.
    from iwanjax.files.matlab import read_mat

    return read_mat(path, names)


def _hdf5(path: Path, names: Sequence[str] | None) -> dict[str, Node]:
    from iwanjax.files.hdf5 import read_hdf5

    return read_hdf5(path, names)


_READERS: dict[str, _Reader] = {".npz": _npz, ".mat": _mat, ".h5": _hdf5, ".hdf5": _hdf5}
