"""Duhem's hysteresis: branches that depend on nothing but the force that they begin with."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def tip_stiffness(
    share: Array, onward: Array, back: Array, d: Array, K_T: Array
) -> Float[Array, "..."]:
    r"""Stiffness at the tips that a slow decay's amplitude shrinks by, force/length.

    Where the force changes by :math:`dF = K_T f(\pm F/F_S)\,|dd|` on the way up and down, a branch
    of the length 2d that begins where one longer by :math:`2\delta` has ended, and those before it,
    takes

    .. math:: k_{tip}\,d\,\delta, \qquad
              k_{tip} = \frac{F_S}{d}\,\frac{4 w\rho}{(1 + \rho)^2}, \quad
              \rho = \frac{f(w)}{f(-w)}

    less than half a steady cycle, with the share w of :math:`F_S` at the tips of that: by the
    balance that :meth:`iwanjax.AbstractJoint.tip_stiffness` states. No source. :math:`K_T` at rest,
    nothing where all has yielded, as of dry friction.

    Parameters
    ----------
    share : array
        w, of the steady cycle of amplitude d.
    onward, back : array
        f(w) and f(-w), 1.
    d : array
        Amplitude over the slip F_S/K_T, 1.
    K_T : array
        Tangent stiffness at rest, force/length.
    """
    at_rest = d == 0.0
    safe = jnp.where(at_rest, 1.0, d)
    turned = 4.0 * onward * back / (onward + back) ** 2
    return K_T * jnp.where(at_rest, 1.0, turned * share / safe)
