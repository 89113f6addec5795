"""Searches of the host side by side: those that fall behind or come to one end are given up."""

import math
from collections.abc import Callable, Hashable, Sequence
from typing import Any, Protocol

import numpy as np

from iwanjax.estimation.levenberg_marquardt import Descent, SearchStart
from iwanjax.estimation.linearisation import Linearisation
from iwanjax.estimation.problem import LeastSquaresSolution
from iwanjax.estimation.settings import SEARCH, SearchSettings


class GroupedResiduals(Protocol):
    """Residuals of groups of data, for many models at once.

    A point is a model and the values of each group, (groups, values); residuals are (groups, N,
    sensors), over their deviations.
    """

    @property
    def count(self) -> float:
        """Number of values that were measured; infinite where their deviations are certain."""
        ...

    def residuals(self, points: Sequence[tuple[Any, np.ndarray]]) -> list[np.ndarray]:
        """At each point, none for no points."""
        ...

    def linearise(self, points: Sequence[tuple[Any, np.ndarray]]) -> list[Linearisation]:
        """The same with derivatives."""
        ...


def begun(
    residuals: GroupedResiduals,
    starts: Sequence[SearchStart],
    settings: SearchSettings = SEARCH,
) -> list[Descent]:
    """Searches at their beginning."""
    seen = residuals.linearise([(each.model, each.layout.values(each.x)) for each in starts])
    return [
        Descent.at(start, residuals.count, there, settings)
        for start, there in zip(starts, seen, strict=True)
    ]


def multistart(
    residuals: GroupedResiduals,
    starts: Sequence[SearchStart],
    steps: int,
    *,
    tolerance: float | None = None,
    give_up: float = math.inf,
    best: float = math.inf,
    at_most: int | None = None,
    in_time: Callable[[], bool] = lambda: True,
    settings: SearchSettings = SEARCH,
) -> list[LeastSquaresSolution]:
    """Levenberg-Marquardt from many starts, in step.

    Parameters
    ----------
    residuals : GroupedResiduals
        Whose squares are minimised, with the prior's.
    starts : sequence of SearchStart
        Where to begin.
    steps : int
        At most.
    tolerance : float, optional
        Relative gain below which, ``settings.patience`` times in a row, a search ends; by default
        that of the settings.
    give_up : float
        Times the best one's cost from which on a search is given up; later on the root of it.
    best : float
        Cost that others have reached.
    at_most : int, optional
        How many of them go on after the first few steps.
    in_time : function
        False when it is time to stop.
    settings : SearchSettings
        How to search.

    Returns
    -------
    list of LeastSquaresSolution
        One for each start.
    """
    if not starts:
        return []
    tolerance = settings.host_tolerance if tolerance is None else tolerance
    descents = begun(residuals, starts, settings)
    for step in range(steps):
        if not in_time():
            break
        if step >= settings.head_start:
            best = min(best, *(descent.cost for descent in descents))
            within = give_up if step < settings.late else math.sqrt(give_up)
            # Not by a product alone: infinity times a cost of zero is no number.
            limit = within * best if math.isfinite(give_up) else math.inf
            for place, descent in enumerate(sorted(descents, key=lambda each: each.cost)):
                ahead = at_most is None or place < at_most
                near = math.isfinite(descent.cost) and descent.cost <= limit
                descent.active = descent.active and ahead and near
            _merge(descents, settings)
        stale = [descent for descent in descents if descent.active and descent.stale]
        seen = residuals.linearise([descent.point for descent in stale])
        for descent, there in zip(stale, seen, strict=True):
            descent.renewed(there)
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
        tried = _bent(residuals, tried)
        found = residuals.residuals([descent.to(x) for descent, x in tried])
        for (descent, x), residual in zip(tried, found, strict=True):
            descent.tried(x, residual, tolerance)
    return [descent.solution() for descent in descents]


def _merge(descents: Sequence[Descent], settings: SearchSettings) -> None:
    """Of searches of one variant that predict the same by now only the best goes on."""
    best: dict[Hashable, list[Descent]] = {}
    for descent in sorted(descents, key=lambda each: each.cost):
        ahead = best.setdefault(descent.start.variant, [])
        if descent.active and any(
            alike(descent.seen.residual, each.seen.residual, settings) for each in ahead
        ):
            descent.active = False
        else:
            ahead.append(descent)


def alike(one: np.ndarray, other: np.ndarray, settings: SearchSettings = SEARCH) -> bool:
    """Whether residuals of one model say that two searches have come to the same end."""
    least = min(np.sum(one**2), np.sum(other**2))
    return bool(np.sum((one - other) ** 2) < settings.alike * least)


def _bent(
    residuals: GroupedResiduals, tried: Sequence[tuple[Descent, np.ndarray]]
) -> list[tuple[Descent, np.ndarray]]:
    """Steps of searches that a straight step has failed, bent along their valleys."""
    where = [descent.to(descent.glimpse(x)) for descent, x in tried if descent.bent]
    seen = iter(residuals.residuals(where))
    return [
        (descent, descent.along_the_valley(x, next(seen)) if descent.bent else x)
        for descent, x in tried
    ]
