"""Fitting joints and suspects to recordings, many hypotheses side by side."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from iwanjax.estimation import multistart as searches
from iwanjax.estimation.levenberg_marquardt import Layout, SearchStart
from iwanjax.estimation.linearisation import Linearisation
from iwanjax.estimation.problem import GroupedSquares, LeastSquaresSolution
from iwanjax.estimation.settings import SEARCH
from iwanjax.identification.free_values import (
    drifting_values,
    elapsed,
    free_values,
    values_measured,
)
from iwanjax.identification.joint_priors import least_of
from iwanjax.identification.linearise import linearise, residuals_at, squares_at
from iwanjax.identification.problem import HistoryProblem, Hypothesis, Start

SHORT_TIME_CONSTANT = 2.0
"""The observer's shortest memory, cycles: residuals are nearly linear in the parameters."""
# Deviations of what a joint's parameters change from the first recording to the last, and of each
# recording from an even change, in prior deviations: a soft hit tells nothing of macroslip, and
# what it leaves open is on the line.
_DRIFT, _UNEVEN = 2.0, 0.1
# Memories with which the state of a decay is estimated, cycles, and steps with each.
_OF_DECAYS, _STEPS_OF_DECAYS = (8.0, 40.0, math.inf), 3


@dataclass(frozen=True, eq=False)
class HypothesisFit:
    """A hypothesis fitted to the recordings.

    Attributes
    ----------
    hypothesis : Hypothesis
        Which.
    solution : LeastSquaresSolution
        Where the search ended; its groups are the recordings.
    time_constant : float
        Memory of the observer; infinity for the free run.
    values : int
        Length of theta without errors of the state.
    """

    hypothesis: Hypothesis
    solution: LeastSquaresSolution
    time_constant: float
    values: int

    @property
    def theta(self) -> np.ndarray:
        """Joint parameters, sizes, shapes and errors of the state, (recordings, values)."""
        return self.solution.values

    @property
    def x(self) -> np.ndarray:
        """What was free, of which theta is made, (free,)."""
        return self.solution.x

    @property
    def cost(self) -> float:
        """Sum of squared weighted innovations, and the prior's."""
        return self.solution.cost

    @property
    def converged(self) -> bool:
        """Whether the search ended by itself."""
        return self.solution.converged

    @property
    def squares(self) -> GroupedSquares:
        """Weighted innovations, recording by recording, and what they say of x."""
        assert self.solution.groups is not None
        return self.solution.groups

    @property
    def misfit(self) -> np.ndarray:
        """Sums of squared weighted innovations, (recordings,)."""
        return self.squares.misfit

    @property
    def residual(self) -> np.ndarray:
        """Weighted innovations, (recordings, N, sensors)."""
        return self.squares.residual

    @property
    def normal(self) -> np.ndarray:
        """Second derivatives of half the cost, (free, free)."""
        return self.squares.normal

    @property
    def precision(self) -> np.ndarray:
        """The prior's part of their diagonal, (free,)."""
        return self.squares.precision

    @property
    def parts(self) -> np.ndarray:
        """The recordings' parts of them, (recordings, free, free)."""
        return self.squares.parts

    @property
    def scores(self) -> np.ndarray:
        """The recordings' parts of half the cost's gradient, (recordings, free)."""
        return self.squares.scores

    @property
    def start(self) -> Start:
        """Where another search may go on."""
        return Start(self.hypothesis, self.theta[:, : self.values])


@dataclass(frozen=True, eq=False)
class _Innovations:
    """Residuals of hypotheses with one observer, as a search asks for them."""

    problem: HistoryProblem
    time_constant: float
    count: float
    keep: bool

    def residuals(self, points: Sequence[tuple[Hypothesis, np.ndarray]]) -> list[np.ndarray]:
        return residuals_at(self.problem, points, self.time_constant)

    def linearise(self, points: Sequence[tuple[Hypothesis, np.ndarray]]) -> list[Linearisation]:
        return linearise(self.problem, points, self.time_constant, self.keep)


def _innovations(
    problem: HistoryProblem, starts: Sequence[SearchStart], time_constant: float
) -> _Innovations:
    """Of searches side by side, which keep their derivatives where there is memory for all."""
    values = sum(len(each.layout.base[0]) for each in starts)
    keep = values * problem.data.response.nbytes <= problem.settings.memory.derivatives
    return _Innovations(problem, time_constant, values_measured(problem), keep)


def laid_out(problem: HistoryProblem, start: Start) -> tuple[Layout, np.ndarray]:
    """Which values are free, and where they begin."""
    hypothesis, R, p = start.hypothesis, problem.recordings, problem.parameters
    slots = len(hypothesis.sizes)
    fixed = problem.map.end(slots)
    given = np.atleast_2d(start.theta)
    known = given.shape[-1] > fixed
    states = given[:, fixed:] if known else np.zeros((R, problem.directions))
    if hypothesis.drifting is None:
        given = given.mean(axis=0, keepdims=True)
    base = np.concatenate([given[0, :fixed], np.zeros(problem.directions)])
    eye = np.eye(len(base))
    shared = free_values(problem, hypothesis)
    columns = [np.tile(eye[i], (R, 1)) for i in shared]
    precision = [1.0 if i < p else 0.0 for i in shared]
    x = [base[i] for i in shared]
    for r in range(R):
        for i in range(fixed, len(base)):
            one = np.zeros((R, len(base)))
            one[r, i] = 1.0
            columns.append(one)
            precision.append(1.0)
            x.append(states[r, i - fixed])
    if hypothesis.drifting is not None:
        line = elapsed(problem, problem.order)
        for i in drifting_values(problem, hypothesis.drifting):
            change = given[:, i] - given[0, i] if len(given) > 1 else np.zeros(R)
            columns.append(np.outer(line, eye[i]))
            precision.append(_DRIFT**-2)
            x.append(change[-1])
            for r in range(1, R):
                columns.append(np.outer(np.arange(R) == r, eye[i]))
                precision.append(_UNEVEN**-2)
                x.append(change[r] - line[r] * change[-1])
    base[shared] = 0.0
    T = np.stack(columns, axis=-1)
    border = np.full(len(x), np.inf)
    border[:p] = SEARCH.farthest
    least = np.full(len(x), -np.inf)
    least[problem.predictor.errors : p] = least_of(problem.joints)
    logs = {problem.map.shape(slot) for slot in range(slots)}
    logs |= {
        problem.map.size(slot)
        for slot in range(slots)
        if hypothesis.sizes[slot] and hypothesis.logarithmic(slot)
    }
    logarithmic = np.zeros(len(x), bool)
    logarithmic[: len(shared)] = [i in logs for i in shared]
    layout = Layout(np.tile(base, (R, 1)), T, np.array(precision), border, least, logarithmic)
    return layout, np.array(x)


def _search_start(problem: HistoryProblem, start: Start) -> SearchStart:
    return SearchStart(*laid_out(problem, start), start.hypothesis, start.hypothesis.variant)


def foreseen(problem: HistoryProblem, starts: Sequence[Start], time_constant: float) -> list[float]:
    """Costs that one full step would reach, were residuals linear in what is fitted.

    What a suspect promises, for the price of one evaluation.

    Parameters
    ----------
    problem : HistoryProblem
        Predictor and data.
    starts : sequence of Start
        Hypotheses and where they are linearised.
    time_constant : float
        Memory of the observer.

    Returns
    -------
    list of float
        Infinite where the model breaks down.
    """
    own = [_search_start(problem, start) for start in starts]
    residuals = _innovations(problem, own, time_constant)
    return [each.foreseen for each in searches.begun(residuals, own)]


class Sifted(NamedTuple):
    """Starts of one search that leave least as they are, and what the first of them leaves."""

    problem: HistoryProblem
    starts: list[Start]
    left: float


def sifted(problem: HistoryProblem, starts: Sequence[Start]) -> Sifted:
    """The most promising starts: what one step of each foresees costs ten times as much."""
    points = [(start.hypothesis, problem.still(start.theta)) for start in starts]
    left = squares_at(problem, points, SHORT_TIME_CONSTANT)
    order = np.argsort(left, kind="stable")
    near = [starts[i] for i in order[: problem.settings.joint_faults.near]]
    return Sifted(problem, near, left[order[0]])


def multistart(
    problem: HistoryProblem,
    starts: Sequence[Start],
    time_constant: float,
    steps: int,
    *,
    tolerance: float = SEARCH.host_tolerance,
    give_up: float = math.inf,
    best: float = math.inf,
    at_most: int | None = None,
    in_time: Callable[[], bool] = lambda: True,
) -> list[HypothesisFit]:
    """Levenberg-Marquardt from many starts, in step.

    The state after each pulse is free within what the force's noise allows.

    Parameters
    ----------
    problem : HistoryProblem
        Predictor and data.
    starts : sequence of Start
        Hypotheses and where to begin.
    time_constant : float
        Memory of the observer.
    steps : int
        At most.
    tolerance : float
        Relative gain below which, twice in a row, a search ends.
    give_up : float
        Times the best one's cost from which on a search is given up; later on the root of it.
    best : float
        Cost that others have reached.
    at_most : int, optional
        How many of them go on after the first few steps.
    in_time : function
        False when it is time to stop.

    Returns
    -------
    list of HypothesisFit
        One for each start.
    """
    own = [_search_start(problem, start) for start in starts]
    found = searches.multistart(
        _innovations(problem, own, time_constant),
        own,
        steps,
        tolerance=tolerance,
        give_up=give_up,
        best=best,
        at_most=at_most,
        in_time=in_time,
    )
    return [
        _fitted(problem, start.hypothesis, each, time_constant)
        for start, each in zip(starts, found, strict=True)
    ]


def moved(problem: HistoryProblem, fitted: HypothesisFit, change: np.ndarray) -> HypothesisFit:
    """A fit with other joints and everything else as it was, and what is seen there.

    Parameters
    ----------
    problem : HistoryProblem
        That it was fitted with.
    fitted : HypothesisFit
        To start from.
    change : (parameters,) array
        Of z.
    """
    start = _search_start(problem, fitted.start)
    there = fitted.x.copy()
    there[: len(change)] += change
    residuals = _innovations(problem, [start], fitted.time_constant)
    (descent,) = searches.begun(residuals, [start._replace(x=there)])
    descent.converged = fitted.converged
    return _fitted(problem, fitted.hypothesis, descent.solution(), fitted.time_constant)


def renewed(problem: HistoryProblem, fitted: HypothesisFit) -> HypothesisFit:
    """A fit with derivatives worked out where it ended.

    A search corrects its own by the steps it takes (Broyden's update). That does for the way, not
    for a covariance: where data say next to nothing of some values together, what is left of a
    correction looks like information, or like recordings that pull against each other.

    Parameters
    ----------
    problem : HistoryProblem
        That it was fitted with.
    fitted : HypothesisFit
        Where the search ended.
    """
    return moved(problem, fitted, np.zeros(problem.parameters))


def with_states_of_decays(
    problem: HistoryProblem, hypothesis: Hypothesis, rows: np.ndarray, decays: np.ndarray
) -> np.ndarray:
    """Values with the states in which free decays began, by the decays themselves.

    The deviations of the measurement count as they are, however little the model explains: what
    is looked for is the best that it can do from any state.

    Parameters
    ----------
    problem : HistoryProblem
        Predictor and the decays.
    hypothesis : Hypothesis
        What is missing.
    rows : (recordings, values) array
        Values of each recording, errors of the state last.
    decays : (recordings,) array of bool
        Which of them are free decays.

    Returns
    -------
    (recordings, values) array
        Those of other recordings as they are.
    """
    R, V = rows.shape
    free = [(r, i) for r in np.flatnonzero(decays) for i in range(V - problem.directions, V)]
    T = np.zeros((R, V, len(free)))
    base = rows.copy()
    for k, (r, i) in enumerate(free):
        T[r, i, k], base[r, i] = 1.0, 0.0
    layout = Layout(base, T, np.ones(len(free)))
    x = np.array([rows[r, i] for r, i in free])
    for time_constant in _OF_DECAYS:
        start = SearchStart(layout, x, hypothesis)
        residuals = replace(_innovations(problem, [start], time_constant), count=math.inf)
        (found,) = searches.multistart(residuals, [start], _STEPS_OF_DECAYS)
        x = found.x
    return layout.values(x)


def _fitted(
    problem: HistoryProblem,
    hypothesis: Hypothesis,
    found: LeastSquaresSolution,
    time_constant: float,
) -> HypothesisFit:
    values = problem.map.end(len(hypothesis.sizes))
    return HypothesisFit(hypothesis, found, time_constant, values)
