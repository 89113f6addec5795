"""Fitting joints and suspects to recordings, many hypotheses side by side."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from iwanjax.discrepancy.histories.levenberg_marquardt import Lane, begun, resumed
from iwanjax.discrepancy.histories.linearise import evaluate, glance
from iwanjax.discrepancy.histories.problem import Hypothesis, Search, Start, Variant

SHORT = 2.0
"""The observer's shortest memory, cycles: residuals are nearly linear in the parameters."""
# Steps before a search may be given up, and before it may be for the root of the factor.
_HEAD_START, _LATE = 3, 6
# Share of the squared residual by which two searches of a hypothesis differ that are one.
_ALIKE = 1e-2


@dataclass(frozen=True, eq=False)
class Fitted:
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
    cycles : float
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
    cycles: float
    converged: bool
    values: int

    @property
    def start(self) -> Start:
        """Where another search may go on."""
        return Start(self.hypothesis, self.theta[:, : self.values])


def foreseen(search: Search, starts: Sequence[Start], cycles: float) -> list[float]:
    """Costs that one full step would reach, were residuals linear in what is fitted.

    What a suspect promises, for the price of one evaluation.

    Parameters
    ----------
    search : Search
        Predictor and data.
    starts : sequence of Start
        Hypotheses and where they are linearised.
    cycles : float
        Memory of the observer.

    Returns
    -------
    list of float
        Infinite where the model breaks down.
    """
    return [lane.foreseen for lane in begun(search, starts, cycles)]


def fit_all(
    search: Search,
    starts: Sequence[Start],
    cycles: float,
    steps: int,
    *,
    tolerance: float = 1e-3,
    race: float = math.inf,
    best: float = math.inf,
    at_most: int | None = None,
    in_time: Callable[[], bool] = lambda: True,
) -> list[Fitted]:
    """Levenberg-Marquardt from many starts, in step.

    The state after each pulse is free within what the force's noise allows.

    Parameters
    ----------
    search : Search
        Predictor and data.
    starts : sequence of Start
        Hypotheses and where to begin.
    cycles : float
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
    lanes = begun(search, starts, cycles)
    for step in range(steps):
        if not in_time():
            break
        if step >= _HEAD_START:
            best = min(best, *(lane.cost for lane in lanes))
            within = race if step < _LATE else math.sqrt(race)
            for place, lane in enumerate(sorted(lanes, key=lambda each: each.cost)):
                ahead = at_most is None or place < at_most
                lane.active = lane.active and ahead and lane.cost < within * best
            _merge(lanes)
        stale = [lane for lane in lanes if lane.active and lane.stale]
        at = [(lane.hypothesis, lane.theta(lane.x)) for lane in stale]
        for lane, seen in zip(stale, evaluate(search, at, cycles), strict=True):
            lane.renewed(seen)
        tried = []
        for lane in lanes:
            x = lane.proposed() if lane.active else None
            if x is None:
                lane.converged = lane.converged or lane.active
                lane.active = False
            else:
                tried.append((lane, x))
        if not tried:
            break
        tried = _bent(search, tried, cycles)
        found = glance(search, [(lane.hypothesis, lane.theta(x)) for lane, x in tried], cycles)
        for (lane, x), residual in zip(tried, found, strict=True):
            lane.tried(x, residual, tolerance)
    return [_fitted(lane, cycles) for lane in lanes]


def _merge(lanes: Sequence[Lane]) -> None:
    """Of searches of one hypothesis that predict the same by now only the best goes on."""
    best: dict[Variant, list[Lane]] = {}
    for lane in sorted(lanes, key=lambda each: each.cost):
        ahead = best.setdefault(lane.hypothesis.variant, [])
        if lane.active and any(alike(lane.seen.residual, each.seen.residual) for each in ahead):
            lane.active = False
        else:
            ahead.append(lane)


def alike(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether residuals of one hypothesis say that two searches have come to the same end."""
    least = min(np.sum(one**2), np.sum(other**2))
    return bool(np.sum((one - other) ** 2) < _ALIKE * least)


def _bent(
    search: Search, tried: Sequence[tuple[Lane, np.ndarray]], cycles: float
) -> list[tuple[Lane, np.ndarray]]:
    """Steps of searches that a straight step has failed, bent along their valleys."""
    where = [(lane.hypothesis, lane.theta(lane.glimpse(x))) for lane, x in tried if lane.bent]
    seen = iter(glance(search, where, cycles))
    return [(lane, lane.along_the_valley(x, next(seen)) if lane.bent else x) for lane, x in tried]


def moved(search: Search, fitted: Fitted, change: np.ndarray) -> Fitted:
    """A fit with other joints and everything else as it was, and what is seen there.

    Parameters
    ----------
    search : Search
        That it was fitted with.
    fitted : Fitted
        To start from.
    change : (parameters,) array
        Of z.
    """
    lane = resumed(search, fitted.start, fitted.x, change, fitted.cycles)
    lane.converged = fitted.converged
    return _fitted(lane, fitted.cycles)


def _fitted(lane: Lane, cycles: float) -> Fitted:
    return Fitted(
        lane.hypothesis,
        lane.theta(lane.x),
        lane.x,
        lane.seen.misfit,
        lane.cost,
        lane.normal,
        lane.layout.precision,
        lane.parts,
        lane.scores,
        lane.seen.residual,
        cycles,
        lane.converged,
        lane.joints + 2 * len(lane.hypothesis.sizes),
    )
