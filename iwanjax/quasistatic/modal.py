"""One mode as an oscillator of unit modal mass: the modal Iwan model."""

import math
from typing import Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint
from iwanjax.types import ArrayLike, as_real, is_traced, real

# Relative difference of amplitudes over which a slope is taken: 1e-6 of it is lost.
_STEP = 1e-3


class Beside(NamedTuple):
    """What a further force does to an oscillator, per unit modal mass.

    Attributes
    ----------
    stiffness : (3, ...) array
        In-phase first harmonic at the amplitudes of :func:`about`.
    tip : (...) array
        Stiffness at the tips that a free decay shrinks by
        (:meth:`iwanjax.joints.AbstractJoint.tip_stiffness`).
    loss : (...) array
        What it dissipates in a cycle.
    """

    stiffness: Array
    tip: Array
    loss: Array


def about(q: ArrayLike) -> Float[Array, "3 ..."]:
    """Amplitudes a little below, at and a little above q, by which slopes are taken."""
    q = real(q)
    return jnp.stack([q * (1.0 - _STEP), q, q * (1.0 + _STEP)])


class ModalOscillator(eqx.Module):
    r"""Unit modal mass on a spring, a dashpot and a joint (thesis Eq. 2.7).

    .. math:: \ddot q + 2\zeta_0\omega_0\dot q + K_\infty q + \hat F(q) = \hat F_{ext},
              \qquad \omega_0^2 = K_\infty + \hat K_T

    With an :class:`~iwanjax.Iwan4` it is the modal Iwan model with six parameters. The
    coordinate q may be the modal displacement or the displacement at a sensor: the joint's
    parameters are then per unit modal mass at that sensor.

    Parameters
    ----------
    f_0 : float or array
        Natural frequency at vanishing amplitude, Hz; K_infinity follows from it.
    zeta_0 : float or array
        Damping ratio beside the joint, 1.
    joint : AbstractJoint
        Element between the mass and the ground; force per unit mass.

    Raises
    ------
    InputError
        For a frequency that is not positive, a negative damping, or a joint that alone is
        stiffer than the frequency allows.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> mode = ij.ModalOscillator(10.0, 1e-3, ij.Iwan4(F_S=1.0, K_T=500.0, chi=-0.5, beta=1.0))
    >>> f, zeta = mode.ringdown_frequency_and_damping(np.array([1e-5, 1e-3]))
    >>> bool(f[1] < f[0] < 10.0), bool(zeta[1] > zeta[0] > 1e-3)
    (True, True)
    """

    f_0: Array
    zeta_0: Array
    joint: AbstractJoint

    def __init__(self, f_0: ArrayLike, zeta_0: ArrayLike, joint: AbstractJoint):
        self.f_0, self.zeta_0 = as_real(f_0, "f_0"), as_real(zeta_0, "zeta_0")
        self.joint = joint
        if not isinstance(joint, AbstractJoint):
            raise InputError(
                f"ModalOscillator: expected a joint element, got {type(joint).__name__}"
            )
        if is_traced(self):
            return
        if not bool(jnp.all(self.f_0 > 0)):
            raise InputError(f"ModalOscillator: f_0 = {self.f_0} Hz; expected a positive number")
        if not bool(jnp.all(self.zeta_0 >= 0)):
            raise InputError(f"ModalOscillator: zeta_0 = {self.zeta_0} is negative")
        if not bool(jnp.all(self.K_inf > 0)):
            raise InputError(
                "ModalOscillator: the joint's stiffness exceeds (2 pi f_0)^2, so that nothing is "
                "left of the mode when it slips; expected a smaller one"
            )

    @property
    def omega_0(self) -> Array:
        """Circular natural frequency at vanishing amplitude, rad/s."""
        return 2.0 * math.pi * self.f_0

    @property
    def K_inf(self) -> Array:
        """Stiffness per unit mass beside the joint, (rad/s)^2."""
        return self.omega_0**2 - self.joint.initial_stiffness

    @eqx.filter_jit
    def frequency_and_damping(
        self, q: ArrayLike, frequency: Literal["secant", "first_harmonic"] = "first_harmonic"
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        r"""Frequency in Hz and damping ratio of a cycle of amplitude q (2.12), (2.13).

        .. math:: \omega^2 = K_\infty + k(q), \qquad
                  \zeta = \frac{D(q)}{2\pi\omega^2q^2} + \zeta_0\frac{\omega_0}{\omega}

        (2.8) and (2.9) are right in microslip once the misprint is mended; here the joint's
        exact forms hold in macroslip too.

        Parameters
        ----------
        q : array_like
            Amplitude of the coordinate.
        frequency : {"first_harmonic", "secant"}
            k is the in-phase first harmonic of the joint's loop, which is what a Hilbert
            transform of a free decay measures, or the secant through its tips.
        """
        q = real(q)
        kinds = {"first_harmonic": self.joint.harmonic_stiffness, "secant": self.joint.secant}
        if frequency not in kinds:
            raise InputError(f"frequency = {frequency!r}: expected one of {', '.join(kinds)}")
        omega2 = self.K_inf + kinds[frequency](q)
        omega = jnp.sqrt(omega2)
        loss = self.joint.dissipation(q, omega=omega)
        damping = loss / (2.0 * math.pi * omega2 * q**2) + self.zeta_0 * self.omega_0 / omega
        return omega / (2.0 * math.pi), damping

    @eqx.filter_jit
    def ringdown_frequency_and_damping(
        self,
        q: ArrayLike,
        further: Beside | None = None,
        *,
        largest: ArrayLike | None = None,
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        r"""What :func:`iwanjax.ringdown` finds in this oscillator's free decay at amplitude q.

        From half cycle to half cycle a loop whose tip force is F(q) shrinks by
        :math:`\delta` with :math:`\delta\,q\,F'(q) = D/2`: the envelope decays by the tangent
        at the tip where (2.13) has the secant. An elastic force counts with its own secant; of
        either k_tip is the :meth:`~iwanjax.joints.AbstractJoint.tip_stiffness`. On the
        acceleration's envelope, to which ringdown converts,

        .. math:: \zeta = \frac{D + 2\pi\zeta_0\omega_0\omega q^2}
                  {2\pi q^2 [K_\infty + \hat k_{tip}(q)]}
                  \left(1 + 2\frac{\mathrm{d}\ln\omega}{\mathrm{d}\ln q}\right),

        which is (2.13) to a tenth of that derivative in microslip (0.05 per cent, say), and one
        or two per cent less or more beside phi_max. Within 0.03 per cent of discrete sliders.

        Of a five-parameter joint all of D, k_tip and omega are those of (4.35), (4.36): what
        slipped at the largest amplitude of the decay slips on at its kinetic friction. Within 1
        per cent of discrete sliders, but about (1 + theta)/2 of the largest amplitude, where the
        damping has a step that a measured curve spreads over the decay of some cycles.

        Parameters
        ----------
        q : array_like
            Amplitude of the coordinate.
        further : Beside, optional
            A force that acts beside the joint; f_0 is without it.
        largest : array_like, optional
            The largest amplitude before, with the decay's own first one at least; broadcasts
            against q. The largest q by default: all of q are then of one decay. Only joints
            that remember it (:class:`~iwanjax.Iwan5`) depend on it.
        """
        q = real(q)
        joint = self.joint.after(jnp.max(q) if largest is None else largest)
        # A difference costs one wider evaluation; a derivative in q would be a second one
        # wherever a fit takes its own, and half a minute to compile.
        omega2 = self.K_inf + joint.harmonic_stiffness(about(q))
        at_tip = self.K_inf + joint.tip_stiffness(q)
        if further is not None:
            omega2, at_tip = omega2 + further.stiffness, at_tip + further.tip
        slope = jnp.log(omega2[2] / omega2[0]) / (4.0 * _STEP)
        omega = jnp.sqrt(omega2[1])
        loss = joint.dissipation(q, omega=omega)
        if further is not None:
            loss = loss + further.loss
        damping = (loss / (2.0 * math.pi * q**2) + self.zeta_0 * self.omega_0 * omega) / at_tip
        return omega / (2.0 * math.pi), damping * (1.0 + 2.0 * slope)

    def curves(
        self,
        amplitude: ArrayLike,
        *,
        frequency: Literal["secant", "first_harmonic"] = "first_harmonic",
        unit: str = "",
        name: str = "",
    ) -> ModalCurves:
        """Frequency and damping against the coordinate's amplitude.

        Parameters
        ----------
        amplitude : (levels,) array_like
            Displacement amplitudes, positive.
        frequency : {"first_harmonic", "secant"}
            As for :meth:`frequency_and_damping`.
        unit, name : str
            Labels.

        Returns
        -------
        ModalCurves

        Raises
        ------
        InputError
            For amplitudes that are not positive.
        """
        q = as_real(amplitude, "amplitude")
        if not is_traced(q) and not bool(jnp.all(q > 0)):
            raise InputError("curves: amplitudes must be positive")
        f, zeta = self.frequency_and_damping(q, frequency)
        return ModalCurves(q, f, zeta, quantity="displacement", unit=unit, name=name)
