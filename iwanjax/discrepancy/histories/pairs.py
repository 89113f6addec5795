"""Two suspects at once: a second beside the first, and each of them questioned again."""

from collections.abc import Sequence

from iwanjax.discrepancy.evidence import INDULGENCE
from iwanjax.discrepancy.histories import hypotheses as suspicion
from iwanjax.discrepancy.histories.likelihood import Evidence, evidence, left_by_noise
from iwanjax.discrepancy.histories.multistart import SHORT, Fitted, fit_all
from iwanjax.discrepancy.histories.problem import Search, Start, Variant
from iwanjax.discrepancy.histories.ranking import (
    MIDDLE,
    MISFIT,
    RACE,
    STEPS,
    Entry,
    Grounds,
    least,
    screened,
)

# Suspects that are tried beside the first, and pairs that are fitted with a longer memory.
_SECONDS, _PARTNERS = 6, 3
# How many times a second suspect has to lessen what is more than noise leaves, and by how much
# evidence.
_FALL, _SECOND_GAIN = 3.0, 15.0
# Times that a second is looked for.
_ROUNDS = 2
# Squared residual over the noise's from which on pairs explain too little, and times the best
# suspect's until which another is worth a second beside it then.
_FAR, _AS_GOOD = 3.0, 2.0


def doubled(search: Search, entries: list[Entry], grounds: Grounds) -> list[Entry]:
    """A second suspect beside the first, where the first leaves much and the second takes it.

    Parameters
    ----------
    search : Search
        Predictor and data.
    entries : list of Entry
        Single suspects with a memory of eight cycles, the best first.
    grounds : Grounds
        What may be suspected.

    Returns
    -------
    list of Entry
        The same, after pairs, or after what turned out to do alone, if there are such.
    """
    found = entries
    for first in _firsts(search, entries):
        found = _grown(search, first, found, grounds)
        if least(first, found).cost < _FAR * left_by_noise(search):
            break
    return found


def _firsts(search: Search, entries: Sequence[Entry]) -> list[Fitted]:
    """The best suspect, and the next best at another place: alone either may be only like both."""
    first = entries[0]
    if first.search is not search or first.fitted.hypothesis.drifting is not None:
        return []
    elsewhere = [
        e.fitted
        for e in entries
        if e.search is search
        and e.fitted.cycles == first.fitted.cycles
        and e.fitted.hypothesis.drifting is None
        and e.fitted.hypothesis.where != first.fitted.hypothesis.where
        and e.fitted.cost < _AS_GOOD * first.fitted.cost
    ]
    return [first.fitted, *elsewhere[:1]]


def _grown(search: Search, first: Fitted, entries: list[Entry], grounds: Grounds) -> list[Entry]:
    """Entries after pairs with one of them, or after what turned out to do alone."""
    for _ in range(_ROUNDS):
        pairs, enough = _beside(search, first, grounds)
        if not enough:
            return [Entry(search, each) for each in pairs] + entries
        # The joints were bent, or the first was only like the second: looked at again from there.
        entries = [Entry(search, each) for each in enough] + entries
        first = enough[0]
    return entries


def _beside(search: Search, first: Fitted, grounds: Grounds) -> tuple[list[Fitted], list[Fitted]]:
    """Pairs that explain much more than a suspect alone, and those of the best that do alone."""
    if not grounds.in_time():
        return [], []
    noise, table = left_by_noise(search), evidence(search, [first])
    # No second suspect takes more than what exceeds the noise.
    if (1.0 - noise / first.cost) * table.worth(first) < _margin(table, first):
        return [], []
    grounds.progress(f"looking for more beside {first.hypothesis.label}")
    candidates = screened(search, first, grounds)
    promise = candidates[0].drop * table.worth(first) if candidates else 0.0
    if first.cost < MISFIT * noise and promise < _margin(table, first):
        return [], []
    starts = [c.start for c in candidates[:_SECONDS]]
    pairs = fit_all(search, starts, SHORT, STEPS, at_most=_PARTNERS, in_time=grounds.in_time)
    pairs.sort(key=lambda each: each.cost)
    pairs = fit_all(
        search, [each.start for each in pairs[:_PARTNERS]], MIDDLE, STEPS, in_time=grounds.in_time
    )
    if not pairs:
        return [], []
    best = min(pairs, key=lambda each: each.cost)
    before, after = (each.cost - noise for each in (first, best))
    if _FALL * after > before or _enough(search, best, [first]):
        return [], []
    # The second may do all alone: the first was then what looked like it before.
    singles = _singles(search, best, grounds)
    if best.cost > MISFIT * noise:
        pairs = [*_repaired(search, best, singles, grounds), *pairs]
        better = min(pairs, key=lambda each: each.cost)
        if better is not best:
            best, singles = better, _singles(search, better, grounds)
    near = {e.hypothesis.variant: e for e in sorted(pairs, key=lambda each: -each.cost)}
    near = [each for each in near.values() if each.cost < RACE * best.cost]
    return near, _enough(search, best, singles)


def _singles(search: Search, pair: Fitted, grounds: Grounds) -> list[Fitted]:
    """Each of a pair alone."""
    starts = [suspicion.alone(search, pair.start, i) for i in range(len(pair.hypothesis.kinds))]
    return fit_all(
        search, starts, MIDDLE, STEPS, race=RACE, best=pair.cost, in_time=grounds.in_time
    )


def _repaired(
    search: Search, pair: Fitted, singles: Sequence[Fitted], grounds: Grounds
) -> list[Fitted]:
    """Other partners for either of a pair: the first was chosen when the second was not known."""
    starts: dict[Variant, Start] = {}
    for kept, single in enumerate(singles):
        place = pair.hypothesis.where[1 - kept]
        candidates = screened(search, single, grounds)
        near = [c for c in candidates if c.start.hypothesis.where[-1] == place]
        for c in [*candidates[:_PARTNERS], *near[:_PARTNERS]]:
            starts.setdefault(c.start.hypothesis.variant, c.start)
    found = fit_all(
        search,
        list(starts.values()),
        SHORT,
        STEPS,
        race=RACE,
        at_most=_PARTNERS,
        in_time=grounds.in_time,
    )
    found.sort(key=lambda each: each.cost)
    return fit_all(
        search, [each.start for each in found[:_PARTNERS]], MIDDLE, STEPS, in_time=grounds.in_time
    )


def _enough(search: Search, pair: Fitted, singles: Sequence[Fitted]) -> list[Fitted]:
    """Single suspects that explain as much as a pair, the best first."""
    table = evidence(search, [pair, *singles])
    margin = _margin(table, pair)
    ordered = sorted(zip(table.values[1:], singles, strict=True), key=lambda each: -each[0])
    return [each for value, each in ordered if table.values[0] - value < margin]


def _margin(table: Evidence, pair: Fitted) -> float:
    """Evidence that a second suspect needs: the model's own errors are worth a part of the rest."""
    return _SECOND_GAIN + INDULGENCE * table.worth(pair)
