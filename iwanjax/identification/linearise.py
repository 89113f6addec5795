"""Residuals of hypotheses at some values, with their derivatives or without."""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import jax
import numpy as np
from jaxtyping import Array

from iwanjax.estimation.linearisation import Linearisation
from iwanjax.identification import kernels
from iwanjax.identification.added import without_added
from iwanjax.identification.joint_priors import Joint
from iwanjax.identification.predictor import Predictor
from iwanjax.identification.problem import DIFFERENCE, HistoryProblem, Hypothesis
from iwanjax.identification.suspects import Suspects
from iwanjax.threads import available_threads

_Found = TypeVar("_Found")


def within_memory(problem: HistoryProblem, threads: int, each: int) -> tuple[int, int]:
    """Threads at most, and directions in each, along which kernels fit into the memory.

    A derivative along one takes about twice what the pushes do: their change, and that of what
    the places feel of them.
    """
    room = max(1, problem.settings.memory.kernels // (2 * problem.data.push.nbytes))
    threads = min(threads, room)
    return threads, min(each, room // threads)


def linearise(
    problem: HistoryProblem,
    points: Sequence[tuple[Hypothesis, np.ndarray]],
    time_constant: float,
    keep: bool = True,
) -> list[Linearisation]:
    """Residuals and their derivatives, for (hypothesis, theta of each recording).

    Without ``keep`` what least squares needs of the derivatives, not they themselves.
    """
    if not points:
        return []
    if not keep:
        one_by_one = (linearise(problem, [point], time_constant) for point in points)
        return [seen._replace(slopes=None) for (seen,) in one_by_one]
    gains = problem.gains([h.suspects for h, _ in points], _means(points), time_constant)
    values = points[0][1].shape[1]
    # Derivatives come in as many parts as there are threads, so that none waits for a hypothesis
    # on its own; more parts than derivatives would be empty.
    threads = min(available_threads(), values)
    threads, size = within_memory(problem, threads, math.ceil(values / threads))
    count = math.ceil(values / size)
    # All parts are of one size, for one kernel: the least that so many need, for what is beyond
    # the last derivative costs as much as a derivative.
    size = math.ceil(values / count)
    ways = np.eye(count * size, values)
    turned = np.zeros((len(points), len(ways), *gains.gain.shape[1:]))
    turned[:, : gains.slope.shape[1]] = gains.slope

    data = [problem.data_with(*point) for point in points]
    J = np.empty((len(points), problem.recordings, len(ways), *problem.data.response.shape[1:]))

    def run(i: int) -> np.ndarray:
        point, part = i // count, slice(i % count * size, (i % count + 1) * size)
        fixed = _fixed(problem, *points[point])
        along = jax.device_put((ways[part], gains.gain[point], turned[point, part]))
        e, J[point, :, part] = kernels.slopes(*fixed, *along, data[point])
        return np.asarray(e)

    slots = points[0][0].suspects.row.shape[0]
    found = _each(problem, ("slopes", slots), count * len(points), run, threads)
    for (point, value), own in _by_faulty_forces(problem, points, gains.gain):
        J[point, :, value] = own
    seen = zip(points, gains.gain, found[::count], J[:, :, :values], strict=True)
    return [
        Linearisation.of(*without_added(problem, *point, gain, e, own))
        for point, gain, e, own in seen
    ]


def _by_faulty_forces(
    problem: HistoryProblem, points: Sequence[tuple[Hypothesis, np.ndarray]], gain: np.ndarray
) -> list[tuple[tuple[int, int], np.ndarray]]:
    """Derivatives by sizes of faults of forces, for (point, place in theta).

    By differences: kernels take the forces that acted as data.
    """
    which = [
        (point, problem.map.size(slot))
        for point, (hypothesis, _) in enumerate(points)
        for slot in hypothesis.of_forces
        if hypothesis.sizes[slot]
    ]

    def run(i: int) -> np.ndarray:
        point, value = which[i // 2]
        hypothesis, theta = points[point]
        moved = theta.copy()
        moved[:, value] += DIFFERENCE * (1 - 2 * (i % 2))
        data = problem.data_with(hypothesis, moved)
        e = kernels.residuals(*_fixed(problem, hypothesis, theta), gain[point], data)[0]
        return np.asarray(e)

    slots = points[0][0].suspects.row.shape[0]
    threads, _ = within_memory(problem, available_threads(), 1)
    found = _each(problem, ("residuals", slots), 2 * len(which), run, threads) if which else []
    changes = (a - b for a, b in zip(found[::2], found[1::2], strict=True))
    return list(zip(which, (x / (2.0 * DIFFERENCE) for x in changes), strict=True))


def residuals_at(
    problem: HistoryProblem, points: Sequence[tuple[Hypothesis, np.ndarray]], time_constant: float
) -> list[np.ndarray]:
    """Residuals alone, for a tenth of the price."""
    return _residuals(problem, points, time_constant, lambda residual, _: residual)


def squares_at(
    problem: HistoryProblem, points: Sequence[tuple[Hypothesis, np.ndarray]], time_constant: float
) -> list[float]:
    """Sums of their squares: of many points the residuals of long recordings take gigabytes."""
    return _residuals(
        problem, points, time_constant, lambda residual, _: float(np.sum(residual**2))
    )


def innovations(
    problem: HistoryProblem, hypothesis: Hypothesis, theta: np.ndarray, time_constant: float
) -> np.ndarray:
    """Measured less predicted, (recordings, N, sensors): all frequencies, no weights."""
    (found,) = _residuals(problem, [(hypothesis, theta)], time_constant, lambda _, left: left)
    return found


def _residuals(
    problem: HistoryProblem,
    points: Sequence[tuple[Hypothesis, np.ndarray]],
    time_constant: float,
    kept: Callable[[np.ndarray, np.ndarray], _Found],
) -> list[_Found]:
    """Of each point what is kept of its weighted residuals and of its innovations."""
    if not points:
        return []
    gains = problem.gains(
        [h.suspects for h, _ in points], _means(points), time_constant, slopes=False
    ).gain

    def run(i: int) -> _Found:
        fixed = _fixed(problem, *points[i])
        found = kernels.residuals(*fixed, gains[i], problem.data_with(*points[i]))
        e, left = map(np.asarray, found)
        residual, _ = without_added(problem, *points[i], gains[i], e, e[:, None][:, :0])
        return kept(residual, left)

    slots = points[0][0].suspects.row.shape[0]
    threads, _ = within_memory(problem, available_threads(), 1)
    return _each(problem, ("residuals", slots), len(points), run, threads)


def _means(points: Sequence[tuple[Hypothesis, np.ndarray]]) -> np.ndarray:
    return np.stack([theta.mean(axis=0) for _, theta in points])


def _fixed(
    problem: HistoryProblem, hypothesis: Hypothesis, theta: np.ndarray
) -> tuple[Predictor, tuple[Joint, ...], Suspects, Array]:
    return problem.predictor, problem.joints, hypothesis.suspects, jax.device_put(theta)


def _each(
    problem: HistoryProblem,
    kernel: tuple[str, int],
    count: int,
    run: Callable[[int], _Found],
    threads: int,
) -> list[_Found]:
    """All jobs side by side; the first alone while a kernel is compiled: two would both do it."""
    made = (*kernel, problem.data.response.shape[1])
    alone = 0 if made in problem.compiled else 1
    found = [run(i) for i in range(alone)]
    problem.compiled.add(made)
    with ThreadPoolExecutor(threads) as pool:
        return [*found, *pool.map(run, range(alone, count))]
