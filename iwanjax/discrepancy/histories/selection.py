"""Hypotheses against one another: from first fits of the likeliest to free runs of the last few."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from iwanjax.discrepancy.findings import PlaceEvidence, Score
from iwanjax.discrepancy.histories.further_suspects import (
    anywhere,
    appearing,
    further_laws,
    probed,
)
from iwanjax.discrepancy.histories.general_law import PlacedLaw, general_law
from iwanjax.discrepancy.histories.joint_faults import (
    like_a_joint,
    with_joint_faults,
    with_joints_left_out,
)
from iwanjax.discrepancy.histories.nested import none_worse, with_nested_laws
from iwanjax.discrepancy.histories.pairs import as_one_law, as_two_laws, doubled
from iwanjax.discrepancy.histories.ranking import (
    TIME_CONSTANT,
    RankedFit,
    Scope,
    again,
    distinct,
    doubted,
    finalists,
    least,
    missing,
    placed,
    ranked,
    refitted,
    scored_by_all,
    settled,
)
from iwanjax.discrepancy.histories.restarts import (
    FAR,
    renominated,
    restarted,
)
from iwanjax.discrepancy.histories.score_test import (
    by_evidence,
    left_likely,
    most_telling,
    where_something_acts,
)
from iwanjax.discrepancy.histories.screening import Screened
from iwanjax.errors import attempted
from iwanjax.identification.estimates import determined
from iwanjax.identification.likelihood import left_by_noise
from iwanjax.identification.macroslip import in_the_middle
from iwanjax.identification.multistart import (
    HypothesisFit,
    renewed,
)
from iwanjax.identification.problem import HistoryProblem, Start


class ModelSelection(NamedTuple):
    """How it stands, or ended.

    Attributes
    ----------
    detected : bool
        Whether something is missing.
    nominal : RankedFit
        The model with its joints refitted.
    entries : tuple of RankedFit
        Suspects, the best first.
    scores : tuple of Score
        Of the screening.
    places : tuple of PlaceEvidence
        The same of all laws of a place at once, the likeliest first.
    general : PlacedLaw, optional
        A general law with the shortest memory, where names leave much.
    failures : tuple of str
        What went wrong on the way and cost no verdict.
    """

    detected: bool
    nominal: RankedFit
    entries: tuple[RankedFit, ...]
    scores: tuple[Score, ...]
    places: tuple[PlaceEvidence, ...] = ()
    general: PlacedLaw | None = None
    failures: tuple[str, ...] = ()

    @property
    def best(self) -> RankedFit:
        """The model to go on with."""
        return self.entries[0] if self.detected else self.nominal

    def by_evidence(self) -> "ModelSelection":
        """The same, its entries in order: those left with a shorter memory came by their fits."""
        return self._replace(entries=tuple(sorted(self.entries, key=lambda e: -e.behind)))

    def on(self, problem: HistoryProblem) -> "ModelSelection":
        """The same on another search of the same suspects, in whose units costs are not yet."""
        nominal, *entries = _moved([self.nominal, *self.entries], problem)
        return self._replace(nominal=nominal, entries=tuple(entries))


def run(
    problem: HistoryProblem, nominal: HypothesisFit, seen: Screened, scope: Scope, seed: int
) -> ModelSelection:
    """The whole competition with the memory that fits are compared with.

    Parameters
    ----------
    problem : HistoryProblem
        Predictor and data.
    nominal : HypothesisFit
        The model with its joints refitted.
    seen : Screened
        Suspects that were screened, the most promising of them refitted.
    scope : Scope
        What may be suspected.
    seed : int
        Of the starts.
    """
    known, far = problem.settings.selection, FAR * left_by_noise(problem)
    shorts, entries, candidates, places = seen.shorts, seen.entries, seen.candidates, seen.places
    scores = seen.scores
    if not scope.in_time():
        rough = seen.most_promising
        return _stopped(problem, nominal, rough, scope)._replace(scores=scores, places=places)
    if least(nominal, entries).cost > far:
        entries = probed(problem, shorts, entries, seen.likely, scope)
    entries = restarted(problem, nominal, entries, scope, seed)
    # A local minimum of the joints would be a false alarm: the winner's joints may be better.
    if scope.in_time():
        nominal = renominated(problem, nominal, entries, scope)
    base, singles = ranked(RankedFit(problem, nominal), entries)
    found = bool(singles) and missing(base, singles[0])
    if found and singles[0].fitted.cost > known.misfit * left_by_noise(problem):
        fitted = settled(singles[0].problem, singles[0].fitted, scope)
        singles[0] = replace(singles[0], fitted=fitted)
    # A joint that looks like two simple forces, or one, is tried before two are looked for.
    early = like_a_joint(least(nominal, singles))
    candidates, entries = where_something_acts(candidates), singles
    if early:
        entries = with_joints_left_out(problem, nominal, shorts, entries, candidates, scope)
    if found and not _in_a_joint(problem, least(nominal, entries), entries):
        entries = distinct([*doubled(problem, singles, scope), *entries])
    if not early:
        entries = with_joints_left_out(problem, nominal, shorts, entries, candidates, scope)
    entries = with_joint_faults(problem, nominal, shorts, entries, scope)
    base, entries = ranked(base, entries)
    if entries and scope.in_time() and restart_wanted(problem, base.fitted, entries):
        # Nothing that was tried explains all: ends that agreed may all have been the wrong one.
        entries = restarted(problem, base.fitted, entries, scope, seed + 1, everywhere=True)
        base = replace(base, fitted=renominated(problem, base.fitted, entries, scope))
        base, entries = ranked(base, entries)
    general, failures = None, list[str]()
    # What even so is not explained may be a law of more parameters, or two at one place.
    if seen.few and least(base.fitted, entries).cost > far and scope.in_time():
        by_all = partial(scored_by_all, problem, base.fitted, scope)
        places = most_telling(attempted("screening by all kinds", by_all, [], failures)) or places
    likely, near = by_evidence(places, scope.places), left_likely(places, scope.places)
    entries = further_laws(problem, base.fitted, shorts, entries, likely, len(near), scope)
    if least(base.fitted, entries).cost > far and near and scope.in_time():
        law = partial(general_law, problem, base.fitted, entries, near, scope, likely[len(near) :])
        general = attempted("looking for a law that has no name", law, None, failures)
    if general is not None:
        two = partial(as_two_laws, problem, general, scope)
        pairs = attempted("looking for two laws at one place", two, [], failures)
        entries = distinct([*entries, *pairs])
        one = partial(as_one_law, problem, base.fitted, shorts, entries, general, scope)
        entries = attempted("looking for one law of several parameters", one, entries, failures)
    base, entries = ranked(base, entries)
    if entries and missing(base, entries[0]):
        simpler = partial(with_nested_laws, problem, entries, scope)
        entries = attempted("refitting simpler kinds", simpler, entries, failures)
        base, entries = ranked(base, entries)
        every = partial(anywhere, problem, base.fitted, shorts, entries, scope)
        entries = attempted("looking for a linear error at any place", every, entries, failures)
        base, entries = ranked(base, entries)
    within = partial(none_worse, base, entries, scope)
    entries = attempted("refitting laws from what they contain", within, entries, failures)
    base, entries = ranked(base, entries)
    found = bool(entries) and missing(base, entries[0])
    return ModelSelection(found, base, tuple(entries), scores, places, general, tuple(failures))


def concluded(table: ModelSelection, problem: HistoryProblem, scope: Scope) -> ModelSelection:
    """The last few polished to the free run, and where all ended.

    Parameters
    ----------
    table : ModelSelection
        How the competition stands.
    problem : HistoryProblem
        The one it was run with, or the same with finer steps between samples.
    scope : Scope
        What may be suspected.
    """
    base, *entries = _moved([table.nominal, *table.entries], problem)
    # From a free run that finer steps have changed there is no way on but the way there.
    memories = (problem.settings.selection.long_time_constant, math.inf)
    if base.fitted.time_constant != TIME_CONSTANT:
        memories = (TIME_CONSTANT, *memories)
    # A search that is still on its way may get there.
    entries = [e for e in entries if determined(e.problem, e.fitted) or not e.fitted.converged]
    close = finalists(base, entries) if table.detected and entries else []
    base, close = _polished(base, close, entries, memories, scope)
    if scope.in_time():
        ended = [replace(e, fitted=renewed(e.problem, e.fitted)) for e in (base, *close)]
        base, close = ended[0], ended[1:]
    known = {e.fitted.hypothesis.variant for e in close}
    if len(sure := _determined(close)) < len(close):
        base, close = ranked(base, sure)
    rest = [e for e in _determined(entries) if e.fitted.hypothesis.variant not in known]
    # What a longer memory does not bear out was an error of the model's own.
    detected = bool(close) and missing(base, close[0])
    if scope.in_time():
        close = [replace(e, fitted=in_the_middle(e.problem, e.fitted)) for e in close]
        base = replace(base, fitted=in_the_middle(base.problem, base.fitted))
    every = (*close, *_behind_all(close, rest))
    return table._replace(detected=detected, nominal=base, entries=every)


def _determined(entries: Sequence[RankedFit]) -> list[RankedFit]:
    """Entries but those whose size is not determined: they are no suspects."""
    return [e for e in entries if determined(e.problem, e.fitted)]


def _moved(entries: Sequence[RankedFit], problem: HistoryProblem) -> list[RankedFit]:
    """Entries with the steps of another search, which takes the place of the first one's."""
    if entries[0].problem is problem:
        return list(entries)
    moved = {id(e.problem): e.problem.with_steps_of(problem) for e in entries}
    moved[id(entries[0].problem)] = problem
    return [replace(e, problem=moved[id(e.problem)]) for e in entries]


def _stopped(
    problem: HistoryProblem, nominal: HypothesisFit, starts: Sequence[Start], scope: Scope
) -> ModelSelection:
    """The most promising suspects of a search that has no time left, against the nominal model.

    They have been fitted with a shorter memory than that one or not at all, and so cannot be held
    against it as they are.
    """
    first = {start.hypothesis.variant: start for start in reversed(starts)}
    few = list(reversed(first.values()))[: problem.settings.selection.finalists]
    base = RankedFit(problem, nominal)
    if not few or not scope.in_time_to_finish():
        return ModelSelection(False, base, (), ())
    scope.progress("refitting the most promising suspects only")
    within = replace(scope, in_time=scope.in_time_to_finish)
    fits = refitted(problem, few, TIME_CONSTANT, math.inf, within)
    entries = placed([RankedFit(problem, fit) for fit in fits])
    # As in a whole search: a local minimum of the joints would be a false alarm.
    base = RankedFit(problem, renominated(problem, nominal, entries, within))
    base, entries = ranked(base, entries)
    found = bool(entries) and missing(base, entries[0])
    return ModelSelection(found, base, tuple(entries), ())


def restart_wanted(
    problem: HistoryProblem, nominal: HypothesisFit, entries: Sequence[RankedFit]
) -> bool:
    """Whether much is left, or a fault of a joint leaves something: that had one start only."""
    enough = FAR if entries[0].problem is problem else problem.settings.selection.misfit
    return least(nominal, entries).cost > enough * left_by_noise(problem)


def _in_a_joint(problem: HistoryProblem, best: HypothesisFit, entries: Sequence[RankedFit]) -> bool:
    """Whether a joint left out alone explains all, so that nobody need look for two others."""
    joint = any(e.fitted is best and e.problem is not problem for e in entries)
    return joint and best.cost < problem.settings.selection.misfit * left_by_noise(problem)


def _behind_all(first: Sequence[RankedFit], rest: Sequence[RankedFit]) -> list[RankedFit]:
    """Entries that were left earlier: no nearer than the last of those that were not."""
    floor = min((e.behind for e in first), default=0.0)
    return [replace(e, behind=min(e.behind, floor)) for e in rest]


def _polished(
    base: RankedFit,
    close: list[RankedFit],
    entries: Sequence[RankedFit],
    memories: Sequence[float],
    scope: Scope,
) -> tuple[RankedFit, list[RankedFit]]:
    """The nominal model and the last few suspects, or what appears only then, in the free run."""
    scope.progress("polishing to the free run")
    shortest = base.fitted
    for time_constant in memories:
        if not scope.in_time():
            break
        polished = again([base, *close], [], time_constant, scope)
        base = next(e for e in polished if not e.fitted.hypothesis.kinds)
        close = [e for e in polished if e.fitted.hypothesis.kinds]
        if not close:
            late = distinct(appearing(base.problem, shortest, base.fitted, entries, scope))
            base, late = ranked(base, late)
            close = finalists(base, late) if late else []
    base, close = ranked(base, none_worse(base, close, scope))
    return base, doubted(base.problem, close) if close else close
