"""All kinds at all places judged at size zero, and the most promising of them refitted."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from iwanjax.discrepancy.findings import PlaceEvidence, Score
from iwanjax.discrepancy.histories.ranking import (
    STEPS,
    TIME_CONSTANT,
    RankedFit,
    Scope,
    again,
    placed,
    scored,
)
from iwanjax.discrepancy.histories.restarts import FAR, OUT_OF_SIGHT
from iwanjax.discrepancy.histories.score_test import (
    Candidate,
    excluded,
    most_telling,
    where_something_acts,
)
from iwanjax.effects.catalogue import kinds_of
from iwanjax.identification.hypotheses import shrunk
from iwanjax.identification.likelihood import evidence, left_by_noise
from iwanjax.identification.linearise import squares_at
from iwanjax.identification.multistart import SHORT_TIME_CONSTANT, HypothesisFit, multistart
from iwanjax.identification.problem import HistoryProblem, Start, Variant


class Screened(NamedTuple):
    """Suspects as a screening leaves them.

    Attributes
    ----------
    tests : list of list of Candidate
        About the joints as refitted, and as given where these are bent; the most promising first.
    few : bool
        Whether by fewer kinds than there are.
    shorts : list of RankedFit
        The most promising, refitted with a short memory.
    entries : list of RankedFit
        The best of these, with the memory that fits are compared with.
    """

    tests: list[list[Candidate]]
    few: bool
    shorts: list[RankedFit]
    entries: list[RankedFit]

    @property
    def candidates(self) -> list[Candidate]:
        """About the joints as refitted."""
        return self.tests[0]

    @property
    def likely(self) -> list[Candidate]:
        """Those of all tests at places where something acts."""
        return [c for each in self.tests for c in where_something_acts(each)]

    @property
    def places(self) -> tuple[PlaceEvidence, ...]:
        """All laws of a place at once, the likeliest first."""
        return most_telling(self.tests)

    @property
    def scores(self) -> tuple[Score, ...]:
        """Of each kind at each place."""
        return tuple(
            Score(c.start.hypothesis.kinds[-1].name, c.start.hypothesis.where[-1], c.drop)
            for c in self.candidates
        )

    @property
    def most_promising(self) -> list[Start]:
        """To begin with where there is no time to go on."""
        if self.entries:
            return [entry.fitted.start for entry in self.entries]
        return [c.start for c in self.candidates if c.drop > 0.0]


def screened(
    problem: HistoryProblem, nominal: HypothesisFit, scope: Scope
) -> tuple[Scope, Screened]:
    """Kinds and places judged by what they would take off, and places that help nothing left out.

    Parameters
    ----------
    problem : HistoryProblem
        Predictor and data.
    nominal : HypothesisFit
        The model with its joints refitted.
    scope : Scope
        What may be suspected.
    """
    # By fewer kinds than all a place may look empty of what they cannot do.
    few = not set(kinds_of()) <= set(scope.kinds)
    if not scope.in_time():
        return scope, Screened([[]], few, [], [])
    scope.progress("screening kinds and places")
    tests = [scored(problem, nominal, scope)]
    clear = bool(tests[0]) and most_telling(tests)[0].reduction > problem.settings.selection.clear
    if nominal.cost > FAR * left_by_noise(problem) and not clear and scope.in_time():
        # Joints that were bent to explain something else are a bad place to look from.
        given = Start(problem.nothing(), problem.map.given())
        (fit,) = multistart(problem, [given], SHORT_TIME_CONSTANT, 0)
        tests.append(scored(problem, fit, scope))
    scope = scope if few else replace(scope, excluded=excluded(tests))
    return scope, Screened(tests, few, [], [])


def with_first_fits(
    problem: HistoryProblem, nominal: HypothesisFit, seen: Screened, scope: Scope
) -> Screened:
    """The most promising refitted, and the best of these with a longer memory.

    Parameters
    ----------
    problem, nominal, scope
        As for :func:`screened`.
    seen : Screened
        Candidates.
    """
    known, noise = problem.settings.selection, left_by_noise(problem)
    if not scope.in_time():
        return seen
    scope.progress("refitting suspects")
    shorts = first_fits(problem, nominal, seen.tests, scope)
    explained = bool(shorts) and shorts[0].fitted.cost < FAR * noise
    within = FAR if explained else known.give_up
    near = [e for e in shorts[: known.second] if e.fitted.cost < within * shorts[0].fitted.cost]
    if shorts and shorts[0].fitted.cost < known.misfit * noise:
        # Beside one that explains all, a longer memory brings nobody back from so far behind.
        near = [e for e in near if e.behind > shorts[0].behind - known.hope]
    if scope.in_time():
        near = again(near, shorts[len(near) :], TIME_CONSTANT, scope)
    return seen._replace(shorts=shorts, entries=near)


def moved(seen: Screened, problem: HistoryProblem, scope: Scope) -> Screened:
    """The same suspects refitted with other steps between samples.

    Parameters
    ----------
    seen : Screened
        In the same modes.
    problem : HistoryProblem
        With these steps.
    scope : Scope
        How long there is time.
    """
    shorts, entries = (
        [replace(entry, problem=problem) for entry in each] for each in (seen.shorts, seen.entries)
    )
    near = [entry for entry in entries if entry.fitted.time_constant == TIME_CONSTANT]
    known = {entry.fitted.hypothesis.variant for entry in near}
    first = [entry for entry in shorts if entry.fitted.hypothesis.variant in known]
    # The others were far behind these, and are so still.
    rest = [entry for entry in shorts if entry.fitted.hypothesis.variant not in known]
    return seen._replace(
        shorts=placed(again(first, rest, SHORT_TIME_CONSTANT, scope)),
        entries=again(near, rest, TIME_CONSTANT, scope),
    )


def first_fits(
    problem: HistoryProblem,
    nominal: HypothesisFit,
    scored: Sequence[Sequence[Candidate]],
    scope: Scope,
) -> list[RankedFit]:
    """The best candidates at places where something acts, whatever it is, refitted."""
    known = problem.settings.selection
    least = known.least_promise / max(evidence(problem, [nominal]).worth(nominal), 1e-300)
    far = nominal.cost > FAR * left_by_noise(problem)
    # Where joints are bent something acts somewhere, though no column may show it.
    promising = [
        [
            c
            for c in where_something_acts(each)
            if c.drop > least and (far or c.place.log_evidence > 0.0)
        ]
        for each in scored
    ]
    chosen: dict[Variant, list[Start]] = {}
    for candidates in promising:
        for rank, c in enumerate(candidates):
            hypothesis = c.start.hypothesis
            if rank < known.first and c.drop > known.hopeless * candidates[0].drop:
                chosen.setdefault(hypothesis.variant, []).extend(_starts(problem, c, far))
    found = multistart(
        problem,
        withstood_starts(problem, nominal, list(chosen.values())),
        SHORT_TIME_CONSTANT,
        STEPS,
        tolerance=known.rough,
        give_up=known.give_up,
        at_most=known.field,
        in_time=scope.in_time,
    )
    return placed([RankedFit(problem, each) for each in found])


def _starts(problem: HistoryProblem, candidate: Candidate, far: bool) -> list[Start]:
    """A candidate with the joints it was screened with, and as given where these are bent."""
    start, p = candidate.start, problem.parameters
    z = problem.with_given_joints(start.common[:p])
    given = Start(start.hypothesis, np.concatenate([z, start.common[p:]]))
    return [start, given] if far else [start]


def withstood_starts(
    problem: HistoryProblem, nominal: HypothesisFit, choices: Sequence[Sequence[Start]]
) -> list[Start]:
    """For each hypothesis the best of its starts, smaller ones where the model breaks down there.

    About joints that are bent to explain something else, a size may be foreseen that no search
    comes back from.
    """
    begun: dict[int, Start] = {}
    for share in problem.settings.selection.smaller:
        points = [
            (i, shrunk(problem, start, share))
            for i, starts in enumerate(choices)
            if i not in begun
            for start in starts
        ]
        costs = squares_at(
            problem,
            [(s.hypothesis, problem.still(s.common)) for _, s in points],
            SHORT_TIME_CONSTANT,
        )
        for cost, (i, start) in sorted(zip(costs, points, strict=True), key=lambda each: each[0]):
            if cost < OUT_OF_SIGHT * nominal.cost:
                begun.setdefault(i, start)
    return [begun[i] for i in sorted(begun)]
