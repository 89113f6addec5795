"""What a diagnosis says."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from iwanjax.discrepancy.catalogue import Kind
from iwanjax.discrepancy.judgement import Verdict
from iwanjax.discrepancy.observables import Observable
from iwanjax.discrepancy.restoring import RestoringForce
from iwanjax.discrepancy.suspicion import Estimate

# Differences by mode that a statement begins with.
_TOLD = 2
# What noise exceeds in one case of twenty over what it leaves, from which on both are told.
_OFTEN = 1.15


class Run(Protocol):
    """A model against recordings of some kind: time histories, or curves of a mode."""

    def by_recording(self) -> Mapping[str, float]:
        """Relative errors."""
        ...

    def floors(self) -> Mapping[str, float]:
        """The same of a perfect model."""
        ...

    def floors_95(self) -> Mapping[str, float]:
        """What a perfect model exceeds in one case of twenty."""
        ...


class Suspect(NamedTuple):
    """What may be missing: one row of a verdict.

    Attributes
    ----------
    kind : Kind
        Of the catalogue.
    where : str
        Label of the place, sensor or joint.
    probability : float
        Among all that were tried, nothing, and something that was not tried.
    log_evidence : float
        Of the data with it, less that of the best.
    parameters : tuple of Estimate
        Its size, and its shape where it has one.
    joint_with : tuple of str
        Labels kind@where of what acts together with it.
    """

    kind: Kind
    where: str
    probability: float
    log_evidence: float
    parameters: tuple[Estimate, ...]
    joint_with: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """kind@where."""
        return f"{self.kind.name}@{self.where}"


class Refused(NamedTuple):
    """What explains the fitted recordings, but predicts those held out worse.

    Attributes
    ----------
    label : str
        kind@where, joined by " + " where several act at once.
    before, after : float
        Errors of the held-out recordings without and with it; infinite where it diverges.
    """

    label: str
    before: float
    after: float


class Errors(NamedTuple):
    """Root mean square of predicted less measured over that of measured; NaN without data."""

    fit: float
    hold_out: float


class Score(NamedTuple):
    """What one suspect would take off the residual, judged at size zero.

    Attributes
    ----------
    kind, where : str
        Which.
    drop : float
        Share of the squared residual, the joints refitted.
    """

    kind: str
    where: str
    drop: float


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Result of :func:`iwanjax.diagnose`.

    Attributes
    ----------
    verdict : Verdict
        Nothing missing, something missing or undecided, with the probabilities that it rests on.
        Headline, JSON and report follow from it.
    what : tuple of Suspect
        By probability. The first is what is missing where that has a name; where the verdict is
        undecided, what was tried with the most success. Empty when nothing is missing, and when
        nothing that was tried is likelier than that.
    before, after, noise_floor : Errors
        Free-run errors of the model with its joints refitted, with the first of ``what`` added,
        and what sensor and force noise alone leave.
    noise_floor_95 : Errors
        What noise alone exceeds in one case of twenty; NaN for curves.
    parameter_spread : Errors
        By how much predictions move within what the fitted recordings leave open of the
        parameters, linearised; NaN for curves.
    refused : tuple of Refused
        What was tried and predicts held-out recordings worse than the model without it.
    indistinguishable : tuple of (str, str)
        Pairs kind@where that these data cannot tell apart.
    observables : tuple of Observable
        Where frequency and damping of the model before differ from the measured ones.
    scores : tuple of Score
        Of the screening, the largest drop first.
    runs : tuple of Free, CurveRun, ModesRun or LoopRun
        Predictions before and after, of all recordings: free runs, curves, or loops.
    sampling_rate : float
        Hz; NaN for curves.
    restoring : RestoringForce or None
        Recovered at the place of the first suspect, where that is a force.
    warnings : tuple of str
        What is odd about the study or the verdict.
    complete : bool
        Whether the budget of time sufficed.
    seconds : float
        What it took.
    """

    verdict: Verdict
    what: tuple[Suspect, ...]
    before: Errors
    after: Errors
    noise_floor: Errors
    noise_floor_95: Errors
    parameter_spread: Errors
    refused: tuple[Refused, ...]
    indistinguishable: tuple[tuple[str, str], ...]
    observables: tuple[Observable, ...] = field(repr=False)
    scores: tuple[Score, ...] = field(repr=False)
    runs: tuple[Run, Run] = field(repr=False)
    sampling_rate: float
    restoring: RestoringForce | None = field(repr=False)
    warnings: tuple[str, ...]
    complete: bool
    seconds: float

    @property
    def detected(self) -> bool:
        """Whether something is missing, known or not."""
        return self.verdict.detected

    @property
    def probability_nothing_missing(self) -> float:
        """Of the verdict."""
        return self.verdict.nothing

    @property
    def probability_something_else(self) -> float:
        """That the truth is none of what was tried, by what the best of it leaves."""
        return self.verdict.something_else

    @property
    def by_recording(self) -> Mapping[str, tuple[float, float]]:
        """Relative errors of each recording before and after."""
        before, after = (run.by_recording() for run in self.runs)
        return {name: (before[name], after[name]) for name in before}

    @property
    def found(self) -> tuple[Suspect, ...]:
        """What is missing: the first suspect and those that act together with it."""
        if not self.verdict.found:
            return ()
        first = self.what[0]
        return (first, *(each for each in self.what[1:] if each.label in first.joint_with))

    def statement(self) -> str:
        """The verdict in plain sentences."""
        by_name = {
            "nothing_missing": self._nothing,
            "something_missing": self._missing,
            "undecided": self._undecided,
        }
        told = [*by_name[self.verdict.name](), *map(_refusal, self.refused), *self.warnings]
        if not self.complete:
            told.append("The time given was too short to finish; this is so far.")
        return " ".join(line if line.endswith(".") else f"{line}." for line in told)

    def _nothing(self) -> list[str]:
        held = self.before.hold_out == self.before.hold_out
        error, floor = ((x.hold_out if held else x.fit) for x in (self.before, self.noise_floor))
        which = "held-out" if held else "fitted"
        return [
            f"Nothing is missing that these recordings show: with its joints refitted the model "
            f"predicts the {which} ones within {error:.2g} of their root mean square "
            f"(probability {self.probability_nothing_missing:.2f}).",
            f"Noise alone would leave {floor:.2g}{self._at_most(held)}.",
            *self._open(),
        ]

    def _undecided(self) -> list[str]:
        """What is known where neither is likely."""
        held = self.before.hold_out == self.before.hold_out
        error, floor, better = (
            (x.hold_out if held else x.fit) for x in (self.before, self.noise_floor, self.after)
        )
        which = "held-out" if held else "fitted"
        off = (
            f"with its joints refitted the model is off by {error:.2g} on the {which} recordings, "
            f"where noise alone would leave {floor:.2g}"
        )
        if not self.detected:
            return [
                f"Undecided: these recordings do not tell whether anything is missing "
                f"(probability {self.probability_nothing_missing:.2f} that nothing is); {off}."
            ]
        told = [
            f"Undecided: something is missing, and nothing that was tried explains it "
            f"(probability {self.probability_something_else:.2f} that it is something else); {off}."
        ]
        if self.what:
            told.append(f"The best of what was tried, {self.what[0].label}, leaves {better:.2g}.")
        return told

    def _at_most(self, held: bool) -> str:
        """What noise seldom exceeds, where that is much more than it leaves on average."""
        usual, high = (
            (x.hold_out if held else x.fit) for x in (self.noise_floor, self.noise_floor_95)
        )
        return f" ({high:.2g} in one case of twenty)" if high > _OFTEN * usual else ""

    def _open(self) -> list[str]:
        """What the parameters leave open of the held-out recordings, where that is much."""
        spread = self.parameter_spread.hold_out
        if not spread > self.noise_floor.hold_out:
            return []
        return [
            f"What the fitted recordings leave open of the parameters moves the held-out ones by "
            f"about {spread:.2g} more"
        ]

    def _missing(self) -> list[str]:
        told = [_difference(each) for each in self.observables[:_TOLD]]
        for each in self.found:
            sizes = ", ".join(
                f"{p.info.name} = {p.value:.4g}" + (f" ± {p.std:.2g}" if p.std == p.std else "")
                for p in each.parameters
            )
            told.append(
                f"The model lacks {each.kind.usual} at {each.where} ({each.kind.name}"
                f"{', ' * bool(sizes)}{sizes}; probability {each.probability:.2f}): its sign is "
                f"{each.kind.signs}."
            )
        if self.before.hold_out == self.before.hold_out:
            told.append(
                f"Held-out error falls from {self.before.hold_out:.2g} to "
                f"{self.after.hold_out:.2g}; the noise floor is {self.noise_floor.hold_out:.2g}"
                f"{self._at_most(held=True)}."
            )
            told += self._open()
        for each in self.found:
            rivals = [b for a, b in self.indistinguishable if a == each.label]
            if rivals:
                told.append(f"These data cannot tell {each.label} from {', '.join(rivals)}.")
        return told


def _refusal(each: Refused) -> str:
    off = f"is {each.after:.2g} off on" if math.isfinite(each.after) else "diverges on"
    return (
        f"{each.label} explains the fitted recordings, but {off} the held-out ones, where the "
        f"model without it is {each.before:.2g} off: it is refused."
    )


def _difference(each: Observable) -> str:
    more = "too much" if each.difference_percent > 0 else "too little"
    low, high = each.amplitude
    return (
        f"In {each.recording} mode {each.mode} has {abs(each.difference_percent):.2g} % {more} "
        f"{each.quantity} in the model, at amplitudes of {low:.2g} to {high:.2g}."
    )


def alike(what: Sequence[Suspect], margin: float) -> tuple[tuple[str, str], ...]:
    """The first suspect with each whose evidence is as good within a margin."""
    return tuple(
        (what[0].label, other.label)
        for other in what[1:]
        if other.log_evidence > what[0].log_evidence - margin
        and other.label not in what[0].joint_with
        and other.label != what[0].label
    )
