"""Many parameter sets of a structure's joints at once, and how well each agrees with the curves."""

import numbers
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.cluster import pieces
from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.estimation.parameters import Parameter, fixed_at, replaced
from iwanjax.joints.iwan4 import Iwan4
from iwanjax.results import AbstractResult
from iwanjax.structures import JointedStructure
from iwanjax.tables import Block, Grid
from iwanjax.threads import available_threads
from iwanjax.types import ArrayLike, require_double_precision
from iwanjax.updating.joint_groups import structural_parameters
from iwanjax.updating.model_error import WITHOUT_NOISE, with_model_error
from iwanjax.updating.problem import Reference
from iwanjax.updating.projected import ProjectedProblem
from iwanjax.updating.structural import StructuralProblem, structural_problem

# Sets that a core computes at once: of 100 000 x 3 modes x 50 levels of the three masses 1024 take
# 1.5 s on two cores, 2048 take 1.5 and 4096 take 1.9.
AT_ONCE = 2048
# Rows of the table that a summary shows.
_SHOWN = 8


@dataclass(frozen=True, eq=False)
class AbstractParameterSets(AbstractResult):
    """Sets of parameters that are held against the same curves.

    Attributes
    ----------
    names : tuple of str
        Of the parameters, in the order of the columns of ``values``.
    values : (sets, parameters) array
        In their units; the damping ratio beside the joints is the one that suits each set best.
    frequency_rmsd : (sets,) array
        Root mean square deviation (3.34) of the frequency, Hz; infinite where a set has no
        equilibrium at a measured amplitude.
    damping_rmsd : (sets,) array
        The same of the damping ratio, 1.
    """

    names: tuple[str, ...]
    values: np.ndarray = field(repr=False)
    frequency_rmsd: np.ndarray = field(repr=False)
    damping_rmsd: np.ndarray = field(repr=False)

    def _named(self, i: int) -> dict[str, float]:
        """Parameters of one set by name."""
        return {n: float(v) for n, v in zip(self.names, self.values[i], strict=True)}

    def _grid(self, called: str, chosen: Iterable[int], parameters: Sequence[Parameter]) -> Grid:
        """Both deviations and the free parameters of some sets."""
        free = [i for i, p in enumerate(parameters) if not p.fixed]
        rows = [
            (
                f"{i}",
                f"{self.frequency_rmsd[i]:.4g}",
                f"{self.damping_rmsd[i]:.3g}",
                *(f"{self.values[i, j]:.4g}" for j in free),
            )
            for i in chosen
        ]
        columns = (called, "frequency (Hz)", "damping", *(self.names[j] for j in free))
        return Grid(columns, tuple(rows))


@dataclass(frozen=True, eq=False)
class SampledFits(AbstractParameterSets):
    """Result of :func:`sample_fits`.

    Attributes
    ----------
    names, values, frequency_rmsd, damping_rmsd
        As of :class:`AbstractParameterSets`, by set.
    front : (k,) array of int
        Sets that no other one beats in both, by rising deviation of the frequency.
    weights : (curves,) array
        W_r of each curve.
    parameters : tuple of Parameter
        As the sets were drawn.
    measured : tuple of ModalCurves
        What the sets are held against.
    problem : StructuralProblem
        For :func:`pareto_front`.
    """

    front: np.ndarray
    weights: np.ndarray
    parameters: tuple[Parameter, ...] = field(repr=False)
    measured: tuple[ModalCurves, ...] = field(repr=False)
    problem: StructuralProblem = field(repr=False)

    def set(self, i: int) -> dict[str, float]:
        """Parameters of one set by name."""
        return self._named(i)

    def model(self, i: int) -> JointedStructure:
        """The structure with the parameters of one set."""
        return self.problem.model(jnp.asarray(self.values[i]))

    def _blocks(self) -> tuple[Block, ...]:
        failed = int(np.sum(~np.isfinite(self.frequency_rmsd)))
        without = f"; {failed} have no equilibrium at a measured amplitude" if failed else ""
        head = (
            f"{len(self.values)} sets{without}; {self.front.size} of them are not beaten in both."
        )
        few = self.front[np.unique(np.linspace(0, self.front.size - 1, _SHOWN).astype(int))]
        return head, self._grid("set", few, self.parameters)


def sample_fits(
    structure: JointedStructure,
    curves: ModalCurves | Sequence[ModalCurves],
    count: int = 4096,
    *,
    weights: Sequence[float] | None = None,
    macroslip: tuple[float, float] = (1.0, 10.0),
    share: tuple[float, float] = (0.1, 1.0),
    parameters: Mapping[str, Parameter] | None = None,
    fixed: Mapping[str, float] | Sequence[str] = (),
    modes: Sequence[int] | None = None,
    sensors: Sequence[ArrayLike] | None = None,
    groups: Mapping[str, Sequence[str]] | None = None,
    reference: Reference | None = None,
    seed: int = 0,
    scheduler: str | None = None,
    workers: int | None = None,
) -> SampledFits:
    r"""Draw parameter sets of a structure's joints and hold each against measured curves.

    The Monte Carlo study of the thesis (Sec. 3.4.3), by a Sobol sequence. Of a four-parameter
    Iwan joint :math:`\chi` is drawn evenly between its bounds, :math:`\phi_{max}` evenly in its
    logarithm from the largest deflection that the curves take the joint to, and R evenly in its
    logarithm up to

    .. math:: R_{max} = \frac{(\chi + 1)\,K_T}{\phi_{max}^{\chi + 1}} \qquad (3.33)

    where S is zero. Every other parameter is drawn from its prior. The agreement is

    .. math:: \mathrm{RMSD} = \sqrt{\sum_r \frac{W_r}{N_r}\sum (\hat y_r - y_r)^2}
              \qquad (3.34)

    of the frequency (of its shift, unless ``reference`` is "absolute") and of the damping ratio.

    Parameters
    ----------
    structure : JointedStructure
        Its Iwan joints' K_T are those of the sets where ``fixed`` names them.
    curves : ModalCurves or sequence of them
        Measured, one for each of ``modes``.
    count : int
        Number of sets; a power of two suits the sequence best.
    weights : sequence of float, optional
        W_r of each curve; 1 by default.
    macroslip : (float, float)
        Range of phi_max over the largest deflection of the joint, 1.
    share : (float, float)
        Range of R over R_max, 1.
    parameters, fixed, modes, sensors, groups, reference
        As in :func:`iwanjax.fit`; here too the damping beside the joints suits each set best
        unless it is fixed.
    seed : int
        Of the sequence's scrambling.
    scheduler : str, optional
        ``local`` for this machine's processes, or the address of a dask scheduler, that parts of
        2048 sets go to; the numbers are the same. By default all is done here.
    workers : int, optional
        Local processes; by default one a processor.

    Returns
    -------
    SampledFits

    Raises
    ------
    InputError
        For ranges that are not positive or cross, weights that do not match the curves or are
        negative, and what :func:`iwanjax.fit` refuses.
    PrecisionError
        When JAX computes in float32.

    References
    ----------
    Lacayo (2017), Sec. 3.4.3, Eqs. (3.33), (3.34), Fig. 3.7.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> system = ij.three_mass()
    >>> levels = np.geomspace(1e-2, 1.0, 12)
    >>> curves = [ij.qsma(system, mode, levels, 1e-4).curves for mode in (0, 1)]
    >>> sets = ij.sample_fits(system, curves, 128, fixed=["J1.K_T"])
    >>> sets.values.shape, bool(sets.damping_rmsd.min() < 1e-3)
    ((128, 6), True)
    """
    require_double_precision("sample_fits")
    if not isinstance(structure, JointedStructure):
        raise InputError(
            f"sample_fits: expected a JointedStructure, got {type(structure).__name__}; one mode "
            "alone is fitted by ij.fit"
        )
    if isinstance(count, bool) or not isinstance(count, numbers.Integral) or count < 1:
        raise InputError(f"sample_fits: count = {count!r}; expected a whole number, at least 1")
    for name, (low, high) in (("macroslip", macroslip), ("share", share)):
        if not 0.0 < low <= high < np.inf:
            raise InputError(f"sample_fits: {name} = ({low:g}, {high:g}); expected 0 < low <= high")
    if share[1] > 1.0:
        raise InputError(
            f"sample_fits: share = ({share[0]:g}, {share[1]:g}); R is at most R_max (3.33), so "
            "that the upper end is at most 1"
        )
    several = [curves] if isinstance(curves, ModalCurves) else list(curves)
    W = _checked_weights(weights, len(several))
    without = any(c.frequency_std is None or c.damping_std is None for c in several)
    # Deviations only weigh the levels of a curve's own offset and of its damping beside the joints.
    several = list(with_model_error(several, WITHOUT_NOISE if without else None))
    known = structural_parameters(structure, groups, several, modes)
    row = fixed_at(replaced(tuple(known.values()), parameters or {}), fixed)
    problem = structural_problem(
        structure, several, row, modes, sensors, groups, reference or "shift"
    )
    draws = _drawn(problem, row, int(count), macroslip, share, seed)
    projected = ProjectedProblem.of(problem, row)
    todo = _in_parts(draws)
    if scheduler is None:
        # The first alone, so that the others find its kernel; one part keeps one core busy.
        parts = [_part(projected, W, todo[0])]
        with ThreadPoolExecutor(available_threads()) as pool:
            parts += pool.map(partial(_part, projected, W), todo[1:])
    else:
        found = dict(pieces(_elsewhere(projected, W), todo, scheduler, workers))
        parts = [found[i] for i in range(len(todo))]
    values, f, zeta = (np.concatenate([part[k] for part in parts])[:count] for k in range(3))
    return SampledFits(
        names=problem.names,
        values=values,
        frequency_rmsd=f,
        damping_rmsd=zeta,
        front=not_beaten(f, zeta),
        weights=W,
        parameters=row,
        measured=tuple(several),
        problem=problem,
    )


def not_beaten(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Indices of points that no other one is better than in both, by rising first value."""
    order = np.lexsort((second, first))
    order = order[np.isfinite(first[order]) & np.isfinite(second[order])]
    best = np.minimum.accumulate(second[order])
    lower = np.concatenate([[True], second[order][1:] < best[:-1]]) if order.size else []
    return order[np.asarray(lower, dtype=bool)]


def deviations(
    problem: StructuralProblem, f: Array, zeta: Array, weights: Array
) -> tuple[Array, Array]:
    r"""Differences of frequency (Hz) and damping, each times :math:`\sqrt{W_r/N_r}`, (N,) each."""
    measured = problem.measured
    f, zeta = problem.shifted(f, zeta)
    lengths = np.diff(measured.edges)
    root = jnp.sqrt(weights / lengths)[problem.curve]
    return root * (f - measured.frequency), root * (zeta - measured.damping)


def _checked_weights(weights: Sequence[float] | None, curves: int) -> np.ndarray:
    W = np.ones(curves) if weights is None else np.asarray(weights, dtype=float)
    if W.shape != (curves,) or not np.all(np.isfinite(W)) or np.any(W < 0.0) or not np.any(W):
        raise InputError(
            f"weights: got {weights!r} for {curves} curve(s); expected one number for each, none "
            "negative, not all zero"
        )
    return W


def _drawn(
    problem: StructuralProblem,
    parameters: Sequence[Parameter],
    count: int,
    macroslip: tuple[float, float],
    share: tuple[float, float],
    seed: int,
) -> np.ndarray:
    """Sets (count, parameters) by a scrambled Sobol sequence of the free parameters."""
    from scipy.stats import qmc  # here, because few need it and it is slow to import

    free = [i for i, p in enumerate(parameters) if not p.fixed]
    unit = np.zeros((count, len(parameters)))
    if free:
        # Half a set's share away from the ends, where a prior's quantile may be infinite.
        unit[:, free] = np.clip(
            qmc.Sobol(len(free), rng=seed).random(count), 0.5 / count, 1.0 - 0.5 / count
        )
    values = np.stack([_quantile(p, u) for p, u in zip(parameters, unit.T, strict=True)], axis=1)
    first = jnp.asarray([p.value for p in parameters])
    for place in problem.iwan_places(first):
        at = [place.positions[name] for name in ("F_S", "K_T", "chi", "beta")]
        F_S, K_T, chi, beta = at
        held = parameters[F_S].fixed or parameters[beta].fixed
        if held or place.reach <= 0.0 or not problem.is_kind(place.owner, Iwan4):
            continue
        c, k = values[:, chi], values[:, K_T]
        if not parameters[chi].fixed:
            p = parameters[chi]
            c = values[:, chi] = p.lower + unit[:, chi] * (p.upper - p.lower)
        phi = place.reach * _between(macroslip, unit[:, F_S])
        rho = _between(share, unit[:, beta])
        # R = rho R_max leaves S = (1 - rho) K_T at the end of the distribution.
        values[:, F_S] = k * phi * (1.0 - rho / (c + 2.0))
        values[:, beta] = 1.0 / rho - 1.0
    return values


def _between(ends: tuple[float, float], u: np.ndarray) -> np.ndarray:
    """Evenly in the logarithm."""
    return ends[0] * (ends[1] / ends[0]) ** u


def _quantile(p: Parameter, u: np.ndarray) -> np.ndarray:
    """Of a parameter's prior within its bounds."""
    if p.fixed:
        return np.full(u.shape, p.value)
    return np.clip(p.prior.quantile(u), p.lower, p.upper)


def _in_parts(draws: np.ndarray) -> list[np.ndarray]:
    """Draws in equal parts, the last one filled up with its last set: one compiled kernel."""
    size = min(len(draws), AT_ONCE)
    missing = -len(draws) % size
    filled = np.concatenate([draws, np.repeat(draws[-1:], missing, axis=0)])
    return np.split(filled, len(filled) // size)


Part = tuple[np.ndarray, np.ndarray, np.ndarray]


def _part(projected: ProjectedProblem, weights: np.ndarray, draws: np.ndarray) -> Part:
    """Sets of one part and their deviations, as NumPy's arrays."""
    found = _agreement(projected, jnp.asarray(draws), jnp.asarray(weights))
    values, of_f, of_zeta = map(np.asarray, found)
    return values, of_f, of_zeta


def _elsewhere(projected: ProjectedProblem, weights: np.ndarray) -> Callable[[np.ndarray], Part]:
    """The same for processes that nobody has set up, as what can be sent to them.

    JAX's arrays would lose half their digits on arrival, where double precision is still off.
    """
    arrays, others = eqx.partition(projected, eqx.is_array)
    return partial(_arrived, jax.tree.map(np.asarray, arrays), others, weights)


def _arrived(
    arrays: ProjectedProblem, others: ProjectedProblem, weights: np.ndarray, draws: np.ndarray
) -> Part:
    jax.config.update("jax_enable_x64", True)
    return _part(eqx.combine(jax.tree.map(jnp.asarray, arrays), others), weights, draws)


@eqx.filter_jit
def _agreement(
    projected: ProjectedProblem, theta: Float[Array, "sets parameters"], weights: Array
) -> tuple[Array, Array, Array]:
    """Sets with the best damping beside the joints, and their deviations (3.34)."""
    problem = projected.base
    f, zeta = problem.predict_sets(theta)

    def each(theta: Array, f: Array, zeta: Array) -> tuple[Array, Array, Array]:
        complete = projected.completed(theta, zeta)
        added = problem.background(complete) - problem.background(theta)
        df, dz = deviations(problem, f, zeta + added[problem.curve], weights)
        of_f, of_zeta = (jnp.sqrt(jnp.sum(x**2)) for x in (df, dz))
        known = jnp.isfinite(of_f) & jnp.isfinite(of_zeta)
        return complete, jnp.where(known, of_f, jnp.inf), jnp.where(known, of_zeta, jnp.inf)

    return jax.vmap(each)(theta, f, zeta)
