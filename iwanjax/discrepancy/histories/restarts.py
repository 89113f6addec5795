"""Refits from many joints and at every place: no local minimum is to stand for an effect."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from iwanjax.discrepancy.histories.ranking import (
    STEPS,
    TIME_CONSTANT,
    RankedFit,
    Scope,
    cost_of,
    least,
    settled,
)
from iwanjax.effects.kinds import UnnamedKind
from iwanjax.estimation.multistart import alike
from iwanjax.estimation.settings import SEARCH
from iwanjax.identification.hypotheses import LawStart
from iwanjax.identification.likelihood import left_by_noise
from iwanjax.identification.multistart import (
    SHORT_TIME_CONSTANT,
    HypothesisFit,
    multistart,
)
from iwanjax.identification.places import Place
from iwanjax.identification.problem import HistoryProblem, Start
from iwanjax.identification.unnamed_law import UnnamedFit, blank_at, fit_unnamed_law
from iwanjax.joints.unnamed_terms import LINEAR

# Starts of the joints alone.
_STARTS = 4
# How many suspects are tried from other joints, how many of these, the time constant to begin with,
# and ends of the best suspects that the nominal model begins at.
_RESTARTED, _RESTARTS, _SHORTEST, _ENDS = 2, 8, 1.0, 3
# Times the best cost until which the nominal model may catch up with its best rival, and a start
# with the nominal model.
OUT_OF_SIGHT = 100.0
# Squared residual over the noise's from which on joints are bent to explain something else.
FAR = 3.0
# Costs that are the same.
_SAME = 1.02


def nominal_fit(problem: HistoryProblem, scope: Scope, seed: int) -> HypothesisFit:
    """Joints refitted from several starts: a local minimum here would be a false alarm."""
    random = np.random.default_rng(seed)
    given = np.zeros(problem.parameters)
    starts = [
        Start(problem.nothing(), problem.map.given(z))
        for z in (given, *_scattered(problem, given, _STARTS - 1, random))
    ]
    found = multistart(
        problem,
        starts,
        SHORT_TIME_CONSTANT,
        STEPS,
        tolerance=problem.settings.selection.rough,
        give_up=problem.settings.selection.give_up,
        in_time=scope.in_time,
    )
    starts = _ends(sorted(found, key=lambda each: each.cost))
    if min(each.cost for each in found) > FAR * left_by_noise(problem):
        # Bent to explain something else, one way or the other.
        starts = starts[:1]
    if not scope.in_time():
        return min(found, key=lambda each: each.cost)
    found = multistart(
        problem,
        starts,
        TIME_CONSTANT,
        STEPS,
        give_up=problem.settings.selection.give_up,
        in_time=scope.in_time,
    )
    best = min(found, key=lambda each: each.cost)
    return settled(problem, best, scope) if best.cost < FAR * left_by_noise(problem) else best


def _scattered(
    problem: HistoryProblem, z: np.ndarray, count: int, random: np.random.Generator
) -> list[np.ndarray]:
    """Joints all over their prior, the linear model as it is."""
    errors = problem.predictor.errors
    draws = random.standard_normal((count, problem.parameters - errors))
    return [np.concatenate([z[:errors], draw]) for draw in draws]


def _ends(fits: Sequence[HypothesisFit]) -> list[Start]:
    """Where the best of fits, the best first, and the next that came to another end go on."""
    others = [each for each in fits[1:] if not alike(each.residual, fits[0].residual)]
    return [each.start for each in (fits[0], *others[:1])]


def restarted(
    problem: HistoryProblem,
    nominal: HypothesisFit,
    entries: list[RankedFit],
    scope: Scope,
    seed: int,
    *,
    everywhere: bool = False,
) -> list[RankedFit]:
    """The best suspects from joints all over their prior, where they leave something.

    With several joints and a strong suspect most starts end in a local minimum. ``everywhere``
    takes the best one only, and all starts whether or not the first of them agree.
    """
    best = least(nominal, entries)
    if best.cost < problem.settings.selection.misfit * left_by_noise(problem) or not entries:
        return entries
    scope.progress("refitting the best suspects from other joints")
    random = np.random.default_rng(seed)
    found, shortest = list(entries), math.inf
    for i, entry in enumerate(entries[: 1 if everywhere else _RESTARTED]):
        start, own = entry.fitted.start, entry.problem
        if entry.fitted.cost > FAR * best.cost or not scope.in_time():
            continue
        p = own.parameters
        z = own.with_given_joints(start.common[:p])
        draws = [z, *_scattered(own, z, _RESTARTS - 1, random)]
        starts = [Start(start.hypothesis, np.concatenate([z, start.common[p:]])) for z in draws]
        fits = scattered(own, starts, shortest, scope, everywhere)
        if fits[0].cost > FAR * shortest:
            continue
        shortest = min(shortest, fits[0].cost)
        for time_constant in (SHORT_TIME_CONSTANT, TIME_CONSTANT):
            fits = multistart(
                own,
                _ends(fits),
                time_constant,
                STEPS,
                give_up=problem.settings.selection.give_up,
                best=best.cost,
                in_time=scope.in_time,
            )
            fits.sort(key=lambda each: each.cost)
        if fits[0].cost < entry.fitted.cost:
            found[i] = replace(entry, fitted=fits[0])
        best = min(best, fits[0], key=lambda each: each.cost)
    return sorted(found, key=cost_of)


def scattered(
    problem: HistoryProblem, starts: Sequence[Start], best: float, scope: Scope, everywhere: bool
) -> list[HypothesisFit]:
    """Fits from joints all over with the shortest memory, the best first.

    Unless they are to be looked for everywhere, the first few are taken for all where they agree,
    or are far behind the best of another.
    """
    fits: list[HypothesisFit] = []
    for some in (starts[:_RESTARTED], starts[_RESTARTED:]):
        costs = [each.cost for each in fits]
        if fits and not everywhere and (max(costs) < _SAME * min(costs) or min(costs) > FAR * best):
            break
        fits += multistart(
            problem,
            some,
            _SHORTEST,
            STEPS,
            give_up=problem.settings.selection.give_up,
            best=best,
            at_most=_ENDS,
            in_time=scope.in_time,
        )
    return sorted(fits, key=lambda each: each.cost)


def renominated(
    problem: HistoryProblem, nominal: HypothesisFit, entries: Sequence[RankedFit], scope: Scope
) -> HypothesisFit:
    """The nominal model from the joints of the best suspects as well."""
    p = problem.parameters
    near = nominal.cost < FAR * least(nominal, entries).cost
    starts = [
        Start(problem.nothing(), problem.map.given(entry.fitted.theta.mean(axis=0)[:p]))
        for entry in entries[: _ENDS if near else 1]
        if entry.problem is problem
    ]
    found = multistart(
        problem,
        starts,
        TIME_CONSTANT,
        STEPS,
        give_up=OUT_OF_SIGHT,
        best=least(nominal, entries).cost,
        in_time=scope.in_time,
    )
    return min([nominal, *found], key=lambda each: each.cost)


def linear_laws(
    problem: HistoryProblem,
    nominal: HypothesisFit,
    places: Sequence[Place],
    scope: Scope,
    begun: Sequence[UnnamedFit] = (),
) -> list[UnnamedFit]:
    """What is linear at each place, fitted with the shortest memory until the search ends.

    Columns do not tell where such a force acts: joints are bent to do most of it, and what it does
    to modes that are near to what other places do is told by how strong it is.

    Parameters
    ----------
    problem, nominal, scope
        As for :func:`linear_law`.
    places : sequence of Place
        Where it may act.
    begun : sequence of UnnamedFit
        Laws at others, to be gone on with.

    Returns
    -------
    list of UnnamedFit
        Those begun, then one for each place that there was time for.
    """
    scope.progress("what is linear, at any place")
    here = (linear_law(place, problem, nominal, scope) for place in places if scope.in_time())
    known = (SHORT_TIME_CONSTANT,), STEPS, scope.in_time
    return [each.onward(*known, wider=False) for each in [*begun, *here]]


def linear_law(
    place: Place, problem: HistoryProblem, nominal: HypothesisFit, scope: Scope
) -> UnnamedFit:
    """A spring, springs that relax and a mass at a place, after a few steps.

    Parameters
    ----------
    place : Place
        Where.
    problem : HistoryProblem
        Of the model without it.
    nominal : HypothesisFit
        That model; it is begun from its joints, and from those given.
    scope : Scope
        How long there is time.
    """
    beside = problem.begun_beside(nominal.theta.mean(axis=0)[: problem.parameters])
    begun = [LawStart(blank_at(place), each) for each in beside]
    short, few = (SHORT_TIME_CONSTANT,), SEARCH.head_start
    return fit_unnamed_law(problem, UnnamedKind(), place, begun, short, few, scope.in_time, LINEAR)
