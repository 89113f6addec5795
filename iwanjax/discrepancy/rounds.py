"""Rounds of a competition: hypotheses fitted with the same memory, and placed by evidence."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from iwanjax.discrepancy.catalogue import Kind
from iwanjax.discrepancy.evidence import evidence
from iwanjax.discrepancy.fitting import Fitted, fit_all
from iwanjax.discrepancy.places import Place
from iwanjax.discrepancy.screen import Candidate, screen
from iwanjax.discrepancy.search import Search

MIDDLE = 8.0
"""Memory of the observer, in cycles, from which on fits are compared with one another."""
STEPS = 12
"""Steps of a search."""
RACE = 10.0
"""Times the best cost from which on a search is given up."""
MISFIT = 1.2
"""Squared residual over the noise's from which on a suspect is not all there is."""
INDULGENCE = 0.06
"""Share of the squared residual that the model's own errors, of integration say, may be worth."""
LEAST_PROMISE = 3.0
"""Evidence that a screening has to promise before a suspect is refitted."""

# Steps of a polish, and times the best cost from which on it is given up: what is left needs
# no last digit.
_POLISH, _HOPELESS = 15, 30.0
# Times that a search may take its steps again.
_MORE = 3


@dataclass(frozen=True, eq=False)
class Grounds:
    """What may be suspected, and how long there is time.

    Attributes
    ----------
    kinds : tuple of Kind
        To be tried.
    places : tuple of Place
        Where forces may act.
    sensors, joints : tuple of str
        Labels.
    in_time : function
        False when it is time to stop.
    progress : function
        Told of every stage.
    """

    kinds: tuple[Kind, ...]
    places: tuple[Place, ...]
    sensors: tuple[str, ...]
    joints: tuple[str, ...]
    in_time: Callable[[], bool]
    progress: Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Entry:
    """A hypothesis in the competition.

    Attributes
    ----------
    search : Search
        That fits it.
    fitted : Fitted
        As far as it got.
    behind : float
        Log evidence less that of the best of its last round.
    """

    search: Search
    fitted: Fitted
    behind: float = 0.0


def screened(search: Search, base: Fitted, grounds: Grounds) -> list[Candidate]:
    """All that may be suspected beside a fit, the most promising first."""
    known = (grounds.kinds, grounds.places, grounds.sensors, grounds.joints)
    return screen(search, base, *known, grounds.in_time)


def settled(search: Search, fitted: Fitted, grounds: Grounds) -> Fitted:
    """A fit, gone on with alone until its search ends by itself.

    What a search leaves that crept along a valley looks as if something were missing.
    """
    for _ in range(_MORE):
        if fitted.converged or not grounds.in_time():
            break
        (fitted,) = fit_all(search, [fitted.start], fitted.cycles, STEPS, in_time=grounds.in_time)
    return fitted


def placed(entries: Sequence[Entry]) -> list[Entry]:
    """Entries of one round that did not break down, the best first, each with its distance."""
    entries = [entry for entry in entries if math.isfinite(entry.fitted.cost)]
    if not entries:
        return []
    values = evidence(entries[0].search, [entry.fitted for entry in entries]).values
    placed = [
        replace(entry, behind=float(value - values.max()))
        for entry, value in zip(entries, values, strict=True)
    ]
    return sorted(placed, key=cost_of)


def least(nominal: Fitted, entries: Sequence[Entry]) -> Fitted:
    """The best fit with the nominal one's memory."""
    same = [e.fitted for e in entries if e.fitted.cycles == nominal.cycles]
    return min([nominal, *same], key=lambda each: each.cost)


def cost_of(entry: Entry) -> float:
    """To sort by."""
    return entry.fitted.cost


def distinct(entries: Sequence[Entry]) -> list[Entry]:
    """Of each hypothesis the one that fits best with the longest memory, the best first."""
    found = {
        entry.fitted.hypothesis.variant: entry
        for entry in sorted(entries, key=lambda e: (e.fitted.cycles, -cost_of(e)))
    }
    return sorted(found.values(), key=cost_of)


def again(
    entries: Sequence[Entry],
    others: Sequence[Entry],
    cycles: float,
    grounds: Grounds,
) -> list[Entry]:
    """Entries refitted with another memory, those of one search side by side; then the others.

    The best one's search first, so that those of others need not go on for nothing.
    """
    found: list[Entry] = []
    groups: dict[tuple[int, int], list[Entry]] = {}
    for entry in sorted(entries, key=cost_of):
        key = (id(entry.search), len(entry.fitted.hypothesis.sizes))
        groups.setdefault(key, []).append(entry)
    long = cycles > MIDDLE
    for group in groups.values():
        starts = [entry.fitted.start for entry in group]
        fits = fit_all(
            group[0].search,
            starts,
            cycles,
            _POLISH if long else STEPS,
            tolerance=1e-4 if long else 1e-3,
            race=_HOPELESS,
            best=min(map(cost_of, found), default=math.inf),
            in_time=grounds.in_time,
        )
        found += [replace(entry, fitted=fit) for entry, fit in zip(group, fits, strict=True)]
    return [*sorted(found, key=cost_of), *others]
