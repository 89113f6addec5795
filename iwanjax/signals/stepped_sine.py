"""Stepped sines: force and response of one mode at one frequency after another."""

from typing import NamedTuple

import numpy as np

from iwanjax.curves import QUANTITIES
from iwanjax.errors import InputError
from iwanjax.types import ArrayLike, as_real

# Nobody tells a phase beyond this, rad.
_MOST_TURNED = 4.0 * np.pi


class SteppedSine(NamedTuple):
    """Points of all levels.

    Attributes
    ----------
    level : (points,) array
        Label of the level that each belongs to.
    omega : (points,) array
        rad/s.
    response : (points,) array
        Amplitude as measured.
    displacement : (points,) array
        Amplitude of the displacement.
    inphase, quadrature : (points,) array
        Real and imaginary part of the dynamic stiffness, force over displacement.
    """

    level: np.ndarray
    omega: np.ndarray
    response: np.ndarray
    displacement: np.ndarray
    inphase: np.ndarray
    quadrature: np.ndarray

    @property
    def name(self) -> str:
        """Of the level that all points are of."""
        return f"level {self.level[0]:g}"

    @property
    def dynamic(self) -> np.ndarray:
        """Dynamic stiffness, force over displacement, (points,)."""
        return self.inphase + 1j * self.quadrature

    def of_one_mode(self, flexibility: float) -> "SteppedSine":
        r"""The same of a mode alone, where all others add a flexibility to its own.

        .. math:: \frac{F}{U - R F} = \frac{Z}{1 - R Z}, \qquad Z = \frac{F}{U}

        Parameters
        ----------
        flexibility : float
            R, the sum of the other modes' displacement over force (Ewins, Modal Testing, Sec. 4.3:
            the residual terms); negative below the mode, where rigid bodies weigh most.
        """
        share = 1.0 - flexibility * self.dynamic
        own = self.dynamic / share
        return self._replace(
            displacement=self.displacement * np.abs(share),
            inphase=np.real(own),
            quadrature=np.imag(own),
        )

    def of(self, at: np.ndarray) -> "SteppedSine":
        """Those of the points, in the order of their frequencies."""
        picked = SteppedSine(*(each[at] for each in self))
        order = np.argsort(picked.omega, kind="stable")
        return SteppedSine(*(each[order] for each in picked))


def stepped_sine(
    level: ArrayLike,
    frequency: ArrayLike,
    force: ArrayLike,
    response: ArrayLike,
    phase: ArrayLike,
    quantity: str,
) -> SteppedSine:
    """Points from columns that broadcast, checked.

    Parameters
    ----------
    level : array_like
        Label of the level that each point belongs to.
    frequency : array_like
        Hz.
    force, response : array_like
        Amplitudes of the fundamental, positive.
    phase : array_like
        Of the response's fundamental ahead of the force, rad.
    quantity : {"acceleration", "velocity", "displacement"}
        What the response is.

    Raises
    ------
    InputError
        For arrays that do not broadcast, or are not finite or positive.
    """
    if quantity not in QUANTITIES:
        raise InputError(f"quantity = {quantity!r}; expected one of {', '.join(QUANTITIES)}")
    labels, f, F, y, angle = _columns(
        {
            "level": level,
            "frequency": frequency,
            "force": force,
            "response": response,
            "phase": phase,
        }
    )
    omega = 2.0 * np.pi * f
    U = y * np.exp(1j * angle) / (1j * omega) ** QUANTITIES[quantity]
    Z = F / U
    return SteppedSine(labels, omega, y, np.abs(U), np.real(Z), np.imag(Z))


def ahead_of_force(
    level: np.ndarray,
    frequency: np.ndarray,
    force: np.ndarray,
    response: np.ndarray,
    phase: np.ndarray,
    quantity: str,
) -> np.ndarray:
    """The response's phase ahead of the force, from one that may be told otherwise.

    Recorders tell the phase of what they hold, or of the displacement, ahead of the force or
    behind it. Only one of these makes a mode of positive mass, stiffness and damping.

    Parameters
    ----------
    level, frequency, force, response, phase : (points,) array
        As for :func:`stepped_sine`, but for the phase.
    quantity : str
        What the response is.

    Raises
    ------
    InputError
        Where none does, and for degrees.
    """
    largest = float(np.max(np.abs(phase)))
    if largest > _MOST_TURNED:
        raise InputError(f"phase_rad goes to {largest:.4g}; that looks like degrees")
    turned = 0.5 * np.pi * QUANTITIES[quantity]
    omega = 2.0 * np.pi * frequency
    for told in (phase, -phase, phase + turned, turned - phase):
        Z = force / response * omega ** QUANTITIES[quantity] * np.exp(1j * (turned - told))
        modes = [_is_mode(omega[level == each], Z[level == each]) for each in np.unique(level)]
        if all(modes):
            return told
    raise InputError(
        "phase_rad: taken as of the response or of the displacement, ahead of the force or behind "
        "it, no mode has positive mass, stiffness and damping"
    )


def _is_mode(omega: np.ndarray, Z: np.ndarray) -> bool:
    """Whether a dynamic stiffness is of a positive mass, stiffness and damping."""
    if np.unique(omega).size < 2:
        return True
    slope, stiffness = np.polyfit(omega**2, np.real(Z), 1)
    return bool(slope < 0.0 < stiffness and np.mean(np.imag(Z)) > 0.0)


def _columns(given: dict[str, ArrayLike]) -> list[np.ndarray]:
    """All of one length."""
    arrays = {key: np.asarray(as_real(value, key)) for key, value in given.items()}
    for key in ("frequency", "force", "response"):
        if not np.all(arrays[key] > 0.0):
            raise InputError(f"{key} holds {np.min(arrays[key]):g}; expected positive numbers")
    try:
        return [column.ravel() for column in np.broadcast_arrays(*arrays.values())]
    except ValueError:
        shapes = ", ".join(f"{key} {value.shape}" for key, value in arrays.items())
        raise InputError(f"shapes do not broadcast: {shapes}") from None
