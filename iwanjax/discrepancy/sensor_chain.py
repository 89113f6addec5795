"""What faulty sensors make of what faultless ones would show."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.discrepancy.suspects import Suspects

DELAY_NODES = 16
"""Samples that a delayed sensor is interpolated from: the last ones, as no later ones are known."""
LONGEST_DELAY = 4.0
"""Samples by which a sensor may be late."""
# Bands from zero, as shares of the sampling rate, and what errors of an interpolation weigh in
# them: structures move most at low frequencies, and recordings are compared up to the last one.
# Beyond it only the weights' own size counts, little.
_BANDS, _OWN = ((0.06, 1e4), (0.14, 1e2), (0.24, 1e1), (0.35, 1.0)), 1e-8


def chain(suspects: Suspects, size: Array, shape: Array) -> tuple[Array, Array]:
    """Weights of the last samples in what each sensor shows, and the largest that it can."""
    gain, delay = (jnp.sum(size[:, None] * suspects.chain[:, i], axis=0) for i in range(2))
    weight = _delayed(jnp.clip(delay, 0.0, LONGEST_DELAY))
    largest = jnp.sum(shape[:, None] * suspects.chain[:, 2], axis=0)
    return (1.0 + gain) * weight, jnp.where(largest > 0, largest, jnp.inf)


def _delayed(late: Array) -> Array:
    """Weights of the last samples in one that is late by so many, (nodes, ...).

    Of least squared error at all frequencies of the bands: a polynomial through the nodes, exact
    at low ones, is off by a fifth at a quarter of the sampling rate, as the delayed sample lies at
    the nodes' end. Without delay the last sample itself.
    """
    none = np.eye(DELAY_NODES)[0].reshape(-1, *[1] * late.ndim)
    change = _matched(late) - _matched(jnp.zeros_like(late))
    return none + jnp.tensordot(_SOLVED, change, axes=1)


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


def change_by_delay(shown: Float[np.ndarray, "recordings N sensors"]) -> np.ndarray:
    """What sensors would show more for each sample that they are late, from rest."""
    slopes = np.asarray(jax.jacfwd(_delayed)(jnp.zeros(())))
    early = np.pad(shown, [(0, 0), (DELAY_NODES - 1, 0), (0, 0)])
    length = shown.shape[1]
    first = DELAY_NODES - 1
    return sum(
        (slope * early[:, first - j : first - j + length] for j, slope in enumerate(slopes)),
        np.zeros_like(shown),
    )
