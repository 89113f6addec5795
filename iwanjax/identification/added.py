"""What is added to sensors: columns of any size in each recording, taken out of the residuals."""

import math

import jax
import numpy as np
from jaxtyping import Float

from iwanjax.effects.faults import AbstractAddedFault
from iwanjax.identification import kernels
from iwanjax.identification.observer import stepped
from iwanjax.identification.problem import DIFFERENCE, HistoryProblem, Hypothesis
from iwanjax.signals.comparison_band import passed

# Relative singular value below which a column says nothing that the others do not.
_ALIKE = 1e-8


def without_added(
    problem: HistoryProblem,
    hypothesis: Hypothesis,
    theta: np.ndarray,
    gain: Float[np.ndarray, "states sensors"],
    e: Float[np.ndarray, "recordings N sensors"],
    slopes: Float[np.ndarray, "recordings ways N sensors"],
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals and derivatives less what the columns of a hypothesis explain.

    That is the least that their sizes, one for each column and recording, can leave: in a free run
    residuals are linear in them (variable projection, Golub and Pereyra 1973).
    """
    if not hypothesis.added:
        return e, slopes
    bases = _bases(problem, hypothesis, theta, gain)
    rest, ways = _less(e[:, None], bases)[:, 0], _less(slopes, bases)
    for slot, kind in hypothesis.added.items():
        at = problem.map.size(slot)
        if kind.told is None or at >= slopes.shape[1]:
            continue
        ends = []
        for sign in (1.0, -1.0):
            beside = theta.copy()
            beside[:, at] += sign * DIFFERENCE
            own = _bases(problem, hypothesis, beside, gain)
            ends.append(_less(e[:, None], own)[:, 0])
        ways[:, at] = (ends[0] - ends[1]) / (2.0 * DIFFERENCE)
    return rest, ways


def _bases(
    problem: HistoryProblem, hypothesis: Hypothesis, theta: np.ndarray, gain: np.ndarray
) -> list[np.ndarray]:
    """Orthonormal columns of each recording, (values, columns)."""
    made = _changes(problem, hypothesis, theta, gain)
    found = []
    for own in made.reshape(*made.shape[:2], -1):
        U, S, _ = np.linalg.svd(own.T, full_matrices=False)
        found.append(U[:, _ALIKE * max(S.max(), 1e-300) < S])
    return found


def _less(
    x: Float[np.ndarray, "recordings ways N sensors"], bases: list[np.ndarray]
) -> Float[np.ndarray, "recordings ways N sensors"]:
    """What columns leave of each recording."""
    with np.errstate(over="ignore", invalid="ignore"):
        flat = x.reshape(*x.shape[:2], math.prod(x.shape[2:]))
        left = [own - (own @ U) @ U.T for own, U in zip(flat, bases, strict=True)]
    return np.stack(left).reshape(x.shape)


def span(problem: HistoryProblem) -> float:
    """Length of the longest recording, s."""
    return problem.data.response.shape[1] * _interval(problem)


def moved(
    problem: HistoryProblem, hypothesis: Hypothesis, values: np.ndarray, slot: int
) -> AbstractAddedFault:
    """A slot's fault with the value that its columns depend on."""
    kind = hypothesis.added[slot]
    if kind.told is None:
        return kind
    return kind.moved(float(values[problem.map.size(slot)]), span(problem))


def size_of_added(
    problem: HistoryProblem,
    hypothesis: Hypothesis,
    theta: np.ndarray,
    time_constant: float,
    slot: int,
) -> tuple[float, float]:
    """Size of what a slot adds to its sensor, over all recordings, and its deviation.

    The mean square of the columns with the sizes that explain most, by noise as it is.
    """
    suspects, mean = hypothesis.suspects, theta.mean(axis=0)
    gain = problem.gains([suspects], mean[None], time_constant, slopes=False).gain[0]
    fixed = problem.predictor, problem.joints, suspects, jax.device_put(theta)
    e = np.asarray(kernels.residuals(*fixed, gain, problem.data_with(hypothesis, theta))[0])
    made = _changes(problem, hypothesis, theta, gain)
    first = sum(kind.count for at, kind in hypothesis.added.items() if at < slot)
    kind = moved(problem, hypothesis, mean, slot)
    part = slice(first, first + kind.count)
    columns = kind.columns(e.shape[1], _interval(problem))
    square, slopes, known, samples = 0.0, [], [], 0
    for own, residual, weight in zip(made, e, np.asarray(problem.data.weight), strict=True):
        X, flat = columns[np.any(weight > 0, axis=1)], own.reshape(len(own), -1)
        inverse = np.linalg.pinv(flat @ flat.T)
        c = -(inverse @ (flat @ residual.ravel()))[part]
        slopes.append(X.T @ (X @ c))
        known.append(inverse[part, part])
        square, samples = square + float(c @ slopes[-1]), samples + len(X)
    rms = math.sqrt(square / max(samples, 1))
    variance = sum(float(g @ C @ g) for g, C in zip(slopes, known, strict=True))
    std = math.sqrt(variance) / max(samples * rms, 1e-300)
    return kind.over_rms * rms, kind.over_rms * std


def _interval(problem: HistoryProblem) -> float:
    return float(problem.predictor.dt) * problem.predictor.substeps


def _changes(
    problem: HistoryProblem,
    hypothesis: Hypothesis,
    theta: np.ndarray,
    gain: Float[np.ndarray, "states sensors"],
) -> Float[np.ndarray, "recordings columns N sensors"]:
    """Changes of the residuals by each column of size 1, joints at their tangents."""
    _, N, sensors = problem.data.response.shape
    parts = []
    for slot in hypothesis.added:
        kind = moved(problem, hypothesis, theta.mean(axis=0), slot)
        own = np.zeros((kind.count, N, sensors))
        own[:, :, hypothesis.channels[slot]] = -kind.columns(N, _interval(problem)).T
        parts.append(own)
    made = np.concatenate(parts)
    if np.any(gain):
        # An observer takes it for a motion, until it has corrected that.
        values = theta.mean(axis=0)[: problem.map.end(len(hypothesis.sizes))]
        A, H = problem.system(hypothesis.suspects, values)
        step = stepped(A, _interval(problem))
        z = np.zeros((len(made), len(A)))
        for n in range(N):
            z = z @ step.T
            made[:, n] -= z @ H.T
            z = z + made[:, n] @ np.asarray(gain).T
    spectrum = np.fft.rfft(made, 2 * N, axis=1) * passed(2 * N)[:, None]
    in_band = np.fft.irfft(spectrum, 2 * N, axis=1)[:, :N]
    return in_band * np.asarray(problem.data.weight)[:, None]
