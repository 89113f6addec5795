"""Frequency and damping from steady vibration at held force: each point at its own amplitude."""

import numpy as np

from iwanjax.curves import QUANTITIES, ModalCurves
from iwanjax.errors import InputError
from iwanjax.signals.stepped_sine import SteppedSine, stepped_sine
from iwanjax.types import ArrayLike

# Points whose stiffness and inertia outweigh the damping more than so many times say little of a
# mode, and other modes are in them.
_BESIDE = 3.0
# Amplitudes closer than this are one; those that the mode is told at are so many times, and so
# many points, apart: splines are then off by a ten-thousandth of what they follow.
_SAME, _APART, _BETWEEN = 0.05, 1.4, 5
# Relative deviation of the mass from which on it is not known.
_UNKNOWN = 0.1


def curves_from_force_control(
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
    r"""Amplitude-dependent frequency and damping from stepped sines at held force.

    At held force the amplitude follows the resonance, and where a mode softens or hardens it
    may jump. So no level is a linear mode, but every point is one at its own amplitude
    :math:`|U|`: of the dynamic stiffness, force over displacement,

    .. math:: \mathrm{Re}\,\frac{F}{U} = k(|U|) - m\omega^2, \qquad
              \mathrm{Im}\,\frac{F}{U} = h(|U|) + h'\left(\frac{\omega}{\omega_r} - 1\right),
              \qquad \omega_r = \sqrt{k/m}, \qquad \zeta = \frac{h}{2k},

    with one mass, and k and h cubic splines in the logarithm of the amplitude, with knots
    where points are. All levels are fitted at once, by least squares of errors in proportion
    to F/U. The mass shows where two frequencies have one amplitude, on both sides of a
    resonance or at different levels. Whether the force was held makes no difference to any of
    this. A mode apart from others is assumed.

    Parameters
    ----------
    level : array_like
        Label of the level that each point belongs to; arrays broadcast against each other.
    frequency : array_like
        Hz.
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
        At the knots, in rising order, with standard deviations from the scatter about the fit.

    Raises
    ------
    InputError
        For arrays that do not broadcast or are not positive, a level that stays away from its
        resonance, too few points, points that do not tell the mass.
    """
    from scipy.interpolate import CubicSpline  # here, because it takes long to import

    points = stepped_sine(level, frequency, force, response, phase, quantity)
    points = points.of(np.abs(points.inphase) < _BESIDE * np.abs(points.quadrature))
    knots = _knots(points, np.unique(np.asarray(level)))
    unknowns = 2 * knots.size + 2
    if points.omega.size <= unknowns:
        raise InputError(
            f"{points.omega.size} points are near their resonance; expected more than {unknowns} "
            f"for {knots.size} amplitudes"
        )
    omega, size = points.omega, np.hypot(points.inphase, points.quadrature)
    splines = CubicSpline(np.log(knots), np.eye(knots.size))
    spanned = splines(np.log(points.displacement))
    middle = float(np.mean(omega))
    # Columns of one size: the mass times the mean frequency squared is about the stiffness.
    inertia = -((omega / middle) ** 2)
    found, spread = _least_squares(np.column_stack([spanned, inertia]), points.inphase, size)
    k, m = found[:-1], found[-1] / middle**2
    if m <= 0.0 or np.any(k <= 0.0):
        raise InputError(
            "the in-phase dynamic stiffness does not fall with frequency; phase must be that of "
            "the response ahead of the force, in rad"
        )
    if (unsure := np.sqrt(spread[-1, -1]) / found[-1]) > _UNKNOWN:
        raise InputError(
            f"the points tell the mode's mass to {100 * unsure:.0f} % only; expected sweeps on "
            "both sides of the resonance, or levels whose amplitudes overlap"
        )
    omega_r = np.sqrt(k / m)
    turned = omega / np.sqrt(spanned @ k / m) - 1.0
    h, lost = _least_squares(np.column_stack([spanned, turned]), points.quadrature, size)
    # d ln omega_r = (dk/k - dm/m)/2, knot by knot.
    share = np.column_stack([np.diag(1.0 / k), np.full(knots.size, -1.0 / found[-1])])
    relative = 0.5 * np.sqrt(np.einsum("ij,jk,ik->i", share, spread, share))
    zeta = 0.5 * h[:-1] / k
    zeta_std = 0.5 / k * np.sqrt(np.diag(lost)[:-1] + (h[:-1] / k) ** 2 * np.diag(spread)[:-1])
    return ModalCurves(
        knots * omega_r ** QUANTITIES[quantity],
        omega_r / (2.0 * np.pi),
        zeta,
        frequency_std=omega_r / (2.0 * np.pi) * relative,
        damping_std=zeta_std,
        quantity=quantity,
        unit=unit,
        name=name,
    )


def _knots(points: SteppedSine, labels: np.ndarray) -> np.ndarray:
    """Amplitudes of displacement to tell the mode at: as many as there are points to tell it by."""
    for label in labels:
        if not np.any(points.level == label):
            raise InputError(
                f"level {label:g} stays away from its resonance: its in-phase dynamic stiffness "
                f"is never below {_BESIDE:g} times that in quadrature; expected steps nearer to it"
            )
    amplitudes = np.sort(points.displacement)
    at = [0]
    for i, each in enumerate(amplitudes):
        if each > _APART * amplitudes[at[-1]] and i >= at[-1] + _BETWEEN:
            at.append(i)
    if amplitudes[-1] < _APART * amplitudes[at[-1]] and len(at) > 1:
        at.pop()
    if amplitudes[-1] < (1.0 + _SAME) * amplitudes[at[-1]]:
        raise InputError(
            f"all amplitudes are within {100 * _SAME:g} % of {amplitudes[0]:g}; at one amplitude "
            "use resonance_from_control"
        )
    return amplitudes[[*at, -1]]


def _least_squares(
    columns: np.ndarray, right: np.ndarray, size: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients and their covariance, errors being in proportion to the size."""
    A, b = columns / size[:, None], right / size
    found, *_ = np.linalg.lstsq(A, b, rcond=None)
    variance = np.sum((b - A @ found) ** 2) / (b.size - found.size)
    return found, variance * np.linalg.inv(A.T @ A)
