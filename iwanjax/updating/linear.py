"""Low-amplitude updating: stiffnesses from natural frequencies and mode shapes."""

import math
import numbers
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.errors import InputError
from iwanjax.estimation.bounded import within_bounds
from iwanjax.estimation.least_squares import least_squares
from iwanjax.estimation.minima import Minimum
from iwanjax.estimation.parameters import Chart, Parameter, drawn, with_values
from iwanjax.estimation.priors import LogNormal
from iwanjax.structures.affine import AffineStructure
from iwanjax.structures.checks import finite_array
from iwanjax.threads import one_thread
from iwanjax.types import ArrayLike, require_double_precision
from iwanjax.updating.linear_problem import RIGID, LinearProblem, Matched, MeasuredModes, believed
from iwanjax.updating.linear_solution import LinearSolution
from iwanjax.updating.solution import certainty

# Draws from which a prior's middle and deviation in the variable that is moved are taken.
_DRAWS = 4000
# Relative change of the values at which a search ends: priors leave long flat valleys.
_TOLERANCE = 1e-4
# Difference in cost that makes one minimum a hundred times as likely as another, 2 ln 100.
_AS_GOOD = 9.2
# Costs within this share of each other are the same minimum.
_SAME_COST = 1e-3


def positive_parameter(
    name: str, value: float, factor: float, unit: str = "", meaning: str = ""
) -> Parameter:
    """A positive quantity known within a factor, one deviation of its logarithm.

    Parameters
    ----------
    name : str
        As the structure calls it.
    value : float
        Where to start, and the prior's median.
    factor : float
        Above 1: two thirds of the belief lie between value / factor and value * factor.
    unit, meaning : str
        For reports.

    Raises
    ------
    InputError
        For a value that is not positive and a factor that is not above 1.

    Examples
    --------
    >>> import iwanjax as ij
    >>> k = ij.positive_parameter("k", 2.0, 1.5, unit="N/m")  # 2, give or take a factor of 1.5
    >>> k.transform, float(k.prior.median)
    ('log', 2.0)
    """
    if not (value > 0 and factor > 1):
        raise InputError(
            f"parameter {name}: value = {value:g}, factor = {factor:g}; expected a positive value "
            "and a factor above 1"
        )
    prior = LogNormal(value, math.log(factor))
    return Parameter(name, value, prior, unit, meaning, lower=0.0, transform="log")


@one_thread()
def update_linear(
    structure: AffineStructure,
    measured: MeasuredModes,
    parameters: Mapping[str, Parameter],
    *,
    sensors: Sequence[ArrayLike] | None = None,
    modes: Sequence[int] | None = None,
    starts: int = 4,
    seed: int = 0,
) -> LinearSolution:
    r"""Find the parameters of an affine structure from its low-amplitude modes.

    Most probable values (thesis Sec. 3.4.2, with priors in place of a well-posed count):

    .. math:: \sum_j \left(\frac{f_{m(j)}(\theta) - f_j}{\sigma_j}\right)^2
              + \sum_j \left|\frac{s_j\,S\phi_{m(j)} - \psi_j}{\sigma_\psi}\right|^2
              + \sum_i \left(\frac{z_i - \bar z_i}{\sigma_i}\right)^2

    by Levenberg-Marquardt from several starts. Measured mode j is compared with the elastic
    mode m(j) whose shape is most like it (MAC), never with the one of the same number.

    Parameters
    ----------
    structure : AffineStructure
        With terms named as the parameters.
    measured : MeasuredModes
        Frequencies, and shapes where they were measured.
    parameters : mapping of str to Parameter
        One for each term, with its starting value and prior;
        :func:`positive_parameter` makes them.
    sensors : sequence of (n,) array_like, optional
        Rows of the sensors that the shapes were measured at.
    modes : sequence of int, optional
        Where no shapes were measured: which elastic mode at the starting values each
        frequency belongs to, lowest first. They are followed by shape.
    starts : int
        The parameters' values, and draws from their priors.
    seed : int
        Of the draws.

    Returns
    -------
    LinearSolution

    Raises
    ------
    InputError
        For parameters that do not match the terms, shapes without sensors or neither shapes
        nor modes, and starts that end nowhere.
    PrecisionError
        When JAX computes in float32.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> springs = {"k1": ij.spring([1, 0]), "k2": ij.spring([-1, 1])}
    >>> family = ij.AffineStructure(np.eye(2), np.zeros((2, 2)), springs)
    >>> omega = family.at({"k1": 300.0, "k2": 200.0}).modes().omega
    >>> measured = ij.MeasuredModes(omega / (2 * np.pi), frequency_std=1e-3)
    >>> guess = {name: ij.positive_parameter(name, 250.0, 2.0) for name in springs}
    >>> solution = ij.update_linear(family, measured, guess, modes=[0, 1])
    >>> {name: round(value) for name, value in solution.values.items()}
    {'k1': 300, 'k2': 200}
    """
    require_double_precision("update_linear")
    if not isinstance(starts, numbers.Integral) or starts < 1:
        raise InputError(f"update_linear: starts = {starts!r}; expected a whole number, at least 1")
    row = _in_order(structure, parameters)
    rows, shapes = _recognised_by(structure, measured, row, sensors, modes)
    chart = Chart(row)
    random = np.random.default_rng(seed)
    many = jnp.asarray(drawn(row, random, _DRAWS))
    logarithmic = tuple(p.transform == "log" for p in row)
    prior = np.asarray(jax.vmap(lambda theta: believed(theta, chart.free, logarithmic))(many))
    problem = LinearProblem(
        chart=chart,
        structure=structure,
        rows=jnp.asarray(rows),
        shapes=jnp.asarray(shapes / np.sqrt(np.mean(shapes**2, axis=0))),
        frequency=jnp.asarray(measured.frequency),
        frequency_std=jnp.asarray(measured.frequency_std),
        shape_std=None if measured.shapes is None else jnp.asarray(measured.shape_std),
        middle=jnp.asarray(prior.mean(axis=0)),
        spread=jnp.asarray(prior.std(axis=0)),
        logarithmic=logarithmic,
        names=structure.names,
    )
    found = least_squares(problem, many[:starts], int(starts), tolerance=_TOLERANCE)
    cost = np.array([each.cost for each in found])
    best = found[int(np.argmin(cost))]
    if not np.isfinite(best.cost):
        raise InputError(
            "update_linear: no start gave finite frequencies; are matrices, starting values and "
            "frequencies in one system of units?"
        )
    end = within_bounds(problem, best)
    theta, active = end.values, end.at_bounds
    final = with_values(row, theta)
    before, after, slope = _there(problem, jnp.asarray([p.value for p in row]), jnp.asarray(theta))
    differences = [np.asarray(x) for x in problem.differences(jnp.asarray(theta))]
    data = problem.data(jnp.asarray(theta))
    misfit = float(jnp.sqrt(jnp.mean(data**2)))
    # Another minimum that is this little worse may hold the truth.
    as_good = np.flatnonzero(cost <= best.cost + _AS_GOOD * max(1.0, misfit) ** 2)
    minima = [_minimum(theta, data, slope)]
    for other in (found[i].values for i in as_good):
        there = jnp.asarray(other)
        minima.append(_minimum(other, problem.data(there), _there(problem, there, there)[2]))
    sure = certainty(minima, final, tuple(active), misfit)
    return LinearSolution(
        parameters=final,
        started=row,
        covariance=sure.covariance,
        undetermined=sure.undetermined,
        determined=sure.determined,
        rivals=sure.rivals,
        active_bounds=dict(active),
        measured_frequency=measured.frequency,
        frequency_std=measured.frequency_std,
        frequency_before=np.asarray(before.frequency),
        frequency=np.asarray(after.frequency),
        mode=np.asarray(after.mode),
        assurance=np.asarray(after.assurance),
        misfit_frequency=float(np.sqrt(np.mean(differences[0] ** 2))),
        misfit_shapes=None
        if measured.shapes is None
        else float(np.sqrt(np.mean(differences[1] ** 2))),
        converged=best.converged or bool(active),
        agreeing=int(np.sum(cost <= best.cost * (1.0 + _SAME_COST) + _SAME_COST)),
        runs=cost.size,
        structure=structure,
    )


def _minimum(theta: np.ndarray, data: Array, slope: Array) -> Minimum:
    return Minimum(theta, float(jnp.sum(data**2)), np.asarray(slope), {}, {})


@eqx.filter_jit
def _there(problem: LinearProblem, start: Array, theta: Array) -> tuple[Matched, Matched, Array]:
    """Matched modes before and after, and the slope of what counts."""
    return problem.matched(start), problem.matched(theta), jax.jacfwd(problem.data)(theta)


def _in_order(
    structure: AffineStructure, parameters: Mapping[str, Parameter]
) -> tuple[Parameter, ...]:
    if not isinstance(structure, AffineStructure):
        raise InputError(
            f"update_linear: expected an AffineStructure, got {type(structure).__name__}"
        )
    if set(parameters) != set(structure.names):
        raise InputError(
            f"update_linear: parameters are {', '.join(parameters) or 'none'}; the structure has "
            f"{', '.join(structure.names)}"
        )
    row = tuple(parameters[name] for name in structure.names)
    if all(p.fixed for p in row):
        raise InputError("update_linear: all parameters are fixed; free at least one")
    return row


def _recognised_by(
    structure: AffineStructure,
    measured: MeasuredModes,
    parameters: Sequence[Parameter],
    sensors: Sequence[ArrayLike] | None,
    modes: Sequence[int] | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Rows and shapes that modes are recognised by."""
    k = measured.frequency.size
    if measured.shapes is not None:
        if sensors is None or modes is not None:
            raise InputError("update_linear: shapes were measured; give sensors, and not modes")
        rows = np.stack([finite_array(each, "sensors") for each in sensors])
        expected = (measured.shapes.shape[0], structure.size)
        if rows.shape != expected:
            raise InputError(
                f"update_linear: sensors have shape {rows.shape}; expected {expected}, a row for "
                "each component of the shapes"
            )
        return rows, measured.shapes
    if modes is None or sensors is not None:
        raise InputError("update_linear: no shapes were measured; give modes, and not sensors")
    start = jnp.asarray([p.value for p in parameters])
    lam, Phi = (np.asarray(x) for x in structure.modes(start))
    elastic = np.flatnonzero(lam > (2.0 * np.pi * RIGID * measured.frequency.min()) ** 2)
    if len(modes) != k or not all(0 <= m < elastic.size for m in modes):
        raise InputError(
            f"update_linear: modes are {list(modes)}; expected {k} of 0 to {elastic.size - 1}, one "
            "for each frequency"
        )
    # With the mass's root for rows, shapes are compared as the mass sees them.
    root = np.linalg.cholesky(np.asarray(structure.matrices(start)[0])).T
    return root, root @ Phi[:, elastic[list(modes)]]
