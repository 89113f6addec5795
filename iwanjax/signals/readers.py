"""Reading recordings from files."""

from collections.abc import Sequence
from typing import Any

from iwanjax.errors import InputError
from iwanjax.signals.recording import Recording
from iwanjax.signals.records import Selection, records


def read_recordings(
    path: Any,
    *,
    variable: str | None = None,
    time: str = "time",
    response: str | Sequence[str] | None = None,
    force: str | Sequence[str] | None = None,
    sampling_rate: float | None = None,
    channels: Sequence[str] | None = None,
    inputs: Sequence[str] | None = None,
    quantity: str = "",
    unit: str = "",
) -> tuple[Recording, ...]:
    """Read all recordings of a file, or of a table of pandas or xarray.

    Understood are NumPy ``.npz``, MATLAB ``.mat`` of every version and HDF5 with

    * arrays time (N,), response (N, s) or (s, N) and perhaps force, at the top or in a
      struct or group; channels may also be arrays of their own;
    * an array or cell of such structs;
    * a cell with one row per recording: time, response, and numbers, which are left out;

    and one recording, or several, of

    * text (``.csv``, ``.txt``) with a row of names, and perhaps one of units, above a column per
      channel; JSON of columns;
    * universal files (``.uff``, ``.unv``): data sets 58 and 58b; LabVIEW's ``.lvm`` and ``.tdms``
      (all of these with the extra ``io``);
    * MATLAB exports of Test.Lab; one NumPy array (``.npy``); sound (``.wav``).

    Quantities, units, directions and remarks are kept where the file has them.

    Parameters
    ----------
    path : str, Path or table
        The file; its extension says how it is read. Of a DataFrame, Series, DataArray or Dataset
        the index, or the first dimension, is the time.
    variable : str, optional
        The struct, group or cell with the recordings, or the group of a TDMS file; may be left
        out where only one has any.
    time : str
        Name of the time axis, s. By default also ``t``, ``time_s`` and the like.
    response : str or sequence of str, optional
        Names of the arrays or columns to take; by default ``response``, or else every
        series that is neither time nor force.
    force : str or sequence of str, optional
        Names of the forces; by default all that start with ``force``. ``[]`` for none.
    sampling_rate : float, optional
        Hz; needed where the file has neither time nor rate. A time axis must agree to 1e-3; where
        its values were only rounded, it is made exact.
    channels, inputs : sequence of str, optional
        Names for the columns of response and of force, in their order.
    quantity, unit : str
        What the response measures, and its unit as a label; nothing is converted. The
        quantity of a channel called acc..., vel... or disp... need not be given.

    Returns
    -------
    tuple of Recording
        Named after the file, and numbered from 0 where there are several.

    Raises
    ------
    InputError
        One line naming the file, the array or the line and column, what arrived, what was
        expected and what to try.

    Examples
    --------
    >>> import iwanjax as ij
    >>> hits = ij.read_recordings("configs/modal_ringdown/hit1.npz", quantity="velocity")
    >>> len(hits), hits[0].sampling_rate
    (1, 2048.0)
    """
    selection = Selection(time, response, force, sampling_rate, channels, inputs, quantity, unit)
    found = records(path, variable, selection)
    return tuple(record.select(selection).recording() for record in found)


def read_recording(
    path: Any,
    index: int | None = None,
    *,
    variable: str | None = None,
    time: str = "time",
    response: str | Sequence[str] | None = None,
    force: str | Sequence[str] | None = None,
    sampling_rate: float | None = None,
    channels: Sequence[str] | None = None,
    inputs: Sequence[str] | None = None,
    quantity: str = "",
    unit: str = "",
) -> Recording:
    """Read one recording; the others in the file may be faulty.

    Parameters
    ----------
    path : str, Path or table
        The file.
    index : int, optional
        Which one, counted from 0; may be left out where there is only one.
    variable, time, response, force, sampling_rate, channels, inputs, quantity, unit
        As for :func:`read_recordings`.

    Returns
    -------
    Recording

    Raises
    ------
    InputError
        As for :func:`read_recordings`, and when ``index`` is missing or out of range.

    Examples
    --------
    >>> import iwanjax as ij
    >>> hit = ij.read_recording("configs/modal_ringdown/hit1.npz", quantity="velocity", unit="m/s")
    >>> hit.response.shape, hit.channels[0].quantity
    ((11264, 1), 'velocity')
    """
    selection = Selection(time, response, force, sampling_rate, channels, inputs, quantity, unit)
    found = records(path, variable, selection)
    place = found[0].path if len(found) == 1 else path
    if index is None and len(found) > 1:
        raise InputError(f"{path}: holds {len(found)} recordings; give index=0 to {len(found) - 1}")
    if not 0 <= (index or 0) < len(found):
        raise InputError(f"{place}: index is {index}; expected 0 to {len(found) - 1}")
    return found[index or 0].select(selection).recording()
