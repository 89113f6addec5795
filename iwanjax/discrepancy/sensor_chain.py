"""What faulty sensors make of what faultless ones would show."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.discrepancy.suspects import Suspects

DELAY_NODES = 8
"""Samples that a delayed sensor is interpolated from, by a polynomial."""
LONGEST_DELAY = 4.0
"""Samples by which a sensor may be late."""


def chain(suspects: Suspects, size: Array, shape: Array) -> tuple[Array, Array]:
    """Weights of the last samples in what each sensor shows, and the largest that it can."""
    gain, delay = (jnp.sum(size[:, None] * suspects.chain[:, i], axis=0) for i in range(2))
    weight = _delayed(jnp.clip(delay, 0.0, LONGEST_DELAY))
    largest = jnp.sum(shape[:, None] * suspects.chain[:, 2], axis=0)
    return (1.0 + gain) * weight, jnp.where(largest > 0, largest, jnp.inf)


def _delayed(late: Array) -> Array:
    """Weights of the last samples in one that is late by so many, (nodes, ...)."""
    nodes = range(DELAY_NODES)
    others = np.array([[j for j in nodes if j != i] for i in nodes])
    apart = np.arange(DELAY_NODES)[:, None] - others
    return jnp.moveaxis(jnp.prod((late[..., None, None] - others) / apart, axis=-1), -1, 0)


def change_by_delay(shown: Float[np.ndarray, "recordings N sensors"]) -> np.ndarray:
    """What sensors would show more for each sample that they are late, from rest."""
    # Of the polynomial through the nodes at the first one.
    powers = np.vander(np.arange(DELAY_NODES), increasing=True).T
    slopes = np.linalg.solve(powers, np.eye(DELAY_NODES)[1])
    early = np.pad(shown, [(0, 0), (DELAY_NODES - 1, 0), (0, 0)])
    length = shown.shape[1]
    first = DELAY_NODES - 1
    return sum(
        (slope * early[:, first - j : first - j + length] for j, slope in enumerate(slopes)),
        np.zeros_like(shown),
    )
