"""The linear dashpot: no force at rest, an ellipse in motion."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.joints.abstract import ParameterInfo, named
from iwanjax.joints.force_law import EffectName
from iwanjax.joints.rate_law import AbstractRateLaw
from iwanjax.types import ArrayLike, real


class Dashpot(AbstractRateLaw):
    r"""Linear dashpot: F = c v.

    Quasi-statically it carries nothing; per cycle it takes pi c omega d^2.

    Parameters
    ----------
    c : float or array
        Viscous coefficient, force x time/length.

    Examples
    --------
    >>> import iwanjax as ij
    >>> lost = ij.Dashpot(c=0.5).dissipation(2.0, omega=3.0)  # pi c omega d^2 in a cycle
    >>> round(float(lost), 4)
    18.8496
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo(
            "c", "force*time/length", "viscous coefficient", 0.0, closed="lower", transform="log"
        ),
    )
    effect: ClassVar[EffectName | None] = EffectName(
        "viscous_damping",
        "unmodelled linear damper",
        "damping that is off at every amplitude",
        "a viscous damper",
    )
    either_sign: ClassVar[bool] = True
    viscous: ClassVar[bool] = True

    c: Array = eqx.field(converter=named("c"))

    def rate_law(self, v: Array) -> tuple[Array, Array]:
        """Force c v and its slope c."""
        return self.c * v, self.c * jnp.ones_like(v)

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        r"""Energy per cycle :math:`\pi c\,\omega d^2`, force x length.

        Parameters
        ----------
        d : array_like
            Amplitude, length.
        omega : array_like
            Circular frequency, rad/s.

        Raises
        ------
        InputError
            When omega is not given: a dashpot's loss depends on rate.
        """
        return jnp.pi * self.c * self._rate(omega) * real(d) ** 2
