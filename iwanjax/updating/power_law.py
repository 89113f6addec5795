"""Free power laws through measured curves, to see whether both want the same exponent."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.updating.problem import Measured

# Exponents are looked for between these.
_RANGE = (0.05, 5.0)
_STARTS = (0.3, 0.6, 1.0, 1.5, 2.0)
# Share of the range, and of the data's own, below which there is nothing to tell.
_AT_END, _NO_TREND = 1e-3, 1e-6
# Deviations apart from which two exponents differ.
_CLEAR = 3.0


@dataclass(frozen=True)
class Exponents:
    r"""Exponents of :math:`f_0 - aA^p` and :math:`\zeta_0 + bA^r`, each fitted on its own.

    One Iwan joint in microslip, Coulomb friction in its sliders, has
    :math:`p = r = \chi + 1`.

    Attributes
    ----------
    frequency, damping : (float, float)
        p and r with standard deviations, which include the misfit.
    frequency_rms, damping_rms : float
        Root mean square of what is left, Hz and 1.
    """

    frequency: tuple[float, float]
    damping: tuple[float, float]
    frequency_rms: float
    damping_rms: float

    @property
    def apart(self) -> float:
        """Difference r - p over its deviation."""
        return (self.damping[0] - self.frequency[0]) / math.hypot(
            self.frequency[1], self.damping[1]
        )

    def statement(self) -> str:
        """The comparison in a sentence."""
        (p, p_std), (r, r_std) = self.frequency, self.damping
        numbers = (
            f"Free power laws have exponents {p:.3f} ± {p_std:.1g} (frequency) and {r:.3f} ± "
            f"{r_std:.1g} (damping)"
        )
        if abs(self.apart) < _CLEAR:
            return f"{numbers}: equal within their deviations, as one Iwan joint in microslip wants"
        return (
            f"{numbers}, {abs(self.apart):.0f} deviations apart; one Iwan joint in microslip wants "
            "them equal, so it has to compromise between the two curves"
        )


def free_exponents(curves: ModalCurves | Sequence[ModalCurves]) -> Exponents:
    """Fit a power law to frequency and one to damping, independently.

    Parameters
    ----------
    curves : ModalCurves or sequence of them
        Of one mode, with deviations.

    Returns
    -------
    Exponents

    Raises
    ------
    InputError
        For curves without deviations, of different quantities, or too few levels.
    """
    several = [curves] if isinstance(curves, ModalCurves) else list(curves)
    measured = Measured.of(several)
    amplitude = np.concatenate([np.asarray(each.amplitude) for each in several])
    if len({each.quantity for each in several}) > 1:
        raise InputError("free_exponents: the curves are against different quantities")
    if amplitude.size < 5:
        raise InputError(f"free_exponents: {amplitude.size} levels; expected at least 5")
    s = amplitude / amplitude.max()
    p, p_std, f_rms = _exponent(
        s, np.asarray(measured.frequency), np.asarray(measured.frequency_std), -1.0
    )
    r, r_std, z_rms = _exponent(
        s, np.asarray(measured.damping), np.asarray(measured.damping_std), 1.0
    )
    return Exponents((p, p_std), (r, r_std), f_rms, z_rms)


def _exponent(
    s: np.ndarray, y: np.ndarray, std: np.ndarray, sign: float
) -> tuple[float, float, float]:
    """Exponent, its deviation and the remainder of y = y_0 + sign a s^n."""
    from scipy.optimize import OptimizeWarning, curve_fit  # here: a second to import

    def law(x: np.ndarray, y_0: float, a: float, n: float) -> np.ndarray:
        return y_0 + sign * a * x**n

    best: tuple[float, float, float, float] | None = None
    for n in _STARTS:
        start = (y[np.argmin(s)], max(np.ptp(y), 1e-12), n)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", OptimizeWarning)
                found, covariance = curve_fit(
                    law,
                    s,
                    y,
                    p0=start,
                    sigma=std,
                    bounds=([-np.inf, 0.0, _RANGE[0]], [np.inf, np.inf, _RANGE[1]]),
                    x_scale=(max(abs(start[0]), 1e-12), start[1], 1.0),
                )
        except (RuntimeError, OptimizeWarning):
            continue
        residual = y - law(s, *found)
        cost = float(np.sum((residual / std) ** 2))
        if best is None or cost < best[0]:
            rms = float(np.sqrt(np.mean(residual**2)))
            best = (cost, float(found[2]), _deviation(found, covariance, start[1]), rms)
    if best is None:
        raise InputError("free_exponents: no power law fits the curves")
    return best[1:]


def _deviation(found: np.ndarray, covariance: np.ndarray, scale: float) -> float:
    """Of the exponent: where nothing rises or falls, or at an end, that of the whole range."""
    low, high = _RANGE
    whole = (high - low) / math.sqrt(12.0)
    at_end = min(found[2] - low, high - found[2]) < _AT_END * (high - low)
    if at_end or found[1] < _NO_TREND * scale:
        return whole
    return min(whole, float(np.sqrt(covariance[2, 2])))
