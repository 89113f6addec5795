"""A model against the curves of one mode."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from iwanjax.curves import ModalCurves


@dataclass(frozen=True, eq=False)
class CurveRun:
    """A model against the curves of one mode.

    Attributes
    ----------
    measured, predicted : tuple of ModalCurves
        At the same amplitudes; those that were fitted come first.
    fitted : int
        How many these are.
    rest : float
        Highest measured frequency of those that were fitted, from which falls are counted, Hz.
    scales : (float, float)
        Root mean square of the frequency's fall from there, Hz, and of the damping, over the
        curves that were fitted: errors are told as shares of them.
    """

    measured: tuple[ModalCurves, ...]
    predicted: tuple[ModalCurves, ...]
    fitted: int
    rest: float
    scales: tuple[float, float]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the curves."""
        return tuple(each.name or f"curve {i}" for i, each in enumerate(self.measured))

    def by_recording(self) -> Mapping[str, float]:
        """Errors, frequency and damping together, as shares of what was measured."""
        errors = [
            self._share(
                np.asarray(model.frequency) - np.asarray(seen.frequency),
                np.asarray(model.damping) - np.asarray(seen.damping),
            )
            for model, seen in zip(self.predicted, self.measured, strict=True)
        ]
        return dict(zip(self.names, errors, strict=True))

    def floors(self) -> Mapping[str, float]:
        """The same for a perfect model: stated deviations."""
        floors = [
            self._share(np.asarray(seen.frequency_std), np.asarray(seen.damping_std))
            for seen in self.measured
        ]
        return dict(zip(self.names, floors, strict=True))

    def floors_95(self) -> Mapping[str, float]:
        """The same: over the points of a curve deviations differ little from their mean."""
        return self.floors()

    def _share(self, f: np.ndarray, zeta: np.ndarray) -> float:
        shares = np.stack([f / self.scales[0], zeta / self.scales[1]])
        return math.sqrt(float(np.mean(shares**2)))
