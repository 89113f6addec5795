"""The trade-off between frequency and damping: fits that no other one beats in both."""

import numbers
from dataclasses import dataclass, field

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.estimation.least_squares import least_squares
from iwanjax.estimation.parameters import Chart, Parameter
from iwanjax.estimation.problem import AbstractLeastSquares
from iwanjax.structures import JointedStructure
from iwanjax.tables import Block
from iwanjax.types import require_double_precision
from iwanjax.updating.projected import ProjectedProblem
from iwanjax.updating.sampled import AbstractParameterSets, SampledFits, deviations, not_beaten
from iwanjax.updating.solution import point

# Decades of the ratio of both weights on either side of equal importance: beyond, an end of the
# front no longer moves by what a curve shows.
_DECADES = 2.0
# Sampled sets that a search for one point begins with.
_STARTS = 4


class _Weighted(AbstractLeastSquares):
    """Deviations of frequency and damping (3.34), each over its scale, at one ratio of weights."""

    projected: ProjectedProblem
    chart: Chart
    factors: Float[Array, "2"]
    weights: Float[Array, " curves"]
    names: tuple[str, ...] = eqx.field(static=True)

    def to_values(self, z: Float[Array, " free"]) -> Float[Array, " parameters"]:
        return self.projected.to_values(z)

    def to_variables(self, theta: Float[Array, " parameters"]) -> Float[Array, " free"]:
        return self.projected.to_variables(theta)

    def residuals(self, theta: Float[Array, " parameters"]) -> Float[Array, " residuals"]:
        df, dz = self.parts(theta)
        return jnp.concatenate([self.factors[0] * df, self.factors[1] * dz])

    def parts(self, theta: Float[Array, " parameters"]) -> tuple[Array, Array]:
        """Both at the damping beside the joints that suits them best, (N,) each."""
        base = self.projected.base
        f, zeta = base.predict(theta)
        added = self.projected.background(theta, zeta) - base.background(theta)
        return deviations(base, f, zeta + added[base.curve], self.weights)


@dataclass(frozen=True, eq=False)
class ParetoFront(AbstractParameterSets):
    """Result of :func:`pareto_front`.

    Attributes
    ----------
    names, values, frequency_rmsd, damping_rmsd
        As of :class:`~iwanjax.updating.sampled.AbstractParameterSets`, by point, in the
        order of rising deviation of the frequency.
    importance : (points,) array
        Weight of the squared damping over that of the squared frequency, each over its scale: that
        of the sampled set that is nearest to the best of both.
    chosen : int
        The point nearest to the best of both, each over its range on the front.
    sampled : SampledFits
        What the front was started from.
    """

    importance: np.ndarray
    chosen: int
    sampled: SampledFits = field(repr=False)

    @property
    def measured(self) -> tuple[ModalCurves, ...]:
        """What the fits are held against."""
        return self.sampled.measured

    def point(self, i: int) -> dict[str, float]:
        """Parameters of one point by name."""
        return self._named(i)

    def model(self, i: int | None = None) -> JointedStructure:
        """The structure with the parameters of one point; of the chosen one without it."""
        at = self.chosen if i is None else i
        return self.sampled.problem.model(jnp.asarray(self.values[at]))

    def _blocks(self) -> tuple[Block, ...]:
        f, zeta = self.frequency_rmsd, self.damping_rmsd
        head = (
            f"{f.size} fits that no other one beats in both: from {f[0]:.3g} Hz and {zeta[0]:.2g} "
            f"to {f[-1]:.3g} Hz and {zeta[-1]:.2g} off in frequency and damping. "
            f"Point {self.chosen} is nearest to the best of both."
        )
        return head, self._grid("point", range(f.size), self.sampled.parameters)


def pareto_front(sampled: SampledFits, points: int = 12) -> ParetoFront:
    r"""Fits between the best in frequency and the best in damping, by gradients.

    For each of some ratios of importance :math:`\lambda` the weighted sum

    .. math:: \min_\theta\; \frac{1}{1 + \lambda}\frac{J_f(\theta)^2}{s_f^2}
              + \frac{\lambda}{1 + \lambda}\frac{J_\zeta(\theta)^2}{s_\zeta^2}

    of both deviations (3.34) is minimised from the best sampled sets and from the point before.
    Where the front is not convex weighted sums leave a gap between two points.

    Parameters
    ----------
    sampled : SampledFits
        Of :func:`sample_fits`; its curves, weights and fixed parameters.
    points : int
        Ratios, at least 3; fits that another one beats are left out.

    Returns
    -------
    ParetoFront

    Raises
    ------
    InputError
        For fewer than 3 points, sets of which none has an equilibrium at every amplitude, and
        where every parameter is fixed.

    References
    ----------
    Lacayo (2017), Sec. 3.4.3, Fig. 3.7. Miettinen, Nonlinear Multiobjective Optimization (1999),
    Sec. 3.1.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> system = ij.three_mass()
    >>> levels = np.geomspace(1e-2, 1.0, 12)
    >>> curves = [ij.qsma(system, mode, levels, 1e-4).curves for mode in (0, 1)]
    >>> sets = ij.sample_fits(system, curves, 128, fixed=["J1.K_T"])
    >>> front = ij.pareto_front(sets, points=3)
    >>> bool(front.damping_rmsd[front.chosen] <= sets.damping_rmsd.min())
    True
    """
    require_double_precision("pareto_front")
    if isinstance(points, bool) or not isinstance(points, numbers.Integral) or points < 3:
        raise InputError(f"pareto_front: points = {points!r}; expected a whole number, at least 3")
    if not sampled.front.size:
        raise InputError(
            "pareto_front: no sampled set has an equilibrium at every measured amplitude; sample "
            "more sets, or stronger joints (macroslip=)"
        )
    parameters: tuple[Parameter, ...] = sampled.parameters
    projected = ProjectedProblem.of(sampled.problem, parameters)
    if not projected.chart.free:
        raise InputError("pareto_front: all parameters are fixed; free at least one")
    middle = _nearest(sampled.frequency_rmsd[sampled.front], sampled.damping_rmsd[sampled.front])
    at = sampled.front[middle]
    scales = np.array([sampled.frequency_rmsd[at], sampled.damping_rmsd[at]])
    scales = np.maximum(scales, np.finfo(float).tiny)
    ratios = 10.0 ** np.linspace(-_DECADES, _DECADES, int(points))
    found: list[np.ndarray] = []
    for ratio in ratios:
        weight = np.array([1.0, ratio]) / (1.0 + ratio)
        problem = _Weighted(
            projected=projected,
            chart=projected.chart,
            factors=jnp.asarray(np.sqrt(weight) / scales),
            weights=jnp.asarray(sampled.weights),
            names=projected.names,
        )
        both = np.stack([sampled.frequency_rmsd, sampled.damping_rmsd]) / scales[:, None]
        best = np.argsort(weight @ both**2)[:_STARTS]
        before = found[-1:] or [sampled.values[best[0]]]
        draws = np.stack([*sampled.values[best], *before])
        ends = least_squares(problem, jnp.asarray(draws), len(draws))
        found.append(_completed(projected, min(ends, key=lambda each: each.cost).values))
    values = np.stack(found)
    f, zeta = _agreements(sampled, values)
    kept = not_beaten(f, zeta)
    return ParetoFront(
        names=sampled.names,
        values=values[kept],
        frequency_rmsd=f[kept],
        damping_rmsd=zeta[kept],
        importance=ratios[kept],
        chosen=_nearest(f[kept], zeta[kept]),
        sampled=sampled,
    )


def _completed(projected: ProjectedProblem, theta: np.ndarray) -> np.ndarray:
    """Parameters with the damping beside the joints that suits them best."""
    there = point(projected.base, jnp.asarray(theta))
    return np.asarray(projected.completed(jnp.asarray(theta), there.prediction[1]))


def _agreements(sampled: SampledFits, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Deviations of frequency and damping (3.34) of sets, by both passes of a fit."""
    rows = []
    for theta in values:
        there = point(sampled.problem, jnp.asarray(theta))
        parts = deviations(sampled.problem, *there.prediction, jnp.asarray(sampled.weights))
        rows.append([float(jnp.sqrt(jnp.sum(x**2))) for x in parts])
    f, zeta = np.asarray(rows).T
    return f, zeta


def _nearest(f: np.ndarray, zeta: np.ndarray) -> int:
    """The point nearest to the least of both, each over its range."""
    both = np.stack([f, zeta], axis=1)
    span = np.ptp(both, axis=0)
    shares = (both - both.min(axis=0)) / np.where(span > 0.0, span, 1.0)
    return int(np.argmin(np.linalg.norm(shares, axis=1)))
