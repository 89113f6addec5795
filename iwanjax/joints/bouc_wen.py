"""The Bouc-Wen element: hysteresis that yields gradually and unloads elastically."""

from dataclasses import replace
from functools import partial
from typing import Any, ClassVar, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.joints import duhem
from iwanjax.joints.abstract import Law, ParameterInfo, named
from iwanjax.joints.force_law import (
    WITHIN_K,
    EffectName,
    NestedLaw,
    PlaceMotion,
    Scales,
    Variant,
)
from iwanjax.joints.jenkins import dry_friction_within, spring_within
from iwanjax.joints.springs import NEVER_GIVING_WAY
from iwanjax.joints.stepped import AbstractStepped
from iwanjax.types import ArrayLike, real

# Gauss-Legendre nodes of s in (0, 1), for integrals over w s^2: smooth for any n from 1 on.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(20)
_SHARE, _WEIGHT = (0.5 * (_NODES + 1.0)) ** 2, 0.5 * (_NODES + 1.0) * _WEIGHTS
_LOG_SHARE = np.log(_SHARE)
# Newton's steps from below on a concave curve: more change nothing.
_STEPS = 8
# Of y, from which on a curve's slope is the last one to 1e-13.
_LAST = 30.0
# Share of the slip force that is remembered at most: at all of it the way there is infinite.
_FULL = 1.0 - 1e-15


class BoucWen(AbstractStepped):
    r"""Bouc-Wen element of equal beta and gamma (Wen 1976), without a spring beside it.

    With the stretch z of a spring K_T, and :math:`s = F_S/K_T`:

    .. math:: F = K_T z, \qquad \dot z = \dot d\left[1 - \left|\frac{z}{s}\right|^n
              \frac{1 + \mathrm{sign}(\dot d\,z)}{2}\right]

    It unloads with K_T; on the virgin curve :math:`d = z\,{}_2F_1(1, 1/n; 1 + 1/n; (z/s)^n)`
    (Charalampakis & Koumousis 2008), for n = 1 :math:`F = F_S(1 - e^{-d/s})`, for n = 2
    :math:`F_S\tanh(d/s)`. Whatever the length of a step, its end is exact.

    Parameters
    ----------
    F_S : float or array
        Force that it tends to, force.
    K_T : float or array
        Stiffness at rest, force/length.
    n : float or array
        How suddenly it yields, 1; from 1 on, a Jenkins element for very large n.
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("F_S", "force", "force it tends to", lower=0.0, transform="log"),
        ParameterInfo("K_T", "force/length", "stiffness at rest", lower=0.0, transform="log"),
        ParameterInfo("n", "1", "how suddenly it yields", 1.0, closed="lower", transform="log"),
    )
    effect: ClassVar[EffectName | None] = EffectName(
        "bouc_wen", "hysteresis of other shape than Iwan's", noun="a Bouc-Wen element"
    )
    rate_dependent: ClassVar[bool] = False
    tried: ClassVar[bool] = False
    taken_for: ClassVar[tuple[str, ...]] = ("coulomb_friction", "iwan_joint")
    variants: ClassVar[tuple[Variant, ...]] = (Variant(), WITHIN_K)

    F_S: Array = eqx.field(converter=named("F_S"))
    K_T: Array = eqx.field(converter=named("K_T"))
    n: Array = eqx.field(converter=named("n"))

    @classmethod
    def searched(cls) -> tuple[ParameterInfo, ...]:
        """Stiffness and deflection at slip, as of dry friction."""
        slip = ParameterInfo("slip", "length", "largest force over k", lower=0.0, transform="log")
        return replace(cls.parameters[1], name="k"), slip

    @classmethod
    def scaled(cls, size: ArrayLike, shape: ArrayLike, n: float = 1.0, **held: Any) -> Self:
        """Of stiffness ``size`` that tends to the force at deflection ``shape``."""
        return cls(F_S=real(size) * real(shape), K_T=size, n=n)

    @classmethod
    def starts(cls, seen: Scales) -> tuple[float, ...]:
        """Yielding at small and at most deflections."""
        return 0.03 * seen.deflection, 0.3 * seen.deflection

    @classmethod
    def begun(cls, seen: Scales, **held: Any) -> tuple[Self, ...]:
        """The same with an exponent that can be moved either way."""
        return super().begun(seen, n=2.0, **held)

    @classmethod
    def nested(cls, **held: Any) -> tuple[NestedLaw, ...]:
        """One that never yields is a spring."""
        return (NEVER_GIVING_WAY,)

    @classmethod
    def nested_whole(cls, **held: Any) -> tuple[NestedLaw, ...]:
        """One that yields all at once is dry friction; one that never does a spring."""
        return (
            dry_friction_within(lambda seen, share: (1.0 / share,)),
            spring_within(lambda seen, share: (2.0,)),
        )

    @property
    def initial_stiffness(self) -> Array:
        """K_T, force/length."""
        return self.K_T + jnp.zeros_like(self.F_S * self.n)

    @property
    def limit_stiffness(self) -> Array:
        """Zero: the force stays below F_S."""
        return jnp.zeros_like(self.F_S * self.K_T * self.n)

    @property
    def slip(self) -> Array:
        """F_S/K_T, length."""
        return self.F_S / self.K_T

    def follow(self, motion: PlaceMotion, memory: Array) -> tuple[Array, Array]:
        """Exact to the end of the step; the spring's stretch is remembered."""
        way = jnp.where(motion.moved < 0.0, -1.0, 1.0)
        stretch = way * self.slip * self._onward(way * memory / self.slip, way * motion.moved)
        return self.K_T * stretch, stretch

    def _onward(self, w: Array, moved: Array) -> Array:
        """Share w of the slip force after a deflection that is not negative, elastic below zero."""
        u = moved / self.slip
        begin = -jnp.log1p(-jnp.clip(w, 0.0, _FULL))
        u_0 = _deflection(begin, self.n)
        onward = u + jnp.minimum(w, 0.0)
        rest = jnp.maximum(onward, 0.0)
        y = _root(u_0 + rest, begin + rest, self.n, 0.0)
        return jnp.where(onward < 0.0, onward, jnp.minimum(-jnp.expm1(-y), _FULL))

    def law(self) -> Law:
        """Virgin curve d -> (force, tangent)."""
        slip, n, F_S, K_T = self.slip, self.n, self.F_S, self.K_T

        def evaluate(d: Array) -> tuple[Array, Array]:
            u = jnp.abs(d) / slip
            y = _root(u, u, n, 0.0)
            return F_S * jnp.sign(d) * -jnp.expm1(-y), K_T * _complement(y, n)

        return evaluate

    def _tip(self, d: ArrayLike) -> Array:
        """Of the steady cycle: y at the tip, where 2 d is its stretch and the virgin curve's d."""
        twice = 2.0 * jnp.abs(real(d)) / self.slip
        return _root(twice, 0.5 * twice, self.n, 1.0)

    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """Secant stiffness of the cycle of amplitude |d|, force/length."""
        amplitude = jnp.abs(real(d))
        at_rest = amplitude == 0
        safe = jnp.where(at_rest, 1.0, amplitude)
        tip = -self.F_S * jnp.expm1(-self._tip(safe))
        return jnp.where(at_rest, self.initial_stiffness, tip / safe)

    def tip_stiffness(self, d: ArrayLike) -> Float[Array, "..."]:
        r"""Of a slow decay (:func:`iwanjax.joints.duhem.tip_stiffness`), force/length.

        .. math:: \frac{F_S}{d}\,\frac{4w(1 - w^n)}{(2 - w^n)^2}

        with the share w of F_S at the tips.
        """
        y = self._tip(d)
        onward, size = _complement(y, self.n), jnp.abs(real(d)) / self.slip
        return duhem.tip_stiffness(-jnp.expm1(-y), onward, jnp.ones_like(y), size, self.K_T)

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        r"""Energy per cycle, :math:`2 F_S s\int_0^w \frac{t^{n+1}}{1 - t^n}\,dt` to the tip's w.

        Parameters
        ----------
        d : array_like
            Amplitude, length.
        omega : array_like, optional
            Ignored: the element does not depend on rate.
        """
        return 2.0 * self.F_S * self.slip * _lost(self._tip(d), self.n)

    def loading(self, d: ArrayLike, d_0: ArrayLike) -> Float[Array, "..."]:
        """Loading branch of the steady loop of amplitude d_0."""
        to, amplitude = real(d), jnp.abs(real(d_0))
        return self.F_S * self._onward(jnp.expm1(-self._tip(amplitude)), to + amplitude)


def _complement(y: Array, n: Array) -> Array:
    """1 - w^n at w = 1 - exp(-y), neither end of which loses its digits."""
    large = y > 0.5
    near = -jnp.expm1(n * jnp.log1p(-jnp.exp(-jnp.where(large, y, 0.5))))
    return jnp.where(large, near, 1.0 - (-jnp.expm1(-jnp.where(large, 0.5, y))) ** n)


@jax.custom_jvp
def _deflection(y: Array, n: Array) -> Array:
    r"""Of the virgin curve over slip, :math:`\int_0^w dt/(1 - t^n)`, its pole apart."""
    return _by_nodes(y, n, _powers(y, n))


@_deflection.defjvp
def _(at: tuple[Array, Array], along: tuple[Array, Array]) -> tuple[Array, Array]:
    y, n = at
    slopes = _slope(y, n, 0.0), _deflection_by_n(y, n)
    return _deflection(y, n), slopes[0] * along[0] + slopes[1] * along[1]


def _at_nodes(of_nodes: np.ndarray, y: Array, n: Array) -> Array:
    """One number for each node, before the axes of y and n."""
    return jnp.asarray(of_nodes).reshape(-1, *(1,) * max(y.ndim, n.ndim))


def _powers(y: Array, n: Array) -> Array:
    """Shares of the nodes to the power n: those of w need but one power more."""
    return jnp.exp(_at_nodes(_LOG_SHARE, y, n) * n)


def _by_nodes(y: Array, n: Array, powers: Array) -> Array:
    """The deflection over slip, by the powers of the nodes' shares."""
    w = -jnp.expm1(-y)
    smooth = 1.0 / (1.0 - powers * w**n) - 1.0 / (n * (1.0 - _at_nodes(_SHARE, y, n) * w))
    return y / n + w * _sum(smooth)


def _deflection_by_n(y: Array, n: Array) -> Array:
    """Its derivative by the exponent."""
    w = -jnp.expm1(-y)
    w_n = _powers(y, n) * w**n
    log = _at_nodes(_LOG_SHARE, y, n) + jnp.log(jnp.where(w > 0.0, w, 1.0))
    pole = 1.0 / (n**2 * (1.0 - _at_nodes(_SHARE, y, n) * w))
    return -y / n**2 + w * _sum(w_n * log / (1.0 - w_n) ** 2 + pole)


def _lost(y: Array, n: Array) -> Array:
    r"""Energy lost over half a cycle, :math:`\int_0^w t^{n+1}/(1 - t^n)\,dt`."""
    w = -jnp.expm1(-y)
    t = _at_nodes(_SHARE, y, n) * w
    t_n = t**n
    whole = t * t_n / (1.0 - t_n)
    smooth = whole - 1.0 / (n * (1.0 - t))
    return jnp.where(y > 1.0, y / n + w * _sum(smooth), w * _sum(whole))


def _sum(values: Array) -> Array:
    return jnp.tensordot(jnp.asarray(_WEIGHT), values, axes=1)


@partial(jax.custom_jvp, nondiff_argnums=(3,))
def _root(target: Array, begin: Array, n: Array, share: float) -> Array:
    """Where the virgin curve's deflection, and a share of its force, is the target; from below."""
    powers = _powers(begin, n)
    # A step squares what the last has left: after one as small as this nothing is.
    small = jnp.sqrt(jnp.finfo(begin.dtype).eps)
    target, begin, n = jnp.broadcast_arrays(target, begin, n)

    def unsettled(at: tuple[int, Array, Array]) -> Array:
        step, y, moved = at
        return (step < _STEPS) & jnp.any(moved > small * y)

    def step(at: tuple[int, Array, Array]) -> tuple[int, Array, Array]:
        step, y, _ = at
        passed = _by_nodes(y, n, powers) - share * jnp.expm1(-y)
        moved = (target - passed) / _slope(y, n, share)
        return step + 1, y + moved, moved

    return jax.lax.while_loop(unsettled, step, (0, begin, jnp.full_like(begin, jnp.inf)))[1]


@_root.defjvp
def _(share: float, at: tuple[Array, ...], along: tuple[Array, ...]) -> tuple[Array, Array]:
    """Implicit: of the equation that is solved, wherever the steps began."""
    target, begin, n = at
    y = _root(target, begin, n, share)
    return y, (along[0] - _deflection_by_n(y, n) * along[2]) / _slope(y, n, share)


def _slope(y: Array, n: Array, share: float) -> Array:
    """Change with y of the deflection over slip, and of a share of the force over F_S."""
    # Where next to nothing is left to yield it is 1/n, as a quotient of nothings.
    left = jnp.minimum(y, _LAST)
    return jnp.exp(-left) / _complement(left, n) + share * jnp.exp(-y)
