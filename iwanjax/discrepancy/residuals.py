"""Residuals of hypotheses at some values, with their derivatives."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.discrepancy.search import Hypothesis, Search
from iwanjax.discrepancy.sensitivity import reduced

# Kernels that run at once, of one hypothesis each: as many to a kernel are no quicker together.
_THREADS = 2


class Seen(NamedTuple):
    """Residuals at some values, recording by recording.

    Attributes
    ----------
    misfit, moment, normal, residual
        As of :class:`Reduced`: its cost, moment, normal and e.
    slopes : array
        Its J.
    """

    misfit: np.ndarray
    moment: np.ndarray
    normal: np.ndarray
    residual: np.ndarray
    slopes: Array


def evaluate(
    search: Search, lanes: Sequence[tuple[Hypothesis, np.ndarray]], cycles: float
) -> list[Seen]:
    """Residuals and their reduced derivatives, for (hypothesis, theta of each recording)."""
    means = np.stack([theta.mean(axis=0) for _, theta in lanes])
    gains = search.gains([h.suspects for h, _ in lanes], means, cycles)

    def run(i: int) -> Seen:
        hypothesis, theta = lanes[i]
        found = reduced(
            search.predictor,
            search.joints,
            hypothesis.suspects,
            jnp.asarray(theta),
            jnp.asarray(gains.gain[i]),
            jnp.asarray(gains.slope[i]),
            search.data,
        )
        e, cost, moment, normal = (np.asarray(x) for x in found[:4])
        return Seen(cost, moment, normal, e, found.J)

    # The first alone where the kernel is yet to be compiled: two would both do it.
    slots = lanes[0][0].suspects.row.shape[0]
    alone = 0 if slots in search.compiled else 1
    found = [run(i) for i in range(alone)]
    search.compiled.add(slots)
    with ThreadPoolExecutor(_THREADS) as pool:
        return [*found, *pool.map(run, range(alone, len(lanes)))]


def correlation_time(residual: np.ndarray) -> float:
    """Of (recordings, N, sensors) in samples: one plus twice the sum of what is positive."""
    largest = float(np.max(np.abs(residual)))
    if not 0.0 < largest < math.inf:
        return 1.0
    # In units of the largest: a run that broke down would overflow.
    flat = residual / largest
    flat = flat - flat.mean(axis=1, keepdims=True)
    size = 2 * flat.shape[1]
    power = np.abs(np.fft.rfft(flat, size, axis=1)) ** 2
    correlation = np.fft.irfft(power.sum(axis=(0, 2)))[: flat.shape[1] // 4]
    if correlation[0] <= 0:
        return 1.0
    correlation = correlation / correlation[0]
    negative = np.flatnonzero(correlation <= 0)
    until = negative[0] if negative.size else correlation.size
    return float(1.0 + 2.0 * np.sum(correlation[1:until]))
