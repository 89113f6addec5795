"""The ``recordings:`` section, or recordings in memory: what they hold, what they are used for."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from iwanjax.config.section import ConfigSection, Index, Offset, OneOrMore, Positive
from iwanjax.curves import ModalCurves
from iwanjax.signals import ForceLoop, Recording
from iwanjax.types import Initial

Kind: TypeAlias = Literal[
    "transient", "free_decay", "curves", "response_control", "force_control", "loop"
]
Use: TypeAlias = Literal["fit", "hold_out"]
Quantity: TypeAlias = Literal["acceleration", "velocity", "displacement"]
Data: TypeAlias = Recording | ModalCurves | ForceLoop
"""What a recording may be in memory."""

_Names = Annotated[tuple[str, ...], OneOrMore]


class ResponseSettings(ConfigSection):
    """What a recording's ``response:`` says of the measured channels.

    Attributes
    ----------
    array : str or None
        The array of the file that holds them.
    channel, channels : str or None, tuple of str
        One or several; a single one is in ``channels`` too. With ``array``, what its columns
        are called, in their order; without, the columns or arrays to take, or where a file
        has no names for them, what they are called.
    sensors : tuple of str
        The channels' sensors, in the same order: labels of the model where it has any.
    quantity : {"acceleration", "velocity", "displacement"} or None
        What they measure; None leaves it to the channels' own names.
    unit : str
        Label, never converted.
    offset : "mean" or tuple of float
        What each channel shows where nothing moves, which is taken off it: a number, or its mean
        over the part that is used.
    """

    array: str | None = None
    channel: str | None = None
    channels: _Names = ()
    sensors: _Names = ()
    quantity: Quantity | None = None
    unit: str = ""
    offset: Offset = ()


class ForceSettings(ConfigSection):
    """What a recording's ``force:`` says of the measured forces.

    Attributes
    ----------
    array : str or None
        The array of the file that holds them.
    inputs : tuple of str
        Where each acts, in the order of its columns: labels of the model where it has any.
    offset : "mean" or tuple of float
        What each shows where nothing acts, as of a response.
    unit : str
        Label of a loop's force, never converted.
    """

    array: str | None = None
    inputs: _Names = ()
    unit: str = ""
    offset: Offset = ()


class RecordingSection(ConfigSection):
    """An entry of ``recordings:``."""

    file: str
    kind: Kind = "transient"
    use: Use = "fit"
    name: str | None = None
    variable: str | None = None
    sampling_rate: Positive | None = None
    index: Annotated[tuple[Index, ...], Field(min_length=1), OneOrMore] | None = None
    response: ResponseSettings = ResponseSettings()
    force: ForceSettings | None = None
    mode: str | None = None
    modes: Annotated[_Names, Field(min_length=1)] | None = None
    levels: Annotated[tuple[Positive, ...], Field(min_length=1), OneOrMore] | None = None
    joint: str | None = None
    channels: _Names = ()
    start: Annotated[float | None, Field(alias="from")] = None
    end: Annotated[float | None, Field(alias="to")] = None
    initial: Initial | None = None


@dataclass(frozen=True, eq=False)
class Measurement:
    """A recording in memory, and what a study shall do with it.

    Parameters
    ----------
    data : Recording, ModalCurves or ForceLoop
        Time histories with their forces; free decays where there is no force; frequency and
        damping of a mode against amplitude; or force against deflection of a joint on its own.
    use : {"fit", "hold_out"}
        Whether a fit may see it.
    mode : str or int, optional
        The mode that it is of: a name, or the index of an elastic mode. Time histories tell of
        all modes unless given; curves need it where there are several.
    joint : str, optional
        Whose loop it is, where there are several joints.
    name : str
        Label; the data's own unless given.
    start, end : float, optional
        Part of a time history that is used, s on its own time axis: ``from`` and ``to`` of a
        study file. A free decay is taken to begin at ``start``.
    initial : {"rest", "unknown", "periodic"}, optional
        The state in which what is used begins; by default at rest where the data show it, else
        unknown. ``periodic`` is whole periods of a steady state.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> t = np.arange(2048) / 1024
    >>> decay = ij.as_recording(np.exp(-t) * np.cos(600 * t), sampling_rate=1024, sensors="tip")
    >>> ij.Measurement(decay, use="hold_out").use
    'hold_out'
    """

    data: Data
    use: Use = "fit"
    mode: str | int | None = None
    joint: str | None = None
    name: str = ""
    start: float | None = None
    end: float | None = None
    initial: Initial | None = None


@dataclass(frozen=True)
class RecordingEntry:
    """A recording of a study, checked; its file is there but has not been opened.

    Attributes
    ----------
    path : Path or None
        The file; None for a recording in memory.
    kind : {"transient", "free_decay", "curves", "response_control", "force_control", "loop"}
        What it holds.
    use : {"fit", "hold_out"}
        Whether a fit may see it.
    name : str
        Label; the file's own name unless given.
    place : str
        ``file:line: recordings[i]``, for faults that only reading the file shows.
    modes : tuple of str or int
        What it tells of: names of modal modes or indices of elastic ones. One for curves,
        response_control and force_control, none for a loop; for time histories all modes of
        the study unless given.
    response : ResponseSettings
        Measured channels.
    force : ForceSettings or None
        Measured forces.
    variable : str or None
        The struct, group or cell of the file that holds the recordings.
    sampling_rate : float or None
        Hz.
    index : tuple of int or None
        Which recordings of the file, counted from 0; None for all.
    levels : tuple of float or None
        Which controlled levels of the file; None for all.
    joint : str or None
        Whose loop it is.
    channels : tuple of str
        What a loop's file calls further channels that the joint may depend on.
    start, end : float or None
        Part of the record that is used, s on its own time axis.
    initial : {"rest", "unknown", "periodic"} or None
        The state in which that part begins; None leaves it to the data.
    places : mapping of str to str
        The same as ``place`` for keys that only reading the file can refuse.
    data : Recording, ModalCurves, ForceLoop or None
        A recording in memory; None for that of a file.
    """

    path: Path | None
    kind: Kind
    use: Use
    name: str
    place: str
    modes: tuple[str | int, ...] = ()
    response: ResponseSettings = field(default_factory=ResponseSettings)
    force: ForceSettings | None = None
    variable: str | None = None
    sampling_rate: float | None = None
    index: tuple[int, ...] | None = None
    levels: tuple[float, ...] | None = None
    joint: str | None = None
    channels: tuple[str, ...] = ()
    start: float | None = None
    end: float | None = None
    initial: Initial | None = None
    places: Mapping[str, str] = field(default_factory=dict)
    data: Data | None = None
