"""The density that a posterior is sampled from, in the variables of its problem."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.estimation.priors import AbstractPrior
from iwanjax.updating.problem import AbstractProblem
from iwanjax.updating.solution import FitSolution

NOISE_SCALES = ("noise_scale_frequency", "noise_scale_damping")
"""Factors on the stated deviations of the two kinds of data."""

# Deviation of the logarithm of those factors before the data: a factor of e either way.
_NOISE_SIGMA = 1.0


class Density(eqx.Module):
    r"""Logarithm of the posterior density of the variables of the problem and of two noise scales.

    .. math:: -\frac12\sum\left(\frac{r_f}{s_f}\right)^2 - N\ln s_f
              -\frac12\sum\left(\frac{r_\zeta}{s_\zeta}\right)^2 - N\ln s_\zeta
              + \sum\ln p(\theta_i) + \ln\left|\frac{\partial\theta}{\partial z}\right|
              + \ln p(s_f) + \ln p(s_\zeta)

    The residuals r are over the stated deviations; the scales s say by how much those are
    too small or too large, with log-normal priors about 1. Where the model leaves
    something out they grow, and the intervals with them. Where the deviations hold a model's own
    error, or doubt about other modes, they do not shrink: neither is scatter that residuals show.
    What is sampled of a scale is :math:`\ln s`, or :math:`\ln\ln s` where it is at least 1 (most
    steps of a walk in :math:`\ln s` would end beyond that bound).

    Attributes
    ----------
    problem : AbstractProblem
    priors : tuple of AbstractPrior
        Of the parameters that move.
    at_least_one : bool
        Whether the scales are.
    """

    problem: AbstractProblem
    priors: tuple[AbstractPrior, ...]
    at_least_one: bool = eqx.field(static=True)

    def at(self, y: Float[Array, " variables"], f: Array, zeta: Array) -> Float[Array, ""]:
        """Log density up to a constant; minus infinity where there is none.

        ``f`` and ``zeta`` are what the problem predicts there, (N,) each.
        """
        z, log_scales = y[:-2], self.log_scales(y[-2:])
        free = np.array(self.problem.chart.free)
        theta = self.problem.to_values(z)
        slopes = jax.jacfwd(self.problem.to_values)(z)[free]
        _, log_volume = jnp.linalg.slogdet(slopes)
        prior = sum(
            (p.log_density(theta[i]) for p, i in zip(self.priors, free, strict=True)),
            jnp.zeros(()),
        )
        inside = jnp.all(
            (theta[free] >= self.problem.chart.lower[free])
            & (theta[free] <= self.problem.chart.upper[free])
        )
        noise = -0.5 * jnp.sum((log_scales / _NOISE_SIGMA) ** 2)
        if self.at_least_one:
            noise += jnp.sum(y[-2:])
        kinds = self.problem.compared(f, zeta)
        data = sum(
            (
                -0.5 * jnp.sum(r**2) * jnp.exp(-2.0 * log) - r.size * log
                for r, log in zip(kinds, log_scales, strict=True)
            ),
            jnp.zeros(()),
        )
        total = data + prior + log_volume + noise
        return jnp.where(inside & jnp.isfinite(total), total, -jnp.inf)

    @classmethod
    def of(cls, solution: FitSolution) -> "Density":
        """The density of a fit's problem with its parameters' priors."""
        systematic = solution.model_error is not None or solution.coupling is not None
        return cls(
            solution.problem,
            tuple(p.prior for p in solution.parameters if not p.fixed),
            systematic,
        )

    def log_scales(self, variables: Array) -> Array:
        """Logarithms of scales."""
        return jnp.exp(variables) if self.at_least_one else variables

    def scale_starts(self, misfits: tuple[float, float], random: np.random.Generator) -> np.ndarray:
        """Variables of both scales about what a fit's misfits say, (2,)."""
        log = np.log(np.maximum(misfits, 0.1))
        if self.at_least_one:
            # Of N residuals that scatter as stated or less, ln s is 1 / N or so, give or take that.
            log = np.log(np.maximum(log, 1.0 / self.problem.measured.q.size))
            return log + random.standard_normal(2)
        return log + 0.1 * random.standard_normal(2)


@eqx.filter_jit
def log_densities(density: Density, y: Float[Array, "walkers variables"]) -> Array:
    """Log densities of many points, (walkers,)."""
    theta = jax.vmap(density.problem.to_values)(y[:, :-2])
    return jax.vmap(density.at)(y, *density.problem.predict_sets(theta))


@eqx.filter_jit
def values_of(problem: AbstractProblem, z: Float[Array, "draws free"]) -> Array:
    """Parameter values of many points, (draws, parameters)."""
    return jax.vmap(problem.to_values)(z)


@eqx.filter_jit
def spread_of(
    problem: AbstractProblem, theta: Float[Array, " parameters"], root: Float[Array, "free k"]
) -> Array:
    """A deviation of the free parameters, column by column, as one of the variables."""
    free = np.array(problem.chart.free)
    slopes = jax.jacfwd(problem.to_variables)(theta)[:, free]
    return slopes @ root
