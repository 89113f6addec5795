"""Independent routes to a joint's force and loss, in NumPy and SciPy only.

Adaptive quadrature of the thesis's Eq. (4.1) over the slider distribution, and a bank of
discrete sliders driven along a history. Nothing here is shared with the package.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.integrate


@dataclass(frozen=True)
class Distribution:
    """rho(phi) = R phi^chi on (0, phi_max), and S at phi_max; theta scales kinetic friction."""

    R: float
    S: float
    chi: float
    phi_max: float
    theta: float = 1.0

    def integral(self, slider: Callable[[float], float], *breaks: float) -> float:
        """Sum of slider(phi) over the distribution, with kinks at ``breaks``."""
        n = self.chi + 1.0
        # With t = phi^n the singularity at zero is gone: R phi^chi dphi = R dt / n.
        inner = sorted({b**n for b in breaks if 0.0 < b < self.phi_max})
        edges = [0.0, *inner, self.phi_max**n]
        total = 0.0
        for a, b in itertools.pairwise(edges):
            size = (b - a) * max(abs(slider(t ** (1.0 / n))) for t in (a, 0.5 * (a + b), b))
            total += scipy.integrate.quad(
                lambda t: slider(t ** (1.0 / n)), a, b, epsabs=1e-12 * size, epsrel=1e-12, limit=200
            )[0]
        return self.R / n * total + self.S * slider(self.phi_max)

    def virgin(self, d: float) -> float:
        """Force on first loading to d > 0."""
        return self.integral(lambda phi: self.theta * phi if phi <= d else d, d)

    def loading(self, d: float, d_0: float) -> float:
        """Force at d on the way up from -d_0 after ring-up to d_0."""
        theta, travel = self.theta, d + d_0

        def slider(phi: float) -> float:
            if phi > d_0:
                return d
            return theta * phi if travel >= (1 + theta) * phi else travel - theta * phi

        return self.integral(slider, d_0, travel / (1 + theta))

    def secant(self, d: float, d_max: float) -> float:
        """Secant stiffness of a steady cycle of amplitude d after the amplitude d_max."""
        theta = self.theta

        def rise(phi: float) -> float:
            return 2 * theta * phi if self._slips(phi, d, d_max) else 2 * d

        return self.integral(rise, d_max, 2 * d / (1 + theta)) / (2 * d)

    def dissipation(self, d: float, d_max: float) -> float:
        """Area of that cycle: each slider that slips draws its own parallelogram."""
        theta = self.theta

        def area(phi: float) -> float:
            if not self._slips(phi, d, d_max):
                return 0.0
            return (1 + theta) * (1 - 3 * theta) * phi**2 + 4 * theta * phi * d

        return self.integral(area, d_max, 2 * d / (1 + theta))

    def _slips(self, phi: float, d: float, d_max: float) -> bool:
        return phi <= d_max and (1 + self.theta) * phi <= 2 * d


def drive_sliders(phi: np.ndarray, k: np.ndarray, theta: float, history: np.ndarray) -> np.ndarray:
    """Force of Jenkins elements along a history; a signed flag for each slider in kinetic slip."""
    stretch, flag = np.zeros_like(phi), np.zeros_like(phi)
    force, u = [], 0.0
    for target in history:
        du, u = target - u, target
        if du != 0:
            way = np.sign(du)
            flag = np.where(flag == way, flag, 0.0)
            stretch = stretch + du
            slips = way * stretch >= np.where(flag == way, theta * phi, phi)
            stretch = np.where(slips, way * theta * phi, stretch)
            flag = np.where(slips, way, flag)
        force.append(np.sum(k * stretch))
    return np.array(force)


def bank(distribution: Distribution, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Thresholds and stiffnesses of ``count`` uniform intervals and the Dirac slider."""
    edges = np.linspace(0.0, distribution.phi_max, count + 1)
    n = distribution.chi + 1.0
    k = distribution.R / n * np.diff(edges**n)
    phi = 0.5 * (edges[1:] + edges[:-1])
    return np.append(phi, distribution.phi_max), np.append(k, distribution.S)
