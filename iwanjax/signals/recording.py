"""One measurement: the responses of several channels, and the forces, on one time axis."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from iwanjax.errors import InputError
from iwanjax.files import nearest
from iwanjax.results import AbstractResult
from iwanjax.signals.clipping import clipped_samples
from iwanjax.tables import Block, Grid
from iwanjax.types import ArrayLike

QUANTITIES = ("acceleration", "velocity", "displacement", "force", "")
"""What a channel may measure; empty when it is not known."""

FEWEST_SAMPLES = 16
"""Fewer samples than this hold no vibration."""
JITTER = 1e-2
"""How far a sample may be from a uniform grid, in steps: rounded times reach some 1e-3, and
1e-2 turns the phase by 0.03 rad at most, at half the sampling rate."""


@dataclass(frozen=True)
class Channel:
    """What one column of a recording measures.

    Attributes
    ----------
    name : str
        Unique in its recording.
    quantity : str
        ``"acceleration"``, ``"velocity"``, ``"displacement"``, ``"force"``, or empty.
    unit : str
        For labels; never converted.
    direction : str
        For labels, for instance ``"+x"``.

    Raises
    ------
    InputError
        For an empty name or an unknown quantity.
    """

    name: str
    quantity: str = ""
    unit: str = ""
    direction: str = ""

    def __post_init__(self):
        if not self.name:
            raise InputError("a channel has no name; expected text")
        if self.quantity not in QUANTITIES:
            known = ", ".join(filter(None, QUANTITIES))
            raise InputError(
                f"channel {self.name!r}: quantity {self.quantity!r} is unknown; expected {known} "
                f"or nothing{nearest(self.quantity, QUANTITIES)}"
            )


@dataclass(frozen=True, eq=False)
class Recording(AbstractResult):
    """Responses and forces, sampled uniformly.

    Attributes
    ----------
    time : (N,) array
        s, uniform to 1e-2 of a step; it may start anywhere.
    response : (N, s) array
        One column per channel, in its unit.
    channels : tuple of s Channel
        What the columns of ``response`` are.
    force : (N, i) array or None
        Measured forces; None where there are none, as in a free decay.
    inputs : tuple of i Channel
        What the columns of ``force`` are.
    name : str
        For messages, for instance ``"hits.mat[3]"``.
    metadata : dict of str to str
        What the file says besides: date, operator, rig.

    The arrays are float64 and read-only.

    Raises
    ------
    InputError
        One line naming the recording and the channel: shapes that do not match, fewer than
        16 samples, NaN or infinity, a time that does not increase or is not uniform,
        channels of one name, a response that never changes or a force that is constant but
        not zero, as sensors are that are not connected.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> t = np.arange(1024) / 1024
    >>> hit = ij.as_recording(np.exp(-t) * np.sin(300 * t), sampling_rate=1024, sensors="tip")
    >>> type(hit).__name__, hit.response.shape, hit.sampling_rate
    ('Recording', (1024, 1), 1024.0)
    """

    time: np.ndarray
    response: np.ndarray
    channels: tuple[Channel, ...]
    force: np.ndarray | None = None
    inputs: tuple[Channel, ...] = ()
    name: str = "recording"
    metadata: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self):
        try:
            self._check()
        except InputError as error:
            raise InputError(f"{self.name}: {error}") from None

    def _blocks(self) -> tuple[Block, ...]:
        columns = [*zip(self.channels, self.response.T, strict=True)]
        if self.force is not None:
            columns += zip(self.inputs, self.force.T, strict=True)
        return (
            f"{self.name}: {self.size} samples, {self.sampling_rate:.6g} Hz, {self.duration:.6g} s",
            Grid(
                ("channel", "measures", "unit", "min", "max", "rms"),
                tuple(
                    (
                        channel.name,
                        channel.quantity or "-",
                        channel.unit or "-",
                        f"{x.min():.4g}",
                        f"{x.max():.4g}",
                        f"{np.sqrt(np.mean(x**2)):.4g}",
                    )
                    for channel, x in columns
                ),
            ),
        )

    @property
    def size(self) -> int:
        """Number of samples N."""
        return len(self.time)

    @property
    def sampling_rate(self) -> float:
        """Samples per second, Hz."""
        return sampling_rate(self.time)

    @property
    def duration(self) -> float:
        """Time of all samples, each lasting one step, s."""
        return self.size / self.sampling_rate

    @property
    def clipped(self) -> dict[str, int]:
        """Names of the channels that rest at their extremes, and for how many samples."""
        counts = {name: clipped_samples(self.channel(name)) for name in self.names}
        return {name: count for name, count in counts.items() if count}

    def channel(self, name: str) -> np.ndarray:
        """One channel, a response or a force.

        Parameters
        ----------
        name : str
            Of one of ``channels`` or ``inputs``.

        Returns
        -------
        (N,) array

        Raises
        ------
        InputError
            For an unknown name, with the known ones.
        """
        names = self.names
        if name not in names:
            raise InputError(
                f"{self.name}: no channel {name!r}; expected one of {', '.join(names)}"
                f"{nearest(name, names)}"
            )
        column = names.index(name)
        if column < len(self.channels):
            return self.response[:, column]
        assert self.force is not None
        return self.force[:, column - len(self.channels)]

    @property
    def names(self) -> list[str]:
        """Of the channels, then of the inputs."""
        return [channel.name for channel in (*self.channels, *self.inputs)]

    def _check(self) -> None:
        time = self._array("time", self.time)
        check_time(time)
        N = len(time)
        self._set(time=time, channels=tuple(self.channels), inputs=tuple(self.inputs))
        self._set(response=self._columns("response", self.response, self.channels, N))
        if self.force is not None:
            self._set(force=self._columns("force", self.force, self.inputs, N))
        elif self.inputs:
            raise InputError(f"{len(self.inputs)} inputs are named but there is no force")
        if not self.channels:
            raise InputError("response has no channels; expected at least one")
        if repeated := [name for name, n in Counter(self.names).items() if n > 1]:
            raise InputError(f"{repeated[0]!r} names two channels; names must be unique")
        for channel in self.channels:
            self._check_channel(channel, zero_is_fine=False)
        for channel in self.inputs:
            # Of several places to hit, a test drives one: the others' force is zero.
            self._check_channel(channel, zero_is_fine=True)

    def _set(self, **values: object) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _array(self, name: str, value: ArrayLike) -> np.ndarray:
        try:
            array = np.array(value)  # a copy, so that no one changes it from outside
        except ValueError as error:
            raise InputError(f"{name}: {error}; expected a rectangular array") from None
        if array.dtype.kind not in "biuf":
            raise InputError(f"{name} is of type {array.dtype}; expected real numbers")
        array = array.astype(np.float64, copy=False)
        array.flags.writeable = False
        return array

    def _columns(
        self, name: str, value: ArrayLike, channels: tuple[Channel, ...], samples: int
    ) -> np.ndarray:
        array = self._array(name, value)
        if array.ndim == 1:
            array = array[:, None]
        if array.shape != (samples, len(channels)):
            raise InputError(
                f"{name} has shape {array.shape}; expected {(samples, len(channels))}: one row for "
                f"each time, one column for each of its {len(channels)} channels"
            )
        return array

    def _check_channel(self, channel: Channel, zero_is_fine: bool) -> None:
        x = self.channel(channel.name)
        bad = np.flatnonzero(~np.isfinite(x))
        if bad.size:
            raise InputError(
                f"channel {channel.name!r} holds {bad.size} NaN or infinite value(s), the first "
                f"at index {bad[0]} (t = {self.time[bad[0]]:.6g} s); cut them off, or leave the "
                "channel out"
            )
        if np.ptp(x) == 0.0 and not (zero_is_fine and x[0] == 0.0):
            raise InputError(
                f"channel {channel.name!r} is {x[0]:g} throughout; is the sensor connected? leave "
                "the channel out"
            )


def sampling_rate(time: np.ndarray) -> float:
    """Mean samples per second of a time axis (N,), Hz."""
    return float((len(time) - 1) / (time[-1] - time[0]))


def check_time(time: np.ndarray) -> None:
    """Refuse a time axis that signal processing cannot use.

    Parameters
    ----------
    time : (N,) array
        s.

    Raises
    ------
    InputError
        When it is no vector, too short, not finite, does not increase or is not uniform.
    """
    if time.ndim != 1:
        raise InputError(f"time has shape {time.shape}; expected (N,)")
    if len(time) < FEWEST_SAMPLES:
        raise InputError(f"time has {len(time)} samples; expected at least {FEWEST_SAMPLES}")
    bad = np.flatnonzero(~np.isfinite(time))
    if bad.size:
        raise InputError(
            f"time holds {bad.size} NaN or infinite value(s), the first at index {bad[0]}"
        )
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if back.size:
        i = int(back[0]) + 1
        raise InputError(
            f"time does not increase at index {i}: {time[i]:.9g} s follows {time[i - 1]:.9g} s; "
            "are two recordings joined, or the digits too few? give sampling_rate instead of time"
        )
    jitter = np.abs(_off_grid(time))
    if np.max(jitter) > JITTER:
        i = int(np.argmax(jitter))
        raise InputError(
            f"time is not uniform: sample {i} ({time[i]:.9g} s) is {jitter[i]:.2g} steps off a "
            f"grid of {sampling_rate(time):.6g} Hz, allowed is {JITTER:g}; resample it, or give "
            "sampling_rate if the times were only rounded"
        )


def _off_grid(time: np.ndarray) -> np.ndarray:
    """How far each sample is from where it would be between the first and last, in steps."""
    return (time - time[0]) * sampling_rate(time) - np.arange(len(time))
