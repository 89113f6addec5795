"""An elastic element whose curve is a table."""

from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.joints.abstract import Law, ParameterInfo
from iwanjax.joints.springs import AbstractSpring
from iwanjax.types import ArrayLike, as_real, is_traced, real


class Tabulated(AbstractSpring):
    """A measured or computed curve: straight between the points of a table and beyond its ends.

    Parameters
    ----------
    d : (points,) array_like
        Deflections, length; strictly increasing, at least two.
    force : (points,) array_like
        Forces at them. One at d = 0 that is not zero is a preload.

    Raises
    ------
    InputError
        For tables of other shapes, not finite or not increasing in d.

    Examples
    --------
    >>> import iwanjax as ij
    >>> stop = ij.Tabulated(d=[-1.0, 0.0, 1.0], force=[-1.0, 0.0, 3.0])
    >>> stop.backbone([-0.5, 0.5, 2.0]).tolist()
    [-0.5, 1.5, 6.0]
    """

    # The table is what the element is, not a parameter that a fit would move. Its points are
    # leaves of their own: one with an axis would be taken for a batch of parameter sets.
    parameters: ClassVar[tuple[ParameterInfo, ...]] = ()

    d: tuple[Array, ...] = eqx.field(converter=lambda value: _row(value, "d"))
    force: tuple[Array, ...] = eqx.field(converter=lambda value: _row(value, "force"))

    @property
    def initial_stiffness(self) -> Array:
        """Slope at d = 0, the mean of both sides' where it changes there, force/length."""
        table, slope = jnp.stack(self.d), self._slopes()
        before, after = (jnp.searchsorted(table, 0.0, side=side) for side in ("left", "right"))
        return 0.5 * (slope(before) + slope(after))

    @property
    def limit_stiffness(self) -> Array:
        """Mean of the slopes at both ends, force/length."""
        slope = self._slopes()
        return 0.5 * (slope(jnp.asarray(0)) + slope(jnp.asarray(len(self.d))))

    def law(self) -> Law:
        """Virgin curve d -> (force, tangent)."""
        table, force, slope_at = jnp.stack(self.d), jnp.stack(self.force), self._slopes()

        def evaluate(d: Array) -> tuple[Array, Array]:
            i = jnp.searchsorted(table, d, side="right")
            left = jnp.clip(i - 1, 0, table.shape[0] - 2)
            slope = slope_at(i)
            return force[left] + slope * (d - table[left]), slope

        return evaluate

    def secant(self, d: ArrayLike) -> Float[Array, "..."]:
        """Slope from tip to tip, force/length."""
        amplitude = jnp.abs(real(d))
        at_rest = amplitude == 0
        safe = jnp.where(at_rest, 1.0, amplitude)
        tips = self.backbone(safe) - self.backbone(-safe)
        return jnp.where(at_rest, self.initial_stiffness, 0.5 * tips / safe)

    def _slopes(self) -> Callable[[Array], Array]:
        """Slope between the points i - 1 and i, outside the table of the nearest interval."""
        rise = jnp.diff(jnp.stack(self.force)) / jnp.diff(jnp.stack(self.d))
        return lambda i: rise[jnp.clip(i - 1, 0, rise.shape[0] - 1)]

    def __repr__(self) -> str:
        """How long the table is."""
        return f"Tabulated({len(self.d)} points)"

    def __check_init__(self) -> None:
        """Refuse what is not a table of a function."""
        if len(self.d) < 2 or len(self.d) != len(self.force):
            raise InputError(
                f"Tabulated: d has {len(self.d)} points and force {len(self.force)}; expected as "
                "many, at least 2"
            )
        if not is_traced(self.d):
            d = np.array(self.d)
            if not np.all(np.diff(d) > 0):
                i = int(np.argmin(np.diff(d) > 0))
                raise InputError(
                    f"Tabulated: d[{i + 1}] = {d[i + 1]:g} follows d[{i}] = {d[i]:g}; "
                    "expected increasing deflections"
                )


def _row(values: ArrayLike, name: str) -> tuple[Array, ...]:
    """The numbers of a table's row, one by one."""
    row = as_real(values, name)
    if row.ndim != 1:
        raise InputError(f"Tabulated: {name} has shape {row.shape}; expected a row of numbers")
    return tuple(row)
