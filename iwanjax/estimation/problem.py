"""What least squares is asked, and what it answers."""

import abc
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from iwanjax.estimation.parameters import Chart


class AbstractLeastSquares(eqx.Module):
    """Residuals of free parameters, and the variables in which they are searched.

    ``chart`` moves the parameters one by one; a problem may know variables that suit the
    data better, in which it is searched and sampled.
    """

    chart: eqx.AbstractVar[Chart]
    names: eqx.AbstractVar[tuple[str, ...]]

    @abc.abstractmethod
    def residuals(self, theta: Float[Array, " parameters"]) -> Float[Array, " residuals"]:
        """All differences in one row, over their deviations."""

    def to_values(self, z: Float[Array, " free"]) -> Float[Array, " parameters"]:
        """Parameter values of the variables that are searched."""
        return self.chart.to_values(z)

    def to_variables(self, theta: Float[Array, " parameters"]) -> Float[Array, " free"]:
        """The variables that are searched, of parameter values."""
        return self.chart.to_variables(theta)

    def improved(self, theta: Float[Array, " parameters"]) -> Float[Array, " parameters"]:
        """A better start than this one, where the problem knows a cheap one."""
        return theta


@eqx.filter_jit
def residuals_and_slopes(
    problem: AbstractLeastSquares, theta: Float[Array, " parameters"]
) -> tuple[Float[Array, " residuals"], Float[Array, "residuals parameters"]]:
    """Residuals at values of the parameters, and their derivatives by these."""
    return _with_slopes(problem.residuals, theta)


@eqx.filter_jit
def residuals_and_slopes_in_variables(
    problem: AbstractLeastSquares, z: Float[Array, " free"]
) -> tuple[Float[Array, " residuals"], Float[Array, "residuals free"]]:
    """Residuals at variables that are searched, and their derivatives by these."""
    return _with_slopes(lambda z: problem.residuals(problem.to_values(z)), z)


def _with_slopes(residuals: Callable[[Array], Array], x: Array) -> tuple[Array, Array]:
    def twice(x: Array) -> tuple[Array, Array]:
        found = residuals(x)
        return found, found

    slopes, found = jax.jacfwd(twice, has_aux=True)(x)
    return found, slopes


class GroupedSquares(NamedTuple):
    """What residuals of several groups of data say at an end of a search.

    Attributes
    ----------
    residual : (groups, N, sensors) array
        Over their deviations.
    misfit : (groups,) array
        Sums of their squares.
    normal : (free, free) array
        Second derivatives of half the cost.
    precision : (free,) array
        The prior's part of its diagonal.
    parts : (groups, free, free) array
        The groups' parts of it.
    scores : (groups, free) array
        Their parts of the cost's half gradient.
    """

    residual: np.ndarray
    misfit: np.ndarray
    normal: np.ndarray
    precision: np.ndarray
    parts: np.ndarray
    scores: np.ndarray


@dataclass(frozen=True, eq=False)
class LeastSquaresSolution:
    """The end of one search, whoever has made it.

    Attributes
    ----------
    values : (parameters,) or (groups, values) array
        What the residuals are of, in its units.
    x : (free,) array
        The variables that were moved.
    cost : float
        Sum of squared residuals, and of the prior's where it is part of the search; infinite
        where the search has broken down.
    converged : bool
        Whether the search ended by its tolerance.
    iterations : int
        Steps, or evaluations where the method counts those.
    method : str
        ``"optimistix"``, ``"jaxopt"`` or ``"host"``.
    at_bounds : mapping of str to float
        Parameters that rest on a bound, and the bound.
    groups : GroupedSquares or None
        Of a search by groups of data.
    """

    values: np.ndarray
    x: np.ndarray
    cost: float
    converged: bool
    iterations: int
    method: str
    at_bounds: Mapping[str, float] = field(default_factory=dict)
    groups: GroupedSquares | None = field(default=None, repr=False)
