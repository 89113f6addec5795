"""How much more likely the data are with a suspect than without."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from iwanjax.correlation import correlation_time
from iwanjax.effects.faults import AbstractAddedFault
from iwanjax.effects.kinds import JointKind
from iwanjax.estimation.evidence import log_evidence
from iwanjax.identification.free_values import free_values, values_measured
from iwanjax.identification.multistart import HypothesisFit
from iwanjax.identification.observer import noise_in_innovations, stepped
from iwanjax.identification.problem import HistoryProblem
from iwanjax.signals.comparison_band import OF_NOISE

# No model is trusted to explain its residual better than this share of the noise's variance.
LEAST_TEMPERATURE = 0.3
UNSURE = 0.05
"""Share of the noise's square that some hundred samples before the triggers leave open."""


class Evidence(NamedTuple):
    r"""Log evidences :math:`-S/(2T\tau) - \frac{k}{2}\ln(N/\tau)` of fits to the same data.

    Attributes
    ----------
    values : (fits,) array
        Of each.
    temperature : float
        Squared residual of the best over the number N of values.
    tau : float
        Its correlation time in samples.
    """

    values: np.ndarray
    temperature: float
    tau: float

    def worth(self, fitted: HypothesisFit) -> float:
        """Evidence that the whole residual of a fit stands for."""
        return fitted.cost / (2.0 * self.temperature * self.tau)

    def at(
        self, problem: HistoryProblem, fits: Sequence[HypothesisFit], temperature: float
    ) -> "Evidence":
        """The same fits at another temperature."""
        costs, known = zip(*((each.cost, unknowns(each)) for each in fits), strict=True)
        count = values_measured(problem)
        values = log_evidence(costs, known, count, temperature, self.tau)
        return Evidence(values, temperature, self.tau)


def evidence(problem: HistoryProblem, fits: Sequence[HypothesisFit]) -> Evidence:
    """Of fits with the same memory, all at the temperature and correlation of the best."""
    best = min(fits, key=lambda each: each.cost)
    count = values_measured(problem)
    temperature = max(LEAST_TEMPERATURE, float(best.misfit.sum()) / count)
    tau = correlation_time(best.residual)
    return Evidence(np.zeros(0), temperature, tau).at(problem, fits, temperature)


def covariance(
    problem: HistoryProblem, fitted: HypothesisFit, own_error: bool = True
) -> np.ndarray:
    r"""Of what was free in a fit, (free, free), by the residual's own size.

    .. math:: C = (J^T J / s + P)^{-1} + \sum_r \delta_r \delta_r^T,

    with the prior's precision P. Residuals that are correlated over some samples count as so many
    fewer. What exceeds the noise is the model's own error: it goes a few ways only (:func:`scale`),
    less those that the fit has taken up, and it pulls recordings of different amplitude different
    ways (:func:`_disagreement`). Where nothing exceeds the noise, and without ``own_error``, there
    is no such term. NaN where the model broke down.
    """
    if not np.all(np.isfinite(fitted.normal)):
        return np.full_like(fitted.normal, np.nan)
    table, prior = evidence(problem, [fitted]), np.diag(fitted.precision)
    white = table.temperature * table.tau
    error = float(fitted.misfit.sum()) - (1.0 - UNSURE) * left_by_noise(problem)
    taken = len(free_values(problem, fitted.hypothesis))
    unit = max(white, 1.0 + own_error * error / max(1, _ways(problem) - taken))
    found = np.linalg.pinv((fitted.normal - prior) / unit + prior)
    # Where a joint drifts each recording has values of its own, which go with it.
    drifts = fitted.hypothesis.drifting is not None
    if not own_error or error <= 0.0 or len(fitted.parts) < 2 or drifts:
        return found
    return found + _disagreement(fitted.parts, fitted.scores, white * prior)


def _disagreement(parts: np.ndarray, scores: np.ndarray, prior: np.ndarray) -> np.ndarray:
    r"""Covariance of values that some recordings pull one way and others another.

    .. math:: \delta_r = H^{-1/2} (I - A_r)^{-1/2} H^{-1/2} s_r, \quad
              A_r = H^{-1/2} H_r H^{-1/2}, \quad H = P + \sum_r H_r

    with each recording's part :math:`H_r` of the second derivatives and :math:`s_r` of the
    gradient: the sandwich by clusters, without bias where they differ by chance (Bell and
    McCaffrey, Survey Methodology 28, 2002, "CR2"). Of R recordings that weigh the same it is the
    jackknife. Where one alone tells of a value, the jackknife says how little the others do; this
    says how far they disagree.
    """
    total = parts.sum(axis=0)
    # What all pull alike is the prior's doing, or that of a search that has not quite ended.
    scores = scores - parts @ (np.linalg.pinv(total) @ scores.sum(axis=0))
    root = _inverse_root(total + prior)
    eye = np.eye(len(total))
    change = np.stack(
        [
            root @ _inverse_root(eye - root @ part @ root) @ root @ score
            for part, score in zip(parts, scores, strict=True)
        ]
    )
    return change.T @ change


def _inverse_root(A: np.ndarray) -> np.ndarray:
    """Of a symmetric matrix, in the directions that it has."""
    values, vectors = np.linalg.eigh(A)
    there = values > len(A) * np.finfo(float).eps * max(values[-1], 1.0)
    inverse = np.where(there, 1.0 / np.sqrt(np.where(there, values, 1.0)), 0.0)
    return vectors * inverse @ vectors.T


def left_by_noise(problem: HistoryProblem, time_constant: float = math.inf) -> float:
    """Squared residual that noise alone leaves: of the sensors, and of forces that last.

    Weights allow for errors of the model too, so that the former is less than the number of
    samples.

    Parameters
    ----------
    problem : HistoryProblem
        Predictor and data.
    time_constant : float
        Memory of the observer; that of the free run by default, which feeds nothing through.
    """
    weight = np.asarray(problem.data.weight)
    left = (OF_NOISE * problem.noise * weight) ** 2
    if not math.isinf(time_constant):
        left = left * _fed_through(problem, time_constant)
    return float(np.sum(left)) + problem.driven


def _fed_through(problem: HistoryProblem, time_constant: float) -> np.ndarray:
    """Squares that each sensor's noise leaves over what it is itself."""
    blank, given, unit = problem.empty(), problem.map.given(), problem.noise
    gain = problem.gains([blank], given[None], time_constant, slopes=False).gain[0] * unit
    if not np.all(np.isfinite(gain)):
        # No observer, and no fit with one either.
        return np.ones(len(unit))
    A, H = problem.rest()
    step = stepped(A, float(problem.predictor.dt) * problem.predictor.substeps)
    return noise_in_innovations(step, H / unit[:, None], gain, problem.data.response.shape[1])


def left_by_right_model(problem: HistoryProblem) -> float:
    """Squared residual that noise leaves and the errors that a right model may have.

    Weights are one over all of them together; while a force acts at times only, its own errors as
    well, which then count for less. One that acts throughout is among them.
    """
    weight = np.asarray(problem.data.weight)
    largest = np.max(weight, axis=1, keepdims=True)
    return float(np.sum((weight / np.where(largest > 0.0, largest, 1.0)) ** 2)) + problem.driven


def scale(
    problem: HistoryProblem,
    fitted: HypothesisFit,
    unsure: float = 0.0,
    left: float | None = None,
) -> float:
    """What differences of squares between rivals of a fit are to be divided by.

    What exceeds the noise is the model's own error. It goes a few ways only, an amplitude and a
    phase of each mode in each recording, and so speaks for or against any rival by chance, more
    than white noise of that size would.

    Parameters
    ----------
    problem : HistoryProblem
        That it was fitted with.
    fitted : HypothesisFit
        The best model.
    unsure : float
        Share of the noise's square that may be error of the model as well.
    left : float, optional
        Squared residual that is left beside the fit's best rival; by default its own.
    """
    left = float(fitted.misfit.sum()) if left is None else left
    temperature = max(LEAST_TEMPERATURE, left / values_measured(problem))
    error = left - (1.0 - unsure) * left_by_noise(problem)
    white = temperature * correlation_time(fitted.residual)
    return max(white, 1.0 + error / _ways(problem))


def _ways(problem: HistoryProblem) -> int:
    """In how many an error of the model's own goes: amplitude and phase of modes in recordings."""
    return 2 * problem.predictor.kept * problem.recordings


def unknowns(fitted: HypothesisFit) -> int:
    """Number of values fitted beyond those of the joints as given."""
    hypothesis = fitted.hypothesis
    own = sum(hypothesis.sizes) + sum(hypothesis.shapes)
    added = [kind.count for kind in hypothesis.kinds if isinstance(kind, AbstractAddedFault)]
    own += sum(len(fitted.theta) * count for count in added)
    return own + sum(len(k.parameters) for k in hypothesis.kinds if isinstance(k, JointKind))
