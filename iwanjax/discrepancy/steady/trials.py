"""Effects of curves and loops, tried in time."""

import math
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Generic, TypeVar

from iwanjax.effects.catalogue import kinds_in_time, kinds_of
from iwanjax.effects.kinds import ChannelKind, ForceKind, JointKind, NamedKind
from iwanjax.identification.steady.fit import AnyFit, Fit, best_of
from iwanjax.identification.steady.shapes import at_a_limit
from iwanjax.joints import AbstractJoint
from iwanjax.joints.force_law import AbstractForceLaw
from iwanjax.settings.stages import settings

T = TypeVar("T")


def forces_of(hypotheses: tuple[str, ...], variants: bool) -> list[ForceKind]:
    """Forces among hypotheses, with or without those that act on one side only.

    Curves of a one-sided force are those of the two-sided one at half the size; loops differ.
    """
    forces = [kind for kind in _beside_k(hypotheses) if isinstance(kind, ForceKind)]
    return [force for force in forces if variants or not force.variant]


def kinds_named(name: str, hypotheses: tuple[str, ...]) -> list[NamedKind]:
    """The kind of this name, if it is to be tried."""
    return [kind for kind in _beside_k(hypotheses) if kind.name == name]


def channel_kinds(hypotheses: tuple[str, ...], joint: AbstractJoint) -> list[ChannelKind]:
    """Ways in which a joint may depend on a channel: by parameters that it has."""
    moved = {"", *(info.name for info in joint.parameters)}
    return [
        kind
        for kind in _beside_k(hypotheses)
        if isinstance(kind, ChannelKind) and kind.moved in moved
    ]


def late_laws(hypotheses: tuple[str, ...], best: AnyFit) -> list[JointKind]:
    """Laws with all of their parameters that are not tried from the beginning.

    Those that were asked for by name; or all where the best that was found leaves more than noise,
    and where it does not, those that may be taken for it.
    """
    laws = [
        kind
        for kind in kinds_in_time(hypotheses)
        if isinstance(kind, JointKind)
        and not kind.within
        # Of the joints' faults only these have a law whose force is of the place's own motion: an
        # attached oscillator answers accelerations, which no loop that is driven slowly shows.
        and isinstance(kind.law, type)
        and issubclass(kind.law, AbstractForceLaw)
    ]
    if hypotheses or best.cost > settings().judgement.unexplained ** 2 * best.count:
        return laws
    found = best.effect.kind.name if best.effect else ""
    return [kind for kind in laws if found in getattr(kind.law, "taken_for", ())]


def _beside_k(hypotheses: tuple[str, ...]) -> list[NamedKind]:
    """Kinds of which K holds nothing: a joint on its own, or a mode, is fitted at every level."""
    return [kind for kind in kinds_of(hypotheses) if not getattr(kind, "within", False)]


class Trials(Generic[Fit]):
    """Effects tried beside a model one after the other, as far as there is time.

    Attributes
    ----------
    found : list of SteadyFit
        Those that ended, in the order that they were tried in.
    unseen : list of str
        Kinds that the measurements cannot show.
    complete : bool
        Whether there was time for all.
    """

    def __init__(self, budget: float, progress: Callable[[str], None], name: str = ""):
        self._started, self._budget, self._progress = time.perf_counter(), budget, progress
        self._prefix = f"{name}: " if name else ""
        self.found: list[Fit] = []
        self.unseen: list[str] = []
        self.complete = True

    @property
    def seconds(self) -> float:
        """Since the first."""
        return time.perf_counter() - self._started

    def say(self, line: str) -> None:
        """Tell what is under way."""
        self._progress(self._prefix + line)

    def in_time(self, items: Iterable[T], line: Callable[[T], str]) -> Iterator[T]:
        """Items while there is time, each announced."""
        for item in items:
            if self.seconds >= self._budget:
                self.complete = False
                return
            self.say(line(item))
            yield item

    def fit(
        self, items: Iterable[T], line: Callable[[T], str], fitted: Callable[[T], Fit | None]
    ) -> list[T]:
        """Fit each item, and return those that the measurements cannot show."""
        hidden = []
        for item in self.in_time(items, line):
            fit = fitted(item)
            if fit is None:
                hidden.append(item)
            elif math.isfinite(fit.cost):
                self.found.append(fit)
        return hidden

    def fit_forces(
        self, forces: Iterable[ForceKind], fitted: Callable[[ForceKind], Fit | None]
    ) -> None:
        """Fit each force beside the only joint."""
        hidden = self.fit(forces, lambda force: f"with {force.name}", fitted)
        self.unseen += dict.fromkeys(force.name for force in hidden)

    @property
    def joined(self) -> Fit | None:
        """The fit with a joint left out, if it was tried."""
        those = [
            fit
            for fit in self.found
            if fit.effect is not None and isinstance(fit.effect.kind, JointKind)
        ]
        return best_of(those) if those else None

    def contained(self, kind: NamedKind, where: str = "") -> list[Fit]:
        """Fits at a place of what a kind has for a limit, the best first."""
        those = [
            fit
            for fit in self.found
            if fit.effect is not None
            and fit.effect.where == where
            and at_a_limit(kind, fit, 1.0, 1.0) is not None
        ]
        return sorted(those, key=lambda each: each.cost)

    def none_worse(self, begun: Callable[[Fit, ForceKind], Fit | None]) -> None:
        """Forces again from the best of what each contains, where that fits better.

        On its own a search may end in a local minimum, whose evidence is not the law's.

        Parameters
        ----------
        begun : function
            The fit of what is contained, and what contains it -> a fit of this.
        """
        for i, fit in enumerate(self.found):
            if fit.effect is None or not isinstance(kind := fit.effect.kind, ForceKind):
                continue
            better = [
                each for each in self.contained(kind, fit.effect.where)[:1] if each.cost < fit.cost
            ]
            for simpler in self.in_time(
                better, lambda _: f"with {kind.name} from what it contains"
            ):
                again = begun(simpler, kind)
                self.found[i] = fit if again is None else best_of([fit, again])
