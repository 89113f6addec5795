"""Fitting joints and suspects to recordings, many hypotheses side by side."""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.discrepancy.measured import DIRECTIONS
from iwanjax.discrepancy.search import Hypothesis, Search, Start, drifting_values, free_values
from iwanjax.discrepancy.sensitivity import reduced

SHORT = 2.0
"""The observer's shortest memory, cycles: residuals are nearly linear in the parameters."""
# Kernels that run at once, of one hypothesis each: as many to a kernel are no quicker together.
_THREADS = 2
# Prior deviations beyond which no joint is looked for.
_FARTHEST = 8.0
# The largest change of a logarithm in one step.
_LEAP = 2.0
# Steps before a search may be given up.
_HEAD_START = 3
# Steps in a row that gain little before a search ends.
_PATIENCE = 2
_DAMPING, _EASED, _RAISED, _MOST_DAMPING = 1e-2, 0.2, 5.0, 1e7
# Deviation of the change of a joint's parameters between recordings, in prior deviations.
_DRIFT = 2.0


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
    residual: np.ndarray = field(repr=False)
    cycles: float
    converged: bool
    values: int

    @property
    def start(self) -> Start:
        """Where another search may go on."""
        return Start(self.hypothesis, self.theta[:, : self.values])


class _Layout(NamedTuple):
    """theta of each recording is base + T x, x with a Gaussian prior."""

    base: np.ndarray
    T: np.ndarray
    precision: np.ndarray


def _layout(search: Search, start: Start) -> tuple[_Layout, np.ndarray]:
    """Which values are free, and where they begin."""
    hypothesis, R, p = start.hypothesis, search.recordings, search.parameters
    slots = len(hypothesis.sizes)
    fixed = p + 2 * slots
    given = np.atleast_2d(start.theta)
    if hypothesis.drifting is None:
        given = given.mean(axis=0, keepdims=True)
    base = np.concatenate([given[0, :fixed], np.zeros(DIRECTIONS)])
    eye = np.eye(len(base))
    shared = free_values(search, hypothesis)
    columns = [np.tile(eye[i], (R, 1)) for i in shared]
    precision = [1.0 if i < p else 0.0 for i in shared]
    x = [base[i] for i in shared]
    for r in range(R):
        for i in range(fixed, len(base)):
            one = np.zeros((R, len(base)))
            one[r, i] = 1.0
            columns.append(one)
            precision.append(1.0)
            x.append(0.0)
    if hypothesis.drifting is not None:
        for i in drifting_values(search, hypothesis.drifting):
            for r in range(1, R):
                one = np.zeros((R, len(base)))
                one[r, i] = 1.0
                columns.append(one)
                precision.append(_DRIFT**-2)
                x.append(given[r, i] - given[0, i] if len(given) > 1 else 0.0)
    base[shared] = 0.0
    T = np.stack(columns, axis=-1)
    return _Layout(np.tile(base, (R, 1)), T, np.array(precision)), np.array(x)


class Seen(NamedTuple):
    """Residuals at some values, recording by recording.

    Attributes
    ----------
    misfit, moment, normal, residual
        As of :class:`Reduced`: its cost, moment, normal and e.
    slopes : array
        Its J.
    """

    misfit: np.ndarray
    moment: np.ndarray
    normal: np.ndarray
    residual: np.ndarray
    slopes: Array


def evaluate(
    search: Search, lanes: Sequence[tuple[Hypothesis, np.ndarray]], cycles: float
) -> list[Seen]:
    """Residuals and their reduced derivatives, for (hypothesis, theta of each recording)."""
    means = np.stack([theta.mean(axis=0) for _, theta in lanes])
    gains = search.gains([h.suspects for h, _ in lanes], means, cycles)

    def run(i: int) -> Seen:
        hypothesis, theta = lanes[i]
        found = reduced(
            search.predictor,
            search.joints,
            hypothesis.suspects,
            jnp.asarray(theta),
            jnp.asarray(gains.gain[i]),
            jnp.asarray(gains.slope[i]),
            search.data,
        )
        e, cost, moment, normal = (np.asarray(x) for x in found[:4])
        return Seen(cost, moment, normal, e, found.J)

    # The first alone where the kernel is yet to be compiled: two would both do it.
    slots = lanes[0][0].suspects.row.shape[0]
    alone = 0 if slots in search.compiled else 1
    found = [run(i) for i in range(alone)]
    search.compiled.add(slots)
    with ThreadPoolExecutor(_THREADS) as pool:
        return [*found, *pool.map(run, range(alone, len(lanes)))]


@dataclass
class _Lane:
    """A search on its way."""

    hypothesis: Hypothesis
    layout: _Layout
    joints: int
    count: int
    x: np.ndarray
    seen: Seen
    tau: float = 1.0
    damping: float = _DAMPING
    active: bool = True
    converged: bool = False
    slow: int = 0

    @property
    def prior(self) -> float:
        """Squares of x in its own deviations."""
        return float(self.x @ (self.layout.precision * self.x))

    @property
    def cost(self) -> float:
        """All squares."""
        return float(self.seen.misfit.sum()) + self.prior

    @property
    def temperature(self) -> float:
        """Squared residual over the noise's, where it is more."""
        return max(1.0, float(self.seen.misfit.sum()) / self.count)

    def objective(self, tau: float) -> float:
        """What is minimised: N ln S, from where the residual's square S is the N of noise.

        As if the deviations were known up to a factor, and residuals that are correlated over
        tau samples counted as so many fewer: what the model cannot explain is no reason to
        believe in joints far from what is likely.
        """
        square = float(self.seen.misfit.sum())
        if square < self.count:
            return square / tau + self.prior
        return self.count / tau * (1.0 + math.log(square / self.count)) + self.prior

    @property
    def normal(self) -> np.ndarray:
        """Second derivatives of half the cost."""
        return self._squares + np.diag(self.layout.precision)

    @property
    def foreseen(self) -> float:
        """Cost after a full step, were residuals linear."""
        moment = np.einsum("rik,ri->k", self.layout.T, self.seen.moment)
        moment += self.layout.precision * self.x
        try:
            found = self.cost - float(moment @ np.linalg.solve(self.normal, moment))
        except np.linalg.LinAlgError:
            return math.inf
        return found if math.isfinite(found) else math.inf

    @property
    def _squares(self) -> np.ndarray:
        T = self.layout.T
        return np.einsum("rik,rij,rjl->kl", T, self.seen.normal, T)

    def proposed(self) -> np.ndarray | None:
        """The next x; None when none is left to try."""
        logs = _leaping(self.hypothesis, self.layout)
        precision = self.temperature * self.tau * self.layout.precision
        normal = self._squares + np.diag(precision)
        moment = np.einsum("rik,ri->k", self.layout.T, self.seen.moment) + precision * self.x
        diagonal = np.diag(normal)
        border = np.full(len(self.x), np.inf)
        border[: self.joints] = _FARTHEST
        while self.damping < _MOST_DAMPING:
            scaled = normal + self.damping * np.diag(diagonal + 1e-12 * diagonal.max())
            move = step_within(scaled, moment, self.x, border)
            if np.all(np.isfinite(move)) and np.all(np.abs(move[logs]) <= _LEAP):
                return self.x + move
            self.damping *= _RAISED
        return None

    def theta(self, x: np.ndarray) -> np.ndarray:
        """Values of each recording."""
        return self.layout.base + self.layout.T @ x


def step_within(
    normal: np.ndarray, moment: np.ndarray, x: np.ndarray, border: np.ndarray
) -> np.ndarray:
    """The step of least squares; values that would go beyond a border stop there.

    What is left of the step is solved for again: a step that is cut short, or damped until it
    stays inside, is a wall that no search gets along.

    Parameters
    ----------
    normal : (n, n) array
        Second derivatives.
    moment, x : (n,) array
        Gradient, and where it is.
    border : (n,) array
        Largest magnitude of each value.

    Returns
    -------
    (n,) array
        Infinite where there is no solution.
    """
    held = np.zeros(len(x), bool)
    move = np.zeros(len(x))
    while True:
        free = ~held
        against = moment[free] + normal[np.ix_(free, held)] @ move[held]
        try:
            move[free] = -np.linalg.solve(normal[np.ix_(free, free)], against)
        except np.linalg.LinAlgError:
            return np.full_like(move, np.inf)
        beyond = free & (np.abs(x + move) > border)
        if not beyond.any():
            return move
        move[beyond] = np.sign(move[beyond]) * border[beyond] - x[beyond]
        held |= beyond


def _leaping(hypothesis: Hypothesis, layout: _Layout) -> np.ndarray:
    """Which of x are logarithms of sizes and shapes."""
    logs = np.zeros(len(layout.precision), bool)
    free = np.flatnonzero(layout.precision == 0)
    at = 0
    for slot, (size, shape) in enumerate(zip(hypothesis.sizes, hypothesis.shapes, strict=True)):
        if size:
            logs[free[at]] = bool(hypothesis.suspects.logarithmic[slot] > 0)
            at += 1
        if shape:
            logs[free[at]] = True
            at += 1
    return logs


def _lanes(search: Search, starts: Sequence[Start], cycles: float) -> list[_Lane]:
    """Searches at their beginning."""
    begun = [_layout(search, start) for start in starts]
    hypotheses = [start.hypothesis for start in starts]
    thetas = [
        (h, layout.base + layout.T @ x) for h, (layout, x) in zip(hypotheses, begun, strict=True)
    ]
    count = int(np.count_nonzero(np.asarray(search.data.weight)))
    return [
        _Lane(h, layout, search.parameters, count, x, seen, correlation_time(seen.residual))
        for h, (layout, x), seen in zip(
            hypotheses, begun, evaluate(search, thetas, cycles), strict=True
        )
    ]


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
    return [lane.foreseen for lane in _lanes(search, starts, cycles)]


def fit_all(
    search: Search,
    starts: Sequence[Start],
    cycles: float,
    steps: int,
    *,
    tolerance: float = 1e-3,
    race: float = math.inf,
    best: float = math.inf,
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
        Times the best one's cost from which on a search is given up.
    best : float
        Cost that others have reached.
    in_time : function
        False when it is time to stop.

    Returns
    -------
    list of Fitted
        One for each start.
    """
    if not starts:
        return []
    lanes = _lanes(search, starts, cycles)
    count = lanes[0].count
    for step in range(steps):
        if not in_time():
            break
        if step >= _HEAD_START:
            best = min(best, *(lane.cost for lane in lanes))
            for lane in lanes:
                lane.active = lane.active and lane.cost < race * best
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
        found = evaluate(search, [(lane.hypothesis, lane.theta(x)) for lane, x in tried], cycles)
        for (lane, x), seen in zip(tried, found, strict=True):
            at = (lane.x, lane.seen)
            tau = lane.tau
            before = lane.objective(tau)
            lane.x, lane.seen = x, seen
            gain = tau * (before - lane.objective(tau))
            if not gain > 0:
                lane.x, lane.seen = at
                lane.damping *= _RAISED
                continue
            lane.tau = correlation_time(seen.residual)
            lane.damping = max(lane.damping * _EASED, 1e-9)
            lane.slow = lane.slow + 1 if gain < tolerance * min(lane.cost, count) else 0
            if lane.slow == _PATIENCE:
                lane.converged, lane.active = True, False
    return [
        Fitted(
            lane.hypothesis,
            lane.theta(lane.x),
            lane.x,
            lane.seen.misfit,
            lane.cost,
            lane.normal,
            lane.seen.residual,
            cycles,
            lane.converged,
            search.parameters + 2 * len(lane.hypothesis.sizes),
        )
        for lane in lanes
    ]


def correlation_time(residual: np.ndarray) -> float:
    """Of (recordings, N, sensors) in samples: one plus twice the sum of what is positive."""
    largest = float(np.max(np.abs(residual)))
    if not 0.0 < largest < math.inf:
        return 1.0
    # In units of the largest: a run that broke down would overflow.
    flat = residual / largest
    flat = flat - flat.mean(axis=1, keepdims=True)
    size = 2 * flat.shape[1]
    power = np.abs(np.fft.rfft(flat, size, axis=1)) ** 2
    correlation = np.fft.irfft(power.sum(axis=(0, 2)))[: flat.shape[1] // 4]
    if correlation[0] <= 0:
        return 1.0
    correlation = correlation / correlation[0]
    negative = np.flatnonzero(correlation <= 0)
    until = negative[0] if negative.size else correlation.size
    return float(1.0 + 2.0 * np.sum(correlation[1:until]))
