"""A sensor is late."""

from functools import cache
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.effects.faults import AbstractSensorFault
from iwanjax.joints import ParameterInfo

DELAY_NODES = 16
"""Samples that a delayed sensor is interpolated from: the last ones, as no later ones are known."""
LONGEST_DELAY = 4.0
"""Samples by which a sensor may be late."""
# Bands from zero, as shares of the sampling rate, and what errors of an interpolation weigh in
# them: structures move most at low frequencies, and recordings are compared up to the last one.
# Beyond it only the weights' own size counts, little.
_BANDS, _OWN = ((0.06, 1e4), (0.14, 1e2), (0.24, 1e1), (0.35, 1.0)), 1e-8


class SensorDelay(AbstractSensorFault):
    """What was seen so many samples earlier is shown."""

    positive: ClassVar[bool] = True
    most: ClassVar[float] = 0.5 * LONGEST_DELAY

    def unit(self, dt: float) -> float:
        """One sample."""
        return dt

    def slope(self, shown: np.ndarray) -> np.ndarray | None:
        """The last samples, weighted by the slopes of their weights."""
        slopes = _slopes()
        early = np.pad(shown, [(0, 0), (DELAY_NODES - 1, 0), (0, 0)])
        first, length = DELAY_NODES - 1, shown.shape[1]
        return sum(
            (slope * early[:, first - j : first - j + length] for j, slope in enumerate(slopes)),
            np.zeros_like(shown),
        )

    def set_up(self, size: Array) -> Any:
        """Weights of the last samples."""
        return _delayed(jnp.clip(size, 0.0, LONGEST_DELAY))

    def rest(self, sensors: int) -> Any:
        """Silence."""
        return jnp.zeros((DELAY_NODES - 1, sensors))

    def show(self, seen: Array, set_up: Any, memory: Any) -> tuple[Array, Any]:
        """What the last samples say of an earlier time."""
        last = jnp.concatenate([seen[None], memory])
        return jnp.sum(set_up * last, axis=0), last[:-1]


def _delayed(late: Array) -> Array:
    """Weights of the last samples in one that is late by so many, (nodes, ...).

    Of least squared error at all frequencies of the bands: a polynomial through the nodes, exact
    at low ones, is off by a fifth at a quarter of the sampling rate, as the delayed sample lies at
    the nodes' end. Without delay the last sample itself.
    """
    none = np.eye(DELAY_NODES)[0].reshape(-1, *[1] * late.ndim)
    change = _matched(late) - _matched(jnp.zeros_like(late))
    return none + jnp.tensordot(_SOLVED, change, axes=1)


@cache
def _slopes() -> np.ndarray:
    """Derivatives of the weights by the delay where there is none, (nodes,)."""
    apart = np.arange(DELAY_NODES)
    parts = [-weight * (2.0 * end) ** 2 * _sinc_slope(2.0 * end * apart) for end, weight in _BANDS]
    return _SOLVED @ sum(parts, np.zeros(DELAY_NODES))


def _sinc_slope(x: np.ndarray) -> np.ndarray:
    """Derivative of sin(pi x)/(pi x)."""
    safe = np.where(x == 0.0, 1.0, x)
    return np.where(x == 0.0, 0.0, (np.cos(np.pi * safe) - np.sinc(safe)) / safe)


def _matched(late: Array) -> Array:
    """What the bands have in common with each node of a signal that is late, (nodes, ...)."""
    apart = np.arange(DELAY_NODES).reshape(-1, *[1] * late.ndim) - late
    parts = [weight * 2.0 * end * jnp.sinc(2.0 * end * apart) for end, weight in _BANDS]
    return sum(parts[1:], parts[0])


def _nodes_in_common() -> np.ndarray:
    """The same for the nodes themselves, inverted, (nodes, nodes)."""
    apart = np.subtract.outer(np.arange(DELAY_NODES), np.arange(DELAY_NODES))
    common = sum(weight * 2.0 * end * np.sinc(2.0 * end * apart) for end, weight in _BANDS)
    return np.linalg.inv(common + _OWN * np.eye(DELAY_NODES))


_SOLVED = _nodes_in_common()

DELAY = SensorDelay(
    "sensor_delay",
    "delay of a filter in one channel",
    ParameterInfo("delay", "time", "by which the sensor is late", 0.0),
    "one sensor whose phase lags in proportion to frequency",
    "a delay",
    "Sensor {where} is late",
)
"""A filter's delay."""
