"""What the parts of a study call each other by."""

from collections.abc import Iterable
from dataclasses import dataclass

from iwanjax.config.faults import one_of
from iwanjax.config.source import Place, Source


@dataclass(frozen=True)
class Names:
    """Names that a study's model gives to the other sections.

    Attributes
    ----------
    modal : tuple of str
        Modes of a study without structure; empty for a structure.
    elastic : int
        Number of a structure's elastic modes.
    chosen : tuple of int or None
        Those of them that the study is about; None for all.
    joints : tuple of str
        Labels of a structure's joints.
    sensors, inputs : tuple of str or None
        Labels of a model file; None where any label goes.
    """

    modal: tuple[str, ...] = ()
    elastic: int = 0
    chosen: tuple[int, ...] | None = None
    joints: tuple[str, ...] = ()
    sensors: tuple[str, ...] | None = None
    inputs: tuple[str, ...] | None = None

    @property
    def modes(self) -> tuple[str | int, ...]:
        """All modes that the study is about, by name or by index."""
        if self.modal:
            return self.modal
        return tuple(range(self.elastic)) if self.chosen is None else self.chosen

    def mode(self, source: Source, place: Place, given: str) -> str | int:
        """One of :attr:`modes`, as a file names it."""
        if self.modal:
            return known(source, place, given, self.modal, "mode")
        mode = self.index(source, place, given)
        if self.chosen is not None and mode not in self.chosen:
            raise source.error(place, f"got {mode}; the study's modes are {list(self.chosen)}")
        return mode

    def index(self, source: Source, place: Place, given: str | int) -> int:
        """The index of an elastic mode."""
        text = str(given)
        if not (text.isascii() and text.isdigit()) or int(text) >= self.elastic:
            raise source.error(
                place,
                f"got {text}; expected 0 to {self.elastic - 1}: the structure has {self.elastic} "
                "elastic mode(s), counted from 0, lowest first",
            )
        return int(text)


def known(source: Source, place: Place, name: str, names: Iterable[str] | None, what: str) -> str:
    """The name, if it is one of ``names`` or these are not known."""
    if names is not None and name not in names:
        raise source.error(place, f"the model has no {what} {name!r}; {one_of(name, names)}")
    return name


def once(source: Source, place: Place, names: Iterable[str | float]) -> None:
    """Refuse a list that holds something twice."""
    seen: set[str | float] = set()
    for i, name in enumerate(names):
        if name in seen:
            told = f"{name:g}" if isinstance(name, float) else name
            raise source.error((*place, i), f"got {told} again; expected each once")
        seen.add(name)
