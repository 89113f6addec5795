"""Two suspects at once: a second beside the first, and each of them questioned again.

And two laws at one place, or one of several parameters, as a general law there shows them.
"""

from collections.abc import Sequence

import numpy as np

from iwanjax.discrepancy.histories.general_law import PlacedLaw, motion_of
from iwanjax.discrepancy.histories.joint_faults import best_of_each, compared, limited
from iwanjax.discrepancy.histories.likeness import nearest_laws, nearest_pairs
from iwanjax.discrepancy.histories.ranking import (
    STEPS,
    TIME_CONSTANT,
    RankedFit,
    Scope,
    again,
    distinct,
    least,
    placed,
    scored,
)
from iwanjax.discrepancy.histories.score_test import where_something_acts
from iwanjax.effects.kinds import ForceKind
from iwanjax.estimation.evidence import MODEL_ERROR_ALLOWANCE
from iwanjax.identification import hypotheses
from iwanjax.identification.likelihood import Evidence, evidence, left_by_noise
from iwanjax.identification.multistart import SHORT_TIME_CONSTANT, HypothesisFit, multistart
from iwanjax.identification.problem import HistoryProblem, Start, Variant
from iwanjax.identification.unnamed_law import force_in
from iwanjax.settings.stages import settings


def doubled(problem: HistoryProblem, entries: list[RankedFit], scope: Scope) -> list[RankedFit]:
    """A second suspect beside the first, where the first leaves much and the second takes it.

    Parameters
    ----------
    problem : HistoryProblem
        Predictor and data.
    entries : list of RankedFit
        Single suspects with a memory of eight cycles, the best first.
    scope : Scope
        What may be suspected.

    Returns
    -------
    list of Entry
        The same, after pairs, or after what turned out to do alone, if there are such.
    """
    found = entries
    for first in _firsts(problem, entries):
        found = _grown(problem, first, found, scope)
        if least(first, found).cost < problem.settings.pairs.far * left_by_noise(problem):
            break
    return found


def _firsts(problem: HistoryProblem, entries: Sequence[RankedFit]) -> list[HypothesisFit]:
    """The best suspect, and the next best at another place: alone either may be only like both."""
    first = entries[0]
    if first.problem is not problem or first.fitted.hypothesis.drifting is not None:
        return []
    as_good = problem.settings.pairs.as_good
    elsewhere = [
        e.fitted
        for e in entries
        if e.problem is problem
        and e.fitted.time_constant == first.fitted.time_constant
        and e.fitted.hypothesis.drifting is None
        and e.fitted.hypothesis.where != first.fitted.hypothesis.where
        and e.fitted.cost < as_good * first.fitted.cost
    ]
    return [first.fitted, *elsewhere[:1]]


def _grown(
    problem: HistoryProblem, first: HypothesisFit, entries: list[RankedFit], scope: Scope
) -> list[RankedFit]:
    """Entries after pairs with one of them, or after what turned out to do alone."""
    for _ in range(problem.settings.pairs.rounds):
        pairs, enough = partners_of(problem, first, scope)
        if not enough:
            return [RankedFit(problem, each) for each in pairs] + entries
        # The joints were bent, or the first was only like the second: looked at again from there.
        entries = [RankedFit(problem, each) for each in enough] + entries
        first = enough[0]
    return entries


def partners_of(
    problem: HistoryProblem, first: HypothesisFit, scope: Scope
) -> tuple[list[HypothesisFit], list[HypothesisFit]]:
    """Pairs that explain much more than a suspect alone, and those of the best that do alone."""
    if not scope.in_time():
        return [], []
    noise, table = left_by_noise(problem), evidence(problem, [first])
    known, own = problem.settings.selection, problem.settings.pairs
    # No second suspect takes more than what exceeds the noise.
    if (1.0 - noise / first.cost) * table.worth(first) < _margin(problem, table, first):
        return [], []
    scope.progress(f"looking for more beside {first.hypothesis.label}")
    candidates = scored(problem, first, scope)
    promise = candidates[0].drop * table.worth(first) if candidates else 0.0
    if first.cost < known.misfit * noise and promise < _margin(problem, table, first):
        return [], []
    starts = [c.start for c in where_something_acts(candidates)[: own.seconds]]
    pairs = multistart(
        problem,
        starts,
        SHORT_TIME_CONSTANT,
        STEPS,
        give_up=known.give_up,
        at_most=own.partners,
        in_time=scope.in_time,
    )
    pairs.sort(key=lambda each: each.cost)
    within = known.give_up * min((each.cost for each in pairs), default=0.0)
    pairs = multistart(
        problem,
        [each.start for each in pairs[: own.partners] if each.cost <= within],
        TIME_CONSTANT,
        STEPS,
        in_time=scope.in_time,
    )
    if not pairs:
        return [], []
    best = min(pairs, key=lambda each: each.cost)
    before, after = (each.cost - noise for each in (first, best))
    if own.fall * after > before or _enough(problem, best, [first]):
        return [], []
    # The second may do all alone: the first was then what looked like it before.
    singles = _singles(problem, best, scope)
    # Of two laws at one place that are far off another first one is no better: it has no name.
    unnamed = len(set(best.hypothesis.where)) == 1 and best.cost > own.far * noise
    if best.cost > known.misfit * noise and not unnamed:
        pairs = [*_repaired(problem, best, singles, scope), *pairs]
        better = min(pairs, key=lambda each: each.cost)
        if better is not best:
            best, singles = better, _singles(problem, better, scope)
    near = {e.hypothesis.variant: e for e in sorted(pairs, key=lambda each: -each.cost)}
    near = [each for each in near.values() if each.cost < known.give_up * best.cost]
    # Two of one kind at one place are a spectrum of it and no name: the general law's to fit.
    near = [each for each in near if not each.hypothesis.twice_the_same]
    return near, _enough(problem, best, singles)


def _singles(problem: HistoryProblem, pair: HypothesisFit, scope: Scope) -> list[HypothesisFit]:
    """Each of a pair alone."""
    starts = [hypotheses.alone(problem, pair.start, i) for i in range(len(pair.hypothesis.kinds))]
    return multistart(
        problem,
        starts,
        TIME_CONSTANT,
        STEPS,
        give_up=problem.settings.selection.give_up,
        best=pair.cost,
        in_time=scope.in_time,
    )


def _repaired(
    problem: HistoryProblem, pair: HypothesisFit, singles: Sequence[HypothesisFit], scope: Scope
) -> list[HypothesisFit]:
    """Other partners for either of a pair: the first was chosen when the second was not known."""
    starts: dict[Variant, Start] = {}
    partners = problem.settings.pairs.partners
    for kept, single in enumerate(singles):
        place = pair.hypothesis.where[1 - kept]
        candidates = scored(problem, single, scope)
        near = [c for c in candidates if c.start.hypothesis.where[-1] == place]
        for c in [*candidates[:partners], *near[:partners]]:
            starts.setdefault(c.start.hypothesis.variant, c.start)
    found = multistart(
        problem,
        list(starts.values()),
        SHORT_TIME_CONSTANT,
        STEPS,
        give_up=problem.settings.selection.give_up,
        at_most=partners,
        in_time=scope.in_time,
    )
    found.sort(key=lambda each: each.cost)
    return multistart(
        problem,
        [each.start for each in found[:partners]],
        TIME_CONSTANT,
        STEPS,
        in_time=scope.in_time,
    )


def _enough(
    problem: HistoryProblem, pair: HypothesisFit, singles: Sequence[HypothesisFit]
) -> list[HypothesisFit]:
    """Single suspects that explain as much as a pair, the best first."""
    table = evidence(problem, [pair, *singles])
    margin = _margin(problem, table, pair)
    ordered = sorted(zip(table.values[1:], singles, strict=True), key=lambda each: -each[0])
    return [each for value, each in ordered if table.values[0] - value < margin]


def _margin(problem: HistoryProblem, table: Evidence, pair: HypothesisFit) -> float:
    """Evidence that a second suspect needs: the model's own errors are worth a part of the rest."""
    return problem.settings.pairs.second_gain + MODEL_ERROR_ALLOWANCE * table.worth(pair)


def as_two_laws(problem: HistoryProblem, general: PlacedLaw, scope: Scope) -> list[RankedFit]:
    """Pairs of named laws that make the general law's force in its motion, fitted in its place.

    Greedy search finds no pair whose first law alone looks like neither: a clearance in which
    something rubs looks viscoelastic.

    Parameters
    ----------
    problem : HistoryProblem
        Of the model without any suspect.
    general : PlacedLaw
        As fitted.
    scope : Scope
        Names to try, and how long there is time.
    """
    fit, known = general.fit, problem.settings
    motion = motion_of(fit)
    force = np.asarray(force_in(fit.law, motion))
    kinds = [kind for kind in scope.kinds if isinstance(kind, ForceKind) and not kind.within]
    z, place = fit.fitted.theta.mean(axis=0)[: problem.parameters], fit.place
    starts = [
        hypotheses.joined(
            problem,
            [
                hypotheses.force(problem, kind, place.label, place.row, z, size, shape)
                for kind, size, shape in pair
            ],
        )
        for pair in nearest_pairs(kinds, motion, force)[: known.pairs.seconds]
    ]
    if not starts or not scope.in_time():
        return []
    scope.progress(f"two laws at {place.label}, as the general law there shows them")
    give_up = known.selection.give_up
    short = multistart(
        problem, starts, SHORT_TIME_CONSTANT, STEPS, give_up=give_up, in_time=scope.in_time
    )
    fits = placed([RankedFit(problem, each) for each in short])
    near = [each for each in fits if each.fitted.cost < give_up * fits[0].fitted.cost]
    found = distinct(again(near[: known.pairs.partners], [], TIME_CONSTANT, scope))
    # Two laws that together leave much are a basis to expand any force in, no names.
    return [each for each in found if each.fitted.cost < known.pairs.far * left_by_noise(problem)]


def as_one_law(
    problem: HistoryProblem,
    nominal: HypothesisFit,
    shorts: Sequence[RankedFit],
    entries: list[RankedFit],
    general: PlacedLaw,
    scope: Scope,
) -> list[RankedFit]:
    """Laws with all of their parameters that begin as the force of a general law, at its place.

    Parameters
    ----------
    problem : HistoryProblem
        Of the model without any suspect.
    nominal : HypothesisFit
        That model.
    shorts, entries : sequence of RankedFit
        Suspects with a memory of two cycles and of eight, the best first.
    general : PlacedLaw
        As fitted.
    scope : Scope
        Names to try, and how long there is time.
    """
    if not scope.in_time():
        return entries
    fit, known = general.fit, problem.settings
    motion = motion_of(fit)
    force = np.asarray(force_in(fit.law, motion))
    near = nearest_laws(scope.kinds, fit.place.scales, motion, force)
    near = [each for each in near if each.share < settings().judgement.neighbour]
    beside = problem.begun_beside(fit.fitted.theta.mean(axis=0)[: problem.parameters])
    made = []
    for kind, law, _ in near[: known.pairs.seconds]:
        starts = [hypotheses.LawStart(law, z) for z in beside]
        made.append(hypotheses.with_law(problem, kind, fit.place, starts))
        scope.progress(f"refitting {made[-1][1][0].hypothesis.label} as the general law shows it")
    limits = limited(problem, nominal, least(nominal, entries).cost, SHORT_TIME_CONSTANT)
    return compared(shorts, entries, best_of_each(made, limits, scope), scope)
