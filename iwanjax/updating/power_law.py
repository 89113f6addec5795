"""Free power laws through measured curves, to see whether both want the same exponent."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.results import AbstractResult, with_std
from iwanjax.tables import Block, Grid
from iwanjax.updating.problem import Measured

# Exponents are looked for between these.
_RANGE = (0.05, 5.0)
# within which an exponent that may be any has this deviation,
_WHOLE = (_RANGE[1] - _RANGE[0]) / math.sqrt(12.0)
# on this many points, then on as many between the best one's neighbours, and once more.
_GRID, _ZOOMS = 200, 4
# Share of the range, and of the data's own, below which there is nothing to tell.
_AT_END, _NO_TREND = 1e-3, 1e-6
# Deviations apart from which two exponents differ.
_CLEAR = 3.0


@dataclass(frozen=True)
class Exponents(AbstractResult):
    r"""Exponents of :math:`f_0 - aA^p` and :math:`\zeta_0 + bA^r`, each fitted on its own.

    One Iwan joint in microslip, Coulomb friction in its sliders, has
    :math:`p = r = \chi + 1`.

    Attributes
    ----------
    frequency, damping : (float, float)
        p and r with standard deviations, which include the misfit.
    c_1, zeta_0 : (float, float)
        Coefficient and background of the damping's law
        :math:`\zeta = c_1 Q^{\chi+1} + \zeta_0` (3.32), with standard deviations; c_1 in
        amplitude\ :sup:`-(chi+1)` of the curves' own quantity. It goes with chi: its deviation
        is that of its logarithm times its value.
    frequency_rms, damping_rms : float
        Root mean square of what is left, Hz and 1.
    """

    frequency: tuple[float, float]
    damping: tuple[float, float]
    c_1: tuple[float, float]
    zeta_0: tuple[float, float]
    frequency_rms: float
    damping_rms: float

    @property
    def chi(self) -> tuple[float, float]:
        """The damping's exponent less one with its standard deviation: chi of (3.32)."""
        return self.damping[0] - 1.0, self.damping[1]

    @property
    def apart(self) -> float:
        """Difference r - p over its deviation."""
        return (self.damping[0] - self.frequency[0]) / math.hypot(
            self.frequency[1], self.damping[1]
        )

    def _blocks(self) -> tuple[Block, ...]:
        told = {
            "p": (self.frequency, "exponent of the frequency's fall"),
            "r": (self.damping, "exponent of the damping's rise"),
            "chi": (self.chi, "r - 1"),
            "c_1": (self.c_1, "coefficient of the damping"),
            "zeta_0": (self.zeta_0, "damping at vanishing amplitude"),
        }
        rows = tuple((name, with_std(*value), meaning) for name, (value, meaning) in told.items())
        left = f"left over: {self.frequency_rms:.2g} Hz and {self.damping_rms:.2g} rms"
        return "f = f_0 - a A^p, zeta = zeta_0 + c_1 A^r", Grid((), rows), left

    def law(self) -> str:
        """The damping's law (3.32) in a sentence."""
        told = ", ".join(
            f"{name} = {value:.3g} ± {std:.2g}"
            for name, (value, std) in (
                ("c_1", self.c_1),
                ("chi", self.chi),
                ("zeta_0", self.zeta_0),
            )
        )
        return f"As a power law the damping is c_1 Q^(chi+1) + zeta_0 with {told}"

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


class _PowerLaw(NamedTuple):
    """A power law y_0 + sign a s^n through a curve: pairs are values and deviations."""

    exponent: tuple[float, float]
    coefficient: tuple[float, float]
    constant: tuple[float, float]
    rms: float


def free_exponents(curves: ModalCurves | Sequence[ModalCurves]) -> Exponents:
    """Fit a power law to frequency and one to damping, independently.

    The damping's is the thesis's (3.32), by least squares weighted with the curves'
    deviations; what is stated of its numbers includes the misfit.

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
    f = _power_law(
        amplitude, np.asarray(measured.frequency), np.asarray(measured.frequency_std), -1.0
    )
    zeta = _power_law(
        amplitude, np.asarray(measured.damping), np.asarray(measured.damping_std), 1.0
    )
    return Exponents(
        frequency=f.exponent,
        damping=zeta.exponent,
        c_1=zeta.coefficient,
        zeta_0=zeta.constant,
        frequency_rms=f.rms,
        damping_rms=zeta.rms,
    )


def _power_law(amplitude: np.ndarray, y: np.ndarray, std: np.ndarray, sign: float) -> _PowerLaw:
    """The law y = y_0 + sign a s^n over amplitudes, a not negative, that fits best.

    For a given n the law is linear in y_0 and a, so n alone has to be looked for.
    """
    largest = float(amplitude.max())
    s = amplitude / largest
    low, high = _RANGE
    n, best = np.empty(0), 0
    for _ in range(_ZOOMS):
        n = np.linspace(low, high, _GRID)
        best = int(np.argmin(_lines(s, n, y, std, sign).cost))
        low, high = n[max(best - 1, 0)], n[min(best + 1, _GRID - 1)]
    found = float(n[best])
    line = _lines(s, np.array([found]), y, std, sign)
    a, constant = float(line.a[0]), float(line.constant[0])
    variance = float(line.cost[0]) / (s.size - 3)
    at_end = min(found - _RANGE[0], _RANGE[1] - found) < _AT_END * (_RANGE[1] - _RANGE[0])
    known = not at_end and a > _NO_TREND * np.ptp(y)
    exponent_std = log_std = constant_std = math.inf
    if known:
        # In y_0, ln a and n; ln c = ln a - n ln(largest amplitude).
        raised = a * s**found
        slopes = np.stack([np.ones(s.size), raised, raised * np.log(s)], axis=1) / std[:, None]
        root = np.linalg.inv(np.linalg.qr(slopes).R) * math.sqrt(variance)
        constant_std, _, exponent_std = (float(x) for x in np.linalg.norm(root, axis=1))
        log_std = float(np.linalg.norm(root[1] - math.log(largest) * root[2]))
    if exponent_std > _WHOLE:
        exponent_std, constant_std = _WHOLE, _over_exponents(s, y, std, sign, line, variance)
    coefficient = a / largest**found
    return _PowerLaw(
        (found, exponent_std),
        (coefficient, coefficient * log_std if known else math.inf),
        (constant, constant_std),
        float(np.sqrt(np.mean(line.residual**2))),
    )


class _LinearFits(NamedTuple):
    """For each exponent the best y_0 and a, their variances for unit misfit, what is left."""

    constant: np.ndarray
    a: np.ndarray
    constant_variance: np.ndarray
    residual: np.ndarray
    cost: np.ndarray


def _lines(
    s: np.ndarray, n: np.ndarray, y: np.ndarray, std: np.ndarray, sign: float
) -> _LinearFits:
    """Weighted lines y = y_0 + sign a s^n for every n, a not negative."""
    total = np.sum(std**-2.0)
    weight = std**-2.0 / total
    x = s ** n[:, None]
    x_mean, y_mean = x @ weight, y @ weight
    off = x - x_mean[:, None]
    spread = off**2 @ weight
    a = np.maximum(sign * (off * (y - y_mean)) @ weight / spread, 0.0)
    constant = y_mean - sign * a * x_mean
    residual = y - constant[:, None] - sign * a[:, None] * x
    return _LinearFits(
        constant,
        a,
        (1.0 + x_mean**2 / spread) / total,
        residual,
        np.sum((residual / std) ** 2, axis=1),
    )


def _over_exponents(
    s: np.ndarray, y: np.ndarray, std: np.ndarray, sign: float, best: _LinearFits, variance: float
) -> float:
    """Deviation of y_0 where the exponent may be any: over all of them by their odds."""
    each = _lines(s, np.linspace(*_RANGE, _GRID), y, std, sign)
    odds = np.exp(-0.5 * (each.cost - best.cost[0]) / variance)
    spread = each.constant_variance * variance + (each.constant - best.constant[0]) ** 2
    return float(np.sqrt(odds @ spread / np.sum(odds)))
