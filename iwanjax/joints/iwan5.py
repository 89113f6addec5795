"""Mignolet's five-parameter Iwan-type element: static and kinetic friction differ."""

from typing import ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.joints.abstract import Law, ParameterInfo, named
from iwanjax.joints.iwan import IWAN_PARAMETERS, AbstractIwan, physical_of
from iwanjax.joints.power import is_positive, power
from iwanjax.types import ArrayLike, Scalar, real


class Iwan5(AbstractIwan):
    r"""Five-parameter Iwan-type element (Mignolet et al. 2015; thesis chapter 4).

    The distribution is that of the four-parameter element, but a slider that starts to
    slip at :math:`\phi` drops to :math:`\theta\phi` and stays there until the motion
    reverses. The steady cycle then depends on the largest amplitude reached so far,
    :math:`u_{max}`: sliders beyond it never slipped.

    With :math:`s=|d|/\phi_{max}`, :math:`\rho=1/(1+\beta)`, the virgin curve is

    .. math:: F = K_T\phi_{max}\left[s-\rho s^{\chi+2}\,
              \frac{\chi+2-\theta(\chi+1)}{\chi+2}\right]\ (s<1),\qquad
              F=\theta F_S\ (s\ge 1)

    (4.5), with a drop of :math:`(1-\theta)S\phi_{max}` where the Dirac slider lets go.
    It need not rise monotonically. The thesis's Eq. (4.33a) is printed with a bracket
    raised to chi+2 by mistake, and it has no macroslip; both are put right here.

    Parameters
    ----------
    F_S : float or array
        Static force at macroslip, as of the four-parameter element with the same
        distribution, force. In macroslip the element carries theta F_S.
    K_T, chi, beta : float or array
        As for :class:`Iwan4`.
    theta : float or array
        Kinetic over static friction, 1; in (0, 1]. At 1 the element is an ``Iwan4``.

    Raises
    ------
    InputError
        For a parameter outside its bounds, not finite, or of a shape that does not
        broadcast with the others.
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        *IWAN_PARAMETERS,
        ParameterInfo(
            "theta",
            "1",
            "kinetic over static friction",
            lower=0.0,
            upper=1.0,
            closed="upper",
            transform="logit",
        ),
    )

    F_S: Array = eqx.field(converter=named("F_S"))
    K_T: Array = eqx.field(converter=named("K_T"))
    chi: Array = eqx.field(converter=named("chi"))
    beta: Array = eqx.field(converter=named("beta"))
    theta: Array = eqx.field(converter=named("theta"))

    @classmethod
    def from_distribution(
        cls, *, R: ArrayLike, S: ArrayLike, chi: ArrayLike, phi_max: ArrayLike, theta: ArrayLike
    ) -> Self:
        """The same element from its slider distribution; arguments as ``Iwan4``'s, and theta."""
        return cls(**physical_of(cls.__name__, R, S, chi, phi_max), theta=theta)

    @property
    def kinetic_share(self) -> Array:
        """Theta."""
        return self.theta

    @property
    def R_bar(self) -> Array:
        """R of the four-parameter element with the same ring-down, force/length^(chi+2) (4.47).

        Equivalent while the amplitude is below (1 + theta)/2 of the largest so far.
        """
        bracket = (1.0 - self.theta) * self.chi + 2.0
        return self.R * bracket * 2.0 ** (self.chi + 1.0) / (1.0 + self.theta) ** (self.chi + 2.0)

    def law(self) -> Law:
        """Virgin curve d -> (force, tangent), Eq. (4.5); theta F_S from phi_max on."""
        n = self.chi + 1.0
        inverse_phi = 1.0 / self.phi_max
        scale = self.K_T * self.phi_max
        remaining = self._remaining(self.theta * n / (n + 1.0))
        slope = (n + 1.0 - self.theta * n) / (1.0 + self.beta)
        macro = self.theta * self.F_S
        K_T = self.K_T

        def evaluate(d: Array) -> tuple[Array, Array]:
            x = d * inverse_phi
            sticks = jnp.abs(x) < 1.0
            p = power(jnp.where(sticks, jnp.abs(x), 1.0), n)
            micro = scale * x * (1.0 - p + remaining * p)
            force = jnp.where(sticks, micro, macro * jnp.sign(x))
            return force, jnp.where(sticks, K_T * (1.0 - slope * p), 0.0)

        return evaluate

    def secant(self, d: ArrayLike, d_max: ArrayLike | None = None) -> Float[Array, "..."]:
        """Secant stiffness of the steady cycle of amplitude |d| (4.7), (4.35) and macroslip.

        Parameters
        ----------
        d : array_like
            Amplitude, length.
        d_max : array_like, optional
            Largest amplitude so far, length; the present one (ring-up, Mignolet's steady
            form) by default and at least.
        """
        u, slipped, cycle, regime = self._cycle(d, d_max)
        n, theta = self.chi + 1.0, self.theta
        w_n, v_n = power(cycle, n), power(slipped, n)
        positive = is_positive(u)
        u_safe = jnp.where(positive, u, 1.0)
        ratio = jnp.where(positive, slipped / u_safe, 1.0)
        within = 1.0 - w_n + w_n * self._reslipping
        all_reslip = 1.0 - v_n + v_n * self._remaining(theta * n / (n + 1.0) * ratio)
        macroslip = theta * self._remaining(n / (n + 1.0)) / u_safe
        return self.K_T * jnp.select([regime == 0, regime == 1], [within, all_reslip], macroslip)

    def dissipation(
        self,
        d: ArrayLike,
        d_max: ArrayLike | None = None,
        *,
        omega: ArrayLike | None = None,
    ) -> Float[Array, "..."]:
        """Energy per steady cycle of amplitude |d| (4.8), (4.36) and macroslip, force x length.

        Parameters
        ----------
        d, d_max : array_like
            As for :meth:`secant`.
        omega : array_like, optional
            Ignored: the element does not depend on rate.
        """
        u, slipped, cycle, regime = self._cycle(d, d_max)
        n, theta = self.chi + 1.0, self.theta
        w_n, v_n = power(cycle, n), power(slipped, n)
        sliders = n / (1.0 + self.beta)
        moments = (n + 1.0) * (n + 2.0)
        bracket = (1.0 - theta) * self.chi + 2.0
        within = sliders * w_n * cycle**2 * bracket * (1.0 + theta) / moments
        steady = (2.0 * theta * (n + 3.0) + (1.0 - 3.0 * theta**2) * (n + 1.0)) / moments
        beyond = 4.0 * theta / (n + 1.0) * (u - slipped)
        all_reslip = sliders * v_n * slipped * (steady * slipped + beyond)
        dirac = self.beta / (1.0 + self.beta) * (1.0 - theta) * (1.0 + 3.0 * theta)
        sliding = 4.0 * theta * self._remaining(n / (n + 1.0)) * (u - 1.0)
        macroslip = sliders * steady + dirac + sliding
        shape = jnp.select([regime == 0, regime == 1], [within, all_reslip], macroslip)
        return self.K_T * self.phi_max**2 * shape

    def loading(self, d: ArrayLike, d_0: ArrayLike) -> Float[Array, "..."]:
        """Forward monotonic curve from -d_0 to d_0 after ring-up to d_0 (4.33, corrected).

        Parameters
        ----------
        d : array_like
            Deflection within [-d_0, d_0], length.
        d_0 : array_like
            Largest amplitude so far, length; in macroslip too.
        """
        d, d_0 = real(d), jnp.abs(real(d_0))
        n, theta = self.chi + 1.0, self.theta
        peak = d_0 / self.phi_max
        slipped = jnp.where(peak < 1.0, peak, 1.0)
        travel = (d + d_0) / self.phi_max
        w = travel / (1.0 + theta)
        reslipping = w < slipped
        w_n, v_n = power(jnp.where(reslipping, w, slipped), n), power(slipped, n)
        within = travel * (1.0 - w_n + w_n * self._reslipping)
        kinetic = 2.0 * theta * n / ((1.0 + self.beta) * (n + 1.0)) * v_n * slipped
        all_reslip = travel * (1.0 - v_n + v_n * self._remaining(0.0)) + kinetic
        macroslip = 2.0 * theta * self._remaining(n / (n + 1.0))
        rise = jnp.where(reslipping, within, jnp.where(peak < 1.0, all_reslip, macroslip))
        return self.K_T * self.phi_max * rise - self.law()(d_0)[0]

    def _remaining(self, part: Scalar) -> Array:
        """1 - rho (1 - part), without the difference of near equals where beta is small."""
        return (self.beta + part) / (1.0 + self.beta)

    @property
    def _reslipping(self) -> Array:
        """Secant of the loading branch over K_T when the last threshold slips again (4.35)."""
        n = self.chi + 1.0
        return self._remaining(2.0 * self.theta * n / ((n + 1.0) * (1.0 + self.theta)))

    def _cycle(self, d: ArrayLike, d_max: ArrayLike | None) -> tuple[Array, Array, Array, Array]:
        """Normalised amplitude, largest slipped threshold, largest reslipping one, and regime.

        The regime is 0 while thresholds are still being reached, 1 when all that ever
        slipped have slipped again, and 2 when the Dirac slider is among them.
        """
        u = jnp.abs(real(d)) / self.phi_max
        largest = u if d_max is None else jnp.abs(real(d_max)) / self.phi_max
        largest = jnp.where(largest > u, largest, u)
        slipped = jnp.where(largest < 1.0, largest, 1.0)
        cycle = 2.0 * u / (1.0 + self.theta)
        partial = (cycle < slipped) | ~is_positive(u)
        regime = jnp.where(partial, 0, jnp.where(largest < 1.0, 1, 2))
        return u, slipped, jnp.where(partial, cycle, slipped), regime
