"""Force against deflection of a joint on its own, driven slowly."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from iwanjax.errors import InputError
from iwanjax.files import existing_file, nearest, read_arrays
from iwanjax.results import AbstractResult
from iwanjax.signals.columns import read_columns
from iwanjax.types import ArrayLike

_FEWEST = 8
_NAMES = ("displacement", "force")
# Median magnitude of a normal value, in deviations, and what a second difference adds of noise.
_MEDIAN, _SECOND = 0.6745, math.sqrt(6.0)
# Share of the largest deflection within which a loop may begin at rest.
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

    Raises
    ------
    InputError
        For other shapes, fewer than 8 values, values that are not finite, a deflection or a
        force that never changes.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> d = np.concatenate([np.linspace(0, 2, 20), np.linspace(2, -2, 40), np.linspace(-2, 2, 40)])
    >>> loop = ij.ForceLoop(d, ij.hysteresis(ij.Jenkins(F_S=1.0, K_T=1.0), d), name="J1, 2 mm")
    >>> loop.d.shape, float(np.max(loop.force))
    ((100,), 1.0)
    """

    d: np.ndarray
    force: np.ndarray
    name: str = ""

    def __init__(self, d: ArrayLike, force: ArrayLike, name: str = "") -> None:
        object.__setattr__(self, "d", _history(d, "displacement"))
        object.__setattr__(self, "force", _history(force, "force"))
        object.__setattr__(self, "name", name)
        if self.d.shape != self.force.shape:
            raise InputError(
                f"displacement has {self.d.size} values and force {self.force.size}; expected as "
                "many of both"
            )

    @property
    def noise(self) -> float:
        r"""Standard deviation of the force, :math:`\mathrm{med}|\Delta^2 F| / (0.67\sqrt{6})`.

        By second differences, whose median a few reversals do not change; too large where the
        force bends from value to value.
        """
        return float(np.median(np.abs(np.diff(self.force, 2)))) / (_MEDIAN * _SECOND)

    @property
    def may_begin_at_rest(self) -> bool:
        """Whether it begins undeflected; what a load cell shows then may be its own zero."""
        return abs(self.d[0]) <= _AT_REST * float(np.abs(self.d).max())

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


def read_loop(path: str | Path, *, name: str = "") -> ForceLoop:
    """Read a loop: JSON, CSV with a header row, ``.npz``, ``.mat`` or HDF5.

    Parameters
    ----------
    path : str or Path
        A file with columns or arrays (N,): displacement and force.
    name : str
        Label; the file's own name by default.

    Raises
    ------
    InputError
        One line naming the file and what is missing or wrong.
    """
    path = existing_file(path, [".json", ".csv"])
    try:
        held = _held(path)
        missing = [each for each in _NAMES if each not in held]
        if missing:
            raise InputError(
                f"{missing[0]} is missing; found {', '.join(held) or 'nothing'}"
                f"{nearest(missing[0], held)}"
            )
        d, force = (_numbers(held[each], each) for each in _NAMES)
        return ForceLoop(d, force, name or path.name)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _held(path: Path) -> Mapping[str, Any]:
    suffix = path.suffix.lower()
    if suffix == ".csv":
        return read_columns(path)
    if suffix != ".json":
        return read_arrays(path)
    try:
        held = json.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"is no JSON ({error}); was it cut short?") from None
    if not isinstance(held, dict):
        raise InputError("holds no object; expected {displacement: [...], force: [...]}")
    return held


def _numbers(node: Any, name: str) -> np.ndarray:
    try:
        return np.asarray(node, float).squeeze()
    except (TypeError, ValueError):
        raise InputError(f"{name} holds no real numbers; expected one for each value") from None
