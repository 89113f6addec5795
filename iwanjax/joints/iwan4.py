"""Segalman's four-parameter Iwan element in closed form."""

from collections.abc import Callable
from typing import Any, ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.joints.abstract import Law, ParameterInfo, named
from iwanjax.joints.discrete import AbstractDiscrete
from iwanjax.joints.force_law import NestedLaw, Values
from iwanjax.joints.iwan import IWAN_PARAMETERS, AbstractIwan, physical_of
from iwanjax.joints.jenkins import dry_friction_within, spring_within
from iwanjax.joints.masing import masing_loading
from iwanjax.joints.power import power
from iwanjax.joints.reversals import Reversals
from iwanjax.joints.sliders import SLIDERS
from iwanjax.types import ArrayLike, real

# Gauss-Legendre nodes of tau in (0, pi/2), for the first harmonic.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_SINE, _COSINE = (f(0.25 * np.pi * (_NODES + 1.0)) for f in (np.sin, np.cos))
_WEIGHT = 0.25 * np.pi * _WEIGHTS
# Relative distance from phi_max within which microslip and macroslip are the same.
_BESIDE = 1e-9
# Exponent of the power-law part of a joint that is nearly a spring or a slider, where it matters
# least: the middle of what bolted joints show (Segalman 2005).
_CHI = -0.5


class Iwan4(AbstractIwan):
    r"""Four-parameter Iwan element (Segalman 2005; thesis App. A).

    Sliders in parallel, their thresholds :math:`\phi` distributed as

    .. math:: \rho(\phi) = R\phi^{\chi}[H(\phi)-H(\phi-\phi_{max})] + S\,\delta(\phi-\phi_{max})

    With :math:`s = |d|/\phi_{max}`, :math:`\rho = 1/(1+\beta)` the power law's share of
    K_T, and :math:`m = \min(s, 1)`:

    .. math::
        F &= K_T\phi_{max}\left(m - \rho\,\frac{m^{\chi+2}}{\chi+2}\right)\mathrm{sign}(d)\\
        D &= 4K_T\phi_{max}^2\left[\rho\,\frac{(\chi+1)\,m^{\chi+3}}{(\chi+2)(\chi+3)}
             + \left(1-\frac{\rho}{\chi+2}\right)\max(s-1,0)\right]

    which are (3.25) and (3.27) below :math:`\phi_{max}` and exact beyond it, where the
    thesis's (2.8) and (2.9) are only asymptotic. (2.8) is printed with (chi+1) for
    (chi+2). Nothing is singular as chi -> -1.

    Parameters
    ----------
    F_S : float or array
        Force at macroslip, force.
    K_T : float or array
        Tangent stiffness at rest, force/length.
    chi : float or array
        Exponent, 1; above -1. Segalman's range is (-1, 0); the formulas hold beyond it.
    beta : float or array
        Ratio of the Dirac share of K_T to the power-law share, 1; not negative.

    Raises
    ------
    InputError
        For a parameter outside its bounds, not finite, or of a shape that does not
        broadcast with the others.

    Examples
    --------
    >>> import iwanjax as ij
    >>> joint = ij.Iwan4(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0)
    >>> float(joint.backbone(100.0))  # macroslip
    10.0
    >>> round(float(joint.dissipation(1.0)), 4)
    0.0265
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = IWAN_PARAMETERS

    F_S: Array = eqx.field(converter=named("F_S"))
    K_T: Array = eqx.field(converter=named("K_T"))
    chi: Array = eqx.field(converter=named("chi"))
    beta: Array = eqx.field(converter=named("beta"))

    @classmethod
    def from_distribution(
        cls, *, R: ArrayLike, S: ArrayLike, chi: ArrayLike, phi_max: ArrayLike
    ) -> Self:
        """The same element from its slider distribution, thesis Eqs. (A.3) to (A.5).

        Parameters
        ----------
        R : array_like
            Strength of the power law, force/length^(chi+2).
        S : array_like
            Strength of the Dirac slider, force/length.
        chi : array_like
            Exponent, 1.
        phi_max : array_like
            Deflection at macroslip, length.
        """
        return cls(**physical_of(cls.__name__, R, S, chi, phi_max))

    def law(self) -> Law:
        """Virgin curve d -> (force, tangent), Eq. (3.25) and its macroslip continuation."""
        scale = self.K_T * self.phi_max
        share = 1.0 / (1.0 + self.beta)
        remaining = self._remaining
        normalised, K_T = self._normalised(), self.K_T

        def evaluate(d: Array) -> tuple[Array, Array]:
            x, sticks, _, p = normalised(d)
            m = jnp.where(sticks, x, jnp.sign(x))
            return scale * m * (1.0 - p + remaining * p), jnp.where(
                sticks, K_T * (1.0 - share * p), 0.0
            )

        return evaluate

    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """Secant stiffness of the cycle of amplitude |d|: K_T at 0, F_S/|d| in macroslip (4.9).

        Parameters
        ----------
        d : array_like
            Amplitude, length; its sign does not matter.
        """
        x, sticks, _, p = self._normalised()(real(d))
        secant = self.K_T * (1.0 - p + self._remaining * p)
        return secant / jnp.where(sticks, 1.0, jnp.abs(x))

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        """Energy per cycle of amplitude |d|, force x length (3.27), exact in macroslip.

        Parameters
        ----------
        d : array_like
            Amplitude, length.
        omega : array_like, optional
            Ignored: the element does not depend on rate.
        """
        x, sticks, m, p = self._normalised()(real(d))
        n, share = self.chi + 1.0, 1.0 / (1.0 + self.beta)
        micro = share * n / ((n + 1.0) * (n + 2.0)) * p * m**2
        macro = self._remaining * jnp.where(sticks, 0.0, jnp.abs(x) - 1.0)
        return 4.0 * self.K_T * self.phi_max**2 * (micro + macro)

    def harmonic_stiffness(self, d: ArrayLike) -> Float[Array, "..."]:
        r"""In-phase first-harmonic stiffness of the cycle d cos(t), without a sum over the cycle.

        With n = chi + 2 and

        .. math:: I(y) = 2\int_0^{\pi/2} \sin^{2n}\tau\,
                  \frac{(1-2y\sin^2\tau)\cos\tau}{\sqrt{1-y\sin^2\tau}}\,d\tau

        Masing's unloading branch gives :math:`k_1 = K_T[1 + \frac{4\rho}{\pi n}
        s^{n-1} I(1)]` in microslip. In macroslip the branch slips as a whole beyond the
        phase :math:`\theta_1 = 2\arcsin s^{-1/2}`:

        .. math:: k_1 = \frac{4K_T}{\pi s}\left[\frac{s}{2}\left(\frac{\theta_1}{2}
                  + \frac{\sin 2\theta_1}{4} - \sin\theta_1\right)
                  + \frac{\rho}{n\sqrt s} I(1/s)
                  + \frac{F_S}{K_T\phi_{max}}\sin\theta_1\right]

        The integral's powers depend on chi alone, so that a level costs a square root per
        node instead of a power. Within 1e-7 of K_T.

        Parameters
        ----------
        d : array_like
            Amplitude, length.
        """
        x, _, _, p = self._normalised()(real(d))
        n, share = self.chi + 2.0, 1.0 / (1.0 + self.beta)
        column = (-1, *(1,) * jnp.ndim(x * n))
        sine, cosine, weight = (row.reshape(column) for row in (_SINE, _COSINE, _WEIGHT))
        powers = weight * jnp.exp(2.0 * n * np.log(sine))
        whole = jnp.sum(powers * (1.0 - 2.0 * sine**2), axis=0)
        micro = 1.0 + 8.0 * share / (jnp.pi * n) * p * whole
        # Beside phi_max the angle's derivative is infinite, with a factor that vanishes.
        slips = jnp.abs(x) > 1.0 + _BESIDE
        s = jnp.where(slips, jnp.abs(x), 2.0)
        y = 1.0 / s
        half = jnp.arcsin(jnp.sqrt(y))
        # At tau = pi/2 the root comes close to zero with cos(tau): two terms of the power's
        # expansion in cos^2 are integrated in closed form, the rest is smooth.
        first, second = 1.0 - 2.0 * y, 2.0 * y - n * (1.0 - 2.0 * y)
        arc = half / jnp.sqrt(y)
        smooth = powers * (1.0 - 2.0 * y * sine**2) - weight * (first + second * cosine**2)
        rest = jnp.sum(smooth * cosine / jnp.sqrt(1.0 - y * sine**2), axis=0)
        integral = 2.0 * (first * arc + second * (arc - 0.5 * (arc - jnp.sqrt(1.0 - y)) / y) + rest)
        theta = 2.0 * half
        macro = (
            0.5 * s * (half + 0.25 * jnp.sin(2.0 * theta) - jnp.sin(theta))
            + share / n * jnp.sqrt(y) * integral
            + self._remaining * jnp.sin(theta)
        ) * (4.0 / jnp.pi * y)
        return self.K_T * jnp.where(slips, macro, micro)

    def discrete(self, sliders: int | None = SLIDERS) -> AbstractDiscrete:
        """A bank of sliders, or with None the closed form on a stack of reversals.

        Parameters
        ----------
        sliders : int or None
            As for :meth:`slider_bank`.
        """
        return Reversals(self) if sliders is None else super().discrete(sliders)

    def loading(self, d: ArrayLike, d_0: ArrayLike) -> Float[Array, "..."]:
        """Loading branch of the steady loop of amplitude d_0, by Masing's rule."""
        return masing_loading(self.law(), real(d), real(d_0))

    @classmethod
    def nested_whole(cls, **held: Any) -> tuple[NestedLaw, ...]:
        """One all of whose sliders slip at once is dry friction, one that never slips a spring."""
        return (
            dry_friction_within(lambda seen, share: (_CHI, 1.0 / share), _sliders),
            spring_within(lambda seen, share: (_CHI, 1.0 / share)),
        )

    @property
    def _remaining(self) -> Array:
        """F_S/(K_T phi_max) = 1 - rho/(chi+2), without the difference of near equals."""
        return (self.beta + (self.chi + 1.0) / (self.chi + 2.0)) / (1.0 + self.beta)

    def _normalised(self) -> Callable[[Array], tuple[Array, Array, Array, Array]]:
        """The map d -> x = d/phi_max, whether |x| < 1, m = min(|x|, 1) and m^(chi+1).

        One form for all methods, so that a compiler finds the power they share.
        """
        inverse_phi, n = 1.0 / self.phi_max, self.chi + 1.0

        def evaluate(d: Array) -> tuple[Array, Array, Array, Array]:
            x = d * inverse_phi
            s = jnp.abs(x)
            sticks = s < 1.0
            m = jnp.where(sticks, s, 1.0)
            return x, sticks, m, power(m, n)

        return evaluate


def _sliders(values: Values) -> tuple[Values, ...]:
    """With a joint's stiffness, and its strength or the largest slip of its sliders."""
    F_S, K_T, *_ = values
    return (K_T, F_S / K_T), (K_T, float(Iwan4(*values).phi_max))
