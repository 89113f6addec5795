"""The verb: joint parameters from measured curves."""

import math
import numbers
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.estimation.bounded import resting, within_bounds
from iwanjax.estimation.least_squares import least_squares
from iwanjax.estimation.minima import Minimum
from iwanjax.estimation.parameters import Parameter, drawn, fixed_at, replaced, with_values
from iwanjax.estimation.problem import AbstractLeastSquares
from iwanjax.estimation.settings import Method
from iwanjax.joints import AbstractJoint, joint_type
from iwanjax.structures import JointedStructure
from iwanjax.types import ArrayLike, require_double_precision
from iwanjax.updating.coupling import (
    checked_beside,
    couplings,
    refuse_lost,
    refuse_ruled,
)
from iwanjax.updating.joint_groups import structural_parameters
from iwanjax.updating.microslip import in_other_ends, left_open, microslip
from iwanjax.updating.modal import modal_parameters, modal_problem
from iwanjax.updating.model_error import ModelError, model_error_of, with_model_error
from iwanjax.updating.most_probable import MostProbable
from iwanjax.updating.problem import AbstractProblem, Reference
from iwanjax.updating.projected import ProjectedProblem
from iwanjax.updating.solution import FitSolution, certainty, point
from iwanjax.updating.structural import StructuralProblem, structural_problem

# Costs within this of each other are the same minimum.
_SAME_COST = 1e-3
# Chance that noise makes the best minimum, when the truth lies in another one.
_CHANCE = 1e-3
# Fits by turns with what modes do to one another, at most; half or twice as many change little or
# nothing where they settle (tests/studies/test_coupled_fit.py: by up to 0.2 of the deviations).
_ROUNDS = 12


def fit(
    model: JointedStructure | type[AbstractJoint] | str,
    curves: ModalCurves | Sequence[ModalCurves],
    parameters: Mapping[str, Parameter] | None = None,
    *,
    fixed: Mapping[str, float] | Sequence[str] = (),
    modes: Sequence[int] | None = None,
    sensors: Sequence[ArrayLike] | None = None,
    groups: Mapping[str, Sequence[str]] | None = None,
    beside: Sequence[Mapping[int, ArrayLike] | None] | None = None,
    reference: Reference | None = None,
    model_error: tuple[float, float] | None = None,
    most_probable: bool = False,
    starts: int = 64,
    seed: int = 0,
    method: Method = "optimistix",
) -> FitSolution:
    r"""Fit joint parameters to measured frequency and damping against amplitude.

    Weighted least squares over all levels of all curves,

    .. math:: \sum \left(\frac{f(q;\theta) - f}{\sigma_f}\right)^2
              + \left(\frac{\zeta(q;\theta) - \zeta}{\sigma_\zeta}\right)^2,

    by Levenberg-Marquardt (optimistix) from many starts in one batch; where a parameter
    comes close to one of two bounds, from there by a bounded least squares (jaxopt). The
    priors provide the starts, and count only where ``most_probable`` or ``beside`` says so.
    ``method`` gives the whole search to another solver.

    Parameters
    ----------
    model : str, joint class or JointedStructure
        A joint's name or class fits one oscillator of unit modal mass with that joint to
        the curves of one mode (thesis Eq. 2.7; "iwan4" is the modal Iwan model). A
        structure has the parameters of its joints fitted through :func:`~iwanjax.qsma`, and
        the damping ratio of each mode beside them, ``"mode1.zeta_0"`` for elastic mode 1.
    curves : ModalCurves or sequence of them
        Measured, with standard deviations; for one oscillator several hits of one mode, for
        a structure one for each of ``modes``.
    parameters : mapping of str to Parameter, optional
        Replaces those of :func:`modal_parameters` or :func:`structural_parameters` by name.
    fixed : mapping of str to float, or sequence of str, optional
        Parameters that are known: ``{"J1.chi": -0.5}`` holds one at a value, ``["J1.chi"]`` at
        the model's own. In a study file the key ``fixed:``.
    modes : sequence of int, optional
        For a structure: the mode of each curve; by default 0, 1, ...
    sensors : sequence of (n,) array_like, optional
        For a structure: the row of the sensor that each curve's amplitude belongs to;
        without it the amplitudes are modal displacements.
    groups : mapping of str to sequence of str, optional
        For a structure: joints that share their parameters, under a common name.
    beside : sequence of mapping of int to (levels,) array_like, optional
        For a structure: for each curve the other modes that moved when it was measured, with their
        modal displacements at its levels. What they do to the curve (:func:`coupled_modes`) is
        taken off it, by turns with the fit, until neither changes. Priors count meanwhile: what the
        levels that are left to a mode do not hold would go anywhere.
    reference : {"absolute", "shift"}, optional
        Compare frequencies themselves (default for an oscillator), or up to one offset a
        curve (default for a structure): errors of the linear model must not be paid for by
        the joints (thesis Sec. 3.4.3).
    model_error : (float, float), optional
        Relative standard deviations of the model's own frequency and damping, joined with the
        curves' in quadrature; curves may then be without any. By default none, but for curves
        without noise (simulated decays) 2e-4 and 0.015, what quasi-static curves in microslip
        differ by from decays; (0, 0) for none. The solution tells.
    most_probable : bool
        Whether priors count as measurements do: for a stiffness that is known from low amplitudes
        within its deviation, say. The sum has :math:`(\ln\theta - \ln m)^2/\sigma^2` for a
        log-normal prior, alike for a normal one, nothing for those between two ends.
    starts : int
        Starting points: the parameters' values, and draws from their priors. All are
        improved and compared; sixteen, the best of each neighbourhood, are run to their
        minimum, and all of up to 64 of a single mode with an Iwan joint.
    seed : int
        Of the draws.
    method : {"optimistix", "jaxopt", "host"}
        Who searches: Levenberg-Marquardt compiled with the residuals, all starts in one batch;
        SciPy's trust regions within the parameters' bounds (jaxopt), one start after the other;
        or the search that diagnoses use. They end at the same minimum.

    Returns
    -------
    FitSolution

    Raises
    ------
    InputError
        For a method that there is not, curves without deviations or with NaN, unknown parameters
        or joints, modes that do not match, a mode whose damping beside the joints is fixed at zero.
    PrecisionError
        When JAX computes in float32.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> q, one = np.geomspace(5e-4, 2e-2, 20), np.ones(20)
    >>> mode = ij.ModalOscillator(10.0, 1e-3, ij.Jenkins(F_S=1.0, K_T=500.0))
    >>> f, zeta = mode.ringdown_frequency_and_damping(q)
    >>> curves = ij.ModalCurves(q, f, zeta, frequency_std=1e-3 * one, damping_std=1e-5 * one)
    >>> solution = ij.fit("jenkins", curves)
    >>> round(solution.values["F_S"], 3), round(solution.values["K_T"], 1)
    (1.0, 500.0)
    """
    require_double_precision("fit")
    if not isinstance(starts, numbers.Integral) or starts < 1:
        raise InputError(f"fit: starts = {starts!r}; expected a whole number, at least 1")
    if reference not in (None, "absolute", "shift"):
        raise InputError(f"fit: reference = {reference!r}; expected 'absolute' or 'shift'")
    several = [curves] if isinstance(curves, ModalCurves) else list(curves)
    if not several:
        raise InputError("fit: no curves; expected at least one ModalCurves")
    if not isinstance(seed, numbers.Integral) or seed < 0:
        raise InputError(f"fit: seed = {seed!r}; expected a whole number, not negative")
    for i, each in enumerate(several):
        if not isinstance(each, ModalCurves):
            raise InputError(f"curve {i}: expected ModalCurves, got {type(each).__name__}")
    error = model_error_of(several, model_error)
    several = list(with_model_error(several, error))
    others = {} if parameters is None else parameters
    if isinstance(model, JointedStructure):
        known = structural_parameters(model, groups, several, modes)
        row = fixed_at(replaced(tuple(known.values()), others), fixed)
        compared, counted = reference or "shift", most_probable or beside is not None

        def solved(
            some: Sequence[ModalCurves], begin: tuple[Parameter, ...], runs: int
        ) -> FitSolution:
            of_these = structural_problem(model, some, begin, modes, sensors, groups, compared)
            return solve(of_these, begin, some, runs, int(seed), error, method, counted)

        if beside is None:
            return solved(several, row, int(starts))
        whole = structural_problem(model, several, row, modes, sensors, groups, compared)
        moved = checked_beside(beside, several, whole.modes)
        return _coupled(solved, several, row, int(starts), whole, moved)
    options = {"modes": modes, "sensors": sensors, "groups": groups, "beside": beside}
    for name, given in options.items():
        if given is not None:
            raise InputError(f"fit: {name} belong to a JointedStructure, not to one oscillator")
    kind = joint_type(model) if isinstance(model, str) else model
    if not (isinstance(kind, type) and issubclass(kind, AbstractJoint)):
        raise InputError(
            f"fit: expected a joint's name or class or a JointedStructure, got {model!r}"
        )
    row = fixed_at(replaced(tuple(modal_parameters(kind, several).values()), others), fixed)
    problem = modal_problem(kind, several, row, reference or "absolute")
    return solve(problem, row, several, int(starts), int(seed), error, method, most_probable)


def _coupled(
    solved: Callable[[Sequence[ModalCurves], tuple[Parameter, ...], int], FitSolution],
    curves: Sequence[ModalCurves],
    parameters: tuple[Parameter, ...],
    starts: int,
    problem: StructuralProblem,
    beside: Sequence[Mapping[int, np.ndarray]],
) -> FitSolution:
    r"""Fit curves of modes that moved together, by turns with what they do to one another.

    With :math:`q` the mode's own amplitude and :math:`Q` those of the others at the same time,

    .. math:: f(q) = f_\text{measured}(q, Q)
              - \left[f(q, Q; \theta) - f(q, 0; \theta)\right],

    and alike for the damping, the bracket with the parameters of the last fit. A level's deviations
    hold what its bracket changed by from one fit to the next: all of it at first, so that levels
    which the others rule say little until a model knows what they do, and nothing in the end. It
    goes beyond the thesis, whose curves need a hit that moves one mode alone (Sec. 3.4.2).

    Raises
    ------
    InputError
        Where a parameter is lost, as nothing was left to hold it, and where others rule a curve.
    """
    given = np.array([p.value for p in parameters])
    now = [each.begun for each in couplings(problem, given, beside)]
    runs, rounds, step = starts, 0, 1.0
    while True:
        alone = [own.taken_off(each) for own, each in zip(now, curves, strict=True)]
        solution = replace(solved(alone, parameters, runs), coupling=tuple(now))
        parameters = solution.parameters
        refuse_lost(parameters, solution.active_bounds)
        theta = np.array([p.value for p in parameters])
        found = couplings(problem, theta, beside)
        now = [new.after(old, step) for new, old in zip(found, now, strict=True)]
        rounds += 1
        settled = all(new.settled(each) for new, each in zip(now, curves, strict=True))
        if (settled and runs == starts) or rounds == _ROUNDS:
            refuse_ruled(now, curves, settled)
            return solution
        # From where it stands: of other ends that are as good it would find another each time.
        # What has settled is looked at from everywhere once more.
        # Half the way, for a curve that was given too much is given too little next.
        runs, step = starts if settled else 1, 0.5


def solve(
    problem: AbstractProblem,
    parameters: tuple[Parameter, ...],
    curves: Sequence[ModalCurves],
    starts: int,
    seed: int,
    model_error: ModelError | None = None,
    method: Method = "optimistix",
    most_probable: bool = False,
) -> FitSolution:
    """Search a problem and say how sure its answer is."""
    random = np.random.default_rng(seed)
    draws = problem.spread(drawn(parameters, random, starts))
    searched, runs = _searched(problem, parameters), min(starts, problem.most_runs)
    asked = MostProbable.of(searched, parameters) if most_probable else searched
    with ThreadPoolExecutor(1) as other:
        # The compiler leaves the second core to this, which is wanted right after.
        other.submit(point, problem, jnp.asarray(draws[0]))
        found = least_squares(asked, jnp.asarray(draws), runs, method=method)
    best = min(found, key=lambda each: each.cost)
    further = problem.restarts(best.values, starts)
    if further is not None:
        # As many again: one compiled search serves both.
        found += least_squares(asked, jnp.asarray(further), runs, method=method)
        best = min(found, key=lambda each: each.cost)
    if not np.isfinite(best.cost):
        raise InputError(
            "fit: no start gave finite residuals; are the amplitudes in the unit that the model "
            "is in?"
        )
    end = within_bounds(asked, best)
    theta = _completed(searched, end.values)
    active = resting(problem, theta)
    final = with_values(parameters, theta)
    there = point(problem, jnp.asarray(theta))
    f, zeta = (np.asarray(x) for x in there.differences)
    freedom = max(1, f.size + zeta.size - len(problem.chart.free) + len(active))
    misfit = float(np.sqrt((np.sum(f**2) + np.sum(zeta**2)) / freedom))
    least = float(np.sum(f**2) + np.sum(zeta**2))
    allowed = least + rival_cost(f.size) * max(1.0, misfit) ** 2
    places = problem.iwan_places(jnp.asarray(theta))
    alike = microslip(
        places,
        final,
        theta,
        lambda each: _minimum(problem, each).cost <= allowed,
    )
    # What the priors say counts in all ends alike.
    within = end.cost + allowed - least
    ends = [_completed(searched, each.values) for each in found if each.cost <= within]
    minima = [_minimum(problem, each) for each in (theta, *ends, *alike.thetas)]
    as_good = [each for each in minima if each.cost <= allowed]
    others = ((problem.iwan_places(jnp.asarray(e.theta)), e.theta) for e in as_good[1:])
    reaches = in_other_ends(places, theta, others) | alike.reaches
    sure = certainty(as_good, final, tuple(active), misfit)
    return FitSolution(
        parameters=final,
        covariance=sure.covariance,
        derived=sure.derived,
        undetermined=sure.undetermined,
        determined={
            name: known and not left_open(name, reaches) for name, known in sure.determined.items()
        },
        rivals=sure.rivals,
        active_bounds=active,
        reaches=reaches,
        misfit=misfit,
        misfit_frequency=_rms(f),
        misfit_damping=_rms(zeta),
        frequency_rms=_rms(f * np.asarray(problem.measured.frequency_std)),
        damping_rms=_rms(
            zeta * np.asarray(problem.measured.damping_std / problem.measured.damping)
        ),
        converged=best.converged or bool(active),
        agreeing=sum(each.cost <= best.cost * (1.0 + _SAME_COST) + _SAME_COST for each in found),
        runs=len(found),
        model_error=model_error,
        most_probable=most_probable,
        model=problem.model(jnp.asarray(theta)),
        measured=tuple(curves),
        predicted=predicted_curves(problem, there.prediction, curves),
        problem=problem,
    )


def _searched(problem: AbstractProblem, parameters: Sequence[Parameter]) -> AbstractLeastSquares:
    """What a search moves: of a structure the joints, where any is free."""
    if not isinstance(problem, StructuralProblem):
        return problem
    projected = ProjectedProblem.of(problem, parameters)
    return projected if projected.chart.free else problem


def _completed(searched: AbstractLeastSquares, theta: np.ndarray) -> np.ndarray:
    """Parameters of a search's end with those that it has left to a closed form."""
    if not isinstance(searched, ProjectedProblem):
        return theta
    there = point(searched.base, jnp.asarray(theta))
    return np.asarray(searched.completed(jnp.asarray(theta), there.prediction[1]))


def _minimum(problem: AbstractProblem, theta: np.ndarray) -> Minimum:
    """Parameters and what the problem says there."""
    there = point(problem, jnp.asarray(theta))
    return Minimum(
        theta,
        float(sum(np.sum(np.asarray(x) ** 2) for x in there.differences)),
        np.asarray(there.slope),
        {name: np.asarray(x) for name, x in there.derived.items()},
        {name: np.asarray(x) for name, x in there.derived_slope.items()},
    )


def rival_cost(levels: int) -> float:
    r"""What another minimum may cost more, in units of chi^2, and still hold the truth.

    A kink may lie between any two levels, and its place and size are two parameters: the
    best of N places gains more than x from noise with a chance of about
    :math:`N e^{-x/2}` (Bonferroni's bound for chi-square of two degrees).
    """
    return 2.0 * math.log(levels / _CHANCE)


def predicted_curves(
    problem: AbstractProblem, prediction: tuple[Array, Array], curves: Sequence[ModalCurves]
) -> tuple[ModalCurves, ...]:
    """A prediction at the amplitudes of the measured curves."""
    f, zeta = prediction
    return tuple(
        ModalCurves(
            each.amplitude,
            f[part],
            zeta[part],
            quantity=each.quantity,
            unit=each.unit,
            name=each.name,
            largest=each.largest,
        )
        for each, part in zip(curves, problem.measured.slices, strict=True)
    )


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
