"""Searches of the host on their way: where they are, and their next step.

Levenberg-Marquardt with geodesic acceleration, borders, a Gaussian prior and derivatives that are
kept while they foresee the cost.
"""

import math
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from iwanjax.correlation import correlation_time
from iwanjax.estimation.linearisation import Linearisation
from iwanjax.estimation.problem import GroupedSquares, LeastSquaresSolution
from iwanjax.estimation.settings import SEARCH, SearchSettings


class Layout(NamedTuple):
    """Values of each group are base + T x, x with a Gaussian prior.

    Attributes
    ----------
    base : (groups, values) array
        Values at x = 0.
    T : (groups, values, free) array
        Their derivatives.
    precision : (free,) array
        Of the prior about x = 0; zero for what has none.
    border : (free,) array or float
        Largest magnitude of each of x.
    least : (free,) array or float
        Least value of each of x, where that is more than minus its border.
    logarithmic : (free,) array or bool
        Which of x are logarithms, and so take no long steps.
    """

    base: np.ndarray
    T: np.ndarray
    precision: np.ndarray
    border: np.ndarray | float = math.inf
    least: np.ndarray | float = -math.inf
    logarithmic: np.ndarray | bool = False

    def values(self, x: np.ndarray) -> np.ndarray:
        """Values of each group, (groups, values)."""
        return self.base + self.T @ x


class SearchStart(NamedTuple):
    """Where a search begins.

    Attributes
    ----------
    layout : Layout
        What is free.
    x : (free,) array
        Its values.
    model : object
        What the residuals are of: handed back to them as it is.
    variant : hashable
        Searches of one variant are merged when they have come to the same end.
    """

    layout: Layout
    x: np.ndarray
    model: Any = None
    variant: Hashable = None


@dataclass
class Descent:
    """A search on its way."""

    start: SearchStart
    count: float
    x: np.ndarray
    seen: Linearisation
    settings: SearchSettings
    tau: float
    damping: float
    steps: int = 0
    active: bool = True
    converged: bool = False
    slow: int = 0
    kept: int = 0
    stale: bool = False
    bent: bool = False
    ahead: float = 0.0

    @classmethod
    def at(
        cls,
        start: SearchStart,
        count: float,
        seen: Linearisation,
        settings: SearchSettings = SEARCH,
    ) -> "Descent":
        """At its beginning.

        Parameters
        ----------
        start : SearchStart
            Where that is.
        count : float
            Number of values that were measured, which noise alone leaves the residual's square at;
            infinite where their deviations count as they are, whatever is left.
        seen : Linearisation
            There.
        settings : SearchSettings
            How to search.
        """
        tau = correlation_time(seen.residual)
        return cls(start, count, start.x, seen, settings, tau, settings.damping)

    @property
    def layout(self) -> Layout:
        """What is free."""
        return self.start.layout

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
        believe in parameters far from what is likely.
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
        """The groups' parts of the gradient of half the cost."""
        return np.einsum("rik,ri->rk", self.layout.T, self.seen.moment)

    @property
    def parts(self) -> np.ndarray:
        """The groups' parts of the second derivatives of half the cost."""
        # As products of matrices: einsum with three of them is of the fourth power of the values.
        T = self.layout.T
        # Of a model that breaks down they are no numbers, nor is its cost.
        with np.errstate(invalid="ignore", over="ignore"):
            return T.swapaxes(1, 2) @ self.seen.normal @ T

    @property
    def _squares(self) -> np.ndarray:
        return self.parts.sum(axis=0)

    def proposed(self) -> np.ndarray | None:
        """The next x; None when none is left to try."""
        logs = np.broadcast_to(self.layout.logarithmic, self.x.shape)
        precision = self.temperature * self.tau * self.layout.precision
        moment = np.einsum("rik,ri->k", self.layout.T, self.seen.moment) + precision * self.x
        while self.damping < self.settings.most_damping:
            move = step_within(self._damped, moment, self.x, *self._range)
            if np.all(np.isfinite(move)) and np.all(np.abs(move[logs]) <= self.settings.leap):
                self.ahead = -float(move @ (2.0 * self._moment + self.normal @ move))
                return self.x + move
            self.damping *= self.settings.raised
        return None

    @property
    def _damped(self) -> np.ndarray:
        """What a step is solved by."""
        normal = self._squares + np.diag(self.temperature * self.tau * self.layout.precision)
        diagonal = np.diag(normal)
        return normal + self.damping * np.diag(diagonal + 1e-12 * diagonal.max())

    @property
    def _range(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest value of each of x."""
        border = np.broadcast_to(self.layout.border, self.x.shape)
        return np.maximum(-border, self.layout.least), border

    def glimpse(self, x: np.ndarray) -> np.ndarray:
        """A little of the way to x."""
        return self.x + self.settings.glimpse * (x - self.x)

    def along_the_valley(self, x: np.ndarray, residual: np.ndarray) -> np.ndarray:
        r"""The next x, bent as the residuals' second derivative along the step says.

        .. math:: \Delta x_2 = -\tfrac{1}{2} (J^T J + \lambda D)^{-1} J^T e'',

        geodesic acceleration (Transtrum & Sethna 2012): parameters that do nearly the
        same lie in valleys that are long, narrow and bent, where a straight step leads up the
        side.

        Parameters
        ----------
        x : (free,) array
            As proposed.
        residual : (groups, N, sensors) array
            At the glimpse of it.
        """
        if self.seen.slopes is None:
            return x
        move, J = x - self.x, self.seen.slopes.reshape(*self.seen.slopes.shape[:2], -1)
        risen = (residual - self.seen.residual).reshape(len(J), -1) / self.settings.glimpse
        straight = np.einsum("rin,ri->rn", J, self.layout.T @ move)
        bend = np.einsum("rin,rn->ri", J, 2.0 / self.settings.glimpse * (risen - straight))
        damped = self._damped
        try:
            more = -0.5 * np.linalg.solve(damped, np.einsum("rik,ri->k", self.layout.T, bend))
        except np.linalg.LinAlgError:
            return x
        size = np.sqrt(np.diag(damped))
        bent, length = np.linalg.norm(size * more), np.linalg.norm(size * move)
        if not math.isfinite(bent):
            return x
        more *= min(1.0, self.settings.most_bent * length / max(2.0 * bent, 1e-300))
        return np.clip(x + more, *self._range)

    def tried(self, x: np.ndarray, residual: np.ndarray, tolerance: float) -> None:
        """Go to x if that gains anything, by the residuals there.

        Derivatives are corrected by the step itself as long as the cost falls as they foresaw,
        and ``stale`` when they have to be worked out again: a search ends with new ones only.
        """
        self.steps += 1
        move, square = x - self.x, float(np.sum(residual**2))
        before = self._objective(self.x, float(self.seen.misfit.sum()))
        gain = self.tau * (before - self._objective(x, square))
        if not gain > 0:
            self.stale = self.kept > 0
            self.bent = self.bent or not self.stale
            self.damping *= 1.0 if self.stale else self.settings.raised
            return
        fallen = self.cost - square - self._prior(x)
        self.seen = self.seen.beside(self.layout.T @ move, residual)
        self.x, self.tau, self.kept = x, correlation_time(residual), self.kept + 1
        self.damping = max(self.damping * self.settings.eased, 1.0 / self.settings.most_damping)
        self.slow = self.slow + 1 if gain < tolerance * min(self.cost, self.count) else 0
        low, high = self.settings.foreseen_low, self.settings.foreseen_high
        well = low * self.ahead < fallen < high * self.ahead
        well = well and self.kept < self.settings.longest_kept and self.seen.slopes is not None
        if self.slow >= self.settings.patience and (well or self.kept == 1):
            self.converged, self.active = True, False
        self.stale = self.active and not (well and self.slow < self.settings.patience)

    def renewed(self, seen: Linearisation) -> None:
        """Take derivatives worked out where it is."""
        self.seen, self.kept, self.stale = seen, 0, False

    @property
    def point(self) -> tuple[Any, np.ndarray]:
        """Model and values where it is."""
        return self.to(self.x)

    def to(self, x: np.ndarray) -> tuple[Any, np.ndarray]:
        """Model and values elsewhere."""
        return self.start.model, self.layout.values(x)

    def solution(self) -> LeastSquaresSolution:
        """Where it is, as its end."""
        seen = self.seen
        return LeastSquaresSolution(
            values=self.layout.values(self.x),
            x=self.x,
            cost=self.cost,
            converged=self.converged,
            iterations=self.steps,
            method="host",
            groups=GroupedSquares(
                seen.residual,
                seen.misfit,
                self.normal,
                self.layout.precision,
                self.parts,
                self.scores,
            ),
        )


def step_within(
    normal: np.ndarray, moment: np.ndarray, x: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """The step of least squares; values that would leave their range stop at its end.

    What is left of the step is solved for again: a step that is cut short, or damped until it
    stays inside, is a wall that no search gets along.

    Parameters
    ----------
    normal : (n, n) array
        Second derivatives.
    moment, x : (n,) array
        Gradient, and where it is.
    low, high : (n,) array
        Least and largest value of each.

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
        beyond = free & ((x + move > high) | (x + move < low))
        if not beyond.any():
            return move
        move[beyond] = (np.clip(x + move, low, high) - x)[beyond]
        held |= beyond
