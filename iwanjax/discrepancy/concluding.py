"""The verdict on one joint, and how much better predictions get with what it lacks."""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from iwanjax.discrepancy.judgement import Misfit, judged
from iwanjax.discrepancy.observables import Observable
from iwanjax.discrepancy.one_joint import Fit, Standing
from iwanjax.discrepancy.suspicion import Estimate
from iwanjax.discrepancy.verdict import Diagnosis, Errors, Run, Score, alike

# Evidences closer than this cannot be told apart.
_ALIKE = 3.0
# Error over the noise's from which on something is left unexplained.
_UNEXPLAINED = 1.25
# Error of held-out recordings over their deviations that uncertain parameters may account for.
_UNFORESEEN = 2.0


def concluded(
    standing: Standing[Fit],
    where: str,
    runs: tuple[Run, Run],
    fitted: int,
    estimates: Callable[[Fit], tuple[Estimate, ...]],
    *,
    observables: tuple[Observable, ...],
    scores: tuple[Score, ...] = (),
    expected: Mapping[str, float] | None = None,
    warnings: Sequence[str],
    complete: bool,
    seconds: float,
) -> Diagnosis:
    """The verdict.

    Parameters
    ----------
    standing : Standing
        Fits by evidence.
    where : str
        What the verdict calls the joint, where forces have no place of their own.
    runs : (Run, Run)
        Predictions before and after, the recordings that were fitted first.
    fitted : int
        How many these are.
    estimates : function
        Size and shape of a fit's force.
    observables : tuple of Observable
        Where the model before is clearly off.
    scores : tuple of Score
        What forces would explain at a glance, where that was looked at.
    expected : mapping of str to float, optional
        Errors that are no surprise, by recording: the noise's, unless the model's form is known
        to be off as well.
    warnings : sequence of str
        What is odd beside the errors themselves.
    complete : bool
        Whether there was time for everything.
    seconds : float
        What it took.
    """
    before, after = (_errors(run.by_recording(), fitted) for run in runs)
    floor = _errors(runs[1].floors(), fitted)
    foreseen = floor if expected is None else _errors(expected, fitted)
    verdict = judged(
        standing.nothing,
        [each.value for each in standing.entries],
        _misfit(before, foreseen),
        _misfit(after, foreseen),
    )
    listed = verdict.detected and standing.detected
    what = tuple(standing.suspects(where, verdict.named, estimates)) if listed else ()
    return Diagnosis(
        verdict=verdict,
        what=what,
        before=before,
        after=after if listed else before,
        noise_floor=floor,
        noise_floor_95=Errors(math.nan, math.nan),
        parameter_spread=Errors(math.nan, math.nan),
        indistinguishable=alike(what, _ALIKE) if what else (),
        observables=observables if verdict.detected else (),
        scores=scores,
        runs=runs if listed else (runs[0], runs[0]),
        sampling_rate=math.nan,
        restoring=None,
        warnings=(
            *warnings,
            *_warnings((before, after), foreseen, verdict.something_else, bool(what)),
        ),
        complete=complete,
        seconds=seconds,
    )


def _misfit(errors: Errors, foreseen: Errors) -> Misfit:
    """Over what is no surprise."""
    return Misfit(errors.fit / foreseen.fit, errors.hold_out / foreseen.hold_out / _UNFORESEEN)


def _errors(by_recording: Mapping[str, float], fitted: int) -> Errors:
    """Root mean square over those that were fitted, and over the others."""
    square = np.square(list(by_recording.values()))
    parts = (square[:fitted], square[fitted:])
    return Errors(*(math.sqrt(float(x.mean())) if x.size else math.nan for x in parts))


def _warnings(
    errors: tuple[Errors, Errors], foreseen: Errors, unknown: float, detected: bool
) -> list[str]:
    """What to think of the errors that are left."""
    told, (before, after) = [], errors
    if math.isnan(before.hold_out):
        told.append("No recording was held out, so nothing shows that the verdict holds")
    elif detected and after.hold_out >= before.hold_out:
        told.append(
            "What was added does not predict the held-out recordings better: take it as a hint"
        )
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
