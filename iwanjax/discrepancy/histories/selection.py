"""Hypotheses against one another: from a screening of all to free runs of the last few."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from iwanjax.discrepancy.diagnosis import Score
from iwanjax.discrepancy.histories.estimates import determined
from iwanjax.discrepancy.histories.hypotheses import shrunk
from iwanjax.discrepancy.histories.joint_faults import (
    like_a_joint,
    with_joint_faults,
    with_joints_left_out,
)
from iwanjax.discrepancy.histories.likelihood import evidence, left_by_noise
from iwanjax.discrepancy.histories.linearise import glance
from iwanjax.discrepancy.histories.macroslip import in_the_middle
from iwanjax.discrepancy.histories.multistart import SHORT, Fitted, alike, fit_all
from iwanjax.discrepancy.histories.nested import with_limits
from iwanjax.discrepancy.histories.pairs import doubled
from iwanjax.discrepancy.histories.probing import probed
from iwanjax.discrepancy.histories.problem import Search, Start, Variant
from iwanjax.discrepancy.histories.ranking import (
    LEAST_PROMISE,
    MIDDLE,
    MISFIT,
    RACE,
    STEPS,
    Entry,
    Grounds,
    again,
    cost_of,
    distinct,
    doubted,
    finalists,
    least,
    missing,
    placed,
    ranked,
    screened,
    settled,
)
from iwanjax.discrepancy.histories.score_test import Candidate
from iwanjax.discrepancy.histories.slow_effects import appearing

# Memories of the observer to polish with, in cycles.
_LONG = (40.0, math.inf)
# Relative gain that is worth another step while many suspects are still in the race.
_ROUGH = 1e-2
# Starts of the joints; how many suspects are tried from other joints, how many of these, and the
# memory to begin with.
_STARTS = 4
_RESTARTED, _RESTARTS, _SHORTEST = 2, 8, 1.0
# Hypotheses that are refitted with a memory of two, eight and thirty cycles; the first ones of all
# screenings: what is missing was among the first five of one.
_FIRST, _SECOND, _THIRD = 12, 6, 3
# Of the first how many go on after a few steps: in 25 of 27 cases the later winner led by then,
# in the others it was second or third.
_FIELD = 8
# Times the best cost until which the nominal model may catch up with its best rival, and a start
# with the nominal model.
_OUT_OF_SIGHT = 100.0
# Shares of the size foreseen that are begun with, until the model withstands one.
_SMALLER = (1.0, 0.1, 0.01)
# Drop of the first in a screening from which on no other screening is needed.
_CLEAR = 0.8
# Squared residual over the noise's from which on the joints as given are looked from as well.
_FAR = 3.0
# Share of the best one's drop from which on a suspect is worth a refit; costs that are the same.
_HOPELESS, _SAME = 0.15, 1.02


class Table(NamedTuple):
    """How it stands, or ended.

    Attributes
    ----------
    detected : bool
        Whether something is missing.
    nominal : Entry
        The model with its joints refitted.
    entries : tuple of Entry
        Suspects, the best first.
    scores : tuple of Score
        Of the screening.
    """

    detected: bool
    nominal: Entry
    entries: tuple[Entry, ...]
    scores: tuple[Score, ...]

    @property
    def best(self) -> Entry:
        """The model to go on with."""
        return self.entries[0] if self.detected else self.nominal


def run(search: Search, grounds: Grounds, seed: int) -> Table:
    """The whole competition with the memory that fits are compared with.

    Parameters
    ----------
    search : Search
        Predictor and data.
    grounds : Grounds
        What may be suspected.
    seed : int
        Of the starts.
    """
    grounds.progress("refitting the joints")
    nominal = _nominal(search, grounds, seed)
    if not grounds.in_time():
        return Table(False, Entry(search, nominal), (), ())
    grounds.progress("screening kinds and places")
    candidates = screened(search, nominal, grounds)
    both = [candidates]
    clear = bool(candidates) and candidates[0].drop > _CLEAR
    if nominal.cost > _FAR * left_by_noise(search) and not clear and grounds.in_time():
        # Joints that were bent to explain something else are a bad place to look from.
        given = Start(search.nothing(), np.zeros(search.parameters + 2))
        both.append(screened(search, fit_all(search, [given], SHORT, 0)[0], grounds))
    scores = tuple(
        Score(c.start.hypothesis.kinds[-1].name, c.start.hypothesis.where[-1], c.drop)
        for c in candidates
    )
    if not grounds.in_time():
        return Table(False, Entry(search, nominal), (), scores)
    grounds.progress("refitting suspects")
    shorts = _first(search, nominal, both, grounds)
    explained = bool(shorts) and shorts[0].fitted.cost < _FAR * left_by_noise(search)
    within = _FAR if explained else RACE
    near = [e for e in shorts[:_SECOND] if e.fitted.cost < within * shorts[0].fitted.cost]
    if not grounds.in_time():
        # With a shorter memory than the nominal model's they cannot be held against it.
        return Table(False, Entry(search, nominal), (), scores)
    entries = again(near, shorts[len(near) :], MIDDLE, grounds)
    if least(nominal, entries).cost > _FAR * left_by_noise(search):
        entries = probed(search, shorts, entries, [c for each in both for c in each], grounds)
    entries = _restarted(search, nominal, entries, grounds, seed)
    # A local minimum of the joints would be a false alarm: the winner's joints may be better.
    if grounds.in_time():
        nominal = _renominated(search, nominal, entries, grounds)
    base, singles = ranked(Entry(search, nominal), entries)
    found = bool(singles) and missing(base, singles[0])
    if found and singles[0].fitted.cost > MISFIT * left_by_noise(search):
        fitted = settled(singles[0].search, singles[0].fitted, grounds)
        singles[0] = replace(singles[0], fitted=fitted)
    # A joint that looks like two simple forces, or one, is tried before two are looked for.
    early = like_a_joint(least(nominal, singles))
    entries = singles
    if early:
        entries = with_joints_left_out(search, nominal, shorts, entries, candidates, grounds)
    if found and not _in_a_joint(search, least(nominal, entries), entries):
        entries = distinct([*doubled(search, singles, grounds), *entries])
    if not early:
        entries = with_joints_left_out(search, nominal, shorts, entries, candidates, grounds)
    entries = with_joint_faults(search, nominal, shorts, entries, grounds)
    base, entries = ranked(base, entries)
    if entries and grounds.in_time() and _lost(search, base.fitted, entries):
        # Nothing that was tried explains all: ends that agreed may all have been the wrong one.
        entries = _restarted(search, base.fitted, entries, grounds, seed + 1, everywhere=True)
        base = replace(base, fitted=_renominated(search, base.fitted, entries, grounds))
        base, entries = ranked(base, entries)
    if entries and missing(base, entries[0]):
        base, entries = ranked(base, with_limits(search, entries, grounds))
    return Table(bool(entries) and missing(base, entries[0]), base, tuple(entries), scores)


def concluded(table: Table, search: Search, grounds: Grounds) -> Table:
    """The last few polished to the free run, and where all ended.

    Parameters
    ----------
    table : Table
        How the competition stands.
    search : Search
        The one it was run with, or the same with finer steps between samples.
    grounds : Grounds
        What may be suspected.
    """
    base, *entries = _moved([table.nominal, *table.entries], search)
    # From a free run that finer steps have changed there is no way on but the way there.
    memories = _LONG if base.fitted.cycles == MIDDLE else (MIDDLE, *_LONG)
    # A search that is still on its way may get there.
    entries = [e for e in entries if determined(e.search, e.fitted) or not e.fitted.converged]
    close = finalists(base, entries) if table.detected and entries else []
    base, close = _polished(base, close, entries, memories, grounds)
    known = {e.fitted.hypothesis.variant for e in close}
    if len(sure := _determined(close)) < len(close):
        base, close = ranked(base, sure)
    rest = [e for e in _determined(entries) if e.fitted.hypothesis.variant not in known]
    # What a longer memory does not bear out was an error of the model's own.
    detected = bool(close) and missing(base, close[0])
    if grounds.in_time():
        close = [replace(e, fitted=in_the_middle(e.search, e.fitted)) for e in close]
        base = replace(base, fitted=in_the_middle(base.search, base.fitted))
    return Table(detected, base, (*close, *_behind_all(close, rest)), table.scores)


def _determined(entries: Sequence[Entry]) -> list[Entry]:
    """Entries but those whose size is not determined: they are no suspects."""
    return [e for e in entries if determined(e.search, e.fitted)]


def _moved(entries: Sequence[Entry], search: Search) -> list[Entry]:
    """Entries with the steps of another search, which takes the place of the first one's."""
    if entries[0].search is search:
        return list(entries)
    moved = {id(e.search): e.search.with_steps_of(search) for e in entries}
    moved[id(entries[0].search)] = search
    return [replace(e, search=moved[id(e.search)]) for e in entries]


def _lost(search: Search, nominal: Fitted, entries: Sequence[Entry]) -> bool:
    """Whether much is left, or a fault of a joint leaves something: that had one start only."""
    enough = _FAR if entries[0].search is search else MISFIT
    return least(nominal, entries).cost > enough * left_by_noise(search)


def _in_a_joint(search: Search, best: Fitted, entries: Sequence[Entry]) -> bool:
    """Whether a joint left out alone explains all, so that nobody need look for two others."""
    joint = any(e.fitted is best and e.search is not search for e in entries)
    return joint and best.cost < MISFIT * left_by_noise(search)


def _behind_all(first: Sequence[Entry], rest: Sequence[Entry]) -> list[Entry]:
    """Entries that were left earlier: no nearer than the last of those that were not."""
    floor = min((e.behind for e in first), default=0.0)
    return [replace(e, behind=min(e.behind, floor)) for e in rest]


def _polished(
    base: Entry,
    close: list[Entry],
    entries: Sequence[Entry],
    memories: Sequence[float],
    grounds: Grounds,
) -> tuple[Entry, list[Entry]]:
    """The nominal model and the last few suspects, or what appears only then, in the free run."""
    grounds.progress("polishing to the free run")
    for cycles in memories:
        if not grounds.in_time():
            break
        before = base.fitted
        polished = again([base, *close], [], cycles, grounds)
        base = next(e for e in polished if not e.fitted.hypothesis.kinds)
        close = [e for e in polished if e.fitted.hypothesis.kinds]
        if not close:
            late = distinct(appearing(base.search, before, base.fitted, entries, grounds))
            base, late = ranked(base, late)
            close = finalists(base, late) if late and missing(base, late[0]) else []
    base, close = ranked(base, close)
    return base, doubted(base.search, close) if close else close


def _nominal(search: Search, grounds: Grounds, seed: int) -> Fitted:
    """Joints refitted from several starts: a local minimum here would be a false alarm."""
    random = np.random.default_rng(seed)
    draws = random.standard_normal((_STARTS - 1, search.parameters))
    starts = [
        Start(search.nothing(), np.append(z, [0.0, 0.0]))
        for z in (np.zeros(search.parameters), *draws)
    ]
    found = fit_all(search, starts, SHORT, STEPS, race=RACE, in_time=grounds.in_time)
    starts = _ends(sorted(found, key=lambda each: each.cost))
    if min(each.cost for each in found) > _FAR * left_by_noise(search):
        # Bent to explain something else, one way or the other.
        starts = starts[:1]
    if not grounds.in_time():
        return min(found, key=lambda each: each.cost)
    found = fit_all(search, starts, MIDDLE, STEPS, race=RACE, in_time=grounds.in_time)
    best = min(found, key=lambda each: each.cost)
    return settled(search, best, grounds) if best.cost < _FAR * left_by_noise(search) else best


def _ends(fits: Sequence[Fitted]) -> list[Start]:
    """Where the best of fits, the best first, and the next that came to another end go on."""
    others = [each for each in fits[1:] if not alike(each.residual, fits[0].residual)]
    return [each.start for each in (fits[0], *others[:1])]


def _first(
    search: Search, nominal: Fitted, screened: Sequence[Sequence[Candidate]], grounds: Grounds
) -> list[Entry]:
    """The best candidates, the rivals at the best place, and joints' faults, refitted."""
    least = LEAST_PROMISE / max(evidence(search, [nominal]).worth(nominal), 1e-300)
    promising = [[c for c in each if c.drop > least] for each in screened]
    far = nominal.cost > _FAR * left_by_noise(search)
    chosen: dict[Variant, list[Start]] = {}
    for candidates in promising:
        best = candidates[0].start.hypothesis.where[-1] if candidates else ""
        for rank, c in enumerate(candidates):
            hypothesis = c.start.hypothesis
            rival = hypothesis.where[-1] == best or hypothesis.drifting is not None
            ahead = rank < _FIRST // len(promising)
            if c.drop > _HOPELESS * candidates[0].drop and (ahead or rival):
                chosen.setdefault(hypothesis.variant, []).extend(_starts(search, c, far))
    found = fit_all(
        search,
        _begun(search, nominal, list(chosen.values())),
        SHORT,
        STEPS,
        tolerance=_ROUGH,
        race=RACE,
        at_most=_FIELD,
        in_time=grounds.in_time,
    )
    return placed([Entry(search, each) for each in found])


def _starts(search: Search, candidate: Candidate, far: bool) -> list[Start]:
    """A candidate with the joints it was screened with, and as given where these are bent."""
    start, p = candidate.start, search.parameters
    given = Start(start.hypothesis, np.concatenate([np.zeros(p), start.common[p:]]))
    return [start, given] if far else [start]


def _begun(search: Search, nominal: Fitted, choices: Sequence[Sequence[Start]]) -> list[Start]:
    """For each hypothesis the best of its starts, smaller ones where the model breaks down there.

    About joints that are bent to explain something else, a size may be foreseen that no search
    comes back from.
    """
    begun: dict[int, Start] = {}
    for share in _SMALLER:
        lanes = [
            (i, shrunk(search, start, share))
            for i, starts in enumerate(choices)
            if i not in begun
            for start in starts
        ]
        seen = glance(search, [(s.hypothesis, search.still(s.common)) for _, s in lanes], SHORT)
        costs = [float(np.sum(e**2)) for e in seen]
        for cost, (i, start) in sorted(zip(costs, lanes, strict=True), key=lambda each: each[0]):
            if cost < _OUT_OF_SIGHT * nominal.cost:
                begun.setdefault(i, start)
    return [begun[i] for i in sorted(begun)]


def _restarted(
    search: Search,
    nominal: Fitted,
    entries: list[Entry],
    grounds: Grounds,
    seed: int,
    *,
    everywhere: bool = False,
) -> list[Entry]:
    """The best suspects from joints all over their prior, where they leave something.

    With several joints and a strong suspect most starts end in a local minimum. ``everywhere``
    takes the best one only, and all starts whether or not the first of them agree.
    """
    best = least(nominal, entries)
    if best.cost < MISFIT * left_by_noise(search) or not entries:
        return entries
    grounds.progress("refitting the best suspects from other joints")
    random = np.random.default_rng(seed)
    found, shortest = list(entries), math.inf
    for i, entry in enumerate(entries[: 1 if everywhere else _RESTARTED]):
        start, own = entry.fitted.start, entry.search
        if entry.fitted.cost > _FAR * best.cost or not grounds.in_time():
            continue
        p = own.parameters
        draws = [np.zeros(p), *random.standard_normal((_RESTARTS - 1, p))]
        starts = [Start(start.hypothesis, np.concatenate([z, start.common[p:]])) for z in draws]
        fits = _scattered(own, starts, shortest, grounds, everywhere)
        if fits[0].cost > _FAR * shortest:
            continue
        shortest = min(shortest, fits[0].cost)
        for cycles in (SHORT, MIDDLE):
            fits = fit_all(
                own,
                _ends(fits),
                cycles,
                STEPS,
                race=RACE,
                best=best.cost,
                in_time=grounds.in_time,
            )
            fits.sort(key=lambda each: each.cost)
        if fits[0].cost < entry.fitted.cost:
            found[i] = replace(entry, fitted=fits[0])
        best = min(best, fits[0], key=lambda each: each.cost)
    return sorted(found, key=cost_of)


def _scattered(
    search: Search, starts: Sequence[Start], best: float, grounds: Grounds, everywhere: bool
) -> list[Fitted]:
    """Fits from joints all over with the shortest memory, the best first.

    Unless they are to be looked for everywhere, the first few are taken for all where they agree,
    or are far behind the best of another.
    """
    fits: list[Fitted] = []
    for some in (starts[:_RESTARTED], starts[_RESTARTED:]):
        costs = [each.cost for each in fits]
        if (
            fits
            and not everywhere
            and (max(costs) < _SAME * min(costs) or min(costs) > _FAR * best)
        ):
            break
        fits += fit_all(
            search,
            some,
            _SHORTEST,
            STEPS,
            race=RACE,
            best=best,
            at_most=_THIRD,
            in_time=grounds.in_time,
        )
    return sorted(fits, key=lambda each: each.cost)


def _renominated(
    search: Search, nominal: Fitted, entries: Sequence[Entry], grounds: Grounds
) -> Fitted:
    """The nominal model from the joints of the best suspects as well."""
    p = search.parameters
    near = nominal.cost < _FAR * least(nominal, entries).cost
    starts = [
        Start(search.nothing(), np.append(entry.fitted.theta.mean(axis=0)[:p], [0.0, 0.0]))
        for entry in entries[: _THIRD if near else 1]
        if entry.search is search
    ]
    found = fit_all(
        search,
        starts,
        MIDDLE,
        STEPS,
        race=_OUT_OF_SIGHT,
        best=least(nominal, entries).cost,
        in_time=grounds.in_time,
    )
    return min([nominal, *found], key=lambda each: each.cost)
