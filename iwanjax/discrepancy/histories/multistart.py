"""Fitting joints and suspects to recordings, many hypotheses side by side."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from iwanjax.discrepancy.histories.levenberg_marquardt import Descent, begun, resumed
from iwanjax.discrepancy.histories.linearise import linearise, residuals_at
from iwanjax.discrepancy.histories.parameter_map import ParameterMap
from iwanjax.discrepancy.histories.problem import HistoryProblem, Hypothesis, Start, Variant

SHORT_TIME_CONSTANT = 2.0
"""The observer's shortest memory, cycles: residuals are nearly linear in the parameters."""
TOLERANCE = 1e-3
"""Relative gain below which, twice in a row, a search ends."""
# Steps before a search may be given up, and before it may be for the root of the factor.
_HEAD_START, _LATE = 3, 6
# Share of the squared residual by which two searches of a hypothesis differ that are one.
_ALIKE = 1e-2


@dataclass(frozen=True, eq=False)
class HypothesisFit:
    """A hypothesis fitted to the recordings.

    Attributes
    ----------
    hypothesis : Hypothesis
        Which.
    theta : (recordings, values) array
        Joint parameters, sizes, shapes and errors of the state.
    x : (free,) array
        What was free, of which theta is made.
    misfit : (recordings,) array
        Sums of squared weighted innovations.
    cost : float
        Their sum and the prior's.
    normal : (free, free) array
        Second derivatives of half the cost.
    precision : (free,) array
        The prior's part of its diagonal.
    parts : (recordings, free, free) array
        The recordings' parts of it.
    scores : (recordings, free) array
        Their parts of its gradient.
    residual : (recordings, N, sensors) array
        Weighted innovations.
    time_constant : float
        Memory of the observer; infinity for the free run.
    converged : bool
        Whether the search ended by itself.
    values : int
        Length of theta without errors of the state.
    """

    hypothesis: Hypothesis
    theta: np.ndarray
    x: np.ndarray
    misfit: np.ndarray
    cost: float
    normal: np.ndarray
    precision: np.ndarray = field(repr=False)
    parts: np.ndarray = field(repr=False)
    scores: np.ndarray = field(repr=False)
    residual: np.ndarray = field(repr=False)
    time_constant: float
    converged: bool
    values: int

    @property
    def start(self) -> Start:
        """Where another search may go on."""
        return Start(self.hypothesis, self.theta[:, : self.values])


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
    return [descent.foreseen for descent in begun(problem, starts, time_constant)]


def multistart(
    problem: HistoryProblem,
    starts: Sequence[Start],
    time_constant: float,
    steps: int,
    *,
    tolerance: float = TOLERANCE,
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
    race : float
        Times the best one's cost from which on a search is given up; later on the root of it.
    best : float
        Cost that others have reached.
    at_most : int, optional
        How many of them go on after the first few steps.
    in_time : function
        False when it is time to stop.

    Returns
    -------
    list of Fitted
        One for each start.
    """
    if not starts:
        return []
    descents = begun(problem, starts, time_constant)
    for step in range(steps):
        if not in_time():
            break
        if step >= _HEAD_START:
            best = min(best, *(descent.cost for descent in descents))
            within = give_up if step < _LATE else math.sqrt(give_up)
            for place, descent in enumerate(sorted(descents, key=lambda each: each.cost)):
                ahead = at_most is None or place < at_most
                descent.active = descent.active and ahead and descent.cost < within * best
            _merge(descents)
        stale = [descent for descent in descents if descent.active and descent.stale]
        at = [(descent.hypothesis, descent.theta(descent.x)) for descent in stale]
        for descent, seen in zip(stale, linearise(problem, at, time_constant), strict=True):
            descent.renewed(seen)
        tried = []
        for descent in descents:
            x = descent.proposed() if descent.active else None
            if x is None:
                descent.converged = descent.converged or descent.active
                descent.active = False
            else:
                tried.append((descent, x))
        if not tried:
            break
        tried = _bent(problem, tried, time_constant)
        found = residuals_at(
            problem, [(descent.hypothesis, descent.theta(x)) for descent, x in tried], time_constant
        )
        for (descent, x), residual in zip(tried, found, strict=True):
            descent.tried(x, residual, tolerance)
    return [_fitted(descent, time_constant) for descent in descents]


def _merge(descents: Sequence[Descent]) -> None:
    """Of searches of one hypothesis that predict the same by now only the best goes on."""
    best: dict[Variant, list[Descent]] = {}
    for descent in sorted(descents, key=lambda each: each.cost):
        ahead = best.setdefault(descent.hypothesis.variant, [])
        if descent.active and any(
            alike(descent.seen.residual, each.seen.residual) for each in ahead
        ):
            descent.active = False
        else:
            ahead.append(descent)


def alike(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether residuals of one hypothesis say that two searches have come to the same end."""
    least = min(np.sum(one**2), np.sum(other**2))
    return bool(np.sum((one - other) ** 2) < _ALIKE * least)


def _bent(
    problem: HistoryProblem, tried: Sequence[tuple[Descent, np.ndarray]], time_constant: float
) -> list[tuple[Descent, np.ndarray]]:
    """Steps of searches that a straight step has failed, bent along their valleys."""
    where = [
        (descent.hypothesis, descent.theta(descent.glimpse(x)))
        for descent, x in tried
        if descent.bent
    ]
    seen = iter(residuals_at(problem, where, time_constant))
    return [
        (descent, descent.along_the_valley(x, next(seen)) if descent.bent else x)
        for descent, x in tried
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
    descent = resumed(problem, fitted.start, fitted.x, change, fitted.time_constant)
    descent.converged = fitted.converged
    return _fitted(descent, fitted.time_constant)


def _fitted(descent: Descent, time_constant: float) -> HypothesisFit:
    return HypothesisFit(
        descent.hypothesis,
        descent.theta(descent.x),
        descent.x,
        descent.seen.misfit,
        descent.cost,
        descent.normal,
        descent.layout.precision,
        descent.parts,
        descent.scores,
        descent.seen.residual,
        time_constant,
        descent.converged,
        ParameterMap(descent.joints).end(len(descent.hypothesis.sizes)),
    )
