"""What a force does to one mode over a steady cycle: stiffness, stiffness at the tip, loss."""

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.discrepancy.effects import ForceKind, PlaceMotion
from iwanjax.quasistatic.modal import Beside

# Steps of a cycle; the first cycle lets sliders and dashpots settle.
_STEPS, _CYCLES = 256, 2
# Of a sum over a cycle, over its largest term.
_ROUNDING = 1e-10
# Change over all amplitudes, relative to the largest value, below which a mode's own frequency
# and damping at rest take all of it up.
_CONSTANT = 1e-6


def beside(kind: ForceKind, shape: float, q: np.ndarray, omega: float | np.ndarray) -> Beside:
    r"""A force of unit size under :math:`d = q\sin\omega t`, for a mode's curves.

    .. math:: k_1 = \frac{1}{\pi q}\oint F\sin\omega t\,\mathrm{d}(\omega t), \qquad
              D = \oint F\,\mathrm{d}d

    by the rectangle rule over the second cycle, which for smooth forces is exact to rounding
    and for sliders to the square of a step. An offset that a one-sided force causes is left
    out: it counts to the second order of the force.

    Parameters
    ----------
    kind : ForceKind
        The force.
    shape : float
        Its shape parameter, where it has one.
    q : (3, ..., levels) array
        Amplitudes a little below, at and a little above those wanted.
    omega : float or (..., 1) array
        Circular frequency, rad/s.

    Returns
    -------
    Beside
        k_1 at all q; stiffness at the tips, and D, at those wanted.
    """
    return _beside(kind, jnp.asarray(shape), jnp.asarray(q), jnp.asarray(omega))


@partial(jax.jit, static_argnums=0)
def _beside(kind: ForceKind, shape: Array, q: Array, omega: Array) -> Beside:
    phases = 2.0 * math.pi * np.arange(1, _CYCLES * _STEPS + 1) / _STEPS
    dt = 2.0 * math.pi / (_STEPS * omega)

    def step(memory: Array, phase: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        sine, cosine, before = phase
        d, v, moved = q * sine, q * omega * cosine, q * (sine - before)
        force, memory = kind.unit_force(
            PlaceMotion(d, v, -(omega**2) * d, moved, dt), shape, memory
        )
        return memory, jnp.broadcast_to(force, q.shape)

    sine, cosine = np.sin(phases), np.cos(phases)
    rows = (jnp.asarray(sine), jnp.asarray(cosine), jnp.asarray(np.append(0.0, sine[:-1])))
    memory, force = jax.lax.scan(step, jnp.zeros(q.shape), rows)
    last = force[-_STEPS:]
    # At both ends of the cycle: a one-sided force has another slope at either.
    tip = 0.5 * (last[_STEPS // 4 - 1] - last[3 * _STEPS // 4 - 1])
    # What remembers is taken for a Masing element's, what does not for elastic: see tip_stiffness.
    tip = jnp.where(memory[1] == 0.0, tip[1] / q[1], (tip[2] - tip[0]) / (q[2] - q[0]))
    # What cancels over a cycle is nothing, not the rounding that is left of it.
    peak = jnp.max(jnp.abs(last), axis=0)

    def told(x: Array, largest: Array) -> Array:
        return jnp.where(jnp.abs(x) > _ROUNDING * largest, x, 0.0)

    return Beside(
        told(2.0 * jnp.einsum("s...,s->...", last, sine[-_STEPS:]) / (_STEPS * q), peak / q),
        told(tip, peak[1] / q[1]),
        told(
            2.0 * math.pi * q[1] * jnp.einsum("s...,s->...", last[:, 1], cosine[-_STEPS:]) / _STEPS,
            peak[1] * q[1],
        ),
    )


def shows(unit: Beside, q: np.ndarray) -> bool:
    """Whether a force changes with amplitude what a mode alone would have at every amplitude."""
    seen = (np.asarray(unit.stiffness)[1], np.asarray(unit.loss) / q[1] ** 2)
    largest = max(float(np.max(np.abs(each))) for each in (*seen, unit.tip))
    return any(float(np.ptp(each)) > _CONSTANT * largest for each in seen)
