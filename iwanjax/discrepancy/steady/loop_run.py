"""A model against loops of a joint on its own."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from iwanjax.signals.force_loop import ForceLoop


@dataclass(frozen=True, eq=False)
class LoopRun:
    """A model against loops of a joint on its own.

    Attributes
    ----------
    measured : tuple of ForceLoop
        Those that were fitted come first.
    predicted : tuple of (N,) array
        Forces at the same deflections, each with the offset that suits the loop best.
    fitted : int
        How many were fitted.
    noise : tuple of float
        Standard deviation of each loop's force.
    """

    measured: tuple[ForceLoop, ...]
    predicted: tuple[np.ndarray, ...]
    fitted: int
    noise: tuple[float, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the loops."""
        return tuple(each.name or f"loop {i}" for i, each in enumerate(self.measured))

    def by_recording(self) -> Mapping[str, float]:
        """Root mean square of predicted less measured over that of the measured force."""
        errors = [
            _rms(model - loop.force) / _rms(loop.force)
            for model, loop in zip(self.predicted, self.measured, strict=True)
        ]
        return dict(zip(self.names, errors, strict=True))

    def floors(self) -> Mapping[str, float]:
        """The same of a perfect model."""
        floors = [
            noise / _rms(loop.force) for noise, loop in zip(self.noise, self.measured, strict=True)
        ]
        return dict(zip(self.names, floors, strict=True))

    def floors_95(self) -> Mapping[str, float]:
        """The same: over the values of a loop noise differs little from its mean."""
        return self.floors()


def _rms(x: np.ndarray) -> float:
    return math.sqrt(float(np.mean(x**2)))
