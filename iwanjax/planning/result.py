"""What a plan of recordings would find."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from iwanjax.results import AbstractResult
from iwanjax.tables import Block, without_empty_columns


class SmallestSize(NamedTuple):
    """The smallest effect of a kind at a place that the plan finds.

    Attributes
    ----------
    kind, where : str
        As in a diagnosis.
    name, unit : str
        Of the effect's size.
    found, named : float
        Sizes from which it is found, and from which it is told from every other effect, in nine of
        ten repetitions; infinite where it is not.
    shape_name, shape_unit : str
        Of a second parameter; empty without one.
    shape : float
        At which of its values the effect shows most.
    force : float
        Root-mean-square of its force at the size found, in the recording where that is largest;
        NaN for faults of channels.
    rival : str
        kind@where that is hardest to tell from it, and which form of it.
    variant : str
        Which of several forms of the kind, in words; empty for the plain one.
    """

    kind: str
    where: str
    name: str
    unit: str
    found: float
    named: float
    shape_name: str
    shape_unit: str
    shape: float
    force: float
    rival: str
    variant: str

    @property
    def label(self) -> str:
        """kind@where."""
        return f"{self.kind}@{self.where}"


class AlikePair(NamedTuple):
    """Two effects that the plan does not tell apart at twice the smallest size found.

    Attributes
    ----------
    first, second : str
        kind@where, and which form of it: what acts, and what it would be taken for.
    found, apart : float
        Sizes of the first from which it is found, and from which it is told from the second.
    decides : str
        The added measurement that brings the latter down most; empty where none does by a tenth.
    factor : float
        Times that it brings it down by.
    """

    first: str
    second: str
    found: float
    apart: float
    decides: str
    factor: float


class AddedMeasurement(NamedTuple):
    """A hit or a sensor that might be added.

    Attributes
    ----------
    label : str
        In words.
    kind : str
        hit or sensor.
    found, named : float
        Geometric mean, over all effects, of the sizes found, and told from others, with it over
        those without: below 1.
    """

    label: str
    kind: str
    found: float
    named: float


@dataclass(frozen=True, eq=False)
class Detectability(AbstractResult):
    """What a plan of recordings finds, what it cannot tell apart, and what to add to it.

    Attributes
    ----------
    name : str
        Of the study.
    smallest : tuple of SmallestSize
        Of each form of each kind at each place, by places.
    alike : tuple of AlikePair
        The hardest first.
    added : tuple of AddedMeasurement
        The most useful first.
    not_judged : tuple of str
        Kinds that have no smallest size: signs, limits and what drifts.
    power : float
        Share of repetitions in which sizes are found.
    warnings : tuple of str
        What to know of them.
    """

    name: str
    smallest: tuple[SmallestSize, ...]
    alike: tuple[AlikePair, ...]
    added: tuple[AddedMeasurement, ...]
    not_judged: tuple[str, ...]
    power: float
    warnings: tuple[str, ...]

    def of(self, kind: str, where: str, variant: str = "") -> SmallestSize:
        """The smallest size of a form of a kind at a place."""
        sought = kind, where, variant
        found = [e for e in self.smallest if (e.kind, e.where, e.variant) == sought]
        if not found:
            raise KeyError(f"{kind}@{where} {variant}".rstrip())
        return found[0]

    def _blocks(self) -> tuple[Block, ...]:
        head = ("", "found from", "told from others from", "force, rms")
        blocks: list[Block] = [f"Detectability: {self.name}"]
        blocks.append(without_empty_columns(head, self._sizes()))
        if self.alike:
            head = ("what acts", "taken for", "found from", "told apart from", "decided by")
            blocks.append("Not told apart at twice the size found")
            blocks.append(without_empty_columns(head, self._pairs()))
        if self.added:
            head = ("added", "sizes found, times", "told apart, times")
            rows = [(a.label, f"{a.found:.2f}", f"{a.named:.2f}") for a in self.added]
            blocks.append(without_empty_columns(head, rows))
        return (*blocks, *self.warnings)

    def _sizes(self) -> Iterator[tuple[str, ...]]:
        for each in self.smallest:
            at = f" at {each.shape_name} = {each.shape:.3g} {each.shape_unit}" * bool(
                each.shape_name
            )
            force = "" if math.isnan(each.force) else f"{each.force:.2g}"
            yield (
                f"{each.label}, {each.variant}" if each.variant else each.label,
                f"{_sized(each.found, each)}{at}",
                f"{_sized(each.named, each)} ({each.rival})" if each.rival else "",
                force,
            )

    def _pairs(self) -> Iterator[tuple[str, ...]]:
        for pair in self.alike:
            helps = f"{pair.decides} ({pair.factor:.1f} times smaller)" if pair.decides else "none"
            apart = f"{pair.apart:.3g}" if math.isfinite(pair.apart) else "never"
            yield pair.first, pair.second, f"{pair.found:.3g}", apart, helps


def _sized(size: float, each: SmallestSize) -> str:
    return f"{each.name} = {size:.3g} {each.unit}" if math.isfinite(size) else "never"
