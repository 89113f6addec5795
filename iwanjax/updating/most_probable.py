"""What is believed of parameters before the curves, beside what the curves say."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.estimation.parameters import Chart, Parameter
from iwanjax.estimation.priors import AbstractPrior
from iwanjax.estimation.problem import AbstractLeastSquares


class MostProbable(AbstractLeastSquares):
    r"""A problem whose parameters' priors count as measurements do.

    .. math:: \sum_i r_i(\theta)^2 + \sum_j \left(\frac{z_j - \bar z_j}{\sigma_j}\right)^2,

    with :math:`z` the parameter of a normal prior and the logarithm of that of a log-normal one.
    Its minimum is the most probable set in these.

    Attributes
    ----------
    base : AbstractLeastSquares
        Whose residuals, variables and starts these are.
    priors : tuple of AbstractPrior
        Of the parameters that the base's chart moves.
    """

    base: AbstractLeastSquares
    priors: tuple[AbstractPrior, ...]
    chart: Chart
    names: tuple[str, ...] = eqx.field(static=True)

    @classmethod
    def of(cls, base: AbstractLeastSquares, parameters: Sequence[Parameter]) -> "MostProbable":
        """Of a problem and the parameters it was made of."""
        priors = tuple(parameters[i].prior for i in base.chart.free)
        return cls(base=base, priors=priors, chart=base.chart, names=base.names)

    def to_values(self, z: Float[Array, " free"]) -> Float[Array, " parameters"]:
        """As the base."""
        return self.base.to_values(z)

    def to_variables(self, theta: Float[Array, " parameters"]) -> Float[Array, " free"]:
        """As the base."""
        return self.base.to_variables(theta)

    def improved(self, theta: Float[Array, " parameters"]) -> Float[Array, " parameters"]:
        """As the base."""
        return self.base.improved(theta)

    def residuals(self, theta: Float[Array, " parameters"]) -> Float[Array, " residuals"]:
        """The base's, then the priors'."""
        return jnp.concatenate([self.base.residuals(theta), self.believed(theta)])

    def believed(self, theta: Float[Array, " parameters"]) -> Float[Array, " free"]:
        """How far each free parameter is from the middle of its prior, in its deviations."""
        return jnp.stack(
            [p.score(theta[i]) for p, i in zip(self.priors, self.chart.free, strict=True)]
        )
