"""Which values of theta a hypothesis fits, and which of them drift."""

from collections.abc import Sequence

import numpy as np

from iwanjax.identification.joint_priors import parameters_of
from iwanjax.identification.problem import HistoryProblem, Hypothesis

# What drifts in a joint.
_DRIFTING = ("F_S", "K_T")


def values_measured(problem: HistoryProblem) -> int:
    """Number of samples that a residual is taken of."""
    return int(np.count_nonzero(np.asarray(problem.data.weight)))


def free_values(problem: HistoryProblem, hypothesis: Hypothesis) -> list[int]:
    """Places in theta of what is fitted and the same in all recordings."""
    at, found = problem.map, list(range(problem.parameters))
    for slot, (size, shape) in enumerate(zip(hypothesis.sizes, hypothesis.shapes, strict=True)):
        found += [at.size(slot)] * size + [at.shape(slot)] * shape
    return found


def elapsed(problem: HistoryProblem, places: Sequence[int]) -> np.ndarray:
    """How far a drift has come at places in the study: 0 in the first recording, 1 in the last."""
    first, last = problem.order[0], problem.order[-1]
    return (np.asarray(places, float) - first) / max(last - first, 1)


def rates(problem: HistoryProblem, hypothesis: Hypothesis) -> list[int]:
    """Places, in what is fitted, of how far the values that drift go in all."""
    if hypothesis.drifting is None:
        return []
    first = len(free_values(problem, hypothesis)) + problem.recordings * problem.directions
    # Each is followed by how far the later recordings are off the line.
    return [
        first + i * problem.recordings
        for i in range(len(drifting_values(problem, hypothesis.drifting)))
    ]


def drifting_values(problem: HistoryProblem, joint: int) -> list[int]:
    """Places in theta of what drifts in a joint."""
    first = problem.predictor.errors + parameters_of(problem.joints[:joint])
    names = [info.name for info in problem.joints[joint].given.parameters]
    return [first + names.index(name) for name in _DRIFTING if name in names]
