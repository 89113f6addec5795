"""One step of a linear mode: exact between samples, or Newmark's average acceleration."""

import math
from functools import partial
from typing import Literal, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Method: TypeAlias = Literal["exact", "newmark"]
"""How modes are taken from one sample to the next."""

# Below this omega dt a power series is used: the closed form divides by its square.
_SLOW = 0.5
_TERMS = 20


class Propagator(NamedTuple):
    r"""A linear map over one step.

    .. math:: q_1 &= a_{qq}q_0 + a_{qv}v_0 + b_{q0}p_0 + b_{q1}p_1\\
              v_1 &= a_{vq}q_0 + a_{vv}v_0 + b_{v0}p_0 + b_{v1}p_1

    with the modal forces p at both ends. Coefficients are (modes,), or (modes, modes) where
    damping couples the modes.
    """

    qq: Float[Array, "*modes"]
    qv: Float[Array, "*modes"]
    vq: Float[Array, "*modes"]
    vv: Float[Array, "*modes"]
    q0: Float[Array, "*modes"]
    q1: Float[Array, "*modes"]
    v0: Float[Array, "*modes"]
    v1: Float[Array, "*modes"]

    def free(self, q: Array, v: Array, p_0: Array, p_1: Array) -> tuple[Array, Array]:
        """Displacement and velocity at the end of the step."""
        return (
            _on(self.qq, q) + _on(self.qv, v) + _on(self.q0, p_0) + _on(self.q1, p_1),
            _on(self.vq, q) + _on(self.vv, v) + _on(self.v0, p_0) + _on(self.v1, p_1),
        )

    def first(self, q: Array, v: Array, p_0: Array) -> tuple[Array, Array]:
        """The same with no modal forces at the end of the step."""
        return (
            _on(self.qq, q) + _on(self.qv, v) + _on(self.q0, p_0),
            _on(self.vq, q) + _on(self.vv, v) + _on(self.v0, p_0),
        )

    def last(self, p: Array) -> tuple[Array, Array]:
        """What modal forces (modes, ...) at the end of the step alone would do."""
        return _on(self.q1, p), _on(self.v1, p)


def _on(coefficient: Array, x: Array) -> Array:
    if coefficient.ndim == 2:
        return coefficient @ x
    return (coefficient * x.T).T


def propagator(omega2: Array, C: Array, dt: Array, method: Method) -> Propagator:
    r"""The step of :math:`\ddot q + C\dot q + \omega^2 q = p`.

    Parameters
    ----------
    omega2 : (modes,) array
        Squared natural frequencies, (rad/s)^2; 0 for a rigid-body mode.
    C : (modes,) or (modes, modes) array
        Modal damping, 2 zeta omega, 1/s.
    dt : array
        Step, s.
    method : {"exact", "newmark"}
        "exact" solves the equation for forces that are linear over the step, whatever its
        length. "newmark" is the average acceleration of the thesis (trapezoidal rule); it
        lowers frequencies by (omega dt)^2/12.
    """
    if C.ndim == 2:
        return _coupled(omega2, C, dt, method)
    return _by_mode(omega2, 0.5 * C, dt, method)


@partial(jax.jit, static_argnames="method")
def _by_mode(omega2: Array, sigma: Array, dt: Array, method: Method) -> Propagator:
    return _exact(omega2, sigma, dt) if method == "exact" else _newmark(omega2, sigma, dt)


@partial(jax.jit, static_argnames="method")
def _coupled(omega2: Array, C: Array, dt: Array, method: Method) -> Propagator:
    """All modes at once, by the matrix exponential or its Cayley form."""
    r = omega2.shape[0]
    eye, none = jnp.eye(r, dtype=C.dtype), jnp.zeros((r, r), C.dtype)
    # Velocities times the step: both halves of the state are of one size then.
    F = jnp.block([[none, eye], [-jnp.diag(omega2) * dt**2, -C * dt]])
    push = jnp.concatenate([none, eye * dt**2])
    if method == "newmark":
        inverse = jnp.linalg.inv(jnp.eye(2 * r, dtype=C.dtype) - 0.5 * F)
        A = inverse @ (jnp.eye(2 * r, dtype=C.dtype) + 0.5 * F)
        B_0 = B_1 = inverse @ (0.5 * push)
    else:
        # Force and its growth over the step are states too (Van Loan 1978).
        zero = jnp.zeros((r, 4 * r), C.dtype)
        slope = jnp.concatenate([zero[:, : 3 * r], eye], axis=1)
        whole = jax.scipy.linalg.expm(
            jnp.concatenate([jnp.concatenate([F, push, jnp.zeros_like(push)], axis=1), slope, zero])
        )
        A, B_1 = whole[: 2 * r, : 2 * r], whole[: 2 * r, 3 * r :]
        B_0 = whole[: 2 * r, 2 * r : 3 * r] - B_1
    q, v = slice(r), slice(r, None)
    return Propagator(
        A[q, q],
        A[q, v] * dt,
        A[v, q] / dt,
        A[v, v],
        B_0[q],
        B_1[q],
        B_0[v] / dt,
        B_1[v] / dt,
    )


def _newmark(omega2: Array, sigma: Array, dt: Array) -> Propagator:
    half = 0.5 * dt
    # (I - h/2 F)^-1 with F = [[0, 1], [-omega^2, -2 sigma]].
    inverse = 1.0 / (1.0 + 2.0 * sigma * half + omega2 * half**2)
    qq = (1.0 + 2.0 * sigma * half - omega2 * half**2) * inverse
    vv = (1.0 - 2.0 * sigma * half - omega2 * half**2) * inverse
    b_q, b_v = half**2 * inverse, half * inverse
    return Propagator(qq, dt * inverse, -omega2 * dt * inverse, vv, b_q, b_q, b_v, b_v)


def _exact(omega2: Array, sigma: Array, dt: Array) -> Propagator:
    r"""From the impulse response G and its integrals over the step, J_1 and J_2 (twice)."""
    slope, G, J_1, J_2 = _responses(omega2, sigma, dt)
    return Propagator(
        qq=slope + 2.0 * sigma * G,
        qv=G,
        vq=-omega2 * G,
        vv=slope,
        q0=J_1 - J_2 / dt,
        q1=J_2 / dt,
        v0=G - J_1 / dt,
        v1=J_1 / dt,
    )


def _responses(omega2: Array, sigma: Array, dt: Array) -> tuple[Array, Array, Array, Array]:
    """G', G, its integral and its double integral at dt."""
    w2, s = omega2 * dt**2, sigma * dt
    slow = jnp.maximum(w2, s**2) < _SLOW**2
    series = _series(jnp.where(slow, w2, 0.0), jnp.where(slow, s, 0.0))
    closed = _closed(jnp.where(slow, 1.0, w2), jnp.where(slow, 0.0, s))
    slope, G, J_1, J_2 = (jnp.where(slow, a, b) for a, b in zip(series, closed, strict=True))
    return slope, dt * G, dt**2 * J_1, dt**3 * J_2


def _closed(w2: Array, s: Array) -> tuple[Array, Array, Array, Array]:
    """In units of the step, by sines or hyperbolic sines."""
    b = w2 - s**2
    size = jnp.sqrt(jnp.maximum(jnp.abs(b), 1e-30))
    under, decay = b > 0, jnp.exp(-s)
    # Two real decays: the slow rate from the product of both, without s - x.
    x = jnp.where(under, 0.0, size)
    fast = -(s + x)
    slow = jnp.where(under, 0.0, w2 / jnp.where(under, 1.0, fast))
    up, down = 0.5 * jnp.exp(slow), 0.5 * jnp.exp(fast)
    c = jnp.where(under, decay * jnp.cos(size), up + down)
    # Near critical damping up - down would keep few digits.
    sine = jnp.where(under, decay * jnp.sin(size), -up * jnp.expm1(-2.0 * x)) / size
    # Critical damping itself: the sine's quotient tends to the decay.
    G = jnp.where(size < 1e-8, decay, sine)
    slope = c - s * G
    # Strong damping: each decay has its integrals, for a rigid body's mode too.
    strong = 2.0 * w2 < s**2
    w2 = jnp.where(strong, 1.0, w2)
    J_1 = (1.0 - slope - 2.0 * s * G) / w2
    J_2 = (1.0 - G - 2.0 * s * J_1) / w2
    (first_slow, second_slow), (first_fast, second_fast) = _integrals(slow), _integrals(fast)
    return (
        slope,
        G,
        jnp.where(strong, (first_slow - first_fast) / (2.0 * size), J_1),
        jnp.where(strong, (second_slow - second_fast) / (2.0 * size), J_2),
    )


def _integrals(rate: Array) -> tuple[Array, Array]:
    """Of exp(rate t) from 0 to 1, once and twice."""
    slow = jnp.abs(rate) < _SLOW
    z = jnp.where(slow, rate, 0.0)
    series = jnp.zeros_like(z)
    for k in reversed(range(2, _TERMS)):
        series = (1.0 + z * series) / k
    z = jnp.where(slow, 1.0, rate)
    twice = jnp.where(slow, series, (jnp.expm1(z) - z) / z**2)
    return 1.0 + rate * twice, twice


def _series(w2: Array, s: Array) -> tuple[Array, Array, Array, Array]:
    """In units of the step, by the power series of G: G(0) = 0, G'(0) = 1."""
    before, last = jnp.zeros_like(w2), jnp.ones_like(w2)
    slope, G, J_1, J_2 = last, last, 0.5 * last, last / 6.0
    for k in range(2, _TERMS):
        term = -(2.0 * s * (k - 1) * last + w2 * before) / (k * (k - 1))
        before, last = last, term
        slope, G = slope + k * term, G + term
        J_1, J_2 = J_1 + term / (k + 1), J_2 + term / ((k + 1) * (k + 2))
    return slope, G, J_1, J_2


def longest_step(omega: float, shift: float) -> float:
    """Newmark's step that lowers a frequency by no more than ``shift`` (relative), s."""
    return math.sqrt(12.0 * shift) / omega
