"""A power that stays finite, with all its derivatives, at zero."""

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float


def is_positive(s: Float[Array, "..."]) -> Bool[Array, "..."]:
    """Whether s is large enough (about 1e-139) that 1/s^2 does not overflow."""
    return s > jnp.finfo(s.dtype).tiny ** 0.45


def power(s: Float[Array, "..."], exponent: ArrayLike) -> Float[Array, "..."]:
    r"""Evaluate :math:`s^a` for s >= 0 with finite first and second derivatives at s = 0.

    The true derivatives of :math:`s^{\chi+1}` are infinite at zero for
    :math:`\chi < 0`. The joints use them only multiplied by an odd function, where
    the value at zero by symmetry is 0; so value and derivatives are 0 there (also
    for s so small, about 1e-139, that its square overflows when inverted).

    Parameters
    ----------
    s : (...) array
        Normalised deflection |d| / phi_max, 1.
    exponent : array_like
        Exponent a, 1; broadcast against ``s``.

    Returns
    -------
    (...) array
        exp(a ln s), cheaper in XLA than its general power (5 against 9 ns).
    """
    positive = is_positive(s)
    safe = jnp.where(positive, s, 1.0)
    return jnp.where(positive, jnp.exp(exponent * jnp.log(safe)), 0.0)
