"""The final comparison: held-out recordings refuse what predicts them worse."""

from collections.abc import Callable
from typing import NamedTuple

from iwanjax.discrepancy.competition import Table
from iwanjax.discrepancy.held_out import Free
from iwanjax.discrepancy.judgement import worse
from iwanjax.discrepancy.ranking import doubted, missing, ranked
from iwanjax.discrepancy.rounds import Entry
from iwanjax.discrepancy.verdict import Refused

Runs = tuple[Free, Free | None]


class Compared(NamedTuple):
    """What is left of a competition after the held-out recordings were looked at.

    Attributes
    ----------
    table : Table
        Without what was refused.
    before, after : (Free, Free or None)
        Free runs of the fitted and the held-out recordings: of the nominal model, and of the best
        that is left (the same where nothing is).
    refused : tuple of Refused
        What explains the fitted recordings and predicts those held out worse, the best first.
    """

    table: Table
    before: Runs
    after: Runs
    refused: tuple[Refused, ...]


def compared(table: Table, run: Callable[[Entry, bool], Runs]) -> Compared:
    """The best suspect that does not predict held-out recordings worse than the model without it.

    Held-out recordings do not choose: the order is that of the evidence of fitted ones, and each
    in turn is held against the nominal model alone. What they refute is out, and so is its
    evidence; where nothing is left nothing that was tried explains the recordings. The error told
    for the second in order was looked at once more than that of the first, which is why refusals
    are told with it.

    Parameters
    ----------
    table : Table
        How the competition ended.
    run : function
        Of an entry, and whether another one takes its place: its free runs.
    """
    before = run(table.nominal, table.detected)
    refused: list[Refused] = []
    while table.detected:
        after = run(table.best, False)
        if before[1] is None or after[1] is None:
            # One side alone, where the other's run failed, compares nothing.
            return Compared(table, (before[0], None), (after[0], None), ())
        errors = before[1].relative, after[1].relative
        if not worse(*errors, before[1].floor_95):
            return Compared(table, before, after, tuple(refused))
        refused.append(Refused(table.best.fitted.hypothesis.label, *errors))
        table = _without_the_best(table)
    if refused:
        before = run(table.nominal, False)
    return Compared(table, before, before, tuple(refused))


def _without_the_best(table: Table) -> Table:
    """The others, placed anew."""
    base, entries = ranked(table.nominal, table.entries[1:])
    same = [e for e in entries if e.fitted.cycles == base.fitted.cycles]
    if same:
        entries = [*doubted(base.search, same), *entries[len(same) :]]
    detected = bool(same) and missing(base, entries[0])
    return Table(detected, base, tuple(entries), table.scores)
