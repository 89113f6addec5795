r"""From one instant to the next: linear motion without error, what joints add by a stable rule.

The pseudo-forces g of the joints are known at the instants only. Between them they are taken to
be linear in time, and a mode of natural frequency :math:`\omega` then follows them without error.
With :math:`\theta = \omega\Delta t` and :math:`\gamma = \tan(\theta/2)/(\theta/2)` this rule is
the one of constant mean forces in the shifted coordinate
:math:`\tilde q = q + (\gamma-1)\,p/\omega^2`, and for joints that only lose energy

.. math:: \sum\tfrac{1}{2\gamma}(\dot q^2+\omega^2\tilde q^2)
          - \sum\tfrac{\gamma-1}{2\omega^2}p^2 - \tfrac12 K_{ref}d^2 + U_{joints}

does not grow. It bounds the motion as long as every :math:`\gamma` is positive,
:math:`\theta<\pi`, and only then. A mode that is faster follows the pseudo-forces by the average
acceleration instead, which conserves the same sum with :math:`\gamma=1`, so that the two rules
may stand side by side. What external forces do to a mode is without error whatever its speed.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from iwanjax.dynamics.coordinates import ModalCoordinates
from iwanjax.dynamics.propagator import Method, Propagator, propagator
from iwanjax.types import is_traced

_FAST = 2.0
"""Angle omega dt from which on a mode follows pseudo-forces by the average acceleration, rad.

Any number below pi is stable; at 2 the sum above is within a factor of 1.56 of the energy.
"""


class ModalMotion(NamedTuple):
    """Modal displacements and velocities.

    Attributes
    ----------
    q, v : (modes,) array
        By the exact rule.
    correction : pair of (modes,) arrays or None
        What pseudo-forces add in fast modes, by the average acceleration.
    """

    q: Array
    v: Array
    correction: tuple[Array, Array] | None

    @property
    def displacement(self) -> Array:
        """All of it."""
        return self.q if self.correction is None else self.q + self.correction[0]

    @property
    def velocity(self) -> Array:
        """All of it."""
        return self.v if self.correction is None else self.v + self.correction[1]


class Stepper(eqx.Module):
    """A step of the modes under external forces f and pseudo-forces g.

    Attributes
    ----------
    modal : ModalCoordinates
        What is moved.
    dt : array
        Length of the step, s.
    method : {"exact", "newmark"}
        Of integration.
    linear : Propagator
        For external forces, and for pseudo-forces in slow modes.
    average : Propagator or None
        For pseudo-forces in fast modes; None where there are none.
    fast : (modes,) bool array
        Which those are.
    unit : ModalMotion
        What a unit of each pseudo-force at the end of the step adds, (modes, joints).
    G, H : (joints, joints) array
        The same of the joints' deflections and rates.
    """

    modal: ModalCoordinates
    dt: Array
    method: Method = eqx.field(static=True)
    linear: Propagator
    average: Propagator | None
    fast: Bool[Array, " modes"]
    unit: ModalMotion
    G: Array
    H: Array

    def free(self, at: ModalMotion, f_0: Array, f_1: Array, g_0: Array) -> ModalMotion:
        """The end of the step without pseudo-forces at its end."""
        p_0 = self.modal.W @ f_0 + self.slow(g_0)
        q, v = self.linear.free(at.q, at.v, p_0, self.modal.W @ f_1)
        return ModalMotion(q, v, self.corrected(at, g_0))

    def corrected(self, at: ModalMotion, g_0: Array) -> tuple[Array, Array] | None:
        """The corrections at the end of the step without pseudo-forces at its end."""
        if self.average is None or at.correction is None:
            return None
        return self.average.first(*at.correction, self.quick(g_0))

    def free_of(self, at: ModalMotion, g_0: Array, g_1: Array) -> ModalMotion:
        """The end of a step under pseudo-forces alone, those at its end in slow modes only."""
        q, v = self.linear.free(at.q, at.v, self.slow(g_0), self.slow(g_1))
        return ModalMotion(q, v, self.corrected(at, g_0))

    def pushed(self, free: ModalMotion, g: Array) -> ModalMotion:
        """The end of the step with pseudo-forces g there."""
        q, v = free.q + self.unit.q @ g, free.v + self.unit.v @ g
        if free.correction is None or self.unit.correction is None:
            return ModalMotion(q, v, None)
        (w, rate), (by, rate_by) = free.correction, self.unit.correction
        return ModalMotion(q, v, (w + by @ g, rate + rate_by @ g))

    def slow(self, g: Array) -> Array:
        """Modal forces of g in the modes that follow them by the exact rule."""
        p = self.modal.P.T @ g
        return p if self.average is None else jnp.where(self.fast, 0.0, p)

    def quick(self, g: Array) -> Array:
        """Modal forces of g in the others."""
        return jnp.where(self.fast, self.modal.P.T @ g, 0.0)


def has_fast_modes(modal: ModalCoordinates, dt: float, method: Method) -> bool:
    """Whether the step is too long for the exact rule in a mode that joints move.

    True where this cannot be told, since natural frequencies are being traced.
    """
    if method == "newmark":
        return False
    if is_traced(modal.omega2, modal.P):
        return True
    moved = np.any(np.asarray(modal.P) != 0.0, axis=0)
    return bool(np.any(np.asarray(_fast(modal.omega2, dt)) & moved))


def _fast(omega2: Array, dt: Any) -> Array:
    return omega2 * dt**2 >= _FAST**2


@eqx.filter_jit
def stepper(modal: ModalCoordinates, dt: Array, method: Method, split: bool) -> Stepper:
    """Prepare a step of length ``dt``; ``split`` says whether there may be fast modes.

    A kernel of its own: all simulations of structures of one size share it, whatever their joints.
    """
    linear = propagator(modal.omega2, modal.C, dt, method)
    fast = _fast(modal.omega2, dt)
    average = propagator(modal.omega2, modal.C, dt, "newmark") if split else None
    P = modal.P.T
    q, v = linear.last(jnp.where(fast[:, None], 0.0, P) if split else P)
    correction = average.last(jnp.where(fast[:, None], P, 0.0)) if average is not None else None
    unit = ModalMotion(q, v, correction)
    return Stepper(
        modal,
        dt,
        method,
        linear,
        average,
        fast,
        unit,
        modal.P @ unit.displacement + modal.R_dg,
        modal.P @ unit.velocity,
    )
