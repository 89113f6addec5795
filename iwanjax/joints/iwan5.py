"""Mignolet's five-parameter Iwan-type element: static and kinetic friction differ."""

from typing import ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.joints.abstract import Law, ParameterInfo, named
from iwanjax.joints.discrete import AbstractDiscrete
from iwanjax.joints.fronts import SlipFronts
from iwanjax.joints.iwan import IWAN_PARAMETERS, AbstractIwan, physical_of
from iwanjax.joints.power import is_positive, power
from iwanjax.joints.sliders import SLIDERS
from iwanjax.types import ArrayLike, Scalar, real

# Gauss-Legendre nodes of a phase between two others, for the first harmonic.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS
# Relative distance within which an amplitude is that at which the last threshold slips again.
_BESIDE = 1e-9
# Sliders of a bank for each segment between slip fronts, and segments at least and at most: 20 by
# default, within 0.1 per cent of 20 000 sliders over random histories, beats and decays; with 12 it
# is 3.6 per cent at worst, with 25 and more the sliders' own error.
_SLIDERS_EACH, _FEWEST, _MOST = 10, 8, 50


def ring_down_share(chi: Array, theta: Array) -> Array:
    """R of the four-parameter element with the same ring-down over the element's own (4.47)."""
    bracket = (1.0 - theta) * chi + 2.0
    return bracket * 2.0 ** (chi + 1.0) / (1.0 + theta) ** (chi + 2.0)


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

    Examples
    --------
    >>> import iwanjax as ij
    >>> joint = ij.Iwan5(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0, theta=0.8)
    >>> float(joint.backbone(100.0))  # all sliders move: kinetic friction, theta F_S
    8.0
    >>> bool(joint.secant(1.0, d_max=100.0) < joint.secant(1.0))
    True
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
        return self.R * ring_down_share(self.chi, self.theta)

    def discrete(self, sliders: int | None = SLIDERS) -> AbstractDiscrete:
        """The element in motion without a grid: all its sliders by their slip fronts.

        A bank of them (:meth:`slider_bank`) loses (1 - theta) k phi at an instant whenever one
        lets go, an error of the first order: 0.1 to 5 per cent of the force with 200.

        Parameters
        ----------
        sliders : int or None
            Of a bank that costs about half as much; the element has room for a tenth as many
            segments (:class:`~iwanjax.joints.SlipFronts`), 8 to 50. None asks for the default.

        Raises
        ------
        InputError
            For fewer than 3.
        """
        count = SLIDERS if sliders is None else sliders
        if count < 3:
            raise InputError(f"sliders = {count}; expected at least 3")
        power_law = self.K_T / (1.0 + self.beta)
        return SlipFronts(
            power_law,
            self.K_T - power_law,
            self.chi + 1.0,
            self.phi_max,
            self.theta,
            min(max(_FEWEST, count // _SLIDERS_EACH), _MOST),
        )

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

    def loading(
        self, d: ArrayLike, d_0: ArrayLike, d_max: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        """Loading branch of the steady cycle of amplitude d_0 (4.33, corrected), and macroslip.

        Parameters
        ----------
        d : array_like
            Deflection within [-d_0, d_0], length.
        d_0 : array_like
            Amplitude, length; in macroslip too.
        d_max : array_like, optional
            Largest amplitude so far, as for :meth:`secant`.
        """
        d, d_0 = real(d), jnp.abs(real(d_0))
        _, slipped, _, _ = self._cycle(d_0, d_max)
        travel = (d + d_0) / self.phi_max
        w = travel / (1.0 + self.theta)
        reslipping = w < slipped
        w_n = power(jnp.where(reslipping, w, slipped), self.chi + 1.0)
        within = travel * (1.0 - w_n + w_n * self._reslipping)
        held, slope = self._kinetic(slipped)
        rise = jnp.where(reslipping, within, held + slope * travel)
        return self.K_T * self.phi_max * rise - self.secant(d_0, d_max) * d_0

    def harmonic_stiffness(
        self, d: ArrayLike, d_max: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        r"""In-phase first harmonic of the steady cycle d cos(t), over d.

        From its lower tip the branch rises with :math:`\tau = u(1-\cos t)`, u = d/phi_max, as
        a power of tau until all thresholds have slipped again, at the phase :math:`t_1`, then
        on a line:

        .. math:: k_1 = -\frac{2K_T}{\pi u}\left[\int_0^{t_1}\left(\tau - (1-r)\,\tau
                  \Big(\frac{\tau}{1+\theta}\Big)^{\chi+1}\right)\cos t\,dt
                  + \int_{t_1}^{\pi}(A + B\tau)\cos t\,dt\right]

        where 1 - r is the share of (4.35). The power by quadrature over its own phases, which
        leaves it smooth; the rest in closed form, so that neither the kink at :math:`t_1` nor
        the drop of the Dirac slider there costs accuracy.

        Parameters
        ----------
        d, d_max : array_like
            As for :meth:`secant`.
        """
        u, slipped, _, regime = self._cycle(d, d_max)
        n, theta = self.chi + 1.0, self.theta
        # All that ever slipped slips again where the way from tip to tip is long enough.
        share = jnp.where(regime > 0, 0.5 * (1.0 + theta) * slipped, 1.0)
        share = share / jnp.where(regime > 0, u, 1.0)
        partly = (regime > 0) & (share < 1.0 - _BESIDE)
        half = jnp.arcsin(jnp.sqrt(jnp.where(partly, share, 0.5)))
        t_1 = jnp.where(partly, 2.0 * half, jnp.pi)
        line = jnp.sin(t_1) - 0.5 * t_1 - 0.25 * jnp.sin(2.0 * t_1)
        column = (-1, *(1,) * jnp.ndim(t_1 * n))
        t = t_1 * _NODES.reshape(column)
        # (1 - cos t)^(n + 1): t is positive at each node.
        powers = jnp.exp((n + 1.0) * jnp.log(2.0 * jnp.sin(0.5 * t) ** 2))
        bent = t_1 * jnp.sum(_WEIGHTS.reshape(column) * powers * jnp.cos(t), axis=0)
        drop = power(u / (1.0 + theta), n) * (1.0 - self._reslipping)
        held, slope = self._kinetic(slipped)
        held = held / jnp.where(partly, u, 1.0)
        beyond = -held * jnp.sin(t_1) - slope * (0.5 * jnp.pi + line)
        whole = line - drop * bent + jnp.where(partly, beyond, 0.0)
        return -2.0 / jnp.pi * self.K_T * whole

    def tip_stiffness(self, d: ArrayLike, d_max: ArrayLike | None = None) -> Float[Array, "..."]:
        r"""Stiffness at the tips that a free decay's amplitude shrinks by.

        What matters is that a branch depends on the way from its tip alone, as (4.34) does:
        then half of its rise from tip to tip is the force at a tip of amplitude d,
        :math:`G(d) = d\,K_{sec}(d, d_{max})`, and half a cycle's energy balance gives
        :math:`D/2 = d\,G'(d)\,\delta` with d_max as it is. For theta = 1 that is the tangent.

        Parameters
        ----------
        d, d_max : array_like
            As for :meth:`secant`.
        """
        _, slipped, cycle, regime = self._cycle(d, d_max)
        n = self.chi + 1.0
        within = 1.0 - (n + 1.0) * power(cycle, n) * (1.0 - self._reslipping)
        _, slope = self._kinetic(slipped)
        return self.K_T * jnp.where(regime == 0, within, slope)

    def after(self, d_max: ArrayLike) -> "RungDown":
        """Its cycles after a larger one: (4.35), (4.36) instead of the ring-up's."""
        return RungDown(self, real(d_max))

    def _remaining(self, part: Scalar) -> Array:
        """1 - rho (1 - part), without the difference of near equals where beta is small."""
        return (self.beta + part) / (1.0 + self.beta)

    @property
    def _reslipping(self) -> Array:
        """Secant of the loading branch over K_T when the last threshold slips again (4.35)."""
        n = self.chi + 1.0
        return self._remaining(2.0 * self.theta * n / ((n + 1.0) * (1.0 + self.theta)))

    def _kinetic(self, slipped: Array) -> tuple[Array, Array]:
        """Rise and slope of a branch once all that ever slipped has slipped again (4.34).

        In macroslip nothing is left to stick; over K_T phi_max and K_T.
        """
        n, theta = self.chi + 1.0, self.theta
        micro = slipped < 1.0
        v_n = power(slipped, n)
        kinetic = 2.0 * theta * n / ((1.0 + self.beta) * (n + 1.0)) * v_n * slipped
        macroslip = 2.0 * theta * self._remaining(n / (n + 1.0))
        slope = 1.0 - v_n + v_n * self._remaining(0.0)
        return jnp.where(micro, kinetic, macroslip), jnp.where(micro, slope, 0.0)

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


class RungDown(eqx.Module):
    """Cycles of a five-parameter element that has seen a larger amplitude.

    Parameters
    ----------
    joint : Iwan5
        The element.
    d_max : array
        Largest amplitude so far, length; where a cycle is larger, that one.
    """

    joint: Iwan5
    d_max: Array

    def harmonic_stiffness(self, d: ArrayLike) -> Float[Array, "..."]:
        """In-phase first harmonic over d."""
        return self.joint.harmonic_stiffness(d, self.d_max)

    def tip_stiffness(self, d: ArrayLike) -> Float[Array, "..."]:
        """Stiffness at the tips that a free decay's amplitude shrinks by."""
        return self.joint.tip_stiffness(d, self.d_max)

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        """Energy per cycle, force x length."""
        return self.joint.dissipation(d, self.d_max, omega=omega)
