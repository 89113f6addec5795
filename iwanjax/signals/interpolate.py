"""A differentiable cubic through points."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def cubic(
    at: Float[Array, " N"], x: Float[Array, " points"], y: Float[Array, " points"]
) -> Float[Array, " N"]:
    """Cubic Hermite interpolation with slopes of three-point parabolas.

    Parameters
    ----------
    at : (N,) array
        Where the values are wanted; beyond the ends the first or last cubic goes on.
    x, y : (points,) array
        Points, at least three; x rises.

    Returns
    -------
    (N,) array
    """
    h = jnp.diff(x)
    chord = jnp.diff(y) / h
    inner = (chord[:-1] * h[1:] + chord[1:] * h[:-1]) / (h[:-1] + h[1:])
    slope = jnp.concatenate([2.0 * chord[:1] - inner[:1], inner, 2.0 * chord[-1:] - inner[-1:]])
    i = jnp.clip(jnp.searchsorted(x, at) - 1, 0, x.size - 2)
    t = (at - x[i]) / h[i]
    a, b = y[i], y[i + 1]
    p, q = slope[i] * h[i], slope[i + 1] * h[i]
    return a + t * (p + t * (3.0 * (b - a) - 2.0 * p - q + t * (2.0 * (a - b) + p + q)))
