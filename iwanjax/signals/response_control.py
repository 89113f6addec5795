"""Frequency and damping from steady vibration at held response: no model, no ring-down."""

from typing import NamedTuple

import numpy as np

from iwanjax.curves import QUANTITIES, ModalCurves
from iwanjax.errors import InputError
from iwanjax.types import ArrayLike, as_real

_FEWEST_FREQUENCIES = 4
# Nobody tells a phase beyond this, rad.
_MOST_TURNED = 4.0 * np.pi
# Between levels closer than this there is no slope to be had.
_SAME = 0.01
# Each takes the amplitude at resonance, or the slope between levels, from the one before; what
# is wrong shrinks by the slope, a tenth or so.
_ROUNDS = 12


class _Level(NamedTuple):
    """The points of one level."""

    name: str
    omega: np.ndarray
    displacement: np.ndarray
    inphase: np.ndarray
    quadrature: np.ndarray


class _Resonance(NamedTuple):
    """What a level's points say."""

    omega: float
    zeta: float
    omega_std: float
    zeta_std: float


def resonance_from_control(
    level: ArrayLike,
    frequency: ArrayLike,
    force: ArrayLike,
    response: ArrayLike,
    phase: ArrayLike,
    *,
    quantity: str = "acceleration",
    unit: str = "",
    name: str = "",
) -> ModalCurves:
    r"""Amplitude-dependent frequency and damping from stepped sines under response control.

    At one amplitude a nonlinear mode is a linear one, so its dynamic stiffness, force over
    displacement U, is fitted level by level about the resonance:

    .. math:: \mathrm{Re}\,\frac{F}{U} = k - m\omega^2, \qquad
              \mathrm{Im}\,\frac{F}{U} = h + h'(\omega - \omega_r), \qquad
              \omega_r = \sqrt{k/m}, \qquad \zeta = \frac{h}{2k}

    While the p-th derivative is held over a sweep, p = 2 for the acceleration, the
    displacement changes and the stiffness with it: k is taken to vary as :math:`|U|^s`, with
    s from the frequencies of neighbouring levels. For a single level s is taken to be zero
    and its damping comes out divided by 1 + ps/2. A mode apart from others is assumed.

    Parameters
    ----------
    level : array_like
        Label of the level that each point belongs to; arrays broadcast against each other.
    frequency : array_like
        Hz, at least 4 different ones for each level, on both sides of its resonance.
    force, response : array_like
        Amplitudes of the fundamental, positive.
    phase : array_like
        Of the response's fundamental ahead of the force, rad.
    quantity : {"acceleration", "velocity", "displacement"}
        What the response is.
    unit, name : str
        Labels of the curves.

    Returns
    -------
    ModalCurves
        Against the mean response of each level, in rising order, with standard deviations
        from the scatter about the fits.

    Raises
    ------
    InputError
        For arrays that do not broadcast or are not positive, levels with too few points,
        those whose resonance was not passed, and different levels of one amplitude.
    """
    if quantity not in QUANTITIES:
        raise InputError(f"quantity = {quantity!r}; expected one of {', '.join(QUANTITIES)}")
    derivatives = QUANTITIES[quantity]
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
    U = y * np.exp(1j * angle) / (1j * omega) ** derivatives
    Z = F / U
    found = [(float(np.mean(y[labels == label])), label) for label in np.unique(labels)]
    amplitude = np.array([mean for mean, _ in sorted(found)])
    levels = []
    for _, label in sorted(found):
        at = np.flatnonzero(labels == label)
        at = at[np.argsort(omega[at])]
        different = np.unique(omega[at]).size
        if different < _FEWEST_FREQUENCIES:
            raise InputError(
                f"level {label:g} has {different} different frequencies; expected at least "
                f"{_FEWEST_FREQUENCIES}"
            )
        parts = (np.real(Z[at]), np.imag(Z[at]))
        levels.append(_Level(f"level {label:g}", omega[at], np.abs(U[at]), *parts))
    close = np.flatnonzero(np.diff(amplitude) < _SAME * amplitude[1:])
    if close.size:
        one, other = levels[close[0]].name, levels[close[0] + 1].name
        raise InputError(
            f"{one} and {other} differ by less than {100 * _SAME:g} % in amplitude; label their "
            "points as one level"
        )
    rows = np.array([_resonance(each, 0.0) for each in levels])
    for _ in range(_ROUNDS if len(levels) > 1 else 0):
        stiffness = np.log(rows[:, 0] ** 2)
        slope = np.gradient(stiffness, np.log(amplitude / rows[:, 0] ** derivatives))
        rows = np.array([_resonance(each, s) for each, s in zip(levels, slope, strict=True)])
    omega_r, zeta, omega_std, zeta_std = rows.T
    return ModalCurves(
        amplitude,
        omega_r / (2.0 * np.pi),
        zeta,
        frequency_std=omega_std / (2.0 * np.pi),
        damping_std=zeta_std,
        quantity=quantity,
        unit=unit,
        name=name,
    )


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
        As for :func:`resonance_from_control`, but for the phase.
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
        raise InputError(f"resonance_from_control: shapes do not broadcast: {shapes}") from None


def _resonance(level: _Level, exponent: float) -> _Resonance:
    """Of one level, with its stiffness varying as the displacement to the exponent."""
    omega_r = 0.5 * (level.omega[0] + level.omega[-1])
    k, m, covariance = _inphase(level, exponent, omega_r)
    for _ in range(_ROUNDS):
        omega_r = np.sqrt(k / m)
        k, m, covariance = _inphase(level, exponent, omega_r)
    columns = np.stack([np.ones_like(level.omega), level.omega / omega_r - 1.0], axis=1)
    (h, _), spread = _least_squares(columns, level.quadrature)
    share = np.array([1.0 / k, -1.0 / m])
    return _Resonance(
        omega_r,
        0.5 * h / k,
        0.5 * omega_r * np.sqrt(share @ covariance @ share),
        0.5 / k * np.sqrt(spread[0, 0] + (h / k) ** 2 * covariance[0, 0]),
    )


def _inphase(level: _Level, exponent: float, omega_r: float) -> tuple[float, float, np.ndarray]:
    """Stiffness at the displacement that goes with omega_r, mass, and their covariance."""
    lowest, highest = level.omega[0], level.omega[-1]
    logs = np.log(level.omega), np.log(level.displacement)
    there = np.exp(np.interp(np.log(omega_r), *logs))
    # Columns of one size: the mass times omega_r^2 is about the stiffness.
    columns = [(level.displacement / there) ** exponent, -((level.omega / omega_r) ** 2)]
    (k, inertia), covariance = _least_squares(np.stack(columns, axis=1), level.inphase)
    if k <= 0.0 or inertia <= 0.0:
        raise InputError(
            f"{level.name}: the in-phase dynamic stiffness does not fall with frequency; phase "
            "must be that of the response ahead of the force, in rad"
        )
    found = omega_r * np.sqrt(k / inertia)
    if not lowest <= found <= highest:
        raise InputError(
            f"{level.name}: the resonance, at {found / (2 * np.pi):.6g} Hz, lies outside the "
            f"measured {lowest / (2 * np.pi):.6g} to {highest / (2 * np.pi):.6g} Hz"
        )
    units = np.array([1.0, omega_r**-2])
    return k, inertia / omega_r**2, covariance * np.outer(units, units)


def _least_squares(columns: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two coefficients and their covariance."""
    found, *_ = np.linalg.lstsq(columns, right, rcond=None)
    variance = np.sum((right - columns @ found) ** 2) / (right.size - 2)
    return found, variance * np.linalg.inv(columns.T @ columns)
