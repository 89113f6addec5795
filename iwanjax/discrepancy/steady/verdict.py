"""Effects ranked by evidence, and the verdict on one model by curves or loops."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from iwanjax.discrepancy.diagnosis import Diagnosis
from iwanjax.discrepancy.findings import (
    Errors,
    Observable,
    Refitted,
    Refused,
    Score,
    Suspect,
    alike,
)
from iwanjax.discrepancy.judgement import Misfit, judged, worse
from iwanjax.discrepancy.steady.runs import CurveRun, LoopRun, ModesRun
from iwanjax.discrepancy.steady.trials import Trials
from iwanjax.effects.estimate import Estimate
from iwanjax.estimation.evidence import (
    LEAST_GAIN,
    MODEL_ERROR_ALLOWANCE,
    linearised,
    log_evidence,
    misspecification_probability,
)
from iwanjax.estimation.parameters import Parameter
from iwanjax.identification.steady.fit import AnyFit, Fit, PlacedEffect, best_of
from iwanjax.joints import ParameterInfo
from iwanjax.settings.stages import settings

Run = TypeVar("Run", CurveRun, ModesRun, LoopRun)


class Weighed(NamedTuple, Generic[Fit]):
    """A fit and its log evidence."""

    fit: Fit
    value: float


class Ranking(NamedTuple, Generic[Fit]):
    """Fits by evidence.

    Attributes
    ----------
    alone : Fit
        The joint on its own.
    nothing : float
        Its log evidence, and how much likelier it is before the data.
    entries : tuple of Weighed
        What may act beside it, the best first.
    refuted : bool
        Whether its own misfit says that it is not all there is.
    """

    alone: Fit
    nothing: float
    entries: tuple[Weighed[Fit], ...]
    refuted: bool = False

    @classmethod
    def of(cls, alone: Fit, found: Sequence[Fit], refuted: bool = False) -> "Ranking[Fit]":
        """By evidence, the best of every kind at a place only.

        A force whose size is not determined is none, where one would be the verdict. Rivals are
        told apart by what the best of them leaves; that nothing is missing is held
        against the deviations as they are stated: a poor fit asks for no more evidence.

        Parameters
        ----------
        alone : Fit
            The joint on its own.
        found : sequence of Fit
            What may act beside it.
        refuted : bool
            Whether its own misfit says that it is not all there is: then the best of what may act
            beside it is looked at, though few values alone do not tell.
        """
        best: dict[tuple[str, ...], Fit] = {}
        for fit in found:
            assert fit.effect is not None
            what = fit.effect.names
            best[what] = best_of([best.get(what, fit), fit])
        fits = [alone, *best.values()]
        first = best_of(fits)
        temperature, tau = max(1.0, first.cost / alone.count), first.correlation()
        costs, unknowns = zip(*((each.cost, each.unknowns) for each in fits), strict=True)

        def values(temperature: float) -> np.ndarray:
            known = log_evidence(costs, unknowns, alone.count, temperature, tau)
            known[0] += MODEL_ERROR_ALLOWANCE * alone.cost / (2.0 * temperature * tau)
            return known

        strict, own = values(1.0), values(temperature)[1:]
        gain = float(strict[1:].max() - strict[0]) if own.size else 0.0
        nothing = (float(own.max()) if own.size else 0.0) - gain + LEAST_GAIN
        entries = [Weighed(fit, float(v)) for fit, v in zip(best.values(), own, strict=True)]
        # Of those that are alike to rounding the one that was tried first, the simplest, leads:
        # the others are as good, not better.
        entries.sort(key=lambda each: -round(each.value, 1))
        ordered = np.minimum.accumulate([each.value for each in entries]).tolist()
        if entries and (refuted or ordered[0] > nothing):
            known = [each.fit for each in entries if determined(each.fit)]
            if len(known) < len(entries):
                return cls.of(alone, known, refuted)
        led = (each._replace(value=v) for each, v in zip(entries, ordered, strict=True))
        return cls(alone, nothing, tuple(led), refuted)

    @property
    def detected(self) -> bool:
        """Whether the first is likelier than nothing."""
        return bool(self.entries) and self.entries[0].value > self.nothing

    @property
    def chosen(self) -> Fit:
        """The model to go on with."""
        suspected = self.detected or (self.refuted and self.entries)
        return self.entries[0].fit if suspected else self.alone

    def suspects(
        self,
        where: str,
        probabilities: Sequence[float],
        estimates: Callable[[Fit], tuple[Estimate, ...]],
    ) -> Iterator[Suspect]:
        """What may act beside the joint, each with its probability."""
        for each, probability in zip(self.entries, probabilities, strict=True):
            effect, behind = each.fit.effect, each.value - self.entries[0].value
            assert effect is not None
            place, told = effect.where or where, estimates(each.fit)
            if effect.force is None:
                yield Suspect(effect.kind, place, probability, behind, told)
                continue
            # Both are there or neither: each with its own parameters.
            kinds, own = (effect.kind, effect.force), len(PlacedEffect(effect.kind).sizes)
            labels = [f"{kind.name}@{place}" for kind in kinds]
            for i, part in enumerate((told[:own], told[own:])):
                yield Suspect(kinds[i], place, probability, behind, part, (labels[1 - i],))


def determined(fit: AnyFit) -> bool:
    """Whether an effect is known to be there, by two standard deviations of a size.

    Of a joint left out either strength or stiffness: the one is not known where it only sticks,
    the other where it only slips. With a force beside it that has to be known as well.
    """
    sure = np.abs(fit.values) > settings().judgement.sure * fit.std()
    beside = fit.effect is not None and fit.effect.force is not None
    return bool(np.any(sure[:2]) and (sure[-1] or not beside))


def concluded(
    trials: Trials[Fit],
    alone: Fit,
    where: str,
    run: Callable[[Fit, Fit], Run],
    parameters: Sequence[Parameter],
    *,
    estimates: Callable[[Fit], tuple[Estimate, ...]] = lambda fit: fit.estimates(),
    observables: Callable[[Run], tuple[Observable, ...]] = lambda before: (),
    scores: tuple[Score, ...] = (),
    expected: Callable[[Fit, Run], Mapping[str, float]] = lambda fit, after: after.floors(),
    spread: Callable[[Fit], Mapping[str, float]] | None = None,
    warnings: Callable[[Fit], Sequence[str]],
) -> Diagnosis:
    """The verdict.

    Parameters
    ----------
    trials : Trials
        What was tried.
    alone : SteadyFit
        The model alone.
    where : str
        What the verdict calls the joint, where effects have no place of their own.
    run : function
        Of a fit and the one that is chosen: its prediction, against what that is held against.
    parameters : sequence of Parameter
        Of the model that was given.
    estimates : function
        Sizes and shape of a fit's effect.
    observables : function
        Of the prediction before: where it is clearly off.
    scores : tuple of Score
        What forces would explain at a glance, where that was looked at.
    expected : function
        Of a fit and its prediction: errors that are no surprise, by recording; the noise's, unless
        the model's form is known to be off as well.
    spread : function, optional
        Of a fit: by how much its predictions move within what the fitted recordings leave open of
        its parameters, by recording.
    warnings : function
        Of the fit that is chosen: what is odd beside the errors themselves.
    """

    def opened(fit: Fit, fitted: int) -> Errors:
        """What the fitted recordings leave open."""
        return Errors(math.nan, math.nan) if spread is None else _errors(spread(fit), fitted)

    first = run(alone, alone)
    fitted = first.fitted
    before = _errors(first.by_recording(), fitted)
    misfit = _misfit(
        before, _errors(expected(alone, first), fitted), opened(alone, fitted).hold_out
    )
    refuted = max(map(misspecification_probability, misfit.ratios)) > 0.5
    standing = Ranking.of(alone, trials.found, refuted)
    refused: list[Refused] = []
    while True:
        chosen = standing.chosen
        both = (run(alone, chosen), run(chosen, chosen))
        before, after = (_errors(each.by_recording(), fitted) for each in both)
        floor = _errors(both[1].floors(), fitted)
        if chosen is alone or not worse(before.hold_out, after.hold_out, floor.hold_out):
            break
        # The next best by fitted recordings; those held out only refuse.
        others = standing.entries[1:]
        (suspect, *_) = standing.suspects(where, [0.0] * len(standing.entries), estimates)
        refused.append(Refused(suspect.label, before.hold_out, after.hold_out))
        standing = Ranking.of(alone, [each.fit for each in others], refuted)
    foreseen, left_open = _errors(expected(chosen, both[1]), fitted), opened(chosen, fitted)
    verdict = judged(
        standing.nothing,
        [each.value for each in standing.entries],
        _misfit(before, foreseen, opened(alone, fitted).hold_out),
        _misfit(after, foreseen, left_open.hold_out),
    )
    listed = verdict.detected and chosen is not alone
    what = tuple(standing.suspects(where, verdict.named, estimates)) if listed else ()
    if not listed:
        after, both, left_open = before, (both[0], both[0]), opened(alone, fitted)
    return Diagnosis(
        verdict=verdict,
        what=what,
        before=before,
        after=after,
        noise_floor=floor,
        noise_floor_95=Errors(math.nan, math.nan),
        parameter_spread=left_open,
        refused=tuple(refused),
        indistinguishable=alike(what) if what else (),
        observables=observables(both[0]) if verdict.detected else (),
        scores=scores,
        joints=_refitted(chosen if listed else alone, parameters, where),
        runs=both,
        sampling_rate=math.nan,
        restoring=None,
        warnings=(
            *warnings(chosen),
            *_warnings(after, foreseen, left_open, verdict.something_else, bool(what)),
        ),
        complete=trials.complete,
        seconds=trials.seconds,
    )


def _refitted(fit: AnyFit, parameters: Sequence[Parameter], name: str) -> tuple[Refitted, ...]:
    """The parameters of a fit to curves or loops, by the joint that each names."""
    problem = fit.problem
    free = [at for at, each in zip(problem.given, parameters, strict=True) if not each.fixed]
    columns = [*free, *problem.places] if fit.effect is not None else free
    std = np.full(len(fit.theta), math.nan)
    columns = np.setdiff1d(columns, fit.idle)
    std[columns] = linearised(fit.linear[1][:, columns], fit.cost, fit.correlation())
    found: dict[str, list[Estimate]] = {}
    for i, each in zip(problem.given, parameters, strict=True):
        joint, _, own = each.name.rpartition(".")
        info = ParameterInfo(own, each.unit, each.meaning)
        estimate = Estimate(info, float(fit.theta[i]), float(std[i]))
        found.setdefault(joint or name, []).append(estimate)
    return tuple(Refitted(joint, tuple(rows)) for joint, rows in found.items())


def _misfit(errors: Errors, foreseen: Errors, spread: float) -> Misfit:
    """Over what is no surprise."""
    held_out = settings().judgement.uncertain * _at_most(foreseen, spread)
    return Misfit(errors.fit / foreseen.fit, errors.hold_out / held_out, (foreseen.fit, held_out))


def _at_most(foreseen: Errors, spread: float) -> float:
    """Deviation of held-out recordings, with what fitted ones leave open of the parameters."""
    return math.hypot(foreseen.hold_out, 0.0 if math.isnan(spread) else spread)


def _errors(by_recording: Mapping[str, float], fitted: int) -> Errors:
    """Root mean square over those that were fitted, and over the others."""
    # A prediction that is no number any more is infinitely far off.
    square = np.nan_to_num(np.square(list(by_recording.values())), nan=math.inf, posinf=math.inf)
    parts = (square[:fitted], square[fitted:])
    return Errors(*(math.sqrt(float(x.mean())) if x.size else math.nan for x in parts))


def _warnings(
    after: Errors, foreseen: Errors, spread: Errors, unknown: float, detected: bool
) -> list[str]:
    """What to think of the errors that are left."""
    told = []
    if math.isnan(after.hold_out):
        told.append("No recording was held out, so nothing shows that the verdict holds")
    ratio = after.fit / foreseen.fit
    if ratio > settings().judgement.unexplained:
        rest = "also with it" if detected else "and nothing that was tried explains it"
        told.append(
            f"The fitted recordings are {ratio:.2g} times their deviations off, {rest} "
            f"(probability {unknown:.2f} that something else is missing)"
        )
    ratio = after.hold_out / _at_most(foreseen, spread.hold_out)
    if ratio > settings().judgement.uncertain:
        told.append(
            f"The held-out recordings are off by {ratio:.2g} times their deviations: either "
            "something acts there that those fitted do not show, or the joint was fitted to the "
            f"wrong end (probability {unknown:.2f} that something else is missing)"
        )
    return told
