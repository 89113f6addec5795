"""What every result can do, and how a solve ended."""

import dataclasses
import enum
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, Self

import equinox as eqx
import numpy as np

from iwanjax.errors import InputError
from iwanjax.files.trees import read_tree, write_tree
from iwanjax.tables import Block, as_html, as_text, without_empty_columns

_UNITS = {
    "frequency": "Hz",
    "damping": "1",
    "omega": "rad/s",
    "time": "s",
    "duration": "s",
    "edges": "s",
    "band": "Hz",
    "sampling_rate": "Hz",
}
"""Units of fields that mean the same in every result."""

_COLUMNS = ("", "value", "deviation", "unit", "size")


class AbstractResult:
    """A result of the package: a frozen dataclass, or an equinox module, of what was found.

    A class gets :meth:`summary`, a table in notebooks, :meth:`to_dict`, :meth:`save` and
    :meth:`load` by having this base. What it shows is every field with ``repr``, unless it names
    others in ``_shown`` (fields or properties) or says it in words by ``_blocks``. Units that
    ``_UNITS`` does not know stand in ``_units``, or come from ``_unit`` where they differ from
    object to object.
    """

    _shown: ClassVar[tuple[str, ...]] = ()
    _units: ClassVar[Mapping[str, str]] = {}

    def summary(self) -> str:
        """The result in words and numbers, as text.

        Returns
        -------
        str
            A line for each quantity: value, or range and shape of an array; its standard
            deviation (the median of an array's) where it is known; unit.
        """
        return as_text(self._blocks())

    def _repr_html_(self) -> str:
        """The same as a table, for notebooks."""
        return as_html(self._blocks())

    def to_dict(self) -> dict[str, Any]:
        """The result's fields by name, without the package's own types.

        Returns
        -------
        dict
            Arrays are NumPy's, results within results dictionaries; models and fitted problems
            are left out. ``json.dumps(..., default=np.ndarray.tolist)`` writes it.
        """
        return _fields_by_name(self)

    def save(self, path: str | Path) -> Path:
        """Save all of it, its models included, as ``.npz``: whole or not at all.

        Parameters
        ----------
        path : str or Path
            What stands there is replaced.

        Returns
        -------
        Path

        Raises
        ------
        InputError
            For a path that does not end in ``.npz`` or cannot be written, and for what no file
            can hold, such as a joint whose class was defined in a function.
        """
        return write_tree(path, self)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Load what :meth:`save` wrote; nothing in the file is executed.

        Parameters
        ----------
        path : str or Path
            The file. Where it holds a joint of your own, import its module first.

        Returns
        -------
        AbstractResult
            Of the class it is asked of.

        Raises
        ------
        InputError
            For a file that is missing, damaged, not a result, or a result of another class.
        """
        found = read_tree(path)
        if not isinstance(found, cls):
            raise InputError(f"{path}: holds a {type(found).__name__}; expected {cls.__name__}")
        return found

    def plot(self, **options: Any) -> Any:
        """The figure that suits it: :func:`iwanjax.plot` of it.

        Parameters
        ----------
        **options
            As for :func:`iwanjax.plot`.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        InputError
            For a result that has no figure.
        """
        if _draw is None:
            raise InputError("plot needs iwanjax itself: import iwanjax")
        return _draw(self, **options)

    def _unit(self, name: str) -> str:
        """Unit of a shown quantity; empty where it is none or not known."""
        return self._units.get(name, _UNITS.get(name, ""))

    def _blocks(self) -> tuple[Block, ...]:
        """What :meth:`summary` and the notebook's table say."""
        name = getattr(self, "name", "")
        head = type(self).__name__ + (f": {name}" if name and isinstance(name, str) else "")
        return head, without_empty_columns(_COLUMNS, self._rows())

    def _rows(self) -> Iterator[tuple[str, ...]]:
        """Cells of each shown quantity."""
        names = self._shown or tuple(f.name for f in _fields(self) if f.repr and f.name != "name")
        for name in names:
            value = getattr(self, name)
            unknown = value is None or (isinstance(value, str | tuple) and not value)
            # A deviation stands beside what it is the deviation of.
            if unknown or name.removesuffix("_std") in set(names) - {name}:
                continue
            if isinstance(value, AbstractResult):
                yield from ((f"{name}.{first}", *rest) for first, *rest in value._rows())
            elif (items := _named_values(value)) is not None:
                yield from ((f"{name}: {k}", *_cells(v, None), "", "") for k, v in items.items())
            else:
                shown, deviation = _cells(value, getattr(self, f"{name}_std", None))
                yield name, shown, deviation, self._unit(name), _size(value)


_draw: Callable[..., Any] | None = None
# Figures are above this layer, so the package says how to make them: draw_with.


def draw_with(draw: Callable[..., Any]) -> None:
    """Say what draws results: the package itself does, when it is imported."""
    global _draw
    _draw = draw


def with_std(value: float, std: float) -> str:
    """A value to the digits its deviation leaves."""
    if not np.isfinite(std) or std <= 0 or not np.isfinite(value):
        return f"{value:.6g}"
    if std >= abs(value):
        return f"{value:.2g} ± {std:.2g}"
    digits = int(np.clip(np.floor(np.log10(abs(value))) - np.floor(np.log10(std)) + 2, 2, 12))
    return f"{value:.{digits}g} ± {std:.2g}"


_NOT_PLAIN = object()


def _fields(result: Any) -> tuple[dataclasses.Field[Any], ...]:
    return dataclasses.fields(result)


def _fields_by_name(result: Any) -> dict[str, Any]:
    found = {f.name: _plain(getattr(result, f.name)) for f in _fields(result)}
    return {name: value for name, value in found.items() if value is not _NOT_PLAIN}


def _plain(value: Any) -> Any:
    """A value without the package's types; ``_NOT_PLAIN`` for a model."""
    if isinstance(value, enum.Enum):
        return value.name.lower()
    if value is None or isinstance(value, bool | int | float | complex | str):
        return value
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "__array__"):
        array = np.asarray(value)
        return array if array.ndim else array.item()
    items = _named_values(value)
    if items is not None:
        found = {str(key): _plain(each) for key, each in items.items()}
        return {key: each for key, each in found.items() if each is not _NOT_PLAIN}
    if isinstance(value, tuple | list):
        return [each for each in map(_plain, value) if each is not _NOT_PLAIN]
    # What is found is a dataclass; what computes is an equinox module.
    model = isinstance(value, eqx.Module) and not isinstance(value, AbstractResult)
    if dataclasses.is_dataclass(value) and not model:
        return _fields_by_name(value)
    return _NOT_PLAIN


def _named_values(value: Any) -> Mapping[Any, Any] | None:
    """Items of a dictionary or a named tuple; None for anything else."""
    if hasattr(value, "_asdict"):
        return value._asdict()
    return value if isinstance(value, Mapping) else None


def _cells(value: Any, std: Any) -> tuple[str, str]:
    """A value and its deviation, in a few characters each."""
    if isinstance(value, bool | np.bool_):
        return ("yes" if value else "no"), ""
    if isinstance(value, enum.Enum | str | Path):
        return str(getattr(value, "name", value)), ""
    if isinstance(value, tuple | list):
        return _listed(value), ""
    if not (hasattr(value, "__array__") or isinstance(value, int | float | complex)):
        return type(value).__name__, ""
    array = np.asarray(value)
    if array.size == 0:
        return "none", ""
    deviation = "" if std is None else f"{np.nanmedian(np.asarray(std)):.2g}"
    if array.dtype.kind == "b":
        return f"{np.count_nonzero(array)} of {array.size}", ""
    if array.dtype.kind == "c":
        array = np.abs(array)
    finite = array[np.isfinite(array)]
    if finite.size == 0:
        return "nan", deviation
    if array.ndim == 0:
        return f"{float(array):.6g}", deviation
    missing = f", {array.size - finite.size} nan" if finite.size < array.size else ""
    return f"{finite.min():.5g} to {finite.max():.5g}{missing}", deviation


def _listed(values: tuple[Any, ...] | list[Any]) -> str:
    """A short row as it is, a row of objects by their number."""
    if all(isinstance(each, str | int | float) for each in values):
        shown = [each if isinstance(each, str) else f"{each:.6g}" for each in values]
        return ", ".join(shown)
    return f"{len(values)} {type(values[0]).__name__}"


def _size(value: Any) -> str:
    """Shape of an array, for instance ``3 x 40``; empty for a number."""
    return " x ".join(map(str, np.shape(value))) if hasattr(value, "__array__") else ""


class Result(enum.IntEnum):
    """Outcome of one solve; results that are not ``CONVERGED`` come with NaN values.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> solution = ij.qsma(ij.three_mass(), 0, np.geomspace(1e-2, 1.0, 5), 1e-4)
    >>> bool((solution.result == ij.Result.CONVERGED).all())
    True
    >>> ij.Result.NO_EQUILIBRIUM.message
    'no static equilibrium: every joint that could carry this load slips; lower alpha'
    """

    CONVERGED = 0
    EXHAUSTED = 1
    NO_EQUILIBRIUM = 2
    LOST_MODE = 3

    @property
    def message(self) -> str:
        """What happened and what to try."""
        return _MESSAGES[self]


_MESSAGES = {
    Result.CONVERGED: "converged",
    Result.EXHAUSTED: (
        "the iteration limit was reached before the tolerance; try closer load levels, or an "
        "element whose force does not fall with growing deflection"
    ),
    Result.NO_EQUILIBRIUM: (
        "no static equilibrium: every joint that could carry this load slips; lower alpha"
    ),
    Result.LOST_MODE: (
        "the joints' stiffness is so far from the structure's reference that the mode cannot be "
        "told from others (modal assurance below 1/2); build the structure with joints closer to it"
    ),
}
