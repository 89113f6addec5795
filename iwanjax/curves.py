"""Frequency and damping of a mode against its amplitude, measured or predicted."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.results import AbstractResult
from iwanjax.types import ArrayLike, is_traced, real

QUANTITIES = {"displacement": 0, "velocity": 1, "acceleration": 2}
"""What a sensor may measure, and how often that is differentiated in time."""


class ModalCurves(AbstractResult, eqx.Module):
    r"""Amplitude-dependent frequency and damping of one mode, or of a batch of them.

    Measured and predicted curves share this type. The last axis runs over amplitude
    levels; leading axes, if any, over modes and parameter sets.

    Parameters
    ----------
    amplitude : (..., levels) array_like
        Vibration amplitude, in ``unit``; increasing levels are not required (a
        ring-down gives falling ones).
    frequency : (..., levels) array_like
        Natural frequency, Hz.
    damping : (..., levels) array_like
        Damping ratio, 1.
    amplitude_std, frequency_std, damping_std : (..., levels) array_like, optional
        Standard deviations, in the units of their curves; None where not known.
    quantity : str
        What ``amplitude`` measures: ``"modal displacement"`` (mass-normalised, q),
        ``"displacement"``, ``"velocity"`` or ``"acceleration"``.
    unit : str
        Unit of ``amplitude`` for labels, for instance ``"mm"``.
    name : str
        Name of the mode for legends.
    largest : (...) array_like, optional
        Largest amplitude that the mode had reached before or in the measurement, in ``unit``: what
        a joint with memory goes by (:class:`iwanjax.Iwan5`). None where only the levels are known.

    Raises
    ------
    InputError
        When the arrays are not numbers or their shapes do not match ``amplitude``.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> q = np.array([1e-3, 1e-2, 1e-1])
    >>> curves = ij.ModalCurves(q, 10.0 - q, 1e-3 + 0.1 * q, name="first bending")
    >>> velocity = curves.as_quantity("velocity")  # amplitudes times 2 pi f
    >>> velocity.quantity, round(float(velocity.amplitude[0]), 4)
    ('velocity', 0.0628)
    """

    amplitude: Float[Array, "*batch levels"]
    frequency: Float[Array, "*batch levels"]
    damping: Float[Array, "*batch levels"]
    amplitude_std: Float[Array, "*batch levels"] | None
    frequency_std: Float[Array, "*batch levels"] | None
    damping_std: Float[Array, "*batch levels"] | None
    quantity: str = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    name: str = eqx.field(static=True)
    largest: Float[Array, "*batch"] | None

    def __init__(
        self,
        amplitude: ArrayLike,
        frequency: ArrayLike,
        damping: ArrayLike,
        *,
        amplitude_std: ArrayLike | None = None,
        frequency_std: ArrayLike | None = None,
        damping_std: ArrayLike | None = None,
        quantity: str = "modal displacement",
        unit: str = "",
        name: str = "",
        largest: ArrayLike | None = None,
    ):
        self.amplitude = real(amplitude)
        self.frequency = self._matched(frequency, "frequency")
        self.damping = self._matched(damping, "damping")
        self.amplitude_std = self._deviation(amplitude_std, "amplitude_std")
        self.frequency_std = self._deviation(frequency_std, "frequency_std")
        self.damping_std = self._deviation(damping_std, "damping_std")
        self.quantity, self.unit, self.name = quantity, unit, name
        self.largest = None if largest is None else real(largest)

    def scaled(self, factor: ArrayLike, quantity: str, unit: str = "") -> "ModalCurves":
        """The same curves against another amplitude, proportional to the present one.

        Parameters
        ----------
        factor : array_like
            New amplitude per present amplitude, for instance a sensor's row of the mode
            shape, ``abs(row @ phi)``; broadcast against ``amplitude``.
        quantity, unit : str
            What the new amplitude measures and its unit.

        Returns
        -------
        ModalCurves
        """
        factor, amplitude, deviation, largest = (
            _plain(each) for each in (factor, self.amplitude, self.amplitude_std, self.largest)
        )
        if largest is not None and np.shape(factor):
            # Beyond the levels the factor is that of the highest.
            xp: Any = np if isinstance(factor, np.ndarray) else jnp
            highest = xp.argmax(amplitude, axis=-1)[..., None]
            broad = xp.broadcast_to(factor, amplitude.shape)
            largest = largest * xp.take_along_axis(broad, highest, axis=-1)[..., 0]
        elif largest is not None:
            largest = largest * factor
        return ModalCurves(
            amplitude * factor,
            self.frequency,
            self.damping,
            amplitude_std=None if deviation is None else deviation * factor,
            frequency_std=self.frequency_std,
            damping_std=self.damping_std,
            quantity=quantity,
            unit=unit,
            name=self.name,
            largest=largest,
        )

    def as_quantity(self, quantity: str, unit: str = "") -> "ModalCurves":
        r"""The same curves against another of displacement, velocity and acceleration.

        .. math:: \omega\,|u| = |\dot u| = |\ddot u|/\omega

        (thesis Eq. 2.22), with each level's own frequency. The damping does not change: it
        is that of energy lost per cycle, whatever was measured.

        Parameters
        ----------
        quantity : {"displacement", "velocity", "acceleration", "modal displacement"}
            What the amplitude shall be; "modal displacement" is a displacement.
        unit : str
            Its unit for labels; nothing is converted.

        Returns
        -------
        ModalCurves

        Raises
        ------
        InputError
            For a quantity that is none of these, here or in the present curves.
        """
        derivatives = QUANTITIES | {"modal displacement": 0}
        for known in (self.quantity, quantity):
            if known not in derivatives:
                raise InputError(
                    f"as_quantity: {known!r} is none of {', '.join(derivatives)}; it cannot be "
                    "converted"
                )
        power = derivatives[quantity] - derivatives[self.quantity]
        return self.scaled((2.0 * np.pi * _plain(self.frequency)) ** power, quantity, unit)

    def _unit(self, name: str) -> str:
        return self.unit if name in ("amplitude", "largest") else super()._unit(name)

    def _matched(self, value: ArrayLike, name: str) -> Array:
        array = real(value)
        if array.shape != self.amplitude.shape:
            raise InputError(
                f"ModalCurves: {name} has shape {array.shape}, amplitude has "
                f"{self.amplitude.shape}; they must match"
            )
        return array

    def _deviation(self, value: ArrayLike | None, name: str) -> Array | None:
        if value is None:
            return None
        array = self._matched(value, name)
        if not is_traced(array) and np.any(np.asarray(array) < 0):
            raise InputError(f"ModalCurves: {name} holds a negative standard deviation")
        return array


def _plain(value: Any) -> Any:
    """An array as NumPy's, unless it is being traced: JAX would compile for every new shape."""
    return value if value is None or is_traced(value) else np.asarray(value)
