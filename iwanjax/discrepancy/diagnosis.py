"""What a diagnosis says."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from iwanjax.discrepancy.findings import (
    Errors,
    ForceNoise,
    MeasuredNoise,
    Observable,
    PlaceEvidence,
    Prediction,
    Refitted,
    Refused,
    Report,
    RestoringForce,
    Score,
    Suspect,
    UnnamedForce,
)
from iwanjax.discrepancy.judgement import Verdict
from iwanjax.effects.kinds import UnnamedKind
from iwanjax.effects.wording import noun, place, sentence, share, sizes
from iwanjax.results import AbstractResult
from iwanjax.settings.stages import settings
from iwanjax.signals.recording import Channel
from iwanjax.structures import JointedStructure
from iwanjax.tables import Block, without_empty_columns


@dataclass(frozen=True, eq=False)
class Diagnosis(AbstractResult):
    """Result of :func:`iwanjax.diagnose`.

    Attributes
    ----------
    verdict : Verdict
        Nothing missing, something missing or undecided, with the probabilities that it rests on.
        Headline, JSON and report follow from it.
    what : tuple of Suspect
        By probability, and where that is the same by evidence. The first is what is missing where
        that has a name; where the verdict is undecided, what was tried with the most success.
        Empty when nothing is missing, and when nothing that was tried is likelier than that.
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
    places : tuple of PlaceEvidence
        Where something acts, whatever it is, the likeliest first: by all laws of a place at once
        and, where one has a name, by the verdict. None for curves and loops.
    joints : tuple of Refitted
        Joints, or modes with theirs, as refitted: with the first of ``what``, where there is one.
    modes : tuple of Refitted
        By how much the linear model's modes were moved within their trust; none where it is
        exact.
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
    failures : tuple of str
        Late stages that failed, in words; what does not rest on them holds.
    model : JointedStructure or None
        The structure with its joints refitted and, where something is missing, with it: ready to
        simulate. None for curves and loops, and where it could not be built.
    noise : tuple of MeasuredNoise
        What was taken for the noise of each sensor in each recording; none for curves and loops.
    unnamed : UnnamedForce or None
        The force that no name fits, where one was fitted.
    force_noise : tuple of ForceNoise
        The same of each force.
    sensors : tuple of Channel
        Names and units of the runs' columns; none for curves and loops.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> d = np.concatenate([np.linspace(0, 2, 40), np.linspace(2, -2, 80), np.linspace(-2, 2, 80)])
    >>> joint = ij.Jenkins(F_S=1.0, K_T=1.0)
    >>> noise = 1e-3 * np.random.default_rng(0).standard_normal(d.size)
    >>> loop = ij.ForceLoop(d, ij.hysteresis(joint, d) + noise)
    >>> verdict = ij.diagnose(joint, loop, hypotheses=["cubic_stiffness", "stiffness_error"])
    >>> verdict.verdict.name, verdict.what
    ('nothing_missing', ())
    >>> verdict.statement()[:18]
    'Nothing is missing'
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
    joints: tuple[Refitted, ...] = field(repr=False)
    runs: tuple[Prediction, Prediction] = field(repr=False)
    sampling_rate: float
    restoring: RestoringForce | None = field(repr=False)
    warnings: tuple[str, ...]
    complete: bool
    seconds: float
    failures: tuple[str, ...] = ()
    modes: tuple[Refitted, ...] = field(default=(), repr=False)
    model: JointedStructure | None = field(default=None, repr=False)
    noise: tuple[MeasuredNoise, ...] = field(default=(), repr=False)
    unnamed: UnnamedForce | None = field(default=None, repr=False)
    places: tuple[PlaceEvidence, ...] = field(default=(), repr=False)
    force_noise: tuple[ForceNoise, ...] = field(default=(), repr=False)
    sensors: tuple[Channel, ...] = field(default=(), repr=False)

    @property
    def noise_floor_is_lower_bound(self) -> bool:
        """Whether more noise may have been there than the floors hold, of a sensor or a force."""
        return any(each.upper > each.deviation for each in self.noise) or any(
            each.deviation is None for each in self.force_noise
        )

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
    def stopped_early(self) -> bool:
        """Whether the time given was over before the model's own joints were fitted."""
        return self.verdict.untold and not self.complete

    @property
    def baseline(self) -> str:
        """What the model before is, in the words of tables and legends."""
        return "joints not yet refitted" if self.stopped_early else "joints refitted"

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

    def report(self) -> Report:
        """The verdict in plain sentences, part by part."""
        by_name = {
            "nothing_missing": self._nothing,
            "something_missing": self._missing,
            "undecided": self._undecided,
        }
        first = by_name[self.verdict.name]()
        return Report.of(first, self._improvement(), self._doubt(), self._next())

    def statement(self) -> str:
        """All of it: the verdict first, then the improvement, the doubt, what to measure next."""
        return self.report().statement()

    @property
    def _held(self) -> bool:
        """Whether recordings were held out."""
        return self.before.hold_out == self.before.hold_out

    @property
    def _which(self) -> str:
        return "held-out" if self._held else "fitted"

    def _of(self, errors: Errors) -> float:
        """The error that tells most: of held-out recordings, where there are some."""
        return errors.hold_out if self._held else errors.fit

    def _nothing(self) -> list[str]:
        return [
            "Nothing is missing that these recordings show "
            f"(probability {self.probability_nothing_missing:.2f})",
            f"With its joints refitted the model predicts the {self._which} recordings to "
            f"{share(self._of(self.before))}; noise alone would leave {self._floor()}",
        ]

    def _missing(self) -> list[str]:
        return [
            f"{sentence(each.kind, each.where)}{': ' * bool(each.parameters)}"
            f"{sizes(each.parameters)} (probability {each.probability:.2f})"
            for each in self.found
        ]

    def _undecided(self) -> list[str]:
        off = (
            f"the model is {share(self._of(self.before))} off on the {self._which} recordings; "
            f"noise alone would leave {self._floor()}"
        )
        if self.stopped_early:
            return [
                "Undecided: the time given was over before the model's own joints were fitted",
                f"So far {off}",
            ]
        off = f"With its joints refitted {off}"
        if not self.detected:
            return [
                "Undecided: these recordings do not tell whether anything is missing "
                f"(probability {self.probability_nothing_missing:.2f} that nothing is)",
                off,
            ]
        if self.unnamed is not None:
            return [*self._general(self.unnamed), off]
        if not self.complete:
            return ["Undecided: something is missing, and there was no time to find out what", off]
        missing = "something is missing"
        if self.places and self.places[0].probability > 0.5:
            at = self.places[0]
            missing = f"something acts {place(at.where)} (probability {at.probability:.2f})"
        return [
            f"Undecided: {missing}, and nothing that was tried explains it "
            f"(probability {self.probability_something_else:.2f} that it is something else)",
            off,
        ]

    def _general(self, force: UnnamedForce) -> list[str]:
        """What a force does that no name fits, and the names that come nearest."""
        (entry,) = [each for each in self.what if each.kind.name == UnnamedKind.name]
        name, probability = next(iter(force.nearest.items()), ("", 0.0))
        likely = settings().judgement.likely
        near = [f"The nearest name is {name} (probability {probability:.2f})"] * (
            probability > likely
        )
        # Names at several places, which no law at one of these need be near to.
        nouns = {each.label: noun(each.kind, each.where) for each in self.what}
        near += [
            f"Or it is {' and '.join(nouns[label] for label in (each.label, *each.joint_with))} "
            f"(probability {each.probability:.2f})"
            for each in self.what
            if each.joint_with and each.probability > likely
        ][:1]
        return [
            f"{sentence(entry.kind, entry.where)}: {force.description} "
            f"(probability {entry.probability:.2f} that something acts there)",
            *(near or ["No name comes near"]),
        ]

    def _floor(self) -> str:
        """What noise leaves, and what it seldom exceeds, where that is much more."""
        usual, high = self._of(self.noise_floor), self._of(self.noise_floor_95)
        if not usual < 1.0:
            return "more than the signal, in a model that amplifies it without bound"
        often = (
            f", in one case of twenty {share(high)}"
            if high > settings().judgement.often * usual
            else ""
        )
        return share(usual) + often

    def _improvement(self) -> list[str]:
        if not self.what:
            return []
        after, before = share(self._of(self.after)), share(self._of(self.before))
        if self.verdict.found or self.unnamed is not None:
            it = "them" if len(self.found) > 1 else "it"
            return [
                f"With {it}, {self._which} recordings are predicted to {after} (refitted model "
                f"alone: {before}; noise floor: {self._floor()})"
            ]
        best = noun(self.what[0].kind, self.what[0].where)
        return [f"The best of what was tried, {best}, leaves {after} of {before}"]

    def _doubt(self) -> list[str]:
        doubts = []
        behind = {each.label: -each.log_evidence for each in self.what}
        for each in self.found:
            rivals = [b for a, b in self.indistinguishable if a == each.label]
            wider = [b for b in rivals if behind.get(b, 0.0) > settings().judgement.alike]
            if close := [b for b in rivals if b not in wider]:
                doubts.append(f"These data cannot tell {each.label} from {', '.join(close)}")
            if wider:
                doubts.append(
                    f"Nothing here speaks against {', '.join(wider)} either, with more parameters: "
                    "the simpler one is named"
                )
        others = [each for each in self.what if each not in self.found]
        if self.verdict.found and others and not doubts:
            next_best = noun(others[0].kind, others[0].where)
            likely = f"has a probability of {others[0].probability:.2g}"
            out = others[0].probability < settings().judgement.excluded
            doubts.append(
                f"The next best explanation, {next_best}, {'is excluded' if out else likely}"
            )
        if self.verdict.found and self.probability_something_else > settings().judgement.likely:
            doubts.append(
                f"The probability that it is something else is "
                f"{self.probability_something_else:.2f}"
            )
        doubts += map(str, self.refused)
        spread = self.parameter_spread.hold_out
        if spread > self.noise_floor.hold_out:
            doubts.append(
                f"What the fitted recordings leave open of the parameters moves the held-out ones "
                f"by about {share(spread)} more"
            )
        doubts += self.warnings
        doubts += [f"This part is missing: {each}" for each in self.failures]
        if not self.complete:
            doubts.append("The time given was too short to finish; this is so far")
        return doubts

    def _next(self) -> list[str]:
        """What to measure next, by what is open."""
        if not self.complete:
            return ["The same recordings, with more time to compare them"]
        if self.unnamed is not None:
            return [
                "Hits of other levels and at other places, to see whether the same law predicts "
                "them; beyond the deflections that it was fitted to it is a guess"
            ]
        if self.refused:
            return [
                "Recordings to fit that are as hard as those held out; what was refused had been "
                "fitted at other amplitudes"
            ]
        if self.verdict.found and any(a == self.found[0].label for a, _ in self.indistinguishable):
            return [
                "Harder and softer hits than these; explanations that agree at the amplitudes "
                "measured part beyond them"
            ]
        if not self._held:
            return ["A recording to hold out, at an amplitude of its own"]
        if self.verdict.name == "undecided" and self.detected:
            first = (self.places or self.scores)[:1]
            where = f", near {first[0].where} first" if first else ""
            return [
                f"More sensors and single modes at several amplitudes{where}, to see which motion "
                "the misfit goes with"
            ]
        if self.verdict.name == "undecided":
            return ["Harder hits, or the same ones with less noise"]
        return ["Harder hits; beyond these amplitudes nothing is known"]

    def _blocks(self) -> tuple[Block, ...]:
        report = self.report()
        suspects = [
            (
                noun(each.kind, each.where),
                f"{each.probability:.2f}",
                sizes(each.parameters),
                ", ".join(each.joint_with),
            )
            for each in self.what[: settings().judgement.listed]
        ]
        errors = [
            (name, share(errors.fit), share(errors.hold_out) if self._held else "")
            for name, errors in (
                (self.baseline, self.before),
                *([("with the first of these", self.after)] if self.what else []),
                ("noise alone", self.noise_floor),
            )
        ]
        header = ("what may be missing", "probability", "parameters", "together with")
        tables = [without_empty_columns(header, suspects)] if suspects else []
        tables.append(without_empty_columns(("error", "fitted", "held out"), errors))
        return report.verdict, *tables, *filter(None, (report.doubt, report.measure_next))
