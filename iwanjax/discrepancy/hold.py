"""One step of linear modes under forces that are parabolas over it."""

from typing import Any, NamedTuple

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


def hold(omega2: Float[np.ndarray, " modes"], C: Float[np.ndarray, "*modes"], dt: float) -> Hold:
    r"""The step of :math:`\ddot q + C\dot q + \omega^2 q = p`, by the matrix exponential.

    The force's coefficients are states too (Van Loan 1978).

    Parameters
    ----------
    omega2 : (modes,) array
        Squared natural frequencies, (rad/s)^2.
    C : (modes,) or (modes, modes) array
        Modal damping, 1/s.
    dt : float
        Step, s.
    """
    import scipy.linalg

    coupled = C.ndim == 2
    size = len(omega2) if coupled else 1
    eye, none = np.eye(size), np.zeros((size, size))
    K = np.diag(omega2)[None] if coupled else omega2[:, None, None]
    damping = C[None] if coupled else C[:, None, None]

    def rows(*blocks: np.ndarray) -> np.ndarray:
        whole = [np.broadcast_to(block, K.shape) for block in blocks]
        return np.concatenate(whole, axis=2)

    # Velocities times the step: both halves of the state are of one size then.
    F = np.concatenate(
        [
            rows(none, eye, none, none, none),
            rows(-K * dt**2, -damping * dt, eye * dt**2, none, none),
            rows(none, none, none, eye, none),
            rows(none, none, none, none, eye),
            rows(none, none, none, none, none),
        ],
        axis=1,
    )
    E = np.stack([scipy.linalg.expm(each) for each in F])

    def part(i: int, j: int, factor: float) -> Any:
        block = factor * E[:, i * size : (i + 1) * size, j * size : (j + 1) * size]
        return block[0] if coupled else block[:, 0, 0]

    # The force's second derivative is twice its last coefficient.
    return Hold(
        (part(0, 0, 1.0), part(0, 1, dt)),
        (part(1, 0, 1.0 / dt), part(1, 1, 1.0)),
        (part(0, 2, 1.0), part(0, 3, 1.0), part(0, 4, 2.0)),
        (part(1, 2, 1.0 / dt), part(1, 3, 1.0 / dt), part(1, 4, 2.0 / dt)),
    )
