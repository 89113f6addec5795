"""Energy per cycle of any Masing mode, from its loading curve alone."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.types import ArrayLike, real

# Steps between two levels, and levels below the first, that the work integral is taken over.
_SUBSTEPS = 8
_BELOW, _DECADES = 128, 3.0
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


def work_dissipation(alpha: ArrayLike, q: ArrayLike) -> Float[Array, "*batch levels"]:
    r"""Dissipation per cycle at each level of a loading curve that obeys Masing's rules.

    .. math:: D = 8\int_0^q \alpha\,dq - 4\alpha q = -4\int_0^q q^2\,d\kappa, \qquad
              \kappa = \alpha/q

    (thesis Sec. 3.2.3). The second form, the first integrated by parts, needs no
    difference of large numbers: energy is lost where the secant stiffness falls. The
    secant is interpolated by cubics in ln q and the integral taken by Gauss's rule;
    below the first level it follows a power law. It suits any curve of load against
    modal displacement, also one from a finite element contact analysis; where the curve
    is known only at its levels, they should be close: with 8 to an octave the error falls
    from 1e-3 at the first, below which the curve is guessed, to 1e-5 two decades on.

    Parameters
    ----------
    alpha : (..., levels) array
        Modal load, increasing, at least 6 levels, force/mass^(1/2).
    q : (..., levels) array
        Modal displacement, mass^(1/2) length.

    Returns
    -------
    (..., levels) array
        Energy per cycle, force x length.

    Raises
    ------
    InputError
        For shapes that differ, or too few levels.
    """
    alpha, q = real(alpha), real(q)
    if alpha.shape[-1:] != q.shape[-1:] or q.shape[-1:] < (6,):
        raise InputError(
            f"work_dissipation: alpha has shape {alpha.shape}, q {q.shape}; expected "
            "the same levels, at least 6, on the last axis"
        )
    kappa = alpha / q
    x = jnp.log(q)
    slope = _slopes(x, kappa)
    h = jnp.diff(x)
    total = jnp.zeros_like(h)
    for node, weight in zip(0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS, strict=True):
        # Derivative of the cubic through both ends with the slopes there.
        rate = (
            6.0 * (node - node**2) * jnp.diff(kappa) / h
            + (1.0 - 4.0 * node + 3.0 * node**2) * slope[..., :-1]
            + (3.0 * node**2 - 2.0 * node) * slope[..., 1:]
        )
        total = total + weight * h * q[..., :-1] ** 2 * jnp.exp(2.0 * node * h) * rate
    # kappa = kappa_0 - b q^n up to the second level, whose slope has neighbours on both
    # sides; n from the slopes further up.
    near, far = slope[..., 1], slope[..., 5]
    falls = (near < 0) & (far < 0)
    ratio = jnp.where(falls, far / jnp.where(falls, near, 1.0), 1.0)
    n = jnp.log(ratio) / (x[..., 5] - x[..., 1])
    second = jnp.where(falls, near * q[..., 1] ** 2 / (n + 2.0), 0.0)[..., None]
    first = second * jnp.exp((n[..., None] + 2.0) * (x[..., :1] - x[..., 1:2]))
    rest = second + jnp.cumsum(total[..., 1:], axis=-1)
    return -4.0 * jnp.concatenate([first, second, rest], axis=-1)


def work_path(
    levels: Float[Array, "modes levels"],
) -> tuple[Float[Array, "modes path"], np.ndarray]:
    """Finer levels that the work integral needs, and where the wanted ones are among them.

    Parameters
    ----------
    levels : (modes, levels) array
        Load levels, increasing.

    Returns
    -------
    (path, wanted)
        (modes, path) array of increasing levels, and the indices of ``levels`` in it.
    """
    x = jnp.log(levels)
    steps = jnp.arange(_SUBSTEPS) / _SUBSTEPS
    between = x[:, :-1, None] + steps * jnp.diff(x)[..., None]
    below = x[:, :1] - _DECADES * np.log(10.0) * (1.0 - jnp.arange(_BELOW) / _BELOW)
    path = jnp.concatenate([below, between.reshape(x.shape[0], -1), x[:, -1:]], axis=1)
    wanted = _BELOW + _SUBSTEPS * np.arange(levels.shape[1])
    # The logarithm's round-off must not move the levels that were asked for.
    return jnp.exp(path).at[:, wanted].set(levels), wanted


def _slopes(x: Array, y: Array) -> Array:
    """dy/dx at unevenly spaced points, by the parabola through each three neighbours."""
    h, rise = jnp.diff(x), jnp.diff(y) / jnp.diff(x)
    left, right = h[..., :-1], h[..., 1:]
    inner = (right * rise[..., :-1] + left * rise[..., 1:]) / (left + right)
    first = 2.0 * rise[..., 0] - inner[..., 0]
    last = 2.0 * rise[..., -1] - inner[..., -1]
    return jnp.concatenate([first[..., None], inner, last[..., None]], axis=-1)
