"""Recordings from arrays and tables: the only place that knows of pandas and xarray."""

from collections.abc import Sequence
from numbers import Real
from typing import Any, NamedTuple

import numpy as np

from iwanjax.errors import InputError
from iwanjax.signals.file_record import FileRecord, channel_of
from iwanjax.signals.recording import Channel, Recording


class _Table(NamedTuple):
    """Columns (N, k), their names where they have any, and the times (N,) where these are known."""

    values: np.ndarray
    names: tuple[str, ...] | None
    time: np.ndarray | None


def as_recording(
    response: Any,
    force: Any = None,
    *,
    sampling_rate: float | None = None,
    sensors: str | Sequence[str] | None = None,
    inputs: str | Sequence[str] | None = None,
    quantity: str = "acceleration",
    unit: str = "",
    name: str = "recording",
) -> Recording:
    """A recording from arrays, or from tables of pandas or xarray.

    A table brings its own names and times: of a pandas DataFrame the columns are the channels and
    the index is the time; of an xarray DataArray the first dimension is time, the second, where
    there is one, the channels. Neither package is needed otherwise.

    Parameters
    ----------
    response : (N,) or (N, sensors) array_like or table
        What the sensors measured.
    force : (N,) or (N, inputs) array_like or table, optional
        Measured forces, N; none for a free decay.
    sampling_rate : float, optional
        Hz; needed where the response brings no times, and instead of them where it is given.
    sensors, inputs : str or sequence of str, optional
        Names of the columns, as the model calls them; ``"s1", "s2"`` and ``"f1"`` by default.
        Of a table: those of its columns to take.
    quantity : {"acceleration", "velocity", "displacement"}
        What the sensors measure.
    unit : str
        Of the responses, for labels; nothing is converted.
    name : str
        For messages and legends.

    Returns
    -------
    Recording

    Raises
    ------
    InputError
        Naming the recording: no times and no rate, names that do not match the columns, and all
        that :class:`iwanjax.Recording` refuses.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> t = np.arange(512) / 256
    >>> hit = ij.as_recording(np.sin(40 * t), np.exp(-t), sampling_rate=256, sensors="tip")
    >>> hit.channels[0].name, hit.inputs[0].name, hit.sampling_rate
    ('tip', 'f1', 256.0)
    """
    motion = _named(_table(response, "response", name), sensors, "sensors", "s", name)
    time = motion.time
    if sampling_rate is not None:
        if not isinstance(sampling_rate, Real) or not 0.0 < sampling_rate < np.inf:
            raise InputError(f"{name}: sampling_rate = {sampling_rate!r}; expected positive Hz")
        time = np.arange(len(motion.values)) / sampling_rate
    if time is None:
        raise InputError(f"{name}: response brings no times; give sampling_rate, in Hz")
    channels = tuple(Channel(each, quantity, unit) for each in motion.names or ())
    if force is None:
        if inputs is not None:
            raise InputError(f"{name}: inputs are named but there is no force")
        return Recording(time, motion.values, channels, name=name)
    push = _named(_table(force, "force", name), inputs, "inputs", "f", name)
    acting = tuple(Channel(each, "force") for each in push.names or ())
    return Recording(time, motion.values, channels, push.values, acting, name)


def table_record(given: Any) -> FileRecord:
    """A table of pandas or xarray as a record: its columns by name, its index as time.

    Parameters
    ----------
    given : DataFrame, Series, DataArray or Dataset
        Of xarray, ``units`` in the attributes are kept, and all others as metadata.

    Raises
    ------
    InputError
        For anything else, which :func:`as_recording` takes with its names beside it.
    """
    name = type(given).__name__
    attributes = {str(key): value for key, value in getattr(given, "attrs", {}).items()}
    parts = {"": given}
    if hasattr(given, "data_vars"):  # of xarray, several arrays
        parts = {str(key): value for key, value in given.data_vars.items()}
    arrays: dict[str, np.ndarray] = {}
    channels = {}
    for label, part in parts.items():
        if not (hasattr(part, "dims") or hasattr(part, "index")):
            raise InputError(
                f"{name}: expected a path, or a table of pandas or xarray; as_recording takes "
                "arrays, with names and rate beside them"
            )
        table = _table(part, label or "table", name)
        own = label or str(getattr(part, "name", "") or "response")
        single = table.names is None and table.values.shape[1] == 1
        names = table.names or tuple(f"{own}[{i}]" for i in range(table.values.shape[1]))
        unit = str(getattr(part, "attrs", {}).get("units", ""))
        for each, column in zip((own,) if single else names, table.values.T, strict=True):
            arrays[each] = column
            channels[each] = channel_of(each, unit)
        if table.time is not None:
            arrays = {"time": table.time} | arrays
    remarks = {key: str(value) for key, value in attributes.items() if key != "units"}
    return FileRecord(arrays, channels, metadata=remarks)


def _table(given: Any, what: str, name: str) -> _Table:
    """What is given, as columns; pandas and xarray are recognised by their attributes."""
    names = time = None
    if hasattr(given, "dims") and hasattr(given, "coords"):
        known = [given.coords.get(dim) for dim in given.dims]
        time, names = (*known, None, None)[:2]
    elif hasattr(given, "index") and hasattr(given, "to_numpy"):
        time, names = given.index, getattr(given, "columns", None)
    try:
        values = _array(given)
    except TypeError as error:
        raise InputError(f"{name}: {what}: {error}; expected one array or table") from None
    if values.ndim == 1:
        values = values[:, None]
    if values.ndim != 2:
        raise InputError(
            f"{name}: {what}, a {type(given).__name__}, has shape {values.shape}; expected (N,) or "
            "(N, columns)"
        )
    labels = None if names is None else tuple(map(str, _array(names)))
    return _Table(values, labels, None if time is None else _seconds(_array(time), name))


def _array(given: Any) -> np.ndarray:
    """The values of an array, a column or a table."""
    if hasattr(given, "to_numpy"):
        return given.to_numpy()
    values = getattr(given, "values", given)
    return np.asarray(given if callable(values) else values)


def _seconds(time: np.ndarray, name: str) -> np.ndarray | None:
    """Times in s from numbers, dates or time differences; None for a mere count of rows."""
    if time.dtype.kind in "iu":
        return None
    if time.dtype.kind == "f":
        return time
    if time.dtype.kind in "mM":
        return (time - time[0]) / np.timedelta64(1, "s")
    raise InputError(
        f"{name}: the times are of type {time.dtype}; expected seconds, or sampling_rate instead"
    )


def _named(
    table: _Table, wanted: str | Sequence[str] | None, what: str, letter: str, name: str
) -> _Table:
    """The table with a name for each column; of a table that has names those wanted."""
    count = table.values.shape[1]
    if wanted is None:
        names = table.names or tuple(f"{letter}{i + 1}" for i in range(count))
        return table._replace(names=names)
    labels = (wanted,) if isinstance(wanted, str) else tuple(wanted)
    if table.names is not None:
        missing = [label for label in labels if label not in table.names]
        if missing:
            raise InputError(
                f"{name}: {what}: no column {missing[0]!r}; the table has {', '.join(table.names)}"
            )
        columns = [table.names.index(label) for label in labels]
        return table._replace(values=table.values[:, columns], names=labels)
    if len(labels) != count:
        raise InputError(
            f"{name}: {what} names {len(labels)} column(s), {', '.join(labels)}; expected {count}, "
            "one for each"
        )
    return table._replace(names=labels)
