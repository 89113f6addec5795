"""What only a long memory of the observer shows: effects that build up slowly."""

from collections.abc import Sequence

from iwanjax.discrepancy.histories.joint_faults import limited, stuck
from iwanjax.discrepancy.histories.likelihood import evidence, left_by_noise
from iwanjax.discrepancy.histories.multistart import Fitted, fit_all
from iwanjax.discrepancy.histories.problem import Search
from iwanjax.discrepancy.histories.ranking import (
    LEAST_PROMISE,
    MISFIT,
    RACE,
    STEPS,
    Entry,
    Grounds,
    cost_of,
    placed,
    screened,
)

# Times what a shorter memory left from which on something new is looked for, and the share of
# what is new that a suspect has to take: a free run adds up the model's own errors, too.
_GROWN, _SHARE = 1.25, 0.5
# Suspects that are refitted: the best so far, and the most promising now; how many of them go on
# after a few steps.
_KNOWN, _REFITTED, _FIELD = 2, 4, 3


def appearing(
    search: Search,
    before: Fitted,
    now: Fitted,
    entries: Sequence[Entry],
    grounds: Grounds,
) -> list[Entry]:
    """Suspects in what a model leaves with a longer memory and did not leave with a shorter one.

    An observer takes what differs from hit to hit, or the phase that a weak force shifts over
    many cycles, for errors of the state and corrects them away: with a short memory a drifting
    joint leaves no more than noise. Joints that stick, each a search of its own, are looked at
    where all others leave something, as with the shorter memory.

    Parameters
    ----------
    search : Search
        Predictor and data.
    before, now : Fitted
        The model with its joints refitted, with a shorter and a longer memory.
    entries : sequence of Entry
        Suspects for which a shorter memory showed too little evidence, the best first.
    grounds : Grounds
        What may be suspected.

    Returns
    -------
    list of Entry
        Refitted with the longer memory, the best first; none where nothing new is left.
    """
    usual = max(before.cost, left_by_noise(search))
    if now.cost < _GROWN * usual or not grounds.in_time():
        return []
    grounds.progress("looking again with a longer memory")
    least = LEAST_PROMISE / evidence(search, [now]).worth(now)
    starts = [c.start for c in screened(search, now, grounds)[:_REFITTED] if c.drop > least]
    known = [e.fitted.start for e in entries if e.search is search][:_KNOWN]
    variants = [start.hypothesis.variant for start in known]
    starts = [*known, *(s for s in starts if s.hypothesis.variant not in variants)]
    fits = fit_all(
        search, starts, now.cycles, STEPS, race=RACE, at_most=_FIELD, in_time=grounds.in_time
    )
    best = min([now.cost, *(each.cost for each in fits)])
    found = [Entry(search, each) for each in fits]
    if best > MISFIT * usual:
        found += stuck(search, now, limited(search, now, best, now.cycles), grounds, now.cycles)
    enough = now.cost - _SHARE * (now.cost - usual)
    return placed([each for each in found if cost_of(each) < enough])
