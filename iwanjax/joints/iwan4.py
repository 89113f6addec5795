"""Segalman's four-parameter Iwan element in closed form."""

from collections.abc import Callable
from typing import ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.joints.abstract import Law, ParameterInfo, named
from iwanjax.joints.iwan import IWAN_PARAMETERS, AbstractIwan, physical_of
from iwanjax.joints.masing import masing_loading
from iwanjax.joints.power import power
from iwanjax.types import ArrayLike, real


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

    def loading(self, d: ArrayLike, d_0: ArrayLike) -> Float[Array, "..."]:
        """Loading branch of the steady loop of amplitude d_0, by Masing's rule."""
        return masing_loading(self.law(), real(d), real(d_0))

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
