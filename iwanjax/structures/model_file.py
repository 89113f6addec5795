"""Reading a structure, its named rows, sensors and inputs from a file of matrices."""

import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import scipy.io

from iwanjax.errors import InputError
from iwanjax.structures.checks import finite_array
from iwanjax.structures.linear import LinearStructure

_NAMED_ROWS = (
    ("row_labels", "rows"),
    ("sensor_labels", "sensor_rows"),
    ("input_labels", "input_rows"),
)
_ARRAYS = ("M", "C", "K", *(name for pair in _NAMED_ROWS for name in pair))


@dataclass(frozen=True, eq=False)
class Model:
    """A structure and the places on it that have names.

    Attributes
    ----------
    structure : LinearStructure
        M, C and K without the joints.
    rows : dict of str to (n,) array
        Deflections ``d = row @ u`` where a joint sits or an unmodelled force may act.
    sensors : dict of str to (n,) array
        What each sensor sees: ``row @ u`` or its derivatives.
    inputs : dict of str to (n,) array
        Where each measured force acts: nodal force ``row * f(t)``.
    """

    structure: LinearStructure
    rows: dict[str, np.ndarray]
    sensors: dict[str, np.ndarray]
    inputs: dict[str, np.ndarray]


def read_model(path: str | Path) -> Model:
    """Read a model file: NumPy ``.npz``, MATLAB ``.mat`` (up to v7) or HDF5 ``.h5``/``.hdf5``.

    The arrays are M, C, K (n, n); row_labels, rows (r, n); sensor_labels, sensor_rows
    (s, n); input_labels, input_rows (i, n). Labels are text: a string array, or in MATLAB
    a cell of char or a char matrix.

    Parameters
    ----------
    path : str or Path
        The file; its extension says how it is read.

    Returns
    -------
    Model

    Raises
    ------
    InputError
        One line naming the file and the array: file missing, damaged or of unknown kind;
        array missing, of wrong shape or type, not finite; labels that are not unique or
        do not match their rows; Python objects, which are never unpickled.
    """
    path = Path(path)
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "does not exist"
        raise InputError(f"{path}: {what}; expected a model file, {_known_extensions()}")
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(
            f"{path}: extension {path.suffix!r} is unknown; expected {_known_extensions()}"
        )
    try:
        return _model(reader(path))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except Exception as error:  # the three libraries raise a dozen kinds for damaged files
        raise InputError(
            f"{path}: cannot be read as {path.suffix} ({type(error).__name__}: {error}); is it cut "
            "short? export it again"
        ) from None


def _known_extensions() -> str:
    *most, last = _READERS
    return f"{', '.join(most)} or {last}"


def _model(arrays: dict[str, np.ndarray]) -> Model:
    """Check the arrays against each other."""
    structure = LinearStructure(arrays["M"], arrays["C"], arrays["K"])
    rows, sensors, inputs = (
        _named_rows(arrays, labels, matrix, structure.size) for labels, matrix in _NAMED_ROWS
    )
    return Model(structure, rows, sensors, inputs)


def _named_rows(
    arrays: dict[str, np.ndarray], labels: str, matrix: str, n: int
) -> dict[str, np.ndarray]:
    names = _texts(arrays[labels], labels)
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{labels} holds {name!r} {names.count(name)} times; labels are names")
    values = finite_array(arrays[matrix], matrix)
    if not names and not values.size:
        return {}
    if values.shape != (len(names), n):
        raise InputError(
            f"{matrix} has shape {values.shape}; expected {(len(names), n)}: one row for each of "
            f"the {len(names)} {labels}, one column for each coordinate of M"
        )
    return dict(zip(names, values, strict=True))


def _texts(value: np.ndarray, name: str) -> list[str]:
    """Labels from an array of strings or a MATLAB cell (an array of arrays of one string)."""
    found = []
    for item in np.ravel(value):
        text = np.asarray(item)
        if text.size != 1 or text.dtype.kind not in "US":
            raise InputError(f"{name} holds {item!r}, of type {text.dtype}; expected text")
        label = text.item()
        # A MATLAB char matrix pads its rows to equal length.
        found.append((label.decode() if isinstance(label, bytes) else label).rstrip())
    return found


def _require(names: Iterable[str]) -> None:
    held = sorted(names)
    for name in _ARRAYS:
        if name not in held:
            raise InputError(
                f"array {name!r} is missing; expected {', '.join(_ARRAYS)}; the file holds "
                f"{', '.join(held) or 'nothing'}"
            )


def _npz(path: Path) -> dict[str, np.ndarray]:
    if not zipfile.is_zipfile(path):
        raise InputError(
            "is not a zip archive, as every .npz file is; is it cut short? write it again with "
            "numpy.savez"
        )
    with np.load(path, allow_pickle=False) as file:
        _require(file.files)
        return {name: _npz_array(file, name) for name in _ARRAYS}


def _npz_array(file: np.lib.npyio.NpzFile, name: str) -> np.ndarray:
    try:
        return file[name]
    except Exception as error:
        if "allow_pickle" in str(error):
            raise InputError(
                f"{name} holds pickled Python objects, which are never loaded; save plain "
                "numbers, and labels as numpy.array([...], dtype=str)"
            ) from None
        raise InputError(f"{name} cannot be read ({error}); is the file damaged?") from None


def _mat(path: Path) -> dict[str, np.ndarray]:
    if h5py.is_hdf5(str(path)):
        raise InputError(
            "is a MATLAB v7.3 file, which stores everything transposed; save it with "
            "save(..., '-v7')"
        )
    _require(name for name, _, _ in scipy.io.whosmat(path))
    return scipy.io.loadmat(path, variable_names=_ARRAYS)


def _hdf5(path: Path) -> dict[str, np.ndarray]:
    with h5py.File(path, "r") as file:
        _require(file)
        return {name: _hdf5_array(file, name) for name in _ARRAYS}


def _hdf5_array(file: h5py.File, name: str) -> np.ndarray:
    entry = file[name]
    if not isinstance(entry, h5py.Dataset):
        raise InputError(f"{name} is a {type(entry).__name__.lower()}; expected a dataset")
    text = h5py.check_string_dtype(entry.dtype) is not None
    return np.asarray(entry.asstr()[()] if text else entry[()])


_READERS: dict[str, Callable[[Path], dict[str, np.ndarray]]] = {
    ".npz": _npz,
    ".mat": _mat,
    ".h5": _hdf5,
    ".hdf5": _hdf5,
}
