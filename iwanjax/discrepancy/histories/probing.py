"""Suspects of any size: what is too strong to be seen from size zero."""

from collections.abc import Sequence

import numpy as np

from iwanjax.discrepancy.effects import ForceKind, SensorKind
from iwanjax.discrepancy.histories.columns import unit_effects
from iwanjax.discrepancy.histories.linearise import residuals_at
from iwanjax.discrepancy.histories.multistart import (
    SHORT_TIME_CONSTANT,
    HypothesisFit,
    multistart,
)
from iwanjax.discrepancy.histories.places import Place
from iwanjax.discrepancy.histories.problem import HistoryProblem, Start, Variant
from iwanjax.discrepancy.histories.ranking import (
    STEPS,
    TIME_CONSTANT,
    RankedFit,
    Scope,
    cost_of,
)
from iwanjax.discrepancy.histories.score_test import Candidate
from iwanjax.estimation.multistart import alike


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
    left = residuals_at(
        problem, [(s.hypothesis, problem.still(s.theta)) for s in starts], SHORT_TIME_CONSTANT
    )
    cost = [float(np.sum(e**2)) for e in left]
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
    problem: HistoryProblem, kind: ForceKind | SensorKind, place: Place, largest: float
) -> list[float]:
    """Sizes whose largest forces are shares of what the place withstands where it went to."""
    predictor, kept = problem.predictor, problem.predictor.kept
    squares, omega2 = np.asarray(place.row) ** 2, np.asarray(predictor.omega2)
    # A rigid body withstands nothing: what holds it is its inertia.
    elastic = omega2 > 0.0
    flexibility = np.sum(squares[:kept][elastic] / omega2[elastic])
    flexibility += np.sum(squares[kept:] * np.asarray(predictor.left))
    if not (0.0 < largest < np.inf and flexibility > 0.0):
        return []
    whole = place.scales.deflection / flexibility
    sizes = [share * whole / largest for share in problem.settings.probing.shares]
    return sizes if kind.positive else [*sizes, *(-size for size in sizes)]
