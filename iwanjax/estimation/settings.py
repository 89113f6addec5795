"""Tuned numbers of searches and of what their ends are worth."""

from dataclasses import dataclass
from typing import Literal

Method = Literal["optimistix", "jaxopt", "host"]
"""Who searches."""


@dataclass(frozen=True)
class SearchSettings:
    """How least squares is searched for.

    None of them is derived: they are values that worked, and what halving and doubling them does
    has not been measured.

    Attributes
    ----------
    tolerance : float
        Relative change of the variables and of the cost below which a search ends that is compiled
        or has bounds.
    most_steps : int
        Of a compiled search.
    host_tolerance : float
        Relative gain below which, ``patience`` times in a row, a search of the host ends: its
        residuals cost a simulation each.
    patience : int
        Steps in a row that gain little before it ends.
    damping, most_damping : float
        Levenberg-Marquardt's, over the second derivatives' diagonal: of the first step, and from
        which on no step is left to try; its least is one over the most.
    raised, eased : float
        Its factors after a step that gained nothing, and after one that did.
    leap : float
        Largest change of a logarithm in one step, 1.
    farthest : float
        Deviations of its prior within which a parameter is looked for, 1.
    foreseen_low, foreseen_high : float
        Fall of the cost over what was foreseen, between which derivatives are as good as new.
    longest_kept : int
        Steps that derivatives are kept for at most.
    glimpse : float
        Share of a step at which it is seen how a valley bends (the geodesic acceleration of
        Transtrum & Sethna 2012).
    most_bent : float
        The most that a step is bent by, over its length.
    head_start, late : int
        Steps before a search may be given up, and before it may be for the root of the factor.
    alike : float
        Share of the squared residual by which two searches differ that have come to one end.
    near_bound : float
        Share of a range within which an estimate is taken to want to leave it.
    on_bound : float
        Share of it within which an estimate is on its bound.
    bound_cost : float
        Sum of squared residuals that going to a bound may cost: a thousandth of one deviation's.
    """

    tolerance: float = 1e-7
    most_steps: int = 200
    host_tolerance: float = 1e-3
    patience: int = 2
    damping: float = 1e-2
    most_damping: float = 1e7
    raised: float = 5.0
    eased: float = 0.2
    leap: float = 2.0
    farthest: float = 8.0
    foreseen_low: float = 0.6
    foreseen_high: float = 1.5
    longest_kept: int = 4
    glimpse: float = 0.1
    most_bent: float = 0.75
    head_start: int = 3
    late: int = 6
    alike: float = 1e-2
    near_bound: float = 1e-2
    on_bound: float = 1e-5
    bound_cost: float = 1e-3


SEARCH = SearchSettings()
"""As searches are made."""
