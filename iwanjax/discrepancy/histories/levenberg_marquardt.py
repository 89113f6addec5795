"""Searches on their way: what is free, where they are, and their next step."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from iwanjax.discrepancy.histories.linearise import Linearisation, linearise
from iwanjax.discrepancy.histories.problem import (
    HistoryProblem,
    Hypothesis,
    Start,
    drifting_values,
    elapsed,
    free_values,
)
from iwanjax.estimation.evidence import correlation_time

# Prior deviations beyond which no joint is looked for.
_FARTHEST = 8.0
# The largest change of a logarithm in one step.
_LEAP = 2.0
# Factors of the damping: after a step that gained nothing, and after one that did.
_RAISED, _EASED = 5.0, 0.2
# Steps in a row that gain little before a search ends.
_PATIENCE = 2
# Fall of the cost over what was foreseen, within which derivatives are as good as new; and steps
# that they are kept for at most.
_AS_FORESEEN, _LONGEST_KEPT = (0.6, 1.5), 4
_DAMPING, _MOST_DAMPING = 1e-2, 1e7
# Share of a step at which it is seen how a valley bends, and the most that the step is bent by.
_GLIMPSE, _MOST_BENT = 0.1, 0.75
# Deviations of what a joint's parameters change from the first recording to the last, and of each
# recording from an even change, in prior deviations: a soft hit tells nothing of macroslip, and
# what it leaves open is on the line.
_DRIFT, _UNEVEN = 2.0, 0.1


class Layout(NamedTuple):
    """theta of each recording is base + T x, x with a Gaussian prior."""

    base: np.ndarray
    T: np.ndarray
    precision: np.ndarray


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
    return Layout(np.tile(base, (R, 1)), T, np.array(precision)), np.array(x)


@dataclass
class Descent:
    """A search on its way."""

    hypothesis: Hypothesis
    layout: Layout
    joints: int
    count: int
    x: np.ndarray
    seen: Linearisation
    tau: float = 1.0
    damping: float = _DAMPING
    active: bool = True
    converged: bool = False
    slow: int = 0
    kept: int = 0
    stale: bool = False
    bent: bool = False
    ahead: float = 0.0

    @property
    def prior(self) -> float:
        """Squares of x in its own deviations."""
        return self._prior(self.x)

    def _prior(self, x: np.ndarray) -> float:
        return float(x @ (self.layout.precision * x))

    @property
    def cost(self) -> float:
        """All squares."""
        return float(self.seen.misfit.sum()) + self.prior

    @property
    def temperature(self) -> float:
        """Squared residual over the noise's, where it is more."""
        return max(1.0, float(self.seen.misfit.sum()) / self.count)

    def _objective(self, x: np.ndarray, square: float) -> float:
        """What is minimised: N ln S, from where the residual's square S is the N of noise.

        As if the deviations were known up to a factor, and residuals that are correlated over
        tau samples counted as so many fewer: what the model cannot explain is no reason to
        believe in joints far from what is likely.
        """
        if square < self.count:
            return square / self.tau + self._prior(x)
        return self.count / self.tau * (1.0 + math.log(square / self.count)) + self._prior(x)

    @property
    def normal(self) -> np.ndarray:
        """Second derivatives of half the cost."""
        return self._squares + np.diag(self.layout.precision)

    @property
    def foreseen(self) -> float:
        """Cost after a full step, were residuals linear."""
        moment = self._moment
        try:
            found = self.cost - float(moment @ np.linalg.solve(self.normal, moment))
        except np.linalg.LinAlgError:
            return math.inf
        return found if math.isfinite(found) else math.inf

    @property
    def _moment(self) -> np.ndarray:
        """Gradient of half the cost."""
        return self.scores.sum(axis=0) + self.layout.precision * self.x

    @property
    def scores(self) -> np.ndarray:
        """The recordings' parts of the gradient of half the cost."""
        return np.einsum("rik,ri->rk", self.layout.T, self.seen.moment)

    @property
    def parts(self) -> np.ndarray:
        """The recordings' parts of the second derivatives of half the cost."""
        T = self.layout.T
        return np.einsum("rik,rij,rjl->rkl", T, self.seen.normal, T)

    @property
    def _squares(self) -> np.ndarray:
        T = self.layout.T
        return np.einsum("rik,rij,rjl->kl", T, self.seen.normal, T)

    def proposed(self) -> np.ndarray | None:
        """The next x; None when none is left to try."""
        logs = _leaping(self.hypothesis, self.layout)
        precision = self.temperature * self.tau * self.layout.precision
        moment = np.einsum("rik,ri->k", self.layout.T, self.seen.moment) + precision * self.x
        while self.damping < _MOST_DAMPING:
            move = step_within(self._damped, moment, self.x, self._border)
            if np.all(np.isfinite(move)) and np.all(np.abs(move[logs]) <= _LEAP):
                self.ahead = -float(move @ (2.0 * self._moment + self.normal @ move))
                return self.x + move
            self.damping *= _RAISED
        return None

    @property
    def _damped(self) -> np.ndarray:
        """What a step is solved by."""
        normal = self._squares + np.diag(self.temperature * self.tau * self.layout.precision)
        diagonal = np.diag(normal)
        return normal + self.damping * np.diag(diagonal + 1e-12 * diagonal.max())

    @property
    def _border(self) -> np.ndarray:
        """Largest magnitude of each of x."""
        border = np.full(len(self.x), np.inf)
        border[: self.joints] = _FARTHEST
        return border

    def glimpse(self, x: np.ndarray) -> np.ndarray:
        """A little of the way to x."""
        return self.x + _GLIMPSE * (x - self.x)

    def along_the_valley(self, x: np.ndarray, residual: np.ndarray) -> np.ndarray:
        r"""The next x, bent as the residuals' second derivative along the step says.

        .. math:: \Delta x_2 = -\tfrac{1}{2} (J^T J + \lambda D)^{-1} J^T e'',

        geodesic acceleration (Transtrum & Sethna 2012): joints whose parameters do nearly the
        same lie in valleys that are long, narrow and bent, where a straight step leads up the
        side.

        Parameters
        ----------
        x : (free,) array
            As proposed.
        residual : (recordings, N, sensors) array
            At the glimpse of it.
        """
        move, J = x - self.x, self.seen.slopes.reshape(*self.seen.slopes.shape[:2], -1)
        risen = (residual - self.seen.residual).reshape(len(J), -1) / _GLIMPSE
        straight = np.einsum("rin,ri->rn", J, self.layout.T @ move)
        bend = np.einsum("rin,rn->ri", J, 2.0 / _GLIMPSE * (risen - straight))
        damped = self._damped
        try:
            more = -0.5 * np.linalg.solve(damped, np.einsum("rik,ri->k", self.layout.T, bend))
        except np.linalg.LinAlgError:
            return x
        size = np.sqrt(np.diag(damped))
        bent, length = np.linalg.norm(size * more), np.linalg.norm(size * move)
        if not math.isfinite(bent):
            return x
        more *= min(1.0, _MOST_BENT * length / max(2.0 * bent, 1e-300))
        return np.clip(x + more, -self._border, self._border)

    def tried(self, x: np.ndarray, residual: np.ndarray, tolerance: float) -> None:
        """Go to x if that gains anything, by the residuals there.

        Derivatives are corrected by the step itself as long as the cost falls as they foresaw,
        and ``stale`` when they have to be worked out again: a search ends with new ones only.
        """
        move, square = x - self.x, float(np.sum(residual**2))
        before = self._objective(self.x, float(self.seen.misfit.sum()))
        gain = self.tau * (before - self._objective(x, square))
        if not gain > 0:
            self.stale = self.kept > 0
            self.bent = self.bent or not self.stale
            self.damping *= 1.0 if self.stale else _RAISED
            return
        fallen = self.cost - square - self._prior(x)
        self.seen = self.seen.beside(self.layout.T @ move, residual)
        self.x, self.tau, self.kept = x, correlation_time(residual), self.kept + 1
        self.damping = max(self.damping * _EASED, 1e-9)
        self.slow = self.slow + 1 if gain < tolerance * min(self.cost, self.count) else 0
        low, high = _AS_FORESEEN
        well = low * self.ahead < fallen < high * self.ahead and self.kept < _LONGEST_KEPT
        if self.slow >= _PATIENCE and (well or self.kept == 1):
            self.converged, self.active = True, False
        self.stale = self.active and not (well and self.slow < _PATIENCE)

    def renewed(self, seen: Linearisation) -> None:
        """Take derivatives worked out where it is."""
        self.seen, self.kept, self.stale = seen, 0, False

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


def _leaping(hypothesis: Hypothesis, layout: Layout) -> np.ndarray:
    """Which of x are logarithms of sizes and shapes."""
    logs = np.zeros(len(layout.precision), bool)
    free = np.flatnonzero(layout.precision == 0)
    at = 0
    for slot, (size, shape) in enumerate(zip(hypothesis.sizes, hypothesis.shapes, strict=True)):
        if size:
            logs[free[at]] = hypothesis.logarithmic(slot)
            at += 1
        if shape:
            logs[free[at]] = True
            at += 1
    return logs


def resumed(
    problem: HistoryProblem, start: Start, x: np.ndarray, change: np.ndarray, time_constant: float
) -> Descent:
    """A search where another ended, the joints moved from there."""
    layout, _ = laid_out(problem, start)
    there = x.copy()
    there[: len(change)] += change
    (seen,) = linearise(
        problem, [(start.hypothesis, layout.base + layout.T @ there)], time_constant
    )
    count = int(np.count_nonzero(np.asarray(problem.data.weight)))
    tau = correlation_time(seen.residual)
    return Descent(start.hypothesis, layout, problem.parameters, count, there, seen, tau)


def begun(problem: HistoryProblem, starts: Sequence[Start], time_constant: float) -> list[Descent]:
    """Searches at their beginning."""
    layouts = [laid_out(problem, start) for start in starts]
    hypotheses = [start.hypothesis for start in starts]
    thetas = [
        (h, layout.base + layout.T @ x) for h, (layout, x) in zip(hypotheses, layouts, strict=True)
    ]
    count = int(np.count_nonzero(np.asarray(problem.data.weight)))
    return [
        Descent(h, layout, problem.parameters, count, x, seen, correlation_time(seen.residual))
        for h, (layout, x), seen in zip(
            hypotheses, layouts, linearise(problem, thetas, time_constant), strict=True
        )
    ]
