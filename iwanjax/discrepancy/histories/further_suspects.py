"""Suspects that a score test at size zero with a short memory does not see.

Too strong ones are probed with forces of any size; what is linear is tried at every place; laws of
several parameters are tried whole; what builds up slowly appears with a longer memory of the
observer.
"""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from iwanjax.discrepancy.histories.joint_faults import (
    Limits,
    best_of_each,
    compared,
    limited,
    stuck,
)
from iwanjax.discrepancy.histories.nested import begun_from
from iwanjax.discrepancy.histories.place_test import gain_in_squares, like_no_linear_error
from iwanjax.discrepancy.histories.ranking import (
    STEPS,
    TIME_CONSTANT,
    RankedFit,
    Scope,
    cost_of,
    distinct,
    least,
    linear,
    placed,
    scored,
)
from iwanjax.discrepancy.histories.restarts import FAR
from iwanjax.discrepancy.histories.score_test import Candidate
from iwanjax.effects.faults import AbstractFault
from iwanjax.effects.kinds import ForceKind, JointKind
from iwanjax.estimation.multistart import alike
from iwanjax.identification import hypotheses
from iwanjax.identification.columns import unit_effects
from iwanjax.identification.likelihood import evidence, left_by_noise, left_by_right_model
from iwanjax.identification.linearise import squares_at
from iwanjax.identification.multistart import (
    SHORT_TIME_CONSTANT,
    HypothesisFit,
    foreseen,
    multistart,
    sifted,
)
from iwanjax.identification.places import Place
from iwanjax.identification.problem import HistoryProblem, Hypothesis, Start, Variant
from iwanjax.identification.receptance import nearest_oscillators
from iwanjax.joints import AttachedOscillator
from iwanjax.joints.motion_only import AbstractMotionOnly


def probed(
    problem: HistoryProblem,
    shorts: Sequence[RankedFit],
    entries: list[RankedFit],
    candidates: list[Candidate],
    scope: Scope,
) -> list[RankedFit]:
    """All forces at the best places with sizes from weak to overwhelming, the best refitted.

    A place that hits something moves otherwise from then on: neither the size nor the kind of
    such a force follows from the motion without it.

    Parameters
    ----------
    problem : HistoryProblem
        Predictor and data.
    shorts, entries : sequence of RankedFit
        Suspects with a memory of two cycles and of eight, the best first.
    candidates : list of Candidate
        Of the screenings, the most promising of each first.
    scope : Scope
        What may be suspected.

    Returns
    -------
    list of Entry
        The same and what was found, the best first.
    """
    settings, give_up = problem.settings.probing, problem.settings.selection.give_up
    named = {place.label: place for place in scope.places}
    labels = pointed_at(shorts, entries, candidates)
    places = [named[label] for label in labels if label in named][: settings.places]
    if not places or not scope.in_time():
        return entries
    scope.progress("probing forces of any size")
    given = Start(problem.nothing(), problem.map.given())
    base = multistart(problem, [given], SHORT_TIME_CONSTANT, 0)[0]
    starts = [
        unit.sized(size)
        for unit in unit_effects(problem, base, scope.kinds, places)
        for size in _sizes(problem, unit.kind, named[unit.where], np.max(np.abs(unit.force)))
    ]
    cost = squares_at(
        problem, [(s.hypothesis, problem.still(s.theta)) for s in starts], SHORT_TIME_CONSTANT
    )
    best: dict[Variant, Start] = {}
    for i in np.argsort(cost):
        best.setdefault(starts[i].hypothesis.variant, starts[i])
    some = list(best.values())[: settings.refitted]
    fits = multistart(
        problem, some, SHORT_TIME_CONSTANT, STEPS, give_up=give_up, in_time=scope.in_time
    )
    fits.sort(key=lambda each: each.cost)
    new = [each.start for each in fits[: settings.kept] if not _known(each, shorts)]
    known = {entry.fitted.hypothesis.variant: entry for entry in entries}
    for each in multistart(
        problem, new, TIME_CONSTANT, STEPS, give_up=give_up, in_time=scope.in_time
    ):
        rival = known.get(each.hypothesis.variant)
        if (
            rival is None
            or each.cost < rival.fitted.cost
            or rival.fitted.time_constant != each.time_constant
        ):
            known[each.hypothesis.variant] = RankedFit(problem, each)
    return sorted(known.values(), key=cost_of)


def pointed_at(
    shorts: Sequence[RankedFit], entries: Sequence[RankedFit], candidates: Sequence[Candidate]
) -> list[str]:
    """Places by rank: where eight cycles and where two point to, then the screenings.

    The former two differ where neither is near the truth, which may be at either.
    """
    found = [entry.fitted.hypothesis.where[-1] for entry in (*entries[:1], *shorts[:1])]
    return list(dict.fromkeys([*found, *(c.start.hypothesis.where[-1] for c in candidates)]))


def _known(fitted: HypothesisFit, shorts: Sequence[RankedFit]) -> bool:
    """Whether the same has come to the same end before."""
    variant = fitted.hypothesis.variant
    earlier = [entry.fitted for entry in shorts if entry.fitted.hypothesis.variant == variant]
    return any(alike(fitted.residual, each.residual) for each in earlier)


def _sizes(
    problem: HistoryProblem, kind: ForceKind | AbstractFault, place: Place, largest: float
) -> list[float]:
    """Sizes whose largest forces are shares of what the place withstands where it went to."""
    if not 0.0 < largest < np.inf:
        return []
    whole = place.scales.deflection * place.scales.stiffness
    sizes = [share * whole / largest for share in problem.settings.probing.shares]
    return sizes if kind.positive else [*sizes, *(-size for size in sizes)]


def anywhere(
    problem: HistoryProblem,
    nominal: HypothesisFit,
    shorts: Sequence[RankedFit],
    entries: list[RankedFit],
    scope: Scope,
) -> list[RankedFit]:
    """Where a linear error explains most, all of them at every place, from joints as given as well.

    Joints that are bent to do most of what is linear exclude its place by their columns: a spring
    across a lap looked like a weaker one at the tip. Where they do not, columns about joints as
    given have been looked at, too.

    Parameters
    ----------
    problem, shorts, entries, scope
        As for :func:`probed`.
    nominal : HypothesisFit
        The model with its joints refitted.

    Returns
    -------
    list of Entry
        The same and what was found, the best first.
    """
    bent = problem.joints and nominal.cost < FAR * left_by_noise(problem)
    if not (bent and linear(entries[0]) and scope.in_time()):
        return entries
    known, named = problem.settings, {place.label: place for place in scope.places}
    kinds = [kind for kind in scope.kinds if isinstance(kind, ForceKind) and kind.linear]
    scope.progress("linear errors at every place")
    z = nominal.theta.mean(axis=0)[: problem.parameters]
    bases = [Start(problem.nothing(), problem.map.given(each)) for each in problem.begun_beside(z)]
    starts = []
    for base in multistart(problem, bases, SHORT_TIME_CONSTANT, 0):
        for unit in unit_effects(problem, base, kinds, scope.places):
            largest = np.max(np.abs(unit.force))
            # The first step tells how large it is: residuals are nearly linear in that.
            small = _sizes(problem, unit.kind, named[unit.where], largest)[:1]
            starts += [unit.sized(size) for size in small]
    order = np.argsort(foreseen(problem, starts, SHORT_TIME_CONSTANT), kind="stable")
    fits = multistart(
        problem,
        [starts[i] for i in order[: known.joint_faults.near]],
        SHORT_TIME_CONSTANT,
        STEPS,
        at_most=known.selection.field,
        in_time=scope.in_time,
    )
    found = distinct(placed([RankedFit(problem, each) for each in fits]))
    return compared(shorts, entries, found, scope)


def further_laws(
    problem: HistoryProblem,
    nominal: HypothesisFit,
    shorts: Sequence[RankedFit],
    entries: list[RankedFit],
    places: Sequence[Place],
    rounds: int,
    scope: Scope,
) -> list[RankedFit]:
    """Laws with all of their parameters beside the others, where nothing else explains much.

    Where something does, those laws alone that may be taken for it, at its place.

    Parameters
    ----------
    problem, nominal, shorts, entries, scope
        As for the others.
    places : sequence of Place
        Where something acts most likely, in order.
    rounds : int
        How many of them may be the right one: so often each law is fitted, at its best place first.
    """
    best, known = least(nominal, entries), problem.settings
    enough = known.selection.misfit * left_by_right_model(problem)
    kinds = [kind for kind in scope.kinds if isinstance(kind, JointKind) and kind.law]
    if best.cost < enough:
        kinds = [kind for kind in kinds if _taken_for(kind, best.hypothesis)]
    if not kinds:
        return entries
    beside = problem.begun_beside(nominal.theta.mean(axis=0)[: problem.parameters])
    limits, found = limited(problem, nominal, best.cost, SHORT_TIME_CONSTANT), []
    near = places
    if best.cost < FAR * left_by_noise(problem):
        # What is left is small beside what was explained there: a name may be wrong, not the place.
        near = _of_the_best(places, entries, known.joint_faults.ahead * best.cost)
    most, rounds = known.selection.finalists, min(max(rounds, 1), known.selection.finalists)
    of_kinds = []
    for kind in kinds:
        assert kind.law
        scope.progress(f"sifting places: {kind.usual}")
        made = []
        here, fitted = sought_at(kind, places, near, most, rounds)
        for place in here if scope.in_time() else ():
            starts = [*begun_from(kind, place, entries[:most], problem)]
            if issubclass(kind.law, AttachedOscillator):
                starts += nearest_oscillators(problem, place, beside, SHORT_TIME_CONSTANT)
            else:
                laws = kind.law.begun(place.scales, **dict(kind.held))
                starts += [hypotheses.LawStart(law, z) for z in beside for law in laws]
            made.append(sifted(*hypotheses.with_law(problem, kind, place, starts)))
        of_kinds.append(sorted(made, key=lambda each: each.left)[:fitted])
    # Shorter, or none, where the time is over.
    for likely in itertools.zip_longest(*of_kinds):
        for own, starts, _ in filter(None, likely):
            scope.progress(f"refitting {starts[0].hypothesis.label}")
            found += best_of_each([(own, starts)], limits, scope)
        if min(map(cost_of, found), default=math.inf) < enough:
            break
    return compared(shorts, entries, found, scope)


def sought_at(
    kind: JointKind, places: Sequence[Place], near: Sequence[Place], most: int, rounds: int
) -> tuple[Sequence[Place], int]:
    """Where a law is sifted, and at how many of these it is fitted.

    At twice as many places as it may be fitted at, of those that are near what explains much
    already, once a round; one that moves on its own, such as an oscillator, wherever anything may
    act: it is unknown to the test of places, and may look like another law elsewhere.
    """
    if kind.law and issubclass(kind.law, AbstractMotionOnly):
        return places[: 2 * most], most
    return near[: 2 * most], rounds


def _taken_for(kind: JointKind, hypothesis: Hypothesis) -> bool:
    """Whether a law may look like what a hypothesis has at one place."""
    names = getattr(kind.law, "taken_for", ())
    return len(set(hypothesis.where)) == 1 and any(each.name in names for each in hypothesis.kinds)


def _of_the_best(
    places: Sequence[Place], entries: Sequence[RankedFit], within: float
) -> list[Place]:
    """Places of suspects that cost no more than this; all, where these are channels."""
    near = [e.fitted.hypothesis.where for e in entries if cost_of(e) < within]
    return [place for place in places if any(place.label in where for where in near)] or [*places]


def appearing(
    problem: HistoryProblem,
    shortest: HypothesisFit,
    now: HypothesisFit,
    entries: Sequence[RankedFit],
    scope: Scope,
) -> list[RankedFit]:
    """Suspects in what a model leaves with a longer memory and did not leave with a shorter one.

    An observer takes what differs from hit to hit, or the phase that a weak force shifts over
    many cycles, for errors of the state and corrects them away: with a short memory a drifting
    joint leaves no more than noise. Joints that stick, each a search of its own, are looked at
    where all others leave something, as with the shorter memory; and where little is left, but more
    in the free run, where noise leaves least.

    Parameters
    ----------
    problem : HistoryProblem
        Predictor and data.
    shortest, now : HypothesisFit
        The model with its joints refitted, with the memory at which nothing was found and a longer
        one.
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
    noise, grown = left_by_noise(problem), now.cost - shortest.cost
    # Of all longer memories: what builds up over them is no less for having built up in steps.
    usual = max(shortest.cost, noise)
    little = now.cost < settings.left * noise
    if little and (math.isfinite(now.time_constant) or grown < gain_in_squares(problem, now)):
        return []
    if not scope.in_time():
        return []
    scope.progress("looking again with a longer memory")
    if little:
        found = _sticking_a_little(problem, now, scope)
    else:
        found = _again_with(problem, now, entries, scope)
        best = min([now.cost, *map(cost_of, found)])
        if best > selection.misfit * usual:
            limits = limited(problem, now, best, now.time_constant)
            found += stuck(problem, now, limits, scope, now.time_constant)
    enough = now.cost - settings.new_share * (now.cost - usual)
    return placed([each for each in found if cost_of(each) < enough])


def _sticking_a_little(
    problem: HistoryProblem, now: HypothesisFit, scope: Scope
) -> list[RankedFit]:
    """Joints that stick, where no errors of the linear model do as much for what is left.

    All other kinds have been looked for in as little: these have no column at size zero, as what
    they do begins with the square of it.
    """
    (promised,) = foreseen(problem, [now.start], now.time_constant)
    limits = Limits(now.cost, promised - gain_in_squares(problem, now))
    found = stuck(problem, now, limits, scope, now.time_constant)
    best = min(map(cost_of, found), default=math.inf)
    return found if like_no_linear_error(problem, now, scope.places, best) else []


def _again_with(
    problem: HistoryProblem, now: HypothesisFit, entries: Sequence[RankedFit], scope: Scope
) -> list[RankedFit]:
    """Suspects known and the most promising ones, with the memory of a fit without any."""
    settings, selection = problem.settings.slow_effects, problem.settings.selection
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
    return [RankedFit(problem, each) for each in fits]
