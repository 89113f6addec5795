"""Least squares: what is minimised."""

import abc

import equinox as eqx
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
