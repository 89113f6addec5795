"""The verdict on one joint, and how much better predictions get with what it lacks."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

import numpy as np

from iwanjax.discrepancy.diagnosis import Diagnosis, Errors, Prediction, Refused, Score, alike
from iwanjax.discrepancy.estimate import Estimate, Refitted
from iwanjax.discrepancy.judgement import Misfit, judged, worse
from iwanjax.discrepancy.observables import Observable
from iwanjax.discrepancy.steady.one_joint import Explained, Fit, Ranking, linearised
from iwanjax.joints import ParameterInfo
from iwanjax.updating.parameters import Parameter

# Evidences closer than this cannot be told apart.
_ALIKE = 3.0
# Error over the noise's from which on something is left unexplained.
_UNEXPLAINED = 1.25
# Error of held-out recordings over their deviations that uncertain parameters may account for.
_UNFORESEEN = 2.0

AnyRun = TypeVar("AnyRun", bound=Prediction)


def concluded(
    standing: Ranking[Fit],
    where: str,
    runs: Callable[[Fit], tuple[AnyRun, AnyRun]],
    fitted: int,
    estimates: Callable[[Fit], tuple[Estimate, ...]],
    *,
    joints: Callable[[Fit], tuple[Refitted, ...]],
    observables: Callable[[AnyRun], tuple[Observable, ...]] = lambda before: (),
    scores: tuple[Score, ...] = (),
    expected: Callable[[Fit, AnyRun], Mapping[str, float]] | None = None,
    warnings: Callable[[Fit], Sequence[str]],
    complete: bool,
    seconds: float,
) -> Diagnosis:
    """The verdict.

    Parameters
    ----------
    standing : Ranking
        Fits by evidence.
    where : str
        What the verdict calls the joint, where forces have no place of their own.
    runs : function
        Of a fit: predictions without and with it, the recordings that were fitted first.
    fitted : int
        How many these are.
    estimates : function
        Size and shape of a fit's force.
    joints : function
        Of a fit: its joint, refitted.
    observables : function
        Of the prediction before: where it is clearly off.
    scores : tuple of Score
        What forces would explain at a glance, where that was looked at.
    expected : function, optional
        Of a fit and its prediction: errors that are no surprise, by recording; the noise's, unless
        the model's form is known to be off as well.
    warnings : function
        Of the fit that is chosen: what is odd beside the errors themselves.
    complete : bool
        Whether there was time for everything.
    seconds : float
        What it took.
    """
    refused: list[Refused] = []
    while True:
        chosen = standing.chosen
        both = runs(chosen)
        before, after = (_errors(run.by_recording(), fitted) for run in both)
        floor = _errors(both[1].floors(), fitted)
        if not (standing.detected and worse(before.hold_out, after.hold_out, floor.hold_out)):
            break
        # The next best by fitted recordings; those held out only refuse.
        others = standing.entries[1:]
        (suspect, *_) = standing.suspects(where, [0.0] * len(standing.entries), estimates)
        refused.append(Refused(suspect.label, before.hold_out, after.hold_out))
        standing = Ranking.of(standing.alone, [each.fit for each in others])
    foreseen = floor if expected is None else _errors(expected(chosen, both[1]), fitted)
    verdict = judged(
        standing.nothing,
        [each.value for each in standing.entries],
        _misfit(before, foreseen),
        _misfit(after, foreseen),
    )
    listed = verdict.detected and standing.detected
    what = tuple(standing.suspects(where, verdict.named, estimates)) if listed else ()
    if not listed:
        after, both = before, (both[0], both[0])
    return Diagnosis(
        verdict=verdict,
        what=what,
        before=before,
        after=after,
        noise_floor=floor,
        noise_floor_95=Errors(math.nan, math.nan),
        parameter_spread=Errors(math.nan, math.nan),
        refused=tuple(refused),
        indistinguishable=alike(what, _ALIKE) if what else (),
        observables=observables(both[0]) if verdict.detected else (),
        scores=scores,
        joints=joints(chosen if listed else standing.alone),
        runs=both,
        sampling_rate=math.nan,
        restoring=None,
        warnings=(
            *warnings(chosen),
            *_warnings(after, foreseen, verdict.something_else, bool(what)),
        ),
        complete=complete,
        seconds=seconds,
    )


def parameters_refitted(
    fit: Explained,
    slopes: np.ndarray,
    parameters: Sequence[Parameter],
    name: str,
    given: Sequence[int] | np.ndarray | None = None,
) -> tuple[Refitted, ...]:
    """The parameters of a fit to curves or loops, by the joint that each names.

    Parameters
    ----------
    fit : fit
        Of these parameters and what was added to them.
    slopes : (residuals, values) array
        Of the residuals, in all of them.
    parameters : sequence of Parameter
        What they are.
    name : str
        What those are called that name no joint.
    given : sequence of int, optional
        Their places among the values; the first ones unless told otherwise.
    """
    places = list(range(len(parameters)) if given is None else map(int, given))
    free = [at for at, each in zip(places, parameters, strict=True) if not each.fixed]
    added = [i for i in range(slopes.shape[1]) if i not in places]
    columns = [*free, *added] if fit.force is not None else free
    std = dict(
        zip(
            columns,
            linearised(slopes[:, columns], fit.cost, fit.correlation()).tolist(),
            strict=True,
        )
    )
    found: dict[str, list[Estimate]] = {}
    for i, each in zip(places, parameters, strict=True):
        joint, _, own = each.name.rpartition(".")
        info = ParameterInfo(own, each.unit, each.meaning)
        estimate = Estimate(info, float(fit.theta[i]), std.get(i, float("nan")))
        found.setdefault(joint or name, []).append(estimate)
    return tuple(Refitted(joint, tuple(rows)) for joint, rows in found.items())


def _misfit(errors: Errors, foreseen: Errors) -> Misfit:
    """Over what is no surprise."""
    return Misfit(errors.fit / foreseen.fit, errors.hold_out / foreseen.hold_out / _UNFORESEEN)


def _errors(by_recording: Mapping[str, float], fitted: int) -> Errors:
    """Root mean square over those that were fitted, and over the others."""
    # A prediction that is no number any more is infinitely far off.
    square = np.nan_to_num(np.square(list(by_recording.values())), nan=math.inf, posinf=math.inf)
    parts = (square[:fitted], square[fitted:])
    return Errors(*(math.sqrt(float(x.mean())) if x.size else math.nan for x in parts))


def _warnings(after: Errors, foreseen: Errors, unknown: float, detected: bool) -> list[str]:
    """What to think of the errors that are left."""
    told = []
    if math.isnan(after.hold_out):
        told.append("No recording was held out, so nothing shows that the verdict holds")
    ratio = after.fit / foreseen.fit
    if ratio > _UNEXPLAINED:
        rest = "also with it" if detected else "and nothing that was tried explains it"
        told.append(
            f"The fitted recordings are {ratio:.2g} times their deviations off, {rest} "
            f"(probability {unknown:.2f} that something else is missing)"
        )
    ratio = after.hold_out / foreseen.hold_out
    if ratio > _UNFORESEEN:
        told.append(
            f"The held-out recordings are off by {ratio:.2g} times their deviations: either "
            "something acts there that those fitted do not show, or the joint was fitted to the "
            f"wrong end (probability {unknown:.2f} that something else is missing)"
        )
    return told
