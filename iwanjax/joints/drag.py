"""Quadratic drag: a force with the square of the rate."""

from dataclasses import replace
from typing import Any, ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.joints.abstract import ParameterInfo, named
from iwanjax.joints.force_law import EffectName
from iwanjax.joints.rate_law import AbstractRateLaw
from iwanjax.types import ArrayLike, real


class QuadraticDrag(AbstractRateLaw):
    r"""Quadratic drag: F = c v |v|, as of a body in a fluid. Quasi-statically it carries nothing.

    Parameters
    ----------
    c : float or array
        Coefficient, force x time^2/length^2.

    Examples
    --------
    >>> import iwanjax as ij
    >>> lost = ij.QuadraticDrag(c=3.0).dissipation(1.0, omega=1.0)  # 8/3 c omega^2 d^3 in a cycle
    >>> round(float(lost), 4)
    8.0
    """

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo(
            "c",
            "force*time^2/length^2",
            "drag coefficient",
            0.0,
            closed="lower",
            transform="log",
        ),
    )
    effect: ClassVar[EffectName | None] = EffectName(
        "quadratic_damping",
        "drag",
        "damping that grows in proportion to amplitude",
        "quadratic damping (drag)",
    )
    either_sign: ClassVar[bool] = True

    c: Array = eqx.field(converter=named("c"))

    @classmethod
    def searched(cls) -> tuple[ParameterInfo, ...]:
        """The coefficient, by a name that tells it from a dashpot's."""
        return (replace(cls.parameters[0], name="c2"),)

    @classmethod
    def scaled(cls, size: ArrayLike, shape: ArrayLike, **held: Any) -> Self:
        """Of the coefficient ``size``."""
        return cls(c=size)

    def rate_law(self, v: Array) -> tuple[Array, Array]:
        """Force c v |v| and its slope 2 c |v|."""
        size = self.c * jnp.abs(v)
        return size * v, 2.0 * size

    def dissipation(self, d: ArrayLike, *, omega: ArrayLike | None = None) -> Float[Array, "..."]:
        r"""Energy per cycle :math:`\tfrac{8}{3} c\,\omega^2 |d|^3`, force x length.

        Parameters
        ----------
        d : array_like
            Amplitude, length.
        omega : array_like
            Circular frequency of the harmonic cycle, rad/s.

        Raises
        ------
        InputError
            When omega is not given.
        """
        return 8.0 / 3.0 * self.c * self._rate(omega) ** 2 * jnp.abs(real(d)) ** 3
