"""Results of a study: one for each of its modes, joints or cases."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from iwanjax.errors import InputError
from iwanjax.files import nearest
from iwanjax.results import AbstractResult
from iwanjax.tables import Block

T = TypeVar("T")


@dataclass(frozen=True, eq=False, repr=False)
class StudyResults(AbstractResult, Mapping[str, T], Generic[T]):
    """What a method of a study returns: its results by name, in the study's order.

    Attributes
    ----------
    by_name : mapping of str to result
        Names are those of single modes, ``"mode 0"`` for a structure's, joints for their loops,
        cases of a simulation; the study's own for its structure.
    seconds : mapping of str to float
        What each took, compilation included, where that was measured.

    Examples
    --------
    >>> from iwanjax.studies import StudyResults
    >>> results = StudyResults({"mode1": 118.0})
    >>> results["mode1"], results.only, list(results)
    (118.0, 118.0, ['mode1'])
    """

    by_name: Mapping[str, T]
    seconds: Mapping[str, float] = field(default_factory=dict)

    def __getitem__(self, name: str) -> T:
        """One result.

        Raises
        ------
        InputError
            For an unknown name, with the known ones.
        """
        if name not in self.by_name:
            raise InputError(
                f"no result {name!r}; expected one of {', '.join(self.by_name)}"
                f"{nearest(str(name), self.by_name)}"
            )
        return self.by_name[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.by_name)

    def __len__(self) -> int:
        return len(self.by_name)

    def __contains__(self, name: object) -> bool:
        return name in self.by_name

    def get(self, name: str, default: Any = None) -> Any:
        """One result, or the default for an unknown name."""
        return self.by_name.get(name, default)

    @property
    def only(self) -> T:
        """The result of a study that has one.

        Raises
        ------
        InputError
            Where there are several, with their names.
        """
        if len(self.by_name) != 1:
            raise InputError(f"there are {len(self)} results: {', '.join(self)}; take one by name")
        return next(iter(self.by_name.values()))

    def _blocks(self) -> tuple[Block, ...]:
        return tuple(block for name, each in self.items() for block in _blocks_of(name, each))

    def __repr__(self) -> str:
        kinds = ", ".join(f"{name}: {type(each).__name__}" for name, each in self.by_name.items())
        return f"StudyResults({kinds})"


def _blocks_of(name: str, result: Any) -> tuple[Block, ...]:
    """A result's summary, under its name."""
    if isinstance(result, AbstractResult):
        return under_name(name, result._blocks())
    statement = getattr(result, "statement", None)
    return under_name(name, (repr(result) if statement is None else statement(),))


def under_name(name: str, blocks: tuple[Block, ...]) -> tuple[Block, ...]:
    """Blocks of which the first begins with a name."""
    first, *others = blocks
    if not isinstance(first, str):
        return f"{name}:", *blocks
    return first if first.startswith(f"{name}:") else f"{name}: {first}", *others
