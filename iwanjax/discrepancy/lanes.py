"""Searches on their way: what is free, where they are, and their next step."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from iwanjax.discrepancy.measured import DIRECTIONS
from iwanjax.discrepancy.residuals import Seen, correlation_time, evaluate
from iwanjax.discrepancy.search import Hypothesis, Search, Start, drifting_values, free_values

# Prior deviations beyond which no joint is looked for.
_FARTHEST = 8.0
# The largest change of a logarithm in one step.
_LEAP = 2.0
RAISED = 5.0
"""Factor of the damping after a step that gained nothing."""
_DAMPING, _MOST_DAMPING = 1e-2, 1e7
# Deviation of the change of a joint's parameters between recordings, in prior deviations.
_DRIFT = 2.0


class Layout(NamedTuple):
    """theta of each recording is base + T x, x with a Gaussian prior."""

    base: np.ndarray
    T: np.ndarray
    precision: np.ndarray


def _laid_out(search: Search, start: Start) -> tuple[Layout, np.ndarray]:
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
    return Layout(np.tile(base, (R, 1)), T, np.array(precision)), np.array(x)


@dataclass
class Lane:
    """A search on its way."""

    hypothesis: Hypothesis
    layout: Layout
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
            self.damping *= RAISED
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


def _leaping(hypothesis: Hypothesis, layout: Layout) -> np.ndarray:
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


def begun(search: Search, starts: Sequence[Start], cycles: float) -> list[Lane]:
    """Searches at their beginning."""
    laid_out = [_laid_out(search, start) for start in starts]
    hypotheses = [start.hypothesis for start in starts]
    thetas = [
        (h, layout.base + layout.T @ x) for h, (layout, x) in zip(hypotheses, laid_out, strict=True)
    ]
    count = int(np.count_nonzero(np.asarray(search.data.weight)))
    return [
        Lane(h, layout, search.parameters, count, x, seen, correlation_time(seen.residual))
        for h, (layout, x), seen in zip(
            hypotheses, laid_out, evaluate(search, thetas, cycles), strict=True
        )
    ]
