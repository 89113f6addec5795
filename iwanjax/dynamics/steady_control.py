"""What is prescribed of a periodic motion: the force, the response, or phase resonance."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.dynamics.harmonic_balance import Motion, PeriodicSystem, Transfer


class Control(eqx.Module):
    """What is prescribed of a motion: as many conditions as unknowns beside the deflections.

    Attributes
    ----------
    finds_frequency : bool
        Whether the frequency is among the unknowns.
    """

    finds_frequency: ClassVar[bool] = False

    @property
    @abc.abstractmethod
    def level(self) -> Array:
        """The amplitude that is prescribed, of whatever."""

    @abc.abstractmethod
    def guess(self, system: PeriodicSystem) -> Motion:
        """The motion of a linear structure."""

    def tuned(self, system: PeriodicSystem, motion: Motion) -> Motion:
        """A guess with the frequency and force that its joints ask for, where these are unknown."""
        return motion

    @abc.abstractmethod
    def motion(self, X: Array, beside: Array) -> Motion:
        """The motion that the unknowns describe."""

    @abc.abstractmethod
    def beside(self, motion: Motion) -> Array:
        """A motion's unknowns beside the deflections, of the size of one."""

    @abc.abstractmethod
    def conditions(self, response: Array) -> Array:
        """What vanishes when the fundamental at the first sensor is as prescribed."""

    @abc.abstractmethod
    def linear(self, system: PeriodicSystem, motion: Motion) -> Transfer:
        """The structure at the motion's frequency."""


class ForceControl(Control):
    """Force and frequency are given, with the structure at that frequency."""

    force: Array
    omega: Array
    known: Transfer

    @property
    def level(self) -> Array:
        """Of force."""
        return self.force

    def guess(self, system: PeriodicSystem) -> Motion:
        """Under the same force."""
        return self.motion(system.elastic_deflections(self.force, self.known), jnp.zeros(0))

    def motion(self, X: Array, beside: Array) -> Motion:
        """Deflections are all that is unknown."""
        return Motion(X, self.force + 0.0j, self.omega)

    def beside(self, motion: Motion) -> Array:
        """None."""
        return jnp.zeros(0)

    def conditions(self, response: Array) -> Array:
        """None."""
        return jnp.zeros(0)

    def linear(self, system: PeriodicSystem, motion: Motion) -> Transfer:
        """As given."""
        return self.known


class HeldResponse(Control):
    """The displacement at the first sensor is given, the force that it takes is found."""

    displacement: Array

    @property
    def level(self) -> Array:
        """Of displacement."""
        return self.displacement

    def conditions(self, response: Array) -> Array:
        """Amplitude as given and phase zero."""
        away = response / self.displacement - 1.0
        return jnp.stack([away.real, away.imag])


class ResponseControl(HeldResponse):
    """Displacement and frequency are given, with the structure at that frequency."""

    omega: Array
    known: Transfer

    def guess(self, system: PeriodicSystem) -> Motion:
        """With the force that the linear structure would need."""
        modal = system.modal
        f = self.displacement / (modal.Y @ self.known.q_f + modal.R_yf[:, 0])[0]
        return Motion(system.elastic_deflections(f, self.known), f, self.omega)

    def motion(self, X: Array, beside: Array) -> Motion:
        """The force's two parts, in units of acceleration."""
        unit = self.omega**2 * self.displacement
        return Motion(X, (beside[0] + 1j * beside[1]) * unit, self.omega)

    def beside(self, motion: Motion) -> Array:
        """See motion."""
        return jnp.stack([motion.f.real, motion.f.imag]) / (self.omega**2 * self.displacement)

    def linear(self, system: PeriodicSystem, motion: Motion) -> Transfer:
        """As given."""
        return self.known


class PhaseResonance(HeldResponse):
    """Displacement is given, a quarter period behind the force; the frequency is found.

    ``omega_0`` and ``shape``, the joints' deflections in it, are those of the linear mode.
    """

    omega_0: Array
    shape: Float[Array, " joints"]

    finds_frequency: ClassVar[bool] = True

    def guess(self, system: PeriodicSystem) -> Motion:
        """The linear mode without damping."""
        fundamental = np.array(system.cycle.harmonics) == 1
        X = self.shape[:, None] * self.displacement * np.where(fundamental, 1.0 + 0.0j, 0.0)
        return Motion(X, jnp.zeros((), X.dtype), self.omega_0)

    def tuned(self, system: PeriodicSystem, motion: Motion) -> Motion:
        r"""From the mode's own equation of motion, driven by the pseudo-forces G of the guess.

        .. math:: \Omega^2 = w^T\omega^2w - \Re\frac{w^TP^TG}{q}, \qquad
                  f = i\Omega\,w^TCw\,q - i\Im\,w^TP^TG

        with w the modal force, of length one.
        """
        modal, first, q = system.modal, system.cycle.first, self.displacement
        w = modal.W[:, 0]
        G = modal.stiffness[:, None] * motion.X - system.forces(motion.X, motion.omega)
        pushed = (modal.P @ w) @ G[:, first]
        square = w @ (modal.omega2 * w) - pushed.real / q
        omega = jnp.sqrt(jnp.where(square > 0.0, square, motion.omega**2))
        damped = w @ (modal.C * w if modal.C.ndim == 1 else modal.C @ w)
        return Motion(motion.X, 1j * (omega * damped * q - pushed.imag), omega)

    def motion(self, X: Array, beside: Array) -> Motion:
        """Frequency over that of the linear mode; force in units of acceleration."""
        unit = self.omega_0**2 * self.displacement
        return Motion(X, 1j * beside[1] * unit, self.omega_0 * beside[0])

    def beside(self, motion: Motion) -> Array:
        """See motion."""
        unit = self.omega_0**2 * self.displacement
        return jnp.stack([motion.omega / self.omega_0, motion.f.imag / unit])

    def linear(self, system: PeriodicSystem, motion: Motion) -> Transfer:
        """Worked out anew: the frequency is being looked for."""
        return system.transfer(motion.omega)
