r"""From a parameter within its bounds to the real line and back.

.. math:: \theta = l + e^z, \qquad \theta = l + \frac{u-l}{1+e^{-z}}, \qquad \theta = z

for ``"log"``, ``"logit"`` and ``"identity"``.
"""

from typing import Any, Literal

import jax
import jax.numpy as jnp

from iwanjax.types import Scalar

Transform = Literal["log", "logit", "identity"]
"""Of what is positive, of what lies between two bounds, and of anything."""

INSIDE = 1e-6
"""Share of its range that a value between two bounds is taken to be within them at least."""


def to_value(transform: Transform, z: Scalar, lower: Scalar, upper: Scalar) -> Scalar:
    """Parameter of a variable.

    Parameters
    ----------
    transform : {"log", "logit", "identity"}
    z : scalar or array
        The variable, 1, or the parameter itself.
    lower, upper : scalar or array
        Bounds in the parameter's unit; those that a transform does not have are not used.
    """
    if transform == "log":
        return lower + jnp.exp(z)
    if transform == "logit":
        return lower + (upper - lower) * jax.nn.sigmoid(z)
    return z


def to_variable(
    transform: Transform,
    value: Scalar,
    lower: Scalar,
    upper: Scalar,
    inside: float = INSIDE,
    xp: Any = jnp,
) -> Scalar:
    """The inverse of :func:`to_value`; a value on a bound is pulled a hair inside.

    With ``numpy`` for ``xp`` nothing is compiled for it.
    """
    if transform == "log":
        return xp.log(xp.maximum(value - lower, jnp.finfo(jnp.result_type(float)).tiny))
    if transform == "logit":
        share = share_of(value, lower, upper, inside, xp)
        return xp.log(share / (1.0 - share))
    return value


def share_of(
    value: Scalar, lower: Scalar, upper: Scalar, inside: float = INSIDE, xp: Any = jnp
) -> Scalar:
    """Where a value lies between its bounds, from 0 to 1 and as much inside as is asked."""
    return xp.clip((value - lower) / (upper - lower), inside, 1.0 - inside)
