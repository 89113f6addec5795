"""Harmonic balance: a periodic motion as Fourier coefficients of the joints' deflections."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex

from iwanjax.dynamics.balance import Joints
from iwanjax.dynamics.coordinates import ModalCoordinates
from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint

# Loss factor that the joints' rows are given on both sides of the balance: about the least that
# keeps a lightly damped mode regular at its natural frequency, and a fair first guess there.
_SHIFT = 0.05
# A joint sees a rigid-body mode if that moves it by this share of what the others do, squared.
_SEES = 1e-12


class Cycle(NamedTuple):
    """How a period is resolved; a kernel is compiled for each.

    Attributes
    ----------
    harmonics : tuple of int
        In rising order; 1 is among them.
    samples : int
        Points of a period at which the joints' forces are evaluated.
    periods : int
        That the joints are driven for; the last one counts.
    """

    harmonics: tuple[int, ...]
    samples: int
    periods: int

    @classmethod
    def of(cls, harmonics: Sequence[int], samples: int, periods: int) -> "Cycle":
        """The same, checked.

        Raises
        ------
        InputError
            For harmonics without the first, fewer than four samples for each, and less than
            two periods.
        """
        chosen = tuple(sorted(set(harmonics)))
        if 1 not in chosen or chosen[0] < 0 or len(chosen) != len(harmonics):
            raise InputError(
                f"harmonics = {harmonics}; expected different numbers from 0 on, 1 among them"
            )
        if samples < 4 * chosen[-1] or samples % 2:
            raise InputError(
                f"samples = {samples}; expected an even number of at least {4 * chosen[-1]}, four "
                f"for each harmonic up to {chosen[-1]}"
            )
        if periods < 2:
            raise InputError(f"periods = {periods}; expected 2 or more, of which the last counts")
        return cls(chosen, samples, periods)

    @property
    def first(self) -> int:
        """Place of the fundamental."""
        return self.harmonics.index(1)


class Motion(NamedTuple):
    """A periodic motion, x(t) = Re sum_h X_h exp(i h omega t).

    Attributes
    ----------
    X : (joints, harmonics) complex array
        Deflections of the joints.
    f : complex array
        Amplitude of the force, at the fundamental.
    omega : array
        Of the fundamental, rad/s.
    """

    X: Complex[Array, "joints harmonics"]
    f: Complex[Array, ""]
    omega: Array


class Transfer(NamedTuple):
    """Modal responses (harmonics, modes, ...) to pseudo-forces and force, with the joints' shift.

    Attributes
    ----------
    Q_g : (harmonics, modes, joints) array
        To what the joints exert.
    q_f : (modes,) array
        To the force, at the fundamental.
    shift : (harmonics, joints) array
        Complex stiffness that was added to each joint.
    """

    Q_g: Complex[Array, "harmonics modes joints"]
    q_f: Complex[Array, " modes"]
    shift: Complex[Array, "harmonics joints"]


class Balanced(NamedTuple):
    """What a motion amounts to.

    Attributes
    ----------
    residual : (joints, harmonics) complex array
        Deflections less those that the joints' forces cause.
    response : (sensors, harmonics) complex array
        Displacements at the sensors.
    """

    residual: Complex[Array, "joints harmonics"]
    response: Complex[Array, "sensors harmonics"]


class PeriodicSystem(eqx.Module):
    r"""A jointed structure in periodic motion under one harmonic force.

    With the pseudo-forces :math:`g = K_{ref}d - F(d)` the structure is linear, each harmonic
    by itself:

    .. math:: [\omega_r^2 - (h\Omega)^2 + ih\Omega C]\,Q_h = W f_h + P^T G_h, \qquad
              D_h = P Q_h + R_{dg}G_h + R_{df}f_h

    so that the joints' deflections D are the only unknowns. The same complex stiffness is
    added to both sides for every joint: the solution stays, but an undamped mode can be
    driven at its natural frequency, where only the joints limit it.

    Attributes
    ----------
    joints : Joints
        The elements.
    modal : ModalCoordinates
        One input; what its sensors see is the response.
    cycle : Cycle
        How a period is resolved.
    """

    joints: Joints
    modal: ModalCoordinates
    cycle: Cycle = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        elements: tuple[AbstractJoint, ...],
        modal: ModalCoordinates,
        cycle: Cycle,
        sliders: int,
    ) -> "PeriodicSystem":
        """With each element in its discrete form."""
        return cls(Joints.of(tuple(each.discrete(sliders) for each in elements)), modal, cycle)

    def forces(self, X: Array, omega: Array) -> Complex[Array, "joints harmonics"]:
        """Fourier coefficients of the joints' forces, alternating between frequency and time.

        Each joint's time starts where its own fundamental peaks, so that the tips of its
        loop fall on samples.
        """
        h, n = np.array(self.cycle.harmonics), self.cycle.samples
        size = X[:, self.cycle.first].real ** 2 + X[:, self.cycle.first].imag ** 2
        moves = size > 0.0
        unit = X[:, self.cycle.first] / jnp.sqrt(jnp.where(moves, size, 1.0))
        unit = jnp.where(moves, unit, 1.0)
        turn = jnp.stack([jnp.conj(unit) ** int(k) for k in h], axis=1)
        E = np.exp(2j * np.pi * np.outer(np.arange(n) / n, h))
        d = jnp.real(E @ (X * turn).T)
        v = jnp.real(E @ (1j * h * omega * X * turn).T)
        dt = 2.0 * jnp.pi / (omega * n)

        def advance(states: Any, at: tuple[Array, Array]) -> tuple[Any, Array]:
            reaction = self.joints.step(*at, dt, states)
            return reaction.state, reaction.force

        def period(states: Any, _: None) -> tuple[Any, Array]:
            return jax.lax.scan(advance, states, (d, v))

        before, _ = jax.lax.scan(
            lambda states, _: (period(states, None)[0], None),
            self.joints.init(),
            length=self.cycle.periods - 1,
        )
        F = period(before, None)[1]
        return (F.T @ E.conj()) * (np.where(h == 0, 1.0, 2.0) / n) * jnp.conj(turn)

    def transfer(self, omega: Array) -> Transfer:
        """The linear structure at a frequency."""
        modal, h = self.modal, np.array(self.cycle.harmonics)
        rigid = modal.omega2 == 0.0
        elastic = jnp.where(rigid, 0.0, 1.0 / jnp.where(rigid, 1.0, modal.omega2))
        flexibility = modal.P**2 @ elastic + jnp.diagonal(modal.R_dg)
        # A mean has no phase: there the shift is real, and holds a body that only joints hold.
        shift = np.where(h == 0, 1.0, 1.0j)[:, None] * (_SHIFT / flexibility)
        coupling = (modal.P.T * (_SHIFT / flexibility)) @ modal.P
        moved = jnp.diagonal(coupling)
        free = rigid & (moved <= _SEES * jnp.max(moved))
        C = jnp.diag(modal.C) if modal.C.ndim == 1 else modal.C
        w = (h * omega)[:, None, None]
        A = jnp.diag(modal.omega2) - w**2 * jnp.eye(rigid.shape[0]) + 1j * w * C
        A = A + np.where(h == 0, 1.0, 1.0j)[:, None, None] * coupling
        # A free body has no mean place; it stays where it is.
        A = A + np.where(h == 0, 1.0, 0.0)[:, None, None] * jnp.diag(free.astype(moved.dtype))
        right = jnp.concatenate([modal.P.T, modal.W], axis=1)
        Q = jnp.linalg.solve(A, jnp.broadcast_to(right.astype(A.dtype), (h.size, *right.shape)))
        return Transfer(Q[:, :, :-1], Q[self.cycle.first, :, -1], shift)

    def balance(self, motion: Motion, F: Array, linear: Transfer) -> Balanced:
        """What the structure does under the joints' forces F (joints, harmonics)."""
        X, f, _ = motion
        modal, h = self.modal, np.array(self.cycle.harmonics)
        first = np.where(h == 1, 1.0, 0.0)
        G = modal.stiffness[:, None] * X - F
        static = modal.R_dg @ G + modal.R_df * (f * first)
        Q = jnp.einsum("hmj,jh->mh", linear.Q_g, G + linear.shift.T * (X - static))
        Q = Q + linear.q_f[:, None] * (f * first)
        residual = X - modal.P @ Q - static
        # Nothing is unknown but the real part of a mean.
        residual = jnp.where(h == 0, residual.real + 1j * X.imag, residual)
        response = modal.Y @ Q + modal.R_yg @ G + modal.R_yf * (f * first)
        return Balanced(residual, response)

    def elastic_deflections(self, f: Array, linear: Transfer) -> Complex[Array, "joints harmonics"]:
        """Deflections of the linear structure, its joints with the shift for damping."""
        h = np.array(self.cycle.harmonics)
        D = self.modal.P @ linear.q_f + self.modal.R_df[:, 0]
        return D[:, None] * f * np.where(h == 1, 1.0, 0.0)
