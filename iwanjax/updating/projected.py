"""A structure's fit with the damping beside its joints taken out of the search."""

from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.estimation.parameters import Chart, Parameter
from iwanjax.estimation.problem import AbstractLeastSquares
from iwanjax.updating.structural import StructuralProblem


class ProjectedProblem(AbstractLeastSquares):
    r"""The same residuals at the damping ratios :math:`\zeta_{0,r}` that suit the joints best.

    The damping of a curve is :math:`\zeta_{0,r}` and what the joints lose, so that the best
    ratio is the weighted mean of measured less lost, or the bound nearest to it: a closed form,
    exact for any number of modes since each ratio is in one curve only. A search would creep
    towards a ratio of zero without end.

    Attributes
    ----------
    base : StructuralProblem
        Whose parameters these are, in the same order.
    chart : Chart
        Of the base, the ratios fixed.
    moved : (curves,) array of bool
        Ratios that are to be found.
    """

    base: StructuralProblem
    chart: Chart
    moved: Array
    names: tuple[str, ...] = eqx.field(static=True)

    @classmethod
    def of(cls, base: StructuralProblem, parameters: Sequence[Parameter]) -> "ProjectedProblem":
        """Of a problem and the parameters it was made of."""
        first = len(parameters) - len(base.modes)
        joints, ratios = parameters[:first], parameters[first:]
        chart = Chart([*joints, *(replace(p, fixed=True) for p in ratios)])
        moved = jnp.asarray([not p.fixed for p in ratios])
        return cls(base=base, chart=chart, moved=moved, names=base.names)

    def to_values(self, z: Float[Array, " free"]) -> Float[Array, " parameters"]:
        """Parameters of the base's variables."""
        return self.base.values_by(self.chart, z)

    def to_variables(self, theta: Float[Array, " parameters"]) -> Float[Array, " free"]:
        """The inverse of :meth:`to_values`."""
        return self.base.variables_by(self.chart, theta)

    def residuals(self, theta: Float[Array, " parameters"]) -> Float[Array, " residuals"]:
        """All differences at the best ratios, (2 N,)."""
        f, zeta = self.base.predict(theta)
        added = self.background(theta, zeta) - self.base.background(theta)
        return jnp.concatenate(self.base.compared(f, zeta + added[self.base.curve]))

    def background(self, theta: Float[Array, " parameters"], zeta: Array) -> Array:
        """The best ratios (curves,), by the damping that is predicted with those of theta."""
        measured, own = self.base.measured, self.base.background(theta)
        weight = measured.damping_std**-2.0
        missing = weight * (measured.damping - zeta)
        best = own + jnp.stack(
            [jnp.sum(missing[part]) / jnp.sum(weight[part]) for part in measured.slices]
        )
        chart, first = self.base.chart, -len(self.base.modes)
        best = jnp.clip(best, chart.lower[first:], chart.upper[first:])
        return jnp.where(self.moved, best, own)

    def completed(self, theta: Float[Array, " parameters"], zeta: Array) -> Array:
        """Parameters with the best ratios, by the damping that is predicted without."""
        return theta.at[-len(self.base.modes) :].set(self.background(theta, zeta))
