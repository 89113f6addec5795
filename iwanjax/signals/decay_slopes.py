"""What all estimators of a free decay end with: amplitude and slopes at times, and their curves."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.signals.decay import Noise

# Multiple of the correction to the acceleration's envelope that is taken as its deviation: it is
# known to a tenth.
_DOUBT_OF_CONVENTION = 0.1


class Decay(NamedTuple):
    """The settled part of a free decay as an estimator takes it.

    Attributes
    ----------
    z : (N,) array
        Analytic signal of the band-passed record from the decay's start on.
    sampling_rate : float
        Hz.
    edges : (intervals + 1,) array
        Samples between which points are wanted.
    noise : Noise
        Along the decay.
    band : (float, float)
        Hz.
    """

    z: np.ndarray
    sampling_rate: float
    edges: np.ndarray
    noise: Noise
    band: tuple[float, float]

    @property
    def logarithm(self) -> tuple[np.ndarray, np.ndarray]:
        """psi_1 and psi_2 of (2.17) and (2.18), (N,) each."""
        return np.log(np.abs(self.z)), np.unwrap(np.angle(self.z))

    @property
    def middles(self) -> np.ndarray:
        """Midpoints of the intervals, s, (intervals,)."""
        return 0.5 * (self.edges[1:] + self.edges[:-1] - 1) / self.sampling_rate


@dataclass(frozen=True)
class DecaySlopes:
    """Logarithm of the amplitude and slopes of envelope and phase at times, with variances.

    Attributes
    ----------
    time : (points,) array
        s.
    height, height_variance : (points,) array
        psi_1.
    rate, rate_variance : (points,) array
        Its slope, 1/s; negative in a decay.
    omega, omega_variance : (points,) array
        Slope of psi_2, rad/s.
    omega_slope : (points,) array
        rad/s^2.
    """

    time: np.ndarray
    height: np.ndarray
    height_variance: np.ndarray
    rate: np.ndarray
    rate_variance: np.ndarray
    omega: np.ndarray
    omega_variance: np.ndarray
    omega_slope: np.ndarray

    def before_the_filter(self, passed: np.ndarray) -> "DecaySlopes":
        """As it was before a gain, exp(passed), that moves with frequency.

        Beside another mode the band's corner may be near: a third of the amplitude is lost there.
        """
        return replace(
            self, height=self.height - passed, rate=self.rate - np.gradient(passed, self.time)
        )

    def curves(self, derivatives: int, largest: float, labels: Mapping[str, str]) -> ModalCurves:
        """Frequency and damping, that of the acceleration's envelope (:func:`.hilbert.ringdown`).

        Parameters
        ----------
        derivatives : int
            Of the displacement that was measured.
        largest : float
            Amplitude of the record.
        labels : mapping of str to str
            Of the curves.
        """
        amplitude = np.exp(self.height)
        convention = (2 - derivatives) * self.omega_slope / self.omega
        rate_std = np.sqrt(self.rate_variance + (_DOUBT_OF_CONVENTION * convention) ** 2)
        rate = self.rate + convention
        natural = np.hypot(self.omega, rate)
        return ModalCurves(
            amplitude,
            natural / (2.0 * math.pi),
            -rate / natural,
            amplitude_std=amplitude * np.sqrt(self.height_variance),
            frequency_std=np.sqrt(self.omega_variance) / (2.0 * math.pi),
            damping_std=rate_std / natural,
            largest=max(largest, float(np.max(amplitude))),
            **labels,
        )
