"""What only a long memory of the observer shows: effects that build up slowly."""

from collections.abc import Sequence

from iwanjax.discrepancy.histories.joint_faults import limited, stuck
from iwanjax.discrepancy.histories.likelihood import evidence, left_by_noise
from iwanjax.discrepancy.histories.multistart import HypothesisFit, multistart
from iwanjax.discrepancy.histories.problem import HistoryProblem
from iwanjax.discrepancy.histories.ranking import (
    STEPS,
    RankedFit,
    Scope,
    cost_of,
    placed,
    scored,
)


def appearing(
    problem: HistoryProblem,
    before: HypothesisFit,
    now: HypothesisFit,
    entries: Sequence[RankedFit],
    scope: Scope,
) -> list[RankedFit]:
    """Suspects in what a model leaves with a longer memory and did not leave with a shorter one.

    An observer takes what differs from hit to hit, or the phase that a weak force shifts over
    many cycles, for errors of the state and corrects them away: with a short memory a drifting
    joint leaves no more than noise. Joints that stick, each a search of its own, are looked at
    where all others leave something, as with the shorter memory.

    Parameters
    ----------
    problem : HistoryProblem
        Predictor and data.
    before, now : HypothesisFit
        The model with its joints refitted, with a shorter and a longer memory.
    entries : sequence of RankedFit
        Suspects for which a shorter memory showed too little evidence, the best first.
    scope : Scope
        What may be suspected.

    Returns
    -------
    list of Entry
        Refitted with the longer memory, the best first; none where nothing new is left.
    """
    settings, selection = problem.settings.slow_effects, problem.settings.selection
    usual = max(before.cost, left_by_noise(problem))
    if now.cost < settings.grown * usual or not scope.in_time():
        return []
    scope.progress("looking again with a longer memory")
    least = selection.least_promise / evidence(problem, [now]).worth(now)
    starts = [c.start for c in scored(problem, now, scope)[: settings.refitted] if c.drop > least]
    known = [e.fitted.start for e in entries if e.problem is problem][: settings.known]
    variants = [start.hypothesis.variant for start in known]
    starts = [*known, *(s for s in starts if s.hypothesis.variant not in variants)]
    fits = multistart(
        problem,
        starts,
        now.time_constant,
        STEPS,
        give_up=selection.give_up,
        at_most=settings.field,
        in_time=scope.in_time,
    )
    best = min([now.cost, *(each.cost for each in fits)])
    found = [RankedFit(problem, each) for each in fits]
    if best > selection.misfit * usual:
        found += stuck(
            problem, now, limited(problem, now, best, now.time_constant), scope, now.time_constant
        )
    enough = now.cost - settings.new_share * (now.cost - usual)
    return placed([each for each in found if cost_of(each) < enough])
