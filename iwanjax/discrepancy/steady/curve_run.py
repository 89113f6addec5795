"""A model against the curves of one mode, and of several."""

import math
from collections.abc import Mapping, Sequence
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

    @classmethod
    def of(
        cls, measured: tuple[ModalCurves, ...], predicted: tuple[ModalCurves, ...], fitted: int
    ) -> "CurveRun":
        """With the scales of the curves that were fitted."""
        f, zeta = (
            np.concatenate([np.asarray(getattr(each, name)) for each in measured[:fitted]])
            for name in ("frequency", "damping")
        )
        rest = float(f.max())
        scales = (float(np.sqrt(np.mean((f - rest) ** 2))), float(np.sqrt(np.mean(zeta**2))))
        return cls(measured, predicted, fitted, rest, scales)

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


@dataclass(frozen=True, eq=False)
class ModesRun:
    """A structure against the curves of its modes.

    Attributes
    ----------
    modes : tuple of CurveRun
        One for each mode.
    labels : tuple of str
        What each is called.
    """

    modes: tuple[CurveRun, ...]
    labels: tuple[str, ...]

    @property
    def fitted(self) -> int:
        """Curves that were fitted: in all mappings they come first."""
        return sum(run.fitted for run in self.modes)

    def by_recording(self) -> Mapping[str, float]:
        """Errors as of :meth:`CurveRun.by_recording`, by mode and curve."""
        return self._ordered([run.by_recording() for run in self.modes])

    def floors(self) -> Mapping[str, float]:
        """The same for a perfect model."""
        return self._ordered([run.floors() for run in self.modes])

    def floors_95(self) -> Mapping[str, float]:
        """The same, as of :meth:`CurveRun.floors_95`."""
        return self._ordered([run.floors_95() for run in self.modes])

    def _ordered(self, told: Sequence[Mapping[str, float]]) -> Mapping[str, float]:
        rows = [
            (i >= run.fitted, f"{label}: {name}", value)
            for label, run, each in zip(self.labels, self.modes, told, strict=True)
            for i, (name, value) in enumerate(each.items())
        ]
        return {name: value for _, name, value in sorted(rows, key=lambda row: row[0])}
