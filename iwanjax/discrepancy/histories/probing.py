"""Suspects of any size: what is too strong to be seen from size zero."""

from collections.abc import Sequence

import numpy as np

from iwanjax.discrepancy.effects import ForceKind, SensorKind
from iwanjax.discrepancy.histories.columns import units
from iwanjax.discrepancy.histories.linearise import glance
from iwanjax.discrepancy.histories.multistart import SHORT, Fitted, alike, fit_all
from iwanjax.discrepancy.histories.places import Place
from iwanjax.discrepancy.histories.problem import Search, Start, Variant
from iwanjax.discrepancy.histories.ranking import MIDDLE, RACE, STEPS, Entry, Grounds, cost_of
from iwanjax.discrepancy.histories.score_test import Candidate

# Places that are probed; largest forces as shares of what would hold the place there; suspects
# that are refitted, and those of them with a longer memory.
_PLACES, _SHARES, _REFITTED, _KEPT = 2, (0.03, 0.3, 3.0, 30.0), 4, 2


def probed(
    search: Search,
    shorts: Sequence[Entry],
    entries: list[Entry],
    candidates: list[Candidate],
    grounds: Grounds,
) -> list[Entry]:
    """All forces at the best places with sizes from weak to overwhelming, the best refitted.

    A place that hits something moves otherwise from then on: neither the size nor the kind of
    such a force follows from the motion without it.

    Parameters
    ----------
    search : Search
        Predictor and data.
    shorts, entries : sequence of Entry
        Suspects with a memory of two cycles and of eight, the best first.
    candidates : list of Candidate
        Of the screenings, the most promising of each first.
    grounds : Grounds
        What may be suspected.

    Returns
    -------
    list of Entry
        The same and what was found, the best first.
    """
    named = {place.label: place for place in grounds.places}
    labels = pointed_at(shorts, entries, candidates)
    places = [named[label] for label in labels if label in named][:_PLACES]
    if not places or not grounds.in_time():
        return entries
    grounds.progress("probing forces of any size")
    given = Start(search.nothing(), np.zeros(search.parameters + 2))
    base = fit_all(search, [given], SHORT, 0)[0]
    starts = [
        unit.sized(size)
        for unit in units(search, base, grounds.kinds, places)
        for size in _sizes(search, unit.kind, named[unit.where], np.max(np.abs(unit.force)))
    ]
    left = glance(search, [(s.hypothesis, search.still(s.theta)) for s in starts], SHORT)
    cost = [float(np.sum(e**2)) for e in left]
    best: dict[Variant, Start] = {}
    for i in np.argsort(cost):
        best.setdefault(starts[i].hypothesis.variant, starts[i])
    some = list(best.values())[:_REFITTED]
    fits = fit_all(search, some, SHORT, STEPS, race=RACE, in_time=grounds.in_time)
    fits.sort(key=lambda each: each.cost)
    new = [each.start for each in fits[:_KEPT] if not _known(each, shorts)]
    known = {entry.fitted.hypothesis.variant: entry for entry in entries}
    for each in fit_all(search, new, MIDDLE, STEPS, race=RACE, in_time=grounds.in_time):
        rival = known.get(each.hypothesis.variant)
        if rival is None or each.cost < rival.fitted.cost or rival.fitted.cycles != each.cycles:
            known[each.hypothesis.variant] = Entry(search, each)
    return sorted(known.values(), key=cost_of)


def pointed_at(
    shorts: Sequence[Entry], entries: Sequence[Entry], candidates: Sequence[Candidate]
) -> list[str]:
    """Places by rank: where eight cycles and where two point to, then the screenings.

    The former two differ where neither is near the truth, which may be at either.
    """
    found = [entry.fitted.hypothesis.where[-1] for entry in (*entries[:1], *shorts[:1])]
    return list(dict.fromkeys([*found, *(c.start.hypothesis.where[-1] for c in candidates)]))


def _known(fitted: Fitted, shorts: Sequence[Entry]) -> bool:
    """Whether the same has come to the same end before."""
    variant = fitted.hypothesis.variant
    earlier = [entry.fitted for entry in shorts if entry.fitted.hypothesis.variant == variant]
    return any(alike(fitted.residual, each.residual) for each in earlier)


def _sizes(
    search: Search, kind: ForceKind | SensorKind, place: Place, largest: float
) -> list[float]:
    """Sizes whose largest forces are shares of what the place withstands where it went to."""
    predictor, kept = search.predictor, search.predictor.kept
    squares, omega2 = np.asarray(place.row) ** 2, np.asarray(predictor.omega2)
    # A rigid body withstands nothing: what holds it is its inertia.
    elastic = omega2 > 0.0
    flexibility = np.sum(squares[:kept][elastic] / omega2[elastic])
    flexibility += np.sum(squares[kept:] * np.asarray(predictor.left))
    if not (0.0 < largest < np.inf and flexibility > 0.0):
        return []
    whole = place.scales.deflection / flexibility
    sizes = [share * whole / largest for share in _SHARES]
    return sizes if kind.positive else [*sizes, *(-size for size in sizes)]
