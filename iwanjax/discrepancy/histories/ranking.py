"""Fits by evidence: rounds of refits with one observer, and what it takes to be the verdict."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from iwanjax.discrepancy.histories.score_test import Candidate, score_test
from iwanjax.effects.catalogue import kinds_in_time
from iwanjax.effects.kinds import Kind
from iwanjax.estimation.evidence import LEAST_GAIN, MODEL_ERROR_ALLOWANCE
from iwanjax.estimation.settings import SEARCH
from iwanjax.identification.free_values import values_measured
from iwanjax.identification.likelihood import UNSURE, Evidence, evidence, left_by_noise, scale
from iwanjax.identification.multistart import SHORT_TIME_CONSTANT, HypothesisFit, multistart
from iwanjax.identification.places import Place
from iwanjax.identification.problem import HistoryProblem, Start

TIME_CONSTANT = 8.0
"""Memory of the observer, in cycles, from which on fits are compared with one another."""
STEPS = 12
"""Steps of a search."""


@dataclass(frozen=True, eq=False)
class Scope:
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
    in_time_to_finish : function
        False when no time is left even for what a search that was stopped has found.
    inputs : tuple of str
        Labels of the measured forces.
    excluded : frozenset of str
        Places where all laws of the catalogue at once do not help.
    outside : tuple of Kind
        Kinds that are tried only where one of ``kinds`` has become one of them.
    """

    kinds: tuple[Kind, ...]
    places: tuple[Place, ...]
    sensors: tuple[str, ...]
    joints: tuple[str, ...]
    in_time: Callable[[], bool]
    progress: Callable[[str], None]
    in_time_to_finish: Callable[[], bool] = lambda: True
    inputs: tuple[str, ...] = ()
    excluded: frozenset[str] = frozenset()
    outside: tuple[Kind, ...] = ()


@dataclass(frozen=True, eq=False)
class RankedFit:
    """A hypothesis in the competition.

    Attributes
    ----------
    problem : HistoryProblem
        That fits it.
    fitted : HypothesisFit
        As far as it got.
    behind : float
        Log evidence less that of the best of its last round.
    """

    problem: HistoryProblem
    fitted: HypothesisFit
    behind: float = 0.0


def scored(problem: HistoryProblem, base: HypothesisFit, scope: Scope) -> list[Candidate]:
    """All that may be suspected beside a fit, the most promising first."""
    known = (scope.kinds, scope.places, scope.sensors, scope.joints)
    return score_test(problem, base, *known, scope.in_time, scope.inputs)


def scored_by_all(
    problem: HistoryProblem, base: HypothesisFit, scope: Scope
) -> list[list[Candidate]]:
    """The same of all kinds there are, for where is no question of names: about two models.

    By fewer of them the place of what they cannot do looks like one beside it, where they can
    nearly: a Maxwell element that was not suspected was looked for at its neighbour. The joints
    are as given, and as in a fit without suspects.
    """
    scope.progress("screening places by all kinds")
    every = replace(scope, kinds=kinds_in_time())
    own = problem.of_kinds(every.kinds)
    starts = [Start(own.nothing(), z) for z in (own.map.given(), base.start.common)]
    return [scored(own, each, every) for each in multistart(own, starts, SHORT_TIME_CONSTANT, 0)]


def settled(problem: HistoryProblem, fitted: HypothesisFit, scope: Scope) -> HypothesisFit:
    """A fit, gone on with alone until its search ends by itself.

    What a search leaves that crept along a valley looks as if something were missing.
    """
    for _ in range(problem.settings.selection.repeats):
        if fitted.converged or not scope.in_time():
            break
        (fitted,) = multistart(
            problem, [fitted.start], fitted.time_constant, STEPS, in_time=scope.in_time
        )
    return fitted


def placed(entries: Sequence[RankedFit]) -> list[RankedFit]:
    """Entries of one round that did not break down, the best first, each with its distance."""
    entries = [entry for entry in entries if math.isfinite(entry.fitted.cost)]
    if not entries:
        return []
    values = evidence(entries[0].problem, [entry.fitted for entry in entries]).values
    placed = [
        replace(entry, behind=float(value - values.max()))
        for entry, value in zip(entries, values, strict=True)
    ]
    return sorted(placed, key=cost_of)


def least(nominal: HypothesisFit, entries: Sequence[RankedFit]) -> HypothesisFit:
    """The best fit with the nominal one's memory."""
    same = [e.fitted for e in entries if e.fitted.time_constant == nominal.time_constant]
    return min([nominal, *same], key=lambda each: each.cost)


def cost_of(entry: RankedFit) -> float:
    """To sort by."""
    return entry.fitted.cost


def distinct(entries: Sequence[RankedFit]) -> list[RankedFit]:
    """Of each hypothesis the one that fits best with the longest memory, the best first."""
    found = {
        entry.fitted.hypothesis.variant: entry
        for entry in sorted(entries, key=lambda e: (e.fitted.time_constant, -cost_of(e)))
    }
    return sorted(found.values(), key=cost_of)


def tolerance_of(problem: HistoryProblem, time_constant: float) -> float:
    """Relative gain below which a search with this memory ends, and costs are the same."""
    return (
        problem.settings.selection.fine if time_constant > TIME_CONSTANT else SEARCH.host_tolerance
    )


def refitted(
    problem: HistoryProblem,
    starts: Sequence[Start],
    time_constant: float,
    best: float,
    scope: Scope,
    give_up: float | None = None,
) -> list[HypothesisFit]:
    """Fits with a memory that costs are compared at, given up far from the best one."""
    known = problem.settings.selection
    return multistart(
        problem,
        starts,
        time_constant,
        known.polish if time_constant > TIME_CONSTANT else STEPS,
        tolerance=tolerance_of(problem, time_constant),
        give_up=give_up or known.polish_give_up,
        best=best,
        in_time=scope.in_time,
    )


def again(
    entries: Sequence[RankedFit],
    others: Sequence[RankedFit],
    time_constant: float,
    scope: Scope,
) -> list[RankedFit]:
    """Entries refitted with another memory, those of one search side by side; then the others.

    The best one's search first, so that those of others need not go on for nothing.
    """
    found: list[RankedFit] = []
    groups: dict[tuple[int, int], list[RankedFit]] = {}
    for entry in sorted(entries, key=cost_of):
        key = (id(entry.problem), len(entry.fitted.hypothesis.sizes))
        groups.setdefault(key, []).append(entry)
    for group in groups.values():
        starts = [entry.fitted.start for entry in group]
        best = min(map(cost_of, found), default=math.inf)
        fits = refitted(group[0].problem, starts, time_constant, best, scope)
        found += [replace(entry, fitted=fit) for entry, fit in zip(group, fits, strict=True)]
    return [*sorted(found, key=cost_of), *others]


def finalists(base: RankedFit, entries: Sequence[RankedFit]) -> list[RankedFit]:
    """The best by evidence, and those that fit best whatever else speaks against them.

    Rivals that are far behind stay where they are. Between a kind and its limit the free run
    decides as well: with a short memory they may differ by less than the model's own errors.
    """
    known = base.problem.settings.selection
    same = [e for e in entries if e.fitted.time_constant == base.fitted.time_constant]
    values = evidence(base.problem, [e.fitted for e in same]).values
    order = [same[i] for i in np.argsort(-values, kind="stable")]
    hopeful = [
        e for e, value in zip(same, values, strict=True) if value > values.max() - known.hope
    ]
    within = known.nested_give_up * cost_of(entries[0])
    limits = [e for e in same if _parts(e) in _simpler(entries[0]) and cost_of(e) < within]
    chosen = dict.fromkeys([*entries[: known.finalists], *order[: known.best_fits], *limits])
    return [e for e in chosen if e is entries[0] or e in hopeful or e in limits]


def ranked(
    base: RankedFit, entries: Sequence[RankedFit], *, beside_linear: bool = True
) -> tuple[RankedFit, list[RankedFit]]:
    """By evidence of fits with the same memory; those with another keep their distance.

    Parameters
    ----------
    base : RankedFit
        The model without suspects.
    entries : sequence of RankedFit
        With them.
    beside_linear : bool
        Whether a law has to explain more than nothing, or than a linear limit of it, by what the
        model's own errors may be worth, as it has to beside any other.
    """
    if not entries:
        return base, []
    same = [e for e in entries if e.fitted.time_constant == base.fitted.time_constant]
    table = evidence(base.problem, [base.fitted, *(e.fitted for e in same)])
    values = _granted(base, same, table, beside_linear)
    # Rivals are told apart by what the best of them leaves, its own errors included. That nothing
    # is missing is held against the noise: a poor fit is no reason to ask for more evidence.
    least = max(1.0, left_by_noise(base.problem) / values_measured(base.problem))
    noise = table.at(base.problem, [base.fitted, *(e.fitted for e in same)], least)
    strict = _granted(base, same, noise, beside_linear) if table.temperature > least else values
    gain = float(strict[1:].max() - strict[0]) if same else 0.0
    behind = values[1:] - values[1:].max() + min(gain, 0.0) if same else values[1:]
    first = [replace(e, behind=float(b)) for e, b in zip(same, behind, strict=True)]
    floor = min((e.behind for e in first), default=0.0)
    left = [replace(e, behind=min(e.behind, floor)) for e in entries if e not in same]
    base = replace(base, behind=min(-gain, 0.0))
    return base, [*sorted(first, key=lambda e: -e.behind), *left]


def _granted(
    base: RankedFit, same: Sequence[RankedFit], table: Evidence, beside_linear: bool
) -> np.ndarray:
    """Log evidences of nothing and of entries, with what either is granted."""
    values = np.array(table.values)
    # For nothing the residual counts a little less: what the model's own errors are worth.
    if beside_linear:
        values[0] += MODEL_ERROR_ALLOWANCE * table.worth(base.fitted)
    # What has simpler kinds for its limits, or is two at once, has to explain so much more.
    for i, e in enumerate(same, 1):
        margin = MODEL_ERROR_ALLOWANCE * table.worth(e.fitted)
        simpler = [
            values[j]
            for j, o in enumerate(same, 1)
            if contains(e, o) and (beside_linear or not linear(o) or linear(e))
        ]
        if any(value > values[i] - margin for value in simpler):
            values[i] -= margin
    return values


def linear(entry: RankedFit) -> bool:
    """Whether all that is suspected is an error of the model's mass, damping or stiffness."""
    return all(getattr(kind, "linear", False) for kind in entry.fitted.hypothesis.kinds)


def contains(entry: RankedFit, other: RankedFit) -> bool:
    """Whether another one is a limit of an entry, or one of its suspects alone."""
    return _parts(other) in _simpler(entry) | _alone(entry)


def doubted(problem: HistoryProblem, entries: Sequence[RankedFit]) -> list[RankedFit]:
    """The same, as far behind the best one as its own error lets them be.

    For nothing, which the model's own error has been granted to already, nothing changes.
    """
    best = entries[0].fitted
    table = evidence(problem, [best])
    share = table.temperature * table.tau / scale(problem, best, UNSURE)
    return [replace(e, behind=e.behind * share) for e in entries]


def missing(base: RankedFit, best: RankedFit) -> bool:
    """Whether the evidence for the best suspect is enough against nothing."""
    return best.behind - base.behind > LEAST_GAIN


def containing(best: RankedFit, entries: Sequence[RankedFit]) -> tuple[tuple[str, str], ...]:
    """Suspects of the best entry, each with one it is a limit of and that explains as much.

    Both as kind@where.

    A joint that never slips is a spring and one that always does a slider: where the simpler
    one does, no data speaks against the other.
    """
    parts = _parts(best)
    return tuple(
        ("@".join(limit), "@".join(whole))
        for e in entries
        if parts in _simpler(e)
        and e.fitted.time_constant == best.fitted.time_constant
        and e.fitted.cost < (1.0 + best.problem.settings.selection.as_much) * best.fitted.cost
        for limit, whole in zip(parts - _parts(e), _parts(e) - parts, strict=True)
    )


def _parts(entry: RankedFit) -> frozenset[tuple[str, str]]:
    """What is suspected, and where."""
    hypothesis = entry.fitted.hypothesis
    names = (kind.name for kind in hypothesis.kinds)
    return frozenset(zip(names, hypothesis.where, strict=True))


def _alone(entry: RankedFit) -> set[frozenset[tuple[str, str]]]:
    """Each of several suspects."""
    parts = _parts(entry)
    return {frozenset([part]) for part in parts} if len(parts) > 1 else set()


def _simpler(entry: RankedFit) -> set[frozenset[tuple[str, str]]]:
    """The same with one suspect's limit in its place."""
    parts, hypothesis = _parts(entry), entry.fitted.hypothesis
    return {
        parts - {(kind.name, where)} | {(limit.name, where)}
        for kind, where in zip(hypothesis.kinds, hypothesis.where, strict=True)
        for limit in getattr(kind, "limits", ())
    }
