"""Force against deflection of a joint on its own, driven slowly."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from iwanjax.errors import InputError
from iwanjax.files import nearest
from iwanjax.results import AbstractResult
from iwanjax.signals.file_record import FileRecord
from iwanjax.signals.formats import read_file
from iwanjax.signals.labels import rate_beside
from iwanjax.signals.recording import check_time
from iwanjax.signals.recording import sampling_rate as measured_rate
from iwanjax.types import ArrayLike

_FEWEST = 8
# Median magnitude of a normal value, in deviations, and what a second difference adds of noise.
_MEDIAN, _SECOND = 0.6745, math.sqrt(6.0)
# Share of the largest deflection within which a loop may begin at rest, and by which the ends of
# runs differ that are alike.
_AT_REST = 0.02


@dataclass(frozen=True, eq=False)
class ForceLoop(AbstractResult):
    """What a test rig shows of a joint: deflection and force, value by value.

    Parameters
    ----------
    d, force : (N,) array_like
        Deflection (length) and force, in the order they were run through, monotonic between
        two values.
    name : str
        Label.
    dt : float, optional
        Time between two values, s; without it nothing can depend on rate.
    unit, force_unit : str
        Labels of deflection and force; values are never converted.
    channels : mapping of str to (N,) array_like or float, optional
        What else was recorded and the joint may depend on, by name: a temperature, a voltage, a
        bolt's or a normal force, in any unit; one number where it was the same throughout.

    Raises
    ------
    InputError
        For other shapes, fewer than 8 values, values that are not finite, a deflection or a
        force that never changes, a time step that is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> d = np.concatenate([np.linspace(0, 2, 20), np.linspace(2, -2, 40), np.linspace(-2, 2, 40)])
    >>> loop = ij.ForceLoop(d, ij.hysteresis(ij.Jenkins(F_S=1.0, K_T=1.0), d), name="J1, 2 mm")
    >>> loop.d.shape, float(np.max(loop.force))
    ((100,), 1.0)
    >>> hot = ij.ForceLoop(loop.d, loop.force, channels={"temperature_c": 60.0})
    >>> hot.channels["temperature_c"].shape
    (100,)
    """

    d: np.ndarray
    force: np.ndarray
    name: str = ""
    dt: float | None = None
    unit: str = ""
    force_unit: str = ""
    channels: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __init__(
        self,
        d: ArrayLike,
        force: ArrayLike,
        name: str = "",
        dt: float | None = None,
        unit: str = "",
        force_unit: str = "",
        channels: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        object.__setattr__(self, "d", _history(d, "displacement"))
        object.__setattr__(self, "force", _history(force, "force"))
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "dt", dt)
        object.__setattr__(self, "unit", unit)
        object.__setattr__(self, "force_unit", force_unit)
        if dt is not None and not 0.0 < dt < math.inf:
            raise InputError(f"dt is {dt!r}; expected a positive number of seconds")
        if self.d.shape != self.force.shape:
            raise InputError(
                f"displacement has {self.d.size} values and force {self.force.size}; expected as "
                "many of both"
            )
        beside = {key: _beside(x, key, self.d.size) for key, x in (channels or {}).items()}
        object.__setattr__(self, "channels", beside)

    @property
    def duration(self) -> float:
        """From the first value to the last, s; NaN without a time step."""
        return math.nan if self.dt is None else (self.d.size - 1) * self.dt

    @property
    def period(self) -> float:
        """Time of a cycle, mean over those that take 2 % of the stroke at least; NaN likewise."""
        ends = self._ends()
        return 2.0 * self.duration / max(len(ends) - 1, 1)

    @property
    def noise(self) -> float:
        r"""Standard deviation of the force, :math:`\mathrm{med}|\Delta^2 F| / (0.67\sqrt{6})`.

        By second differences, whose median a few reversals do not change; too large where the
        force bends from value to value.
        """
        return float(np.median(np.abs(np.diff(self.force, 2)))) / (_MEDIAN * _SECOND)

    @property
    def scatter(self) -> float:
        r"""Standard deviation of the force between cycles, at equal deflection on equal branches.

        Of each run between two reversals the force is taken at common deflections; runs of one
        direction between like ends, within 2 % of the stroke, are compared with their mean, or
        where there are further channels with a straight line in them: what follows these is no
        scatter. NaN where no two runs are alike.
        """
        ends = self._ends()
        held = (self.force, *self.channels.values())
        runs: dict[bool, list[list[np.ndarray]]] = {True: [], False: []}
        low, high = (1.0 - _AT_REST) * self.d.min(), (1.0 - _AT_REST) * self.d.max()
        at = np.linspace(low, high, _FEWEST * _FEWEST)
        for a, b in itertools.pairwise(ends):
            x = self.d[a : b + 1]
            if min(x[0], x[-1]) > low or max(x[0], x[-1]) < high:
                continue
            order = np.argsort(x, kind="stable")
            some = [np.interp(at, x[order], y[a : b + 1][order]) for y in held]
            runs[bool(x[-1] > x[0])].append(some)
        parts = [_off_a_line(np.array(each)) for each in runs.values() if len(each) > 1]
        freedom = sum(free for _, free in parts)
        return math.sqrt(sum(squares for squares, _ in parts) / freedom) if freedom else math.nan

    @property
    def may_begin_at_rest(self) -> bool:
        """Whether it begins undeflected; what a load cell shows then may be its own zero."""
        return abs(self.d[0]) <= _AT_REST * float(np.abs(self.d).max())

    def _ends(self) -> list[int]:
        """Where its runs begin and end."""
        turns = np.flatnonzero(np.diff(np.sign(np.diff(self.d))) != 0) + 1
        return _outermost(self.d, turns, _AT_REST * float(np.ptp(self.d)))

    def before(self, at_rest: bool) -> np.ndarray:
        """(2,) deflections that lead from rest to where it begins.

        None, if it begins at rest as it may; else through the largest ones, so that it begins
        on the outermost loop, on the branch that it goes on along.
        """
        if at_rest and self.may_begin_at_rest:
            return np.zeros(2)
        ends = np.array([self.d.max(), self.d.min()])
        moved = self.d[np.argmax(self.d != self.d[0])] - self.d[0]
        return ends if moved > 0 else ends[::-1]


def _off_a_line(runs: np.ndarray) -> tuple[float, int]:
    """Squares of forces less their mean and what follows channels linearly, and how many are free.

    Parameters
    ----------
    runs : (runs, 1 + channels, deflections) array
        The force, then the channels.
    """
    force, channels = runs[:, 0].T[:, :, None], runs[:, 1:].transpose(2, 0, 1)
    channels = channels - channels.mean(axis=1, keepdims=True)
    size = np.abs(runs[:, 1:]).max(axis=(0, 2))
    base = np.concatenate([np.ones_like(force), channels / np.where(size > 0.0, size, 1.0)], axis=2)
    hat = base @ np.linalg.pinv(base)
    free = force.size - round(float(np.trace(hat, axis1=1, axis2=2).sum()))
    return float(np.sum((force - hat @ force) ** 2)) if free else 0.0, free


def _outermost(d: np.ndarray, turns: np.ndarray, least: float) -> list[int]:
    """Turning points, first and last value included, less those whose swing is small."""
    ends = [0]
    for at in (*turns.tolist(), d.size - 1):
        before = d[ends[-2]] if len(ends) > 1 else None
        goes_on = before is not None and (d[ends[-1]] - before) * (d[at] - d[ends[-1]]) > 0
        if goes_on:
            ends[-1] = at
        elif abs(d[at] - d[ends[-1]]) >= least:
            ends.append(at)
    return ends


def _history(values: ArrayLike, name: str) -> np.ndarray:
    x = np.array(values, float)
    if x.ndim != 1 or x.size < _FEWEST:
        raise InputError(f"{name} has shape {x.shape}; expected (N,) with at least {_FEWEST}")
    if not np.all(np.isfinite(x)):
        first = int(np.argmin(np.isfinite(x)))
        raise InputError(f"{name} holds NaN or infinity, first at value {first}, counted from 0")
    if np.ptp(x) == 0.0:
        raise InputError(f"{name} is {x[0]:g} throughout; expected a loop")
    return x


def _beside(values: ArrayLike, name: str, count: int) -> np.ndarray:
    """A further channel, one value for each of the loop's."""
    try:
        x = np.array(values, float)
    except (TypeError, ValueError):
        raise InputError(f"channel {name} holds no real numbers") from None
    if x.size == 1:
        x = np.full(count, x.item())
    if x.shape != (count,):
        raise InputError(
            f"channel {name} has shape {x.shape}; expected one value, or {count} as displacement "
            "and force have: was it recorded at another rate?"
        )
    if not np.all(np.isfinite(x)):
        first = int(np.argmin(np.isfinite(x)))
        raise InputError(
            f"channel {name} holds NaN or infinity, first at value {first}, counted from 0; "
            "expected a number at every value: fill the gap, or leave the channel out"
        )
    return x


def common_channels(loops: Sequence[ForceLoop], places: Sequence[str] = ()) -> tuple[str, ...]:
    """Names of the further channels, which all loops of a joint have to have.

    Parameters
    ----------
    loops : sequence of ForceLoop
        Of one joint.
    places : sequence of str, optional
        What messages call each; by default its name.

    Raises
    ------
    InputError
        Where one loop has a channel that another has not.
    """
    called = places or [each.name or f"loop {i}" for i, each in enumerate(loops)]
    found = {
        name: place for each, place in zip(loops, called, strict=True) for name in each.channels
    }
    for each, place in zip(loops, called, strict=True):
        for name, holder in found.items():
            if name not in each.channels:
                own = ", ".join(each.channels) or "none"
                raise InputError(
                    f"{place}: channels: {name} is missing, which {holder} has; got {own}; "
                    "expected the same of all loops of a joint: add it here, or leave it out there"
                )
    return tuple(found)


def read_loop(
    path: str | Path,
    *,
    name: str = "",
    displacement: str = "displacement",
    force: str = "force",
    sampling_rate: float | None = None,
    unit: str = "",
    force_unit: str = "",
    channels: Sequence[str] = (),
) -> ForceLoop:
    """Read a loop from any file that :func:`iwanjax.signals.read_recordings` reads.

    Of what a file holds beside displacement and force only the channels that are named are kept:
    a second load cell or the actuator's own signals would explain any force.

    Parameters
    ----------
    path : str or Path
        A file with columns or arrays (N,): displacement and force, and perhaps time or a sampling
        rate.
    name : str
        Label; the file's own name by default.
    displacement, force : str
        What the file calls them.
    sampling_rate : float, optional
        Hz, where the file does not say and a force may depend on rate.
    unit, force_unit : str
        Labels of deflection and force.
    channels : sequence of str
        What the file calls further ones that the joint may depend on, (N,) or one number each.

    Raises
    ------
    InputError
        One line naming the file and what is missing or wrong.
    """
    path, (record, *_) = read_file(path)
    # One number for the whole loop is a remark in some formats.
    held, beside = record.arrays, {**record.arrays, **record.metadata}
    wanted = [(displacement, held), (force, held), *((each, beside) for each in channels)]
    try:
        for each, known in wanted:
            if each not in known:
                found = ", ".join(known) or "nothing"
                raise InputError(f"{each} is missing; found {found}{nearest(each, known)}")
        d, f = (_numbers(held[each], each) for each in (displacement, force))
        dt = _step(record, sampling_rate)
        further = {each: _numbers(beside[each], each) for each in channels}
        return ForceLoop(d, f, name or path.name, dt, unit, force_unit, further)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _step(record: FileRecord, sampling_rate: float | None) -> float | None:
    """Time between two values, s; None where neither the file nor anyone says it."""
    rate = sampling_rate or record.sampling_rate or rate_beside(record.arrays)
    time = record.arrays.get("time")
    if rate is None and isinstance(time, np.ndarray) and time.dtype.kind in "iuf":
        time = time.squeeze().astype(float)
        check_time(time)
        rate = measured_rate(time)
    return None if rate is None else 1.0 / rate


def _numbers(node: Any, name: str) -> np.ndarray:
    try:
        return np.asarray(node, float).squeeze()
    except (TypeError, ValueError):
        raise InputError(f"{name} holds no real numbers; expected one for each value") from None
