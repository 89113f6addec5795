"""Free power laws through measured curves, to see whether both want the same exponent."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.updating.problem import Measured

# Exponents are looked for between these.
_RANGE = (0.05, 5.0)
# on this many points, then on as many between the best one's neighbours, and once more.
_GRID, _ZOOMS = 200, 4
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
    """Exponent, its deviation and the remainder of y = y_0 + sign a s^n, with a not negative.

    For a given n the law is linear in y_0 and a, so n alone has to be looked for.
    """
    low, high = _RANGE
    n, best = np.empty(0), 0
    for _ in range(_ZOOMS):
        n = np.linspace(low, high, _GRID)
        best = int(np.argmin(np.sum((_line(s ** n[:, None], y, std, sign)[0] / std) ** 2, axis=1)))
        low, high = n[max(best - 1, 0)], n[min(best + 1, _GRID - 1)]
    found = float(n[best])
    residual, a = _line(s[None] ** found, y, std, sign)
    cost = float(np.sum((residual / std) ** 2))
    rms = float(np.sqrt(np.mean(residual**2)))
    return found, _deviation(s, std, found, float(a[0]), np.ptp(y), cost), rms


def _line(
    x: np.ndarray, y: np.ndarray, std: np.ndarray, sign: float
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals and a of y = y_0 + sign a x, weighted, for every row of x."""
    weight = std**-2.0 / np.sum(std**-2.0)
    x = x - (x @ weight)[:, None]
    y = y - y @ weight
    a = np.maximum(sign * (x * y) @ weight / (x**2 @ weight), 0.0)
    return y - sign * a[:, None] * x, a


def _deviation(
    s: np.ndarray, std: np.ndarray, n: float, a: float, scale: float, cost: float
) -> float:
    """Of the exponent: where nothing rises or falls, or at an end, that of the whole range."""
    low, high = _RANGE
    whole = (high - low) / math.sqrt(12.0)
    at_end = min(n - low, high - n) < _AT_END * (high - low)
    if at_end or a <= _NO_TREND * scale:
        return whole
    # What a change of n does that changes of y_0 and a cannot undo is the last row of R.
    slopes = np.stack([np.ones(s.size), s**n, a * s**n * np.log(s)], axis=1) / std[:, None]
    own = abs(float(np.linalg.qr(slopes).R[2, 2]))
    return min(whole, math.sqrt(cost / (s.size - 3)) / own)
