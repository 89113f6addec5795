"""How exact a linear model is taken to be where its study does not say."""

import math
import time
from collections.abc import Callable
from dataclasses import replace

from iwanjax.discrepancy import Diagnosis
from iwanjax.identification.predictor import HeavyDampingError
from iwanjax.settings.stages import settings
from iwanjax.structures import LinearTrust

DAMPING_OPEN = LinearTrust(frequencies=0.0, damping=0.3)
"""Modal damping is measured or guessed, not computed: two tests differ by a third of it."""
USUAL = LinearTrust(frequencies=0.005, damping=0.3)
"""Frequencies as well: half a per cent is what is left of a model updated to a modal test."""


def by_usual_trust(
    diagnose: Callable[[LinearTrust | None, float], Diagnosis],
    budget: float,
    progress: Callable[[str], None],
) -> Diagnosis:
    """The diagnosis of a model whose study does not say how exact it is.

    Its damping is fitted within :data:`DAMPING_OPEN`, its frequencies are taken as given: an error
    of theirs that one spring or mass explains in all modes at once is told as that. Where this
    leaves more than noise, frequencies are fitted as well, within :data:`USUAL`, and what predicts
    the recordings better counts. A model with a mode that is damped too heavily is exact.

    Parameters
    ----------
    diagnose : function
        (trust, budget in seconds) -> diagnosis.
    budget : float
        Time to spend on all, s.
    progress : function
        Receives a line.

    Returns
    -------
    Diagnosis
        Its warnings say what was granted, where that is more than damping.
    """
    started = time.perf_counter()
    try:
        found = diagnose(DAMPING_OPEN, budget)
    except HeavyDampingError:
        return diagnose(None, budget)
    left = budget - (time.perf_counter() - started)
    if left <= 0.0 or unexplained(found) <= 1.0:
        return found
    progress("frequencies as given leave more than noise: fitting them within 0.5 % as well")
    freer = diagnose(USUAL, left)
    seconds = time.perf_counter() - started
    if not unexplained(freer) < unexplained(found):
        return replace(found, seconds=seconds)
    granted = (
        "The study does not say how exact its linear model is (trust); its frequencies were fitted "
        f"within {USUAL.frequencies:.1%}, since as given they leave more than noise"
    )
    return replace(freer, seconds=seconds, warnings=(granted, *freer.warnings))


def unexplained(found: Diagnosis) -> float:
    """Error of a verdict's model over what is worth no word; the largest of fit and held out.

    Infinite for a model that diverges, and for one that is not known.
    """
    known = settings().judgement
    ratios = [
        _over(found.after.fit, found.noise_floor.fit) / known.unexplained,
        _over(found.after.hold_out, found.noise_floor_95.hold_out) / known.unforeseen,
    ]
    measured = [ratio for ratio in ratios if not math.isnan(ratio)]
    return max(measured, default=math.inf)


def _over(error: float, floor: float) -> float:
    return error / floor if floor > 0.0 else math.inf
