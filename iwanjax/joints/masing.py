"""Masing's rules: from a virgin curve to its steady loop and the energy the loop encloses."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.joints.abstract import Law

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(48)


def masing_loading(law: Law, d: Array, d_0: Array) -> Float[Array, "..."]:
    r"""Loading branch of the steady loop of amplitude d_0 (thesis Sec. 3.2.3).

    The virgin curve magnified by two and moved to the lower tip:

    .. math:: F(d) = -F_0(d_0) + 2 F_0\!\left(\tfrac{d + d_0}{2}\right)

    Parameters
    ----------
    law : Law
        Virgin curve, d -> (force, tangent).
    d, d_0 : array
        Deflection within [-d_0, d_0] and amplitude, length.
    """
    return -law(d_0)[0] + 2.0 * law(0.5 * (d + d_0))[0]


def masing_dissipation(law: Law, d_0: Array) -> Float[Array, "..."]:
    r"""Energy per cycle of a Masing element, from its virgin curve alone.

    .. math:: D = 8\int_0^{d_0} F\,du - 4 d_0 F(d_0)
              = 8\int_0^{d_0} \left(F - \frac{u}{d_0}F(d_0)\right)du

    The second form subtracts the secant line before it sums, so that small losses are
    not lost in the elastic work. Gauss-Legendre in t with u = d_0 t^3, which makes a
    power law smooth at zero: 1e-10 while the curve is smooth, 1e-3 across a kink.

    Parameters
    ----------
    law : Law
        Virgin curve, d -> (force, tangent).
    d_0 : array
        Amplitude, length.
    """
    amplitude = jnp.abs(d_0)
    tip = law(amplitude)[0]
    node = (0.5 * (_NODES + 1.0)).reshape(-1, *(1,) * tip.ndim)
    weight = (0.5 * _WEIGHTS).reshape(node.shape) * 3.0 * node**2
    force, _ = law(amplitude * node**3)
    return 8.0 * amplitude * jnp.sum(weight * (force - node**3 * tip), axis=0)
