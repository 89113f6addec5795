"""The exact map of modes over one step, for forces that are parabolas within it."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class Hold(NamedTuple):
    r"""The exact map over one step for modal forces :math:`p_0 + p_1 s + p_2 s^2`, s in (0, 1).

    Attributes
    ----------
    q, v : two (modes,) or (modes, modes) arrays each
        What displacement and velocity at the beginning make of those at the end.
    q_by, v_by : three (modes,) or (modes, modes) arrays each
        What the force's coefficients add.
    """

    q: tuple[Array, Array]
    v: tuple[Array, Array]
    q_by: tuple[Array, Array, Array]
    v_by: tuple[Array, Array, Array]

    def free(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Displacement and velocity at the end without force."""
        return on(self.q[0], q) + on(self.q[1], v), on(self.v[0], q) + on(self.v[1], v)

    def pushed(self, p: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        """What forces, (modes, ...) a coefficient, add to both."""
        return _added(self.q_by, p), _added(self.v_by, p)


def _added(by: tuple[Array, Array, Array], p: tuple[Array, Array, Array]) -> Array:
    return on(by[0], p[0]) + on(by[1], p[1]) + on(by[2], p[2])


def on(coefficient: Array, x: Array) -> Array:
    """A coefficient by mode, or a matrix of them, on (modes, ...)."""
    if coefficient.ndim == 2:
        return coefficient @ x
    return (coefficient * x.T).T


def slope_at_end(now: Any, last: Any, before: Any, dt: Any) -> Any:
    """How fast a force changes at the end of a step, by its values there and at the last two."""
    return (1.5 * now - 2.0 * last + 0.5 * before) / dt


def slopes_at_ends(
    force: Float[Array, "N substeps forces"], dt: Array
) -> Float[Array, "N substeps forces"]:
    """The same at the end of each step from rest on."""
    whole = jnp.pad(force.reshape(-1, force.shape[-1]), [(2, 0), (0, 0)])
    return slope_at_end(whole[2:], whole[1:-1], whole[:-2], dt).reshape(force.shape)


MOST = 16.0
"""Largest entry of A within a kernel: of a mode that turns by 2 radians in a step, at 4 times
critical damping. Each doubling loses a third of a digit."""


def hold(
    omega2: Array | np.ndarray, C: Array | np.ndarray, dt: Array | float, xp: Any = np
) -> Hold:
    r"""The step of :math:`\ddot q + C\dot q + \omega^2 q = p`, by the matrix exponential.

    With :math:`z = (q, h\dot q)` over a step h the map is :math:`e^A`, and a force
    :math:`s^k/k!` adds :math:`h^2\varphi_{k+1}(A)` of its column, where
    :math:`\varphi_k(A) = \sum_i A^i/(i+k)!`: a series of a small part of A, doubled back
    (Higham 2008, section 10.7.4).

    Parameters
    ----------
    omega2 : (modes,) array
        Squared natural frequencies, (rad/s)^2.
    C : (modes,) or (modes, modes) array
        Modal damping, 1/s.
    dt : float
        Step h, s.
    xp : module
        ``jax.numpy`` within a kernel.
    """
    coupled = C.ndim == 2
    size = omega2.shape[0] if coupled else 1
    eye = xp.eye(size)
    K = xp.diag(omega2)[None] if coupled else omega2[:, None, None]
    damping = C[None] if coupled else C[:, None, None]
    both = xp.broadcast_to(eye, K.shape), xp.zeros(K.shape)
    # Velocities times the step: both halves of the state are of one size then.
    lower = xp.concatenate([-K * dt**2, -damping * dt], axis=2)
    A = xp.concatenate([xp.concatenate(both[::-1], axis=2), lower], axis=1)
    # Known on the host; a kernel takes it for no more than is allowed where it is made.
    norm = float(np.max(np.abs(A), initial=0.0)) if xp is np else MOST
    E, by_1, by_2, by_3 = _phi(A, xp, max(5, math.ceil(math.log2(max(norm, 1.0))) + 1))

    def part(block: Array, i: int, j: int, factor: Any) -> Any:
        found = factor * block[:, i * size : (i + 1) * size, j * size : (j + 1) * size]
        return found[0] if coupled else found[:, 0, 0]

    # The force's second derivative is twice its last coefficient.
    through = ((by_1, 1.0), (by_2, 1.0), (by_3, 2.0))
    q_by = tuple(part(block, 0, 1, factor * dt**2) for block, factor in through)
    v_by = tuple(part(block, 1, 1, factor * dt) for block, factor in through)
    q = part(E, 0, 0, 1.0), part(E, 0, 1, dt)
    return Hold(q, (part(E, 1, 0, 1.0 / dt), part(E, 1, 1, 1.0)), q_by, v_by)


def _phi(A: Array, xp: Any, doublings: int, terms: int = 16) -> tuple[Array, Array, Array, Array]:
    """The exponential of a stack of matrices, and the first three functions after it.

    So many terms are exact to the last digit for a part of norm 1, which so many doublings take
    back to A.
    """
    small, eye = A / 2.0**doublings, xp.broadcast_to(xp.eye(A.shape[-1]), A.shape)

    def nested(i: Any, series: Array) -> Array:
        return eye + small @ series / (terms + 3 - i)

    def doubled(_: Any, found: tuple[Array, ...]) -> tuple[Array, ...]:
        E, one, two, three = found
        return (
            E @ E,
            (E @ one + one) / 2.0,
            (E @ two + one + two) / 4.0,
            (E @ three + one / 2.0 + two + three) / 8.0,
        )

    # By the last one's series, and phi_k = 1/k! + A phi_{k+1}.
    three = _repeated(terms, nested, eye, xp) / 6.0
    two = eye / 2.0 + small @ three
    one = eye + small @ two
    E, one, two, three = _repeated(doublings, doubled, (eye + small @ one, one, two, three), xp)
    return E, one, two, three


def _repeated(count: int, step: Callable[[Any, Any], Any], start: Any, xp: Any) -> Any:
    """What so many steps make of a start; a kernel compiles one step, not all of them."""
    if xp is not np:
        return jax.lax.fori_loop(0, count, step, start)
    for i in range(count):
        start = step(i, start)
    return start
