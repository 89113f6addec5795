"""Reading a structure, its named rows, sensors and inputs from a file of matrices."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iwanjax.errors import InputError
from iwanjax.files import Node, read_arrays
from iwanjax.structures.checks import finite_array
from iwanjax.structures.linear import LinearStructure

_NAMED_ROWS = (
    ("row_labels", "rows"),
    ("sensor_labels", "sensor_rows"),
    ("input_labels", "input_rows"),
)
BASE = "base"
"""The input that is the acceleration of the ground; its row is -M r, with r the motion of the
coordinates when the ground moves by 1 and nothing deforms."""
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
        Where each measured force acts: nodal force ``row * f(t)``. ``base`` is the acceleration
        of the ground, its row -M r: r is the motion of the coordinates when the ground moves by 1
        and nothing deforms, and all motion is relative to the ground.
    coordinates : tuple of str
        Names of the first coordinates u, as many as have one.
    """

    structure: LinearStructure
    rows: dict[str, np.ndarray]
    sensors: dict[str, np.ndarray]
    inputs: dict[str, np.ndarray]
    coordinates: tuple[str, ...] = ()


def read_model(path: str | Path) -> Model:
    """Read a model file: NumPy ``.npz``, MATLAB ``.mat`` or HDF5 ``.h5``/``.hdf5``.

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
    nodes = read_arrays(path, _ARRAYS)
    try:
        return _model({name: _array(node, name) for name, node in nodes.items()})
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _array(node: Node, name: str) -> np.ndarray:
    if not isinstance(node, np.ndarray):
        raise InputError(f"{name} is a group or struct; expected a dataset or array")
    return node


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
        if text.size != 1 or text.dtype.kind != "U":
            raise InputError(f"{name} holds {item!r}, of type {text.dtype}; expected text")
        # A MATLAB char matrix pads its rows to equal length.
        found.append(text.item().rstrip())
    return found
