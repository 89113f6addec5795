"""How alike mode shapes are."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.types import ArrayLike

# Shapes of less than this share of the largest one's square are not seen by the sensors.
_UNSEEN = 1e-6


def modal_assurance(
    first: ArrayLike,
    second: ArrayLike,
    weight: ArrayLike | None = None,
) -> Float[Array, "k m"]:
    r"""Modal assurance criterion (MAC) of every pair of shapes, 0 to 1.

    .. math:: \mathrm{MAC}_{ij} = \frac{(a_i^T W b_j)^2}{(a_i^T W a_i)(b_j^T W b_j)}

    Parameters
    ----------
    first, second : (n, k), (n, m) array
        Shapes as columns, at the same sensors or coordinates.
    weight : (n, n) array, optional
        W, symmetric: the mass for orthogonality of coordinates; else one.

    Returns
    -------
    (k, m) array
        Zero for a shape that moves less than a thousandth of the largest in its set: what is
        seen of it is noise.

    References
    ----------
    Allemang and Brown, IMAC 1 (1982) 110.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> ij.modal_assurance(np.eye(2), np.array([[1.0, 1.0], [0.0, 1.0]])).round(2).tolist()
    [[1.0, 0.5], [0.0, 0.5]]
    """
    a, b = jnp.asarray(first), jnp.asarray(second)
    Wa, Wb = (a, b) if weight is None else (jnp.asarray(weight) @ x for x in (a, b))
    cross = a.T @ Wb
    own_first = jnp.sum(a * Wa, axis=0)
    own_second = jnp.sum(b * Wb, axis=0)
    return cross**2 / (_seen(own_first)[:, None] * _seen(own_second))


def _seen(square: Array) -> Array:
    return jnp.where(square > _UNSEEN * jnp.max(square), square, jnp.inf)
