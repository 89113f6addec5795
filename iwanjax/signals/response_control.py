"""Frequency and damping from steady vibration at held response: no model, no ring-down."""

from typing import NamedTuple

import numpy as np

from iwanjax.curves import QUANTITIES, ModalCurves
from iwanjax.errors import InputError
from iwanjax.signals.stepped_sine import SteppedSine, stepped_sine
from iwanjax.types import ArrayLike

_FEWEST_FREQUENCIES = 4
# Between levels closer than this there is no slope to be had.
_SAME = 0.01
# Each takes the amplitude at resonance, or the slope between levels, from the one before; what
# is wrong shrinks by the slope, a tenth or so.
_ROUNDS = 12


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
    points = stepped_sine(level, frequency, force, response, phase, quantity)
    derivatives = QUANTITIES[quantity]
    labels = points.level
    found = [(float(np.mean(points.response[labels == each])), each) for each in np.unique(labels)]
    amplitude = np.array([mean for mean, _ in sorted(found)])
    levels = []
    for _, label in sorted(found):
        here = points.of(labels == label)
        different = np.unique(here.omega).size
        if different < _FEWEST_FREQUENCIES:
            raise InputError(
                f"level {label:g} has {different} different frequencies; expected at least "
                f"{_FEWEST_FREQUENCIES}"
            )
        levels.append(here)
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


def _resonance(level: SteppedSine, exponent: float) -> _Resonance:
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


def _inphase(
    level: SteppedSine, exponent: float, omega_r: float
) -> tuple[float, float, np.ndarray]:
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
