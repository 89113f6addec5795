"""Hypotheses against one another: from a screening of all to free runs of the last few."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from iwanjax.discrepancy import suspicion
from iwanjax.discrepancy.catalogue import JointKind, Kind
from iwanjax.discrepancy.evidence import Evidence, evidence, shares, values_measured
from iwanjax.discrepancy.fitting import SHORT, Fitted, evaluate, fit_all
from iwanjax.discrepancy.joint_faults import with_joint_faults
from iwanjax.discrepancy.rounds import (
    MIDDLE,
    MISFIT,
    RACE,
    STEPS,
    Entry,
    Grounds,
    again,
    cost_of,
    least,
    placed,
)
from iwanjax.discrepancy.screen import Candidate, screen
from iwanjax.discrepancy.search import Search, Start
from iwanjax.discrepancy.verdict import Score

# Memories of the observer to polish with, in cycles.
_LONG = (40.0, math.inf)
# Relative gain that is worth another step while many suspects are still in the race.
_ROUGH = 1e-2
# Starts of the joints; how many suspects are tried from other joints, how many of these, and the
# memory to begin with.
_STARTS = 4
_RESTARTED, _RESTARTS, _SHORTEST = 2, 8, 1.0
# Hypotheses that are refitted with a memory of two, eight and thirty cycles.
_FIRST, _SECOND, _THIRD = 12, 6, 3
# Something is missing when the evidence for it exceeds that for nothing by this. The model's
# own errors, of integration for instance, may be worth this share of the squared residual.
_LEAST_GAIN, _INDULGENCE = 12.0, 0.06
# Squared residual over the noise's from which on a second suspect is looked for, how many times
# it has to lessen what is more than a right model leaves, and by how much evidence.
_TWO, _FALL, _RIGHT, _SECOND_GAIN = 1.15, 3.0, 0.9, 15.0
# Times the best cost until which the nominal model may catch up with its best rival.
_OUT_OF_SIGHT = 100.0
# Drop of the first in a screening from which on no other screening is needed.
_CLEAR = 0.8
# Squared residual over the noise's from which on the joints as given are looked from as well.
_FAR = 3.0
# Share of the best one's drop from which on a suspect is worth a refit; costs that are the same.
_HOPELESS, _SAME = 0.15, 1.02
# Evidence that a screening has to promise before a suspect is refitted.
_LEAST_PROMISE = 3.0


class Table(NamedTuple):
    """How it ended.

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

    @property
    def probability_of_nothing(self) -> float:
        """Among everything."""
        return float(shares(self._behind)[0])

    def probability(self, entry: Entry) -> float:
        """Of one, among everything."""
        return float(shares(self._behind)[1 + self.entries.index(entry)])

    @property
    def _behind(self) -> np.ndarray:
        return np.array([self.nominal.behind, *(entry.behind for entry in self.entries)])


def run(search: Search, grounds: Grounds, seed: int) -> Table:
    """The whole competition."""
    grounds.progress("refitting the joints")
    nominal = _nominal(search, grounds, seed)
    grounds.progress("screening kinds and places")
    candidates = _screened(search, nominal, grounds)
    screened = [candidates]
    clear = bool(candidates) and candidates[0].drop > _CLEAR
    if nominal.cost > _FAR * values_measured(search) and not clear:
        # Joints that were bent to explain something else are a bad place to look from.
        given = Start(search.nothing(), np.zeros(search.parameters + 2))
        screened.append(_screened(search, fit_all(search, [given], SHORT, 0)[0], grounds))
    grounds.progress("refitting suspects")
    entries = _first(search, nominal, screened, grounds)
    near = [e for e in entries[:_SECOND] if e.fitted.cost < RACE * entries[0].fitted.cost]
    shorts = entries
    entries = again(near, entries[len(near) :], MIDDLE, grounds)
    entries = _restarted(search, nominal, entries, grounds, seed)
    # A local minimum of the joints would be a false alarm: the winner's joints may be better.
    nominal = _renominated(search, nominal, entries, grounds)
    base, entries = _ranked(Entry(search, nominal), entries)
    entries = _doubled(search, base, entries, grounds)
    entries = with_joint_faults(search, nominal, shorts, entries, candidates, grounds)
    base, entries = _ranked(base, entries)
    detected = bool(entries) and _missing(base, entries[0])
    grounds.progress("polishing to the free run")
    # Rivals that are far behind stay where they are.
    close = [e for e in entries[:_THIRD] if e.fitted.cost < RACE * entries[0].fitted.cost]
    count = len(close) if detected else 0
    for cycles in _LONG:
        polished = again([base, *entries[:count]], [], cycles, grounds)
        base = next(e for e in polished if not e.fitted.hypothesis.kinds)
        rest = [e for e in polished if e.fitted.hypothesis.kinds]
        entries = [*rest, *entries[count:]]
    if detected:
        base, first = _ranked(base, entries[:count])
        # What a longer memory does not bear out was an error of the model's own.
        detected = _missing(base, first[0])
        floor = min((e.behind for e in first), default=0.0)
        entries = [*first, *(replace(e, behind=min(e.behind, floor)) for e in entries[count:])]
    scores = tuple(
        Score(c.start.hypothesis.kinds[-1].name, c.start.hypothesis.where[-1], c.drop)
        for c in candidates
    )
    return Table(detected, base, tuple(entries), scores)


def _screened(search: Search, base: Fitted, grounds: Grounds) -> list[Candidate]:
    return screen(search, base, grounds.kinds, grounds.places, grounds.sensors, grounds.joints)


def _nominal(search: Search, grounds: Grounds, seed: int) -> Fitted:
    """Joints refitted from several starts: a local minimum here would be a false alarm."""
    random = np.random.default_rng(seed)
    draws = random.standard_normal((_STARTS - 1, search.parameters))
    starts = [
        Start(search.nothing(), np.append(z, [0.0, 0.0]))
        for z in (np.zeros(search.parameters), *draws)
    ]
    found = fit_all(search, starts, SHORT, STEPS, race=RACE, in_time=grounds.in_time)
    found.sort(key=lambda each: each.cost)
    # Those that came to the same end are one.
    other = [each for each in found[1:] if each.cost > _SAME * found[0].cost]
    starts = [each.start for each in (found[0], *other[:1])]
    found = fit_all(search, starts, MIDDLE, STEPS, race=RACE, in_time=grounds.in_time)
    return min(found, key=lambda each: each.cost)


def _first(
    search: Search, nominal: Fitted, screened: Sequence[Sequence[Candidate]], grounds: Grounds
) -> list[Entry]:
    """The best candidates, the rivals at the best place, and joints' faults, refitted."""
    least = _LEAST_PROMISE / max(evidence(search, [nominal]).worth(nominal), 1e-300)
    promising = [[c for c in each if c.drop > least] for each in screened]
    far = nominal.cost > _FAR * values_measured(search)
    chosen: dict[tuple[str, ...], list[Start]] = {}
    for candidates in promising:
        best = candidates[0].start.hypothesis.where[-1] if candidates else ""
        for rank, c in enumerate(candidates):
            hypothesis = c.start.hypothesis
            rival = hypothesis.where[-1] == best or hypothesis.drifting is not None
            if c.drop > _HOPELESS * candidates[0].drop and (rank < _FIRST or rival):
                chosen.setdefault(hypothesis.variant, []).extend(_starts(search, c, far))
    found = fit_all(
        search,
        _begun(search, list(chosen.values())),
        SHORT,
        STEPS,
        tolerance=_ROUGH,
        race=RACE,
        in_time=grounds.in_time,
    )
    return placed([Entry(search, each) for each in found])


def _starts(search: Search, candidate: Candidate, far: bool) -> list[Start]:
    """A candidate with the joints it was screened with, and as given where these are bent."""
    start, p = candidate.start, search.parameters
    given = Start(start.hypothesis, np.concatenate([np.zeros(p), start.common[p:]]))
    return [start, given] if far else [start]


def _begun(search: Search, choices: Sequence[Sequence[Start]]) -> list[Start]:
    """For each hypothesis the best of its starts."""
    lanes = [(s.hypothesis, search.still(s.common)) for starts in choices for s in starts]
    if len(lanes) == len(choices):
        return [starts[0] for starts in choices]
    costs = iter([float(seen.misfit.sum()) for seen in evaluate(search, lanes, SHORT)])
    return [min(starts, key=lambda _: next(costs)) for starts in choices]


def _restarted(
    search: Search, nominal: Fitted, entries: list[Entry], grounds: Grounds, seed: int
) -> list[Entry]:
    """The best suspects from joints all over their prior, where they leave something.

    With several joints and a strong suspect most starts end in a local minimum.
    """
    best = least(nominal, entries)
    if best.cost < MISFIT * values_measured(search) or not entries:
        return entries
    grounds.progress("refitting the best suspects from other joints")
    random = np.random.default_rng(seed)
    p = search.parameters
    found = list(entries)
    for i, entry in enumerate(entries[:_RESTARTED]):
        start = entry.fitted.start
        hopeless = entry.fitted.cost > RACE * best.cost
        if start.hypothesis.drifting is not None or hopeless or not grounds.in_time():
            continue
        draws = [np.zeros(p), *random.standard_normal((_RESTARTS - 1, p))]
        starts = [Start(start.hypothesis, np.concatenate([z, start.common[p:]])) for z in draws]
        fits: list[Fitted] = []
        for some in (starts[:_RESTARTED], starts[_RESTARTED:]):
            # The first few that agree are taken for all.
            if not fits or max(e.cost for e in fits) > _SAME * min(e.cost for e in fits):
                fits += fit_all(search, some, _SHORTEST, STEPS, race=RACE, in_time=grounds.in_time)
        fits.sort(key=lambda each: each.cost)
        for cycles in (SHORT, MIDDLE):
            fits = fit_all(
                search,
                [each.start for each in fits[:_RESTARTED]],
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


def _ranked(base: Entry, entries: Sequence[Entry]) -> tuple[Entry, list[Entry]]:
    """By evidence of fits with the same memory; those with another keep their distance."""
    if not entries:
        return base, []
    same = [e for e in entries if e.fitted.cycles == base.fitted.cycles]
    table = evidence(base.search, [base.fitted, *(e.fitted for e in same)])
    values = np.array(table.values)
    # For nothing the residual counts a little less: what the model's own errors are worth.
    values[0] += _INDULGENCE * table.worth(base.fitted)
    # A whole joint can look like much that is simpler: it has to explain so much more.
    values[1:] -= [
        _INDULGENCE * table.worth(e.fitted) * any(map(_is_joint, e.fitted.hypothesis.kinds))
        for e in same
    ]
    behind = values - values.max()
    ranked = [replace(e, behind=float(b)) for e, b in zip(same, behind[1:], strict=True)]
    floor = min((e.behind for e in ranked), default=0.0)
    left = [replace(e, behind=min(e.behind, floor)) for e in entries if e not in same]
    return replace(base, behind=float(behind[0])), [*sorted(ranked, key=lambda e: -e.behind), *left]


def _is_joint(kind: Kind) -> bool:
    return isinstance(kind, JointKind) and kind.name == "iwan_joint"


def _missing(base: Entry, best: Entry) -> bool:
    return best.behind - base.behind > _LEAST_GAIN


def _doubled(search: Search, base: Entry, entries: list[Entry], grounds: Grounds) -> list[Entry]:
    """A second suspect beside the first, where the first leaves much and the second takes it."""
    if not entries or not _missing(base, entries[0]) or not grounds.in_time():
        return entries
    first = entries[0]
    count = values_measured(search)
    if first.fitted.cost < _TWO * count or first.search is not search:
        return entries
    if first.fitted.hypothesis.drifting is not None:
        return entries
    grounds.progress(f"looking for more beside {first.fitted.hypothesis.label}")
    candidates = _screened(search, first.fitted, grounds)
    starts = [c.start for c in candidates[:_SECOND]]
    pairs = fit_all(search, starts, SHORT, STEPS, in_time=grounds.in_time)
    pairs.sort(key=lambda each: each.cost)
    pairs = fit_all(
        search, [each.start for each in pairs[:_THIRD]], MIDDLE, STEPS, in_time=grounds.in_time
    )
    if not pairs:
        return entries
    best = min(pairs, key=lambda each: each.cost)
    table = evidence(search, [first.fitted, best])
    before, after = (each.cost - _RIGHT * count for each in (first.fitted, best))
    if _FALL * after > before or table.values[1] - table.values[0] < _SECOND_GAIN:
        return entries
    # The second may do all alone: the first was then what looked like it before.
    singles = [suspicion.alone(search, best.start, i) for i in range(len(best.hypothesis.kinds))]
    fits = fit_all(search, singles, MIDDLE, STEPS, in_time=grounds.in_time)
    table = evidence(search, [best, *fits])
    enough = [each for each, v in zip(fits, table.values[1:], strict=True) if _enough(table, v)]
    return [Entry(search, each) for each in [*enough, best]] + entries


def _enough(table: Evidence, alone: float) -> bool:
    """Whether one suspect explains as much as a pair, whose evidence comes first."""
    return float(table.values[0]) - alone < _SECOND_GAIN
