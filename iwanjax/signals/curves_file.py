"""Reading amplitude-dependent frequency and damping from files."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.files import Node, Unreadable, existing_file, nearest, read_arrays
from iwanjax.signals.columns import read_columns

_FEWEST_POINTS = 3
_NEEDED = ("amplitude", "frequency", "damping")
_NAMES = {
    "amplitude": ("amplitude",),
    "frequency": ("frequency_hz", "frequency"),
    "damping": ("damping",),
    "amplitude_std": ("amplitude_std",),
    "frequency_std": ("frequency_hz_std", "frequency_std"),
    "damping_std": ("damping_std",),
}


def read_curves(
    path: str | Path,
    *,
    quantity: str = "modal displacement",
    unit: str = "",
    name: str = "",
) -> ModalCurves:
    """Read the curves of one mode: CSV with a header row, ``.npz``, ``.mat`` or HDF5.

    Parameters
    ----------
    path : str or Path
        A file with columns or arrays (levels,): amplitude, frequency_hz or frequency (Hz),
        damping (ratio), and perhaps amplitude_std, frequency_hz_std or frequency_std,
        damping_std. Other columns are left out.
    quantity, unit, name : str
        What the amplitude measures, its unit, and the mode's name; see
        :class:`iwanjax.ModalCurves`.

    Returns
    -------
    ModalCurves

    Raises
    ------
    InputError
        One line naming the file and the column: missing, misspelt, twice, not finite,
        fewer than 3 points, amplitude or frequency not positive, damping in percent.
    """
    path = existing_file(path, [".csv"])
    held: Mapping[str, Node] = (
        read_columns(path) if path.suffix.lower() == ".csv" else read_arrays(path)
    )
    try:
        columns = {key: _column(held, names) for key, names in _NAMES.items()}
        _refuse_misspelt(held)
        found = {key: value for key, value in columns.items() if value is not None}
        _check(found)
        amplitude, frequency, damping = (found.pop(key) for key in _NEEDED)
        return ModalCurves(
            amplitude, frequency, damping, quantity=quantity, unit=unit, name=name, **found
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _column(held: Mapping[str, Node], names: tuple[str, ...]) -> np.ndarray | None:
    """A column by one of its names, (levels,); None where it is not there and need not be."""
    present = [name for name in names if name in held]
    if len(present) > 1:
        raise InputError(f"{' and '.join(present)} are the same; leave out one")
    if not present:
        if names[-1] in _NEEDED:
            raise InputError(
                f"{' or '.join(names)} is missing; found {', '.join(held) or 'nothing'}"
                f"{nearest(names[-1], held)}"
            )
        return None
    name = present[0]
    node = held[name]
    if isinstance(node, Unreadable):
        raise InputError(f"{name} {node.reason}")
    if not isinstance(node, np.ndarray) or node.dtype.kind not in "biuf":
        raise InputError(f"{name} holds no real numbers; expected one value for each level")
    if max(node.shape, default=0) != node.size:
        raise InputError(f"{name} has shape {node.shape}; expected one axis, (levels,)")
    column = node.ravel().astype(np.float64)
    if column.size < _FEWEST_POINTS:
        raise InputError(f"{name} has {column.size} points; expected at least {_FEWEST_POINTS}")
    if not np.all(np.isfinite(column)):
        first = int(np.argmin(np.isfinite(column)))
        raise InputError(
            f"{name} holds {np.sum(~np.isfinite(column))} NaN or infinite value(s), the first at "
            f"point {first}, counted from 0; leave these points out"
        )
    return column


def _refuse_misspelt(held: Mapping[str, Node]) -> None:
    """A deviation under a misspelt name must not go unnoticed."""
    known = [name for names in _NAMES.values() for name in names]
    for name in held:
        if name not in known and (hint := nearest(name, known)):
            raise InputError(f"{name} is unknown{hint}")


def _check(columns: dict[str, np.ndarray]) -> None:
    for name in ("amplitude", "frequency"):
        low = int(np.argmin(columns[name]))
        if columns[name][low] <= 0.0:
            raise InputError(
                f"{name} is {columns[name][low]:g} at point {low}, counted from 0; expected "
                "positive numbers"
            )
    for name in ("damping", "damping_std"):
        largest = np.max(columns.get(name, 0.0))
        if largest > 1.0:
            raise InputError(
                f"{name} is {largest:g}; expected a ratio below 1; that looks like percent, so "
                "divide by 100"
            )
