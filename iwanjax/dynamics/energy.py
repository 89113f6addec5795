"""Where the energy of a simulation comes from and goes."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from iwanjax.dynamics.coordinates import ModalCoordinates
from iwanjax.dynamics.stepping import ModalMotion, Stepper

# From this squared angle (omega dt)^2 on a mode's mean follows from its equation of motion without
# loss of digits; below, that of the cubic between both ends is as exact.
_RESOLVED = 0.25


class Energies(NamedTuple):
    """Energies and what went in and out since the beginning, force x length, (N,) each.

    Attributes
    ----------
    kinetic : array
        Of the structure.
    elastic : array
        Of the structure without its joints.
    stored : array
        In the joints' springs.
    work : array
        Of the external forces.
    viscous : array
        Lost in the structure's damping.
    joints : array
        Lost in the joints: the work done on them less what their springs store.
    slip : array
        The same by the joints' own account of slip and rate, which takes their forces to be
        exact within a step instead of linear in time; it comes closer with the square of the
        step.
    """

    kinetic: Array
    elastic: Array
    stored: Array
    work: Array
    viscous: Array
    joints: Array
    slip: Array

    @property
    def imbalance(self) -> Array:
        """Work and initial energy that is neither stored nor lost, (N,)."""
        stored = self.kinetic + self.elastic + self.stored
        return self.work + stored[..., :1] - stored - self.viscous - self.joints


def exchanged(
    by: Stepper,
    before: ModalMotion,
    after: ModalMotion,
    f: tuple[Array, Array],
    g: tuple[Array, Array],
) -> tuple[Array, Array, Array]:
    """Over a step: work of the external forces, loss by damping, work on the joints.

    Parameters
    ----------
    by : Stepper
        What made the step.
    before, after : ModalMotion
        At its ends.
    f, g : pair of arrays
        External and pseudo-forces at its ends.
    """
    modal, dt = by.modal, by.dt
    (f_0, f_1), (g_0, g_1) = f, g
    q_0, v_0, q, v = before.displacement, before.velocity, after.displacement, after.velocity
    p_0, p_1 = modal.W @ f_0, modal.W @ f_1
    r_0, r_1 = modal.P.T @ g_0, modal.P.T @ g_1
    d_0, d_1 = modal.P @ q_0 + modal.R_dg @ g_0, modal.P @ q + modal.R_dg @ g_1
    d_0, d_1 = d_0 + modal.R_df @ f_0, d_1 + modal.R_df @ f_1
    elastic = 0.5 * modal.stiffness @ (d_1**2 - d_0**2)
    # Modes that were left out follow at once: the work done on them.
    yielded = 0.5 * (g_0 + g_1) @ (d_1 - d_0 - modal.P @ (q - q_0))
    left_out = 0.5 * (g_1 - g_0) @ modal.R_df @ (f_0 + f_1)
    moved = q - q_0
    if by.method == "newmark":
        # With these sums the average acceleration conserves energy exactly.
        yielded += 0.5 * (r_0 + r_1) @ moved
        work = left_out + 0.5 * (p_0 + p_1) @ moved
        return work, moved @ _damped(modal, moved) / dt, elastic - yielded
    a_0 = p_0 + r_0 - _damped(modal, v_0) - modal.omega2 * q_0
    a_1 = p_1 + r_1 - _damped(modal, v) - modal.omega2 * q
    # Forces are linear over the step: by parts, with the mean of q.
    mean = _mean(by, (q_0, v_0, p_0 + r_0), (q, v, p_1 + r_1))
    ends = v_0 @ _damped(modal, v_0) + v @ _damped(modal, v)
    slopes = v_0 @ _damped(modal, _slow(by, a_0)) - v @ _damped(modal, _slow(by, a_1))
    yielded += r_1 @ q - r_0 @ q_0 - (r_1 - r_0) @ mean
    return (
        left_out + p_1 @ q - p_0 @ q_0 - (p_1 - p_0) @ mean,
        dt * (0.5 * ends + dt / 6.0 * slopes),
        elastic - yielded,
    )


def work_on_joints(
    by: Stepper, d: tuple[Array, Array], rates: tuple[Array, Array], g: tuple[Array, Array]
) -> Array:
    """Over a step, from the joints' deflections, their rates without fast modes', pseudo-forces."""
    (d_0, d_1), (v_0, v_1), (g_0, g_1) = d, rates, g
    elastic = 0.5 * by.modal.stiffness @ (d_1**2 - d_0**2)
    mean = 0.5 * (g_0 + g_1) @ (d_1 - d_0)
    if by.method == "newmark":
        return elastic - mean
    # By parts, with d along the cubic between both ends.
    return elastic - mean + by.dt / 12.0 * (g_1 - g_0) @ (v_0 - v_1)


def held(modal: ModalCoordinates, q: Array, v: Array, d: Array, g: Array, f: Array) -> Array:
    """Kinetic energy and that of the structure's own springs, without its joints, (2,)."""
    # The modes that were left out, but for what the external forces alone store in them, which
    # is no part of their work here either.
    residual = 0.5 * g @ (modal.R_dg @ g) + g @ (modal.R_df @ f)
    elastic = 0.5 * (modal.omega2 @ q**2 - modal.stiffness @ d**2) + residual
    return jnp.stack([0.5 * v @ v, elastic])


def accounts(rows: Array) -> Energies:
    """Kinetic, elastic, stored; work, viscous loss, work on the joints, slip: by name."""
    kinetic, elastic, stored, work, viscous, done, slip = jnp.moveaxis(rows, -1, 0)
    return Energies(
        kinetic, elastic, stored, work, viscous, done - (stored - stored[..., :1]), slip
    )


def _mean(
    by: Stepper, first: tuple[Array, Array, Array], last: tuple[Array, Array, Array]
) -> Array:
    """Of the modal displacements over the step."""
    modal, dt = by.modal, by.dt
    (q_0, v_0, p_0), (q, v, p) = first, last
    ends = 0.5 * (q_0 + q)
    cubic = ends + _slow(by, dt / 12.0 * (v_0 - v))
    resolved = modal.omega2 * dt**2 > _RESOLVED
    omega2 = jnp.where(resolved, modal.omega2, 1.0)
    exact = (0.5 * (p_0 + p) - (_damped(modal, q - q_0) + v - v_0) / dt) / omega2
    return jnp.where(resolved & ~by.fast, exact, cubic)


def _slow(by: Stepper, x: Array) -> Array:
    """Without what a mode does that the step cannot follow."""
    return jnp.where(by.fast, 0.0, x)


def _damped(modal: ModalCoordinates, v: Array) -> Array:
    return modal.C * v if modal.C.ndim == 1 else modal.C @ v
