"""What finer steps between samples change in residuals."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import jax
import numpy as np

from iwanjax.identification.linearise import innovations, residuals_at
from iwanjax.identification.predictor import Data
from iwanjax.identification.problem import HistoryProblem, Hypothesis

# Errors of a free run that grow with time are so much larger over twice a time than they were over
# its second half: mean squares of 4/3 and 7/12.
_GROWN = math.sqrt(16.0 / 7.0)


class Change(NamedTuple):
    """What finer steps change in residuals.

    Attributes
    ----------
    change : float, deviations
        Root mean square of the recording that changes most.
    ratio : float
        That over what is allowed.
    """

    change: float
    ratio: float

    @classmethod
    def most(cls, changes: Mapping[float, float], same: Mapping[float, float]) -> "Change":
        """Of some time constants the one for which it counts most."""
        each = (cls(change, change / same[key]) for key, change in changes.items())
        return max(each, key=lambda one: one.ratio)


def changed(
    problem: HistoryProblem,
    finer: HistoryProblem,
    hypothesis: Hypothesis,
    theta: np.ndarray,
    same: Mapping[float, float],
) -> Change:
    """What finer steps change in the residuals of the recording that changes most.

    Parameters
    ----------
    problem, finer : HistoryProblem
        With fewer and with more steps between samples.
    hypothesis, theta
        Whose residuals.
    same : mapping of float to float
        Observer's time constants in cycles, and the change that each allows.
    """
    points, changes = [(hypothesis, theta)], {}
    for time_constant in same:
        off = (
            residuals_at(finer, points, time_constant)[0]
            - residuals_at(problem, points, time_constant)[0]
        )
        changes[time_constant] = float(np.max(np.sqrt(np.mean(off**2, axis=(1, 2)))))
    return Change.most(changes, same)


def of_own_motion(
    problem: HistoryProblem,
    twice: HistoryProblem,
    hypothesis: Hypothesis,
    theta: np.ndarray,
    same: Mapping[float, float],
) -> Change:
    """What steps leave of recordings that the model itself makes with twice as many.

    Without another kernel, which takes seconds to compile: half a recording with twice as many
    steps has as many as the whole. So each half is made from rest, from where its force begins,
    and predicted from there; the half that is off most counts. What an observer's corrections
    add in a model that is far from the recording is not in it, and small beside what that is off.
    A sensor's fault, whose delay counts samples, is left out.

    Parameters
    ----------
    problem, twice : HistoryProblem
        With any number of steps between samples, and with twice as many.
    hypothesis, theta, same
        As for :func:`changed`.
    """
    data, steps = problem.data, problem.predictor.substeps
    push, weight = np.asarray(data.push), np.asarray(data.weight)
    finer = np.asarray(twice.data.push).reshape(len(push), -1, *push.shape[2:])
    begin, size = np.argmax(np.any(push != 0.0, axis=(2, 3)), axis=1), push.shape[1]
    # Samples at full weight; in a pulse they hardly count.
    peak = np.max(weight, axis=1, keepdims=True)
    full = np.divide(weight, peak, out=np.zeros_like(weight), where=peak > 0.0) ** 2
    chain = jax.device_put(np.zeros(hypothesis.suspects.chain.shape))
    faultless = replace(hypothesis, suspects=hypothesis.suspects._replace(chain=chain))
    halved = replace(twice, predictor=replace(twice.predictor, substeps=steps))
    silent, off = np.zeros_like(weight), {time_constant: [] for time_constant in same}
    for half in range(2):
        edges = np.minimum(begin[:, None] + size // 2 * np.array([half, half + 1]), size)
        made, own = np.zeros_like(push), np.zeros_like(push)
        for i, (a, b) in enumerate(edges):
            made[i, : 2 * (b - a)] = finer[i, 2 * a : 2 * b]
            own[i, a:b] = push[i, a:b]
        run = replace(halved, data=_of_itself(data, made, silent))
        exact = -innovations(run, faultless, theta, math.inf)
        there = replace(problem, data=_of_itself(data, own, silent))
        # Beyond its end each half goes on as predicted, lest the band's filter sees an end.
        response = -innovations(there, faultless, theta, math.inf)
        for i, (a, b) in enumerate(edges):
            response[i, a:b] = exact[i, 1 : 2 * (b - a) : 2]
        there = replace(problem, data=_of_itself(data, own, response))
        for time_constant, found in off.items():
            e = residuals_at(there, [(faultless, theta)], time_constant)[0]
            for i, (a, b) in enumerate(edges):
                found += _root_mean_square(e[i, a:b], full[i, a:b])
                if math.isinf(time_constant):
                    middle = (a + b) // 2
                    later = _root_mean_square(e[i, middle:b], full[i, middle:b])
                    found += [_GROWN * each for each in later]
    return Change.most({key: max(found, default=math.inf) for key, found in off.items()}, same)


def _root_mean_square(e: np.ndarray, full: np.ndarray) -> list[float]:
    """Of residuals over the samples that count; none where these are none."""
    count = float(np.sum(full))
    return [math.sqrt(float(np.sum(e**2)) / count)] if count > 0.0 else []


def _of_itself(data: Data, push: np.ndarray, response: np.ndarray) -> Data:
    """What a model would measure itself, whose state is certain."""
    push, response, kick = jax.device_put((push, response, np.zeros(data.kick.shape)))
    return data._replace(push=push, response=response, kick=kick)
