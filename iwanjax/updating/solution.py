"""What a fit has found, how sure it is, and what it could not find."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.estimation.minima import Minimum, mixture
from iwanjax.estimation.parameters import Parameter
from iwanjax.results import AbstractResult, with_std
from iwanjax.tables import Block, Grid
from iwanjax.types import compiled_for_one_call
from iwanjax.updating.coupling import ModalCoupling
from iwanjax.updating.microslip import left_open
from iwanjax.updating.model_error import ModelError
from iwanjax.updating.problem import AbstractProblem

# A parameter or combination counts as determined when the data leave less than this share
# of what the prior leaves open.
_DETERMINED = 1.0 / 3.0
_PRIOR_DRAWS = 4000
# Deviation over all minima, over that of the best one alone, from which on minima disagree.
_DISAGREE = 2.0
# Components below this are left out when a direction is put into words.
_SMALL_COMPONENT = 0.25


@dataclass(frozen=True)
class Direction:
    """A combination of parameters that the curves do not determine.

    Attributes
    ----------
    components : dict of str to float
        Of the unit vector, in units of each parameter's prior deviation in its transform.
    narrowing : float
        Deviation along it after the data over before, 1.
    """

    components: dict[str, float]
    narrowing: float

    def __str__(self) -> str:
        """The larger components, for instance ``+0.7 F_S -0.7 beta``."""
        ordered = sorted(self.components.items(), key=lambda pair: -abs(pair[1]))
        largest = [f"{v:+.2f} {k}" for k, v in ordered if abs(v) >= _SMALL_COMPONENT]
        return " ".join(largest)


@dataclass(frozen=True, eq=False)
class FitSolution(AbstractResult):
    r"""Result of :func:`iwanjax.fit`.

    Attributes
    ----------
    parameters : tuple of Parameter
        With the estimates as values.
    covariance : (parameters, parameters) array
        Of the estimates, linearised, times ``misfit``\ ^2 where that is above 1, over all
        minima that explain the curves by their evidence; combinations that the data leave open
        are closed by the priors. Zero for fixed parameters and those on a bound.
    derived : dict of str to (float, float)
        What follows from the parameters, with deviations.
    undetermined : tuple of Direction
        Combinations that the data narrow to no less than a third of the prior.
    determined : dict of str to bool
        For each free parameter, whether the data narrow it to less than a third.
    rivals : dict of str to (float, float)
        Range of each parameter over minima that noise may have made the worse ones, where
        that is more than a third of its prior, or where they more than double its deviation;
        such are not determined.
    active_bounds : dict of str to float
        Parameters that the data would move beyond a bound, and the bound.
    reaches : dict of str to float
        Largest deflection of each Iwan joint (or group; a mode's only one has no name) that the
        curves may leave in microslip: its phi_max is that or more, and no more is known of it, nor
        are F_S, beta and S determined.
    misfit : float
        Root of chi^2 per degree of freedom: 1 where the model explains the curves to
        their stated deviations.
    misfit_frequency, misfit_damping : float
        The same over each kind of data, per value.
    frequency_rms : float
        Root mean square of the frequency's residuals, Hz.
    damping_rms : float
        The same of the damping's, relative to the damping.
    converged : bool
        Whether the best run ended by its tolerance.
    agreeing : int
        Runs that ended at the same cost as the best, within a thousandth (at least 1e-3).
    runs : int
        Runs in all, from the best of the starts.
    model_error : ModelError or None
        Relative deviations of the model's own frequency and damping that were allowed for, in
        the deviations of ``measured`` too; None for none.
    model : ModalOscillator or JointedStructure
        With the estimates.
    measured, predicted : tuple of ModalCurves
        What was fitted, and the model at the same amplitudes.
    problem : AbstractProblem
        For a posterior.
    coupling : tuple of ModalCoupling, optional
        Of each curve what other modes did to it, which ``measured`` is without.
    most_probable : bool
        Whether the priors counted beside the curves.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> q, one = np.geomspace(5e-4, 2e-2, 20), np.ones(20)
    >>> mode = ij.ModalOscillator(10.0, 1e-3, ij.Jenkins(F_S=1.0, K_T=500.0))
    >>> f, zeta = mode.ringdown_frequency_and_damping(q)
    >>> curves = ij.ModalCurves(q, f, zeta, frequency_std=1e-3 * one, damping_std=1e-5 * one)
    >>> solution = ij.fit("jenkins", curves)
    >>> solution.determined["F_S"], solution.active_bounds
    (True, {})
    >>> round(solution.model.f_0.item(), 3)
    10.0
    """

    parameters: tuple[Parameter, ...]
    covariance: np.ndarray = field(repr=False)
    derived: dict[str, tuple[float, float]]
    undetermined: tuple[Direction, ...]
    determined: dict[str, bool]
    rivals: dict[str, tuple[float, float]]
    active_bounds: dict[str, float]
    reaches: dict[str, float]
    misfit: float
    misfit_frequency: float
    misfit_damping: float
    frequency_rms: float
    damping_rms: float
    converged: bool
    agreeing: int
    runs: int
    model_error: ModelError | None
    model: eqx.Module = field(repr=False)
    measured: tuple[ModalCurves, ...] = field(repr=False)
    predicted: tuple[ModalCurves, ...] = field(repr=False)
    problem: AbstractProblem = field(repr=False)
    coupling: tuple[ModalCoupling, ...] | None = field(default=None, repr=False)
    most_probable: bool = False

    @property
    def values(self) -> dict[str, float]:
        """Estimates by name."""
        return {p.name: p.value for p in self.parameters}

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations by name; zero for fixed ones and those on a bound."""
        deviations = np.sqrt(np.diag(self.covariance))
        return {p.name: float(s) for p, s in zip(self.parameters, deviations, strict=True)}

    def draws(self, count: int, seed: int = 0) -> np.ndarray:
        """Full parameter vectors drawn from the covariance, (count, parameters).

        Normal in each parameter's transform, as the covariance is meant (the logarithm of a
        strength, say), where that is within the bounds.
        """
        value, std = (np.array([*each.values()]) for each in (self.values, self.std))
        scale = np.where(std > 0.0, std, 1.0)
        sizes, axes = np.linalg.eigh(self.covariance / np.outer(scale, scale))
        root = axes * np.sqrt(np.maximum(sizes, 0.0))
        # A value of zero has no logarithm.
        by_log = np.array([p.transform == "log" for p in self.parameters]) & (value > 0.0)
        unit = np.where(by_log, value, 1.0)
        low, high = np.array([(p.lower, p.upper) for p in self.parameters]).T
        random, found = np.random.default_rng(seed), np.empty((0, value.size))
        while len(found) < count:
            change = random.standard_normal((count, value.size)) @ root.T * std
            theta = np.where(by_log, value * np.exp(change / unit), value + change)
            inside = np.all((std == 0.0) | ((low < theta) & (theta < high)), axis=1)
            found = np.vstack([found, theta[inside]])
        return found[:count]

    def follows(self, name: str) -> bool:
        """Whether a derived quantity is determined: known to a third of itself."""
        value, std = self.derived[name]
        return std < _DETERMINED * abs(value) and not left_open(name, self.reaches)

    def least(self, name: str) -> float | None:
        """Lower bound of a derived phi_max that the curves do not determine, else None."""
        owner, _, quantity = name.rpartition(".")
        return self.reaches.get(owner) if quantity == "phi_max" else None

    def _blocks(self) -> tuple[Block, ...]:
        f = np.concatenate([np.asarray(curves.frequency) for curves in self.measured])
        head = [
            self._headline(),
            f"It follows the frequency within {self.frequency_rms:.2g} Hz rms "
            f"({100 * self.frequency_rms / np.ptp(f):.2g} % of its range) and the damping within "
            f"{100 * self.damping_rms:.2g} % rms.",
        ]
        if self.model_error is not None:
            head.append(
                f"Deviations include {100 * self.model_error.frequency:.2g} % of the frequency and "
                f"{100 * self.model_error.damping:.2g} % of the damping for the model's own error."
            )
        if self.most_probable:
            head.append("Most probable values: what is believed of the parameters counts, too.")
        head += [told for each in self.coupling or () if (told := each.told())]
        rows = [(p.name, self._told(p), p.meaning) for p in self.parameters]
        rows += [(name, self._derived(name), "follows from the above") for name in self.derived]
        bounds = [
            f"  BOUND: {name} rests on its bound {bound:g}; the curves ask for a value beyond "
            "it, and the other parameters pay for it."
            for name, bound in self.active_bounds.items()
        ]
        remarks = self.problem.remarks(self.values, self.determined)
        return (
            "\n".join(head),
            Grid((), tuple(rows)),
            *bounds,
            *ambiguities(self.rivals, self.undetermined, "curves"),
            *(f"  {remark}" for remark in remarks),
        )

    def _derived(self, name: str) -> str:
        value, std = self.derived[name]
        least = self.least(name)
        if least is not None:
            return f">= {least:.3g} (largest deflection)"
        return with_std(value, std) if self.follows(name) else f"{value:.3g} (undetermined)"

    def _headline(self) -> str:
        state = "" if self.converged else " NOT CONVERGED: raise starts or look at the curves."
        if self.misfit > 2.0:
            verdict = (
                f"residuals are {self.misfit:.1f} times the stated deviations (frequency "
                f"{self.misfit_frequency:.1f}, damping {self.misfit_damping:.1f}): the model does "
                "not explain the curves to their noise"
            )
        else:
            verdict = (
                f"residuals are {self.misfit:.2f} times the stated deviations (frequency "
                f"{self.misfit_frequency:.2f}, damping {self.misfit_damping:.2f})"
            )
        kind = type(self.model).__name__
        joint = getattr(self.model, "joint", None)
        kind += f" with {type(joint).__name__}" if joint is not None else ""
        return f"{kind}: {verdict}; {self.agreeing} of {self.runs} runs agree.{state}"

    def _told(self, p: Parameter) -> str:
        unit = f" {p.unit}" if p.unit else ""
        if p.fixed:
            return f"{p.value:.6g}{unit} (fixed)"
        if p.name in self.active_bounds:
            return f"{p.value:.6g}{unit} (on its bound)"
        told = with_std(p.value, self.std[p.name]) + unit
        if self.determined[p.name]:
            return told
        if self.most_probable and p.name not in self.rivals:
            return f"{told} (mostly what was believed)"
        return f"{p.value:.3g}{unit} (undetermined)"


def ambiguities(
    rivals: Mapping[str, tuple[float, float]], undetermined: Sequence[Direction], data: str
) -> list[str]:
    """What data leave open, in words: other minima, and combinations they do not determine."""
    told = []
    if rivals:
        lines = [f"    {name} from {low:.3g} to {high:.3g}" for name, (low, high) in rivals.items()]
        head = f"  Other minima explain these {data} as well, to what noise can do, with"
        told.append("\n".join([head, *lines]))
    if undetermined:
        lines = [
            f"    {direction} (known to {100 * direction.narrowing:.0f} % of what the prior "
            "leaves open)"
            for direction in undetermined
        ]
        told.append("\n".join([f"  These {data} do not determine:", *lines]))
    return told


@dataclass(frozen=True)
class Certainty:
    """How well the data determine each parameter at an estimate."""

    covariance: np.ndarray
    derived: dict[str, tuple[float, float]]
    undetermined: tuple[Direction, ...]
    rivals: dict[str, tuple[float, float]]
    determined: dict[str, bool]


class Evaluation(NamedTuple):
    """All that a problem says at one set of parameters.

    Attributes
    ----------
    prediction : two (N,) arrays
        Frequency, Hz, and damping.
    differences : two (N,) arrays
        Less the measured ones, over their deviations.
    slope : (2 N, parameters) array
        Derivative of the differences.
    derived, derived_slope : dict of str to array
        What follows from the parameters, and its derivatives.
    """

    prediction: tuple[jax.Array, jax.Array]
    differences: tuple[jax.Array, jax.Array]
    slope: jax.Array
    derived: Mapping[str, jax.Array]
    derived_slope: Mapping[str, jax.Array]


@compiled_for_one_call
def point(problem: AbstractProblem, theta: jax.Array) -> Evaluation:
    """A problem at one set of parameters, in one compiled kernel."""

    def residuals(t: jax.Array):
        differences, derived = problem.differences(t), dict(problem.derived(t))
        return (jnp.concatenate(differences), derived), (problem.predict(t), differences, derived)

    (slope, derived_slope), (prediction, differences, derived) = jax.jacfwd(
        residuals, has_aux=True
    )(theta)
    return Evaluation(prediction, differences, slope, derived, derived_slope)


def certainty(
    minima: Sequence[Minimum],
    parameters: Sequence[Parameter],
    active: Sequence[str],
    misfit: float,
) -> Certainty:
    """Covariance, undetermined combinations, deviations of derived quantities.

    The residuals are linearised in each parameter's transform (the logarithm of a strength,
    say) and measured by the deviation its prior has there. ``minima`` are the estimate and
    other ends of the search that are as good: deviations cover them by their evidence
    (:func:`~iwanjax.estimation.minima.mixture`).
    """
    moving = [i for i, p in enumerate(parameters) if not p.fixed and p.name not in active]
    spread = np.array([prior_deviation(parameters[i]) for i in moving])
    names = [parameters[i].name for i in moving]
    found = mixture(minima, parameters, moving, spread, misfit)
    # The prior, taken as normal, closes the directions that the data leave open.
    undetermined = tuple(
        Direction(
            dict(zip(names, (row * np.sign(row[np.argmax(abs(row))])).tolist(), strict=True)),
            float(size),
        )
        for size, row in zip(1.0 / np.hypot(found.singular, 1.0), found.rows, strict=True)
        if size > _DETERMINED
    )
    covariance = np.zeros((len(parameters), len(parameters)))
    covariance[np.ix_(moving, moving)] = found.covariance * np.outer(spread, spread)
    deviation, alone = (np.sqrt(np.diag(C)) for C in (found.covariance, found.alone))
    rivals = np.stack([each.theta for each in minima])
    ranges = {
        parameters[i].name: (float(rivals[:, i].min()), float(rivals[:, i].max()))
        for i, open_before, wide, narrow in zip(moving, spread, deviation, alone, strict=True)
        if wide > _DISAGREE * narrow
        or _apart(parameters[i], rivals[:, i])
        > _DETERMINED * _apart_unit(parameters[i], open_before)
    }
    return Certainty(
        covariance,
        found.derived,
        undetermined,
        ranges,
        {
            name: bool(size < _DETERMINED) and name not in ranges
            for name, size in zip(names, deviation, strict=True)
        },
    )


def _apart(p: Parameter, values: np.ndarray) -> float:
    """Largest distance between values of a parameter, in its logarithm where that is moved."""
    if p.transform == "log":
        values = np.log(np.maximum(values, np.finfo(float).tiny))
    return float(np.ptp(values))


def _apart_unit(p: Parameter, deviation: float) -> float:
    """A prior's deviation in the same terms."""
    return deviation / p.value if p.transform == "log" else deviation


def prior_deviation(p: Parameter) -> float:
    """Deviation that the prior gives a parameter, linearised at its value.

    That of the logarithm times the value for what is moved by its logarithm.
    """
    draws = p.prior.draw(np.random.default_rng(0), _PRIOR_DRAWS)
    if p.transform == "log":
        return float(np.std(np.log(draws[draws > 0])) * p.value)
    return float(np.std(draws))
