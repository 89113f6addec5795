"""Measured low-amplitude modes, and a model's modes beside them."""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from iwanjax.errors import InputError
from iwanjax.estimation.parameters import Chart
from iwanjax.estimation.problem import AbstractLeastSquares
from iwanjax.results import AbstractResult
from iwanjax.structures.affine import AffineStructure
from iwanjax.structures.assurance import modal_assurance
from iwanjax.structures.checks import finite_array
from iwanjax.types import ArrayLike

RIGID = 0.03
"""Modes below this share of the lowest measured frequency are rigid-body motion."""


@dataclass(frozen=True, eq=False)
class MeasuredModes(AbstractResult):
    """Natural frequencies and mode shapes at low amplitude.

    Parameters
    ----------
    frequency : (k,) array_like
        Hz.
    frequency_std : (k,) array_like or float
        Standard deviation, Hz.
    shapes : (s, k) array_like, optional
        Real shapes at the sensors, each to any scale.
    shape_std : float or (k,) array_like
        Standard deviation of a shape's components, as share of its root mean square. Both
        deviations are those of all that may keep a model from the measurement: noise, and what a
        mesh or a reduction twice as fine would change.

    Raises
    ------
    InputError
        For shapes that do not match the frequencies, and values that are not positive.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> measured = ij.MeasuredModes([10.0, 25.0], frequency_std=0.05, shapes=np.eye(2))
    >>> measured.frequency.shape, measured.shapes.shape  # modes; sensors, modes
    ((2,), (2, 2))
    """

    frequency: np.ndarray
    frequency_std: np.ndarray
    shapes: np.ndarray | None
    shape_std: np.ndarray

    def __init__(
        self,
        frequency: ArrayLike,
        frequency_std: ArrayLike,
        shapes: ArrayLike | None = None,
        shape_std: ArrayLike = 0.05,
    ):
        f = np.atleast_1d(finite_array(frequency, "frequency"))
        std = finite_array(frequency_std, "frequency_std")
        if f.ndim != 1 or std.shape not in ((), f.shape):
            raise InputError(
                f"MeasuredModes: frequency has shape {f.shape} and frequency_std {std.shape}; "
                "expected one of each for each mode"
            )
        for name, values in (("frequency", f), ("frequency_std", std)):
            if not np.all(values > 0):
                raise InputError(
                    f"MeasuredModes: {name} holds {values.min():g}; expected Hz above 0"
                )
        psi = None if shapes is None else finite_array(shapes, "shapes")
        if psi is not None and (psi.ndim != 2 or psi.shape[1] != f.size):
            raise InputError(
                f"MeasuredModes: shapes have shape {psi.shape}; expected (sensors, {f.size}), one "
                "column for each frequency"
            )
        if psi is not None and not np.all(np.any(psi != 0, axis=0)):
            raise InputError("MeasuredModes: a shape is zero throughout")
        share = finite_array(shape_std, "shape_std")
        if share.shape not in ((), f.shape):
            raise InputError(
                f"MeasuredModes: shape_std has shape {share.shape}; expected one share, or one "
                f"for each of {f.size} frequencies"
            )
        if not np.all(share > 0):
            raise InputError(
                f"MeasuredModes: shape_std holds {share.min():g}; expected a positive share"
            )
        object.__setattr__(self, "frequency", f)
        object.__setattr__(self, "frequency_std", np.broadcast_to(std, f.shape))
        object.__setattr__(self, "shapes", psi)
        object.__setattr__(self, "shape_std", np.broadcast_to(share, f.shape))


class Matched(eqx.Module):
    """A model's modes beside the measured ones.

    Attributes
    ----------
    mode : (k,) array of int
        Which of all modes, rigid ones counted.
    frequency : (k,) array
        Hz.
    shapes : (r, k) array
        At the rows of the comparison.
    assurance : (k,) array
        Modal assurance with the measured shape.
    """

    mode: Int[Array, " k"]
    frequency: Float[Array, " k"]
    shapes: Float[Array, "r k"]
    assurance: Float[Array, " k"]


class LinearProblem(AbstractLeastSquares):
    """Frequencies and shapes of an affine structure against measured ones, and the priors.

    Attributes
    ----------
    structure : AffineStructure
        Its parameters are those that are found, in the same order.
    rows : (r, n) array
        Where shapes are compared.
    shapes : (r, k) array
        That modes are recognised by, of root mean square 1.
    frequency, frequency_std : (k,) array
        Hz.
    shape_std : (k,) array, optional
        Share of a shape's root mean square; None where shapes are not data.
    middle, spread : (free,) array
        Of the priors: of the logarithm for what is moved by its logarithm.
    logarithmic : tuple of bool
        Which parameters these are.
    """

    chart: Chart
    structure: AffineStructure
    rows: Float[Array, "r n"]
    shapes: Float[Array, "r k"]
    frequency: Float[Array, " k"]
    frequency_std: Float[Array, " k"]
    shape_std: Float[Array, " k"] | None
    middle: Float[Array, " free"]
    spread: Float[Array, " free"]
    logarithmic: tuple[bool, ...] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)

    def matched(self, theta: Float[Array, " parameters"]) -> Matched:
        """For each measured mode the elastic one whose shape is most like it."""
        lam, Phi = self.structure.modes(theta)
        slowest = (2.0 * np.pi * RIGID * jnp.min(self.frequency)) ** 2
        seen = jnp.where(lam > slowest, self.rows @ Phi, 0.0)
        assurance = modal_assurance(self.shapes, seen)
        mode = jnp.argmax(assurance, axis=1)
        lam, shapes = self.structure.followed(theta, lam, Phi, mode)
        return Matched(
            mode,
            jnp.sqrt(lam) / (2.0 * np.pi),
            self.rows @ shapes,
            jnp.take_along_axis(assurance, mode[:, None], axis=1)[:, 0],
        )

    def differences(self, theta: Float[Array, " parameters"]) -> tuple[Array, Array]:
        """Frequencies' (k,) and shapes' (r, k) differences over their deviations.

        The shapes' are zero where they are not data.
        """
        found = self.matched(theta)
        frequency = (found.frequency - self.frequency) / self.frequency_std
        # Each shape at the scale that suits the measured one best.
        scale = jnp.sum(found.shapes * self.shapes, axis=0) / jnp.sum(found.shapes**2, axis=0)
        off = scale * found.shapes - self.shapes
        return frequency, jnp.zeros_like(off) if self.shape_std is None else off / self.shape_std

    def data(self, theta: Float[Array, " parameters"]) -> Array:
        """Differences that count, in one row."""
        frequency, shapes = self.differences(theta)
        if self.shape_std is None:
            return frequency
        return jnp.concatenate([frequency, shapes.ravel()])

    def residuals(self, theta: Float[Array, " parameters"]) -> Float[Array, " residuals"]:
        """The data's, and the distance from the priors' middles in their deviations."""
        off = believed(theta, self.chart.free, self.logarithmic) - self.middle
        return jnp.concatenate([self.data(theta), off / self.spread])


def believed(theta: Array, free: Sequence[int], logarithmic: Sequence[bool]) -> Array:
    """The free parameters, or their logarithms, as the priors are about them."""
    return jnp.stack([jnp.log(theta[i]) if logarithmic[i] else theta[i] for i in free])
