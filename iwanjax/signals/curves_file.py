"""Reading amplitude-dependent frequency and damping from files."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.files import Node, Unreadable, existing_file, nearest, read_arrays
from iwanjax.signals.columns import read_columns
from iwanjax.signals.force_control import curves_from_force_control
from iwanjax.signals.response_control import resonance_from_control
from iwanjax.signals.stepped_sine import ahead_of_force

_FEWEST_POINTS = 3
_NEEDED = ("amplitude", "frequency", "damping")
# What is measured in a sweep, by the name of its column.
_SEEN = {
    "acceleration_m_s2": ("acceleration", "m/s^2"),
    "velocity_m_s": ("velocity", "m/s"),
    "displacement_m": ("displacement", "m"),
}
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

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     f, zeta = [10.0, 9.9, 9.8], [1e-3, 2e-3, 3e-3]
    ...     np.savez(f"{folder}/mode.npz", amplitude=[1.0, 2.0, 3.0], frequency=f, damping=zeta)
    ...     curves = ij.read_curves(f"{folder}/mode.npz")
    >>> curves.frequency.tolist()
    [10.0, 9.9, 9.8]
    """
    path, held = _read(path)
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


def read_response_control(
    path: str | Path, levels: Sequence[float] | None = None, *, name: str = ""
) -> ModalCurves:
    """Read stepped sines under response control, and what they say of their mode.

    Parameters
    ----------
    path : str or Path
        A file with columns or arrays (points,): level (a label), frequency_hz (Hz), force_n (N),
        one of acceleration_m_s2, velocity_m_s and displacement_m, and phase_rad: the response's
        ahead of the force, or the displacement's, with either sign. Other columns are left out.
    levels : sequence of float, optional
        Labels of those to take; all by default.
    name : str
        Of the mode.

    Returns
    -------
    ModalCurves
        See :func:`iwanjax.signals.resonance_from_control`.

    Raises
    ------
    InputError
        One line naming the file and the column or level: missing, not finite, levels that cannot
        be analysed, a phase that suits no mass and damper.
    """
    return _stepped(resonance_from_control, path, levels, name)


def read_force_control(
    path: str | Path, levels: Sequence[float] | None = None, *, name: str = ""
) -> ModalCurves:
    """Read stepped sines under force control, and what they say of their mode.

    Parameters
    ----------
    path, levels, name
        As for :func:`read_response_control`.

    Returns
    -------
    ModalCurves
        See :func:`iwanjax.signals.curves_from_force_control`.

    Raises
    ------
    InputError
        As :func:`read_response_control`.
    """
    return _stepped(curves_from_force_control, path, levels, name)


def _stepped(
    analysed: Callable[..., ModalCurves],
    path: str | Path,
    levels: Sequence[float] | None,
    name: str,
) -> ModalCurves:
    """Curves by an analysis of a file's stepped sines."""
    path, held = _read(path)
    try:
        given = {key: _needed(held, key) for key in ("level", "frequency_hz", "force_n")}
        phase = _needed(held, "phase_rad")
        present = [key for key in _SEEN if key in held]
        if len(present) != 1:
            raise InputError(
                f"expected one of {', '.join(_SEEN)}; found {' and '.join(present) or 'none'}"
            )
        (column,) = present
        label, f, force = given.values()
        arrays = [label, f, force, _needed(held, column), phase]
        unknown = sorted(set(levels or ()) - set(label.tolist()))
        if unknown:
            there = ", ".join(f"{each:g}" for each in np.unique(label))
            raise InputError(f"no level {unknown[0]:g}; the file has {there}")
        taken = np.isin(label, levels) if levels else np.ones(label.shape, bool)
        label, f, force, response, phase = (each[taken] for each in arrays)
        quantity, unit = _SEEN[column]
        phase = ahead_of_force(label, f, force, response, phase, quantity)
        return analysed(label, f, force, response, phase, quantity=quantity, unit=unit, name=name)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _read(path: str | Path) -> tuple[Path, Mapping[str, Node]]:
    """A file's columns or arrays."""
    path = existing_file(path, [".csv"])
    return path, read_columns(path) if path.suffix.lower() == ".csv" else read_arrays(path)


def _needed(held: Mapping[str, Node], name: str) -> np.ndarray:
    """A column that has to be there."""
    column = _column(held, (name,))
    if column is None:
        raise InputError(f"{name} is missing; found {', '.join(held)}{nearest(name, held)}")
    return column


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
