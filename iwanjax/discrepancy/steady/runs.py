"""Models against what was measured: curves of a mode or of several, loops of a joint."""

import abc
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.discrepancy.findings import Observable
from iwanjax.settings.stages import settings
from iwanjax.signals.force_loop import ForceLoop

T = TypeVar("T")


class AbstractRun(abc.ABC):
    """A model against several recordings, those that were fitted first."""

    @property
    @abc.abstractmethod
    def names(self) -> tuple[str, ...]:
        """Of the recordings."""

    @abc.abstractmethod
    def _errors(self) -> Sequence[float]:
        """Of the model, in the order of the names."""

    @abc.abstractmethod
    def _expected(self) -> Sequence[float]:
        """The same of a perfect model."""

    def by_recording(self) -> Mapping[str, float]:
        """Errors as shares of what was measured."""
        return dict(zip(self.names, self._errors(), strict=True))

    def floors(self) -> Mapping[str, float]:
        """The same of a perfect model: standard deviations."""
        return dict(zip(self.names, self._expected(), strict=True))

    def floors_95(self) -> Mapping[str, float]:
        """The same: over the values of a curve or a loop noise differs little from its mean."""
        return self.floors()


@dataclass(frozen=True, eq=False)
class CurveRun(AbstractRun):
    """A model against the curves of one mode; errors take frequency and damping together.

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
        curves that were fitted: errors are shares of them.
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

    def _errors(self) -> Sequence[float]:
        return [
            self._share(
                np.asarray(model.frequency) - np.asarray(seen.frequency),
                np.asarray(model.damping) - np.asarray(seen.damping),
            )
            for model, seen in zip(self.predicted, self.measured, strict=True)
        ]

    def _expected(self) -> Sequence[float]:
        return [self._deviation(seen) for seen in self.measured]

    def deviations(self) -> Mapping[str, float]:
        """The deviations that the predicted curves have, by recording."""
        return dict(zip(self.names, map(self._deviation, self.predicted), strict=True))

    def _deviation(self, curves: ModalCurves) -> float:
        return self._share(np.asarray(curves.frequency_std), np.asarray(curves.damping_std))

    def _share(self, f: np.ndarray, zeta: np.ndarray) -> float:
        return _rms(np.stack([f / self.scales[0], zeta / self.scales[1]]))


@dataclass(frozen=True, eq=False)
class ModesRun(AbstractRun):
    """A structure against the curves of its modes; errors as of :class:`CurveRun`.

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

    @property
    def names(self) -> tuple[str, ...]:
        """Mode and curve."""
        each = zip(self.labels, self.modes, strict=True)
        named = [[f"{label}: {name}" for name in run.names] for label, run in each]
        return tuple(self._fitted_first(named))

    def _errors(self) -> Sequence[float]:
        return self._fitted_first([run._errors() for run in self.modes])

    def _expected(self) -> Sequence[float]:
        return self._fitted_first([run._expected() for run in self.modes])

    def _fitted_first(self, by_mode: Iterable[Sequence[T]]) -> list[T]:
        parts = list(zip(self.modes, by_mode, strict=True))
        fitted = [value for run, values in parts for value in values[: run.fitted]]
        return fitted + [value for run, values in parts for value in values[run.fitted :]]


@dataclass(frozen=True, eq=False)
class LoopRun(AbstractRun):
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

    def _errors(self) -> Sequence[float]:
        return [
            _rms(model - loop.force) / _rms(loop.force)
            for model, loop in zip(self.predicted, self.measured, strict=True)
        ]

    def _expected(self) -> Sequence[float]:
        return [
            noise / _rms(loop.force) for noise, loop in zip(self.noise, self.measured, strict=True)
        ]


def _rms(x: np.ndarray) -> float:
    return math.sqrt(float(np.mean(x**2)))


def clear_differences(run: CurveRun, mode: int, called: str) -> tuple[Observable, ...]:
    """Where a model is clearly off the curves of a mode, the largest difference first."""
    found = []
    for name, model, seen in zip(run.names, run.predicted, run.measured, strict=True):
        x = np.asarray(seen.amplitude)
        for quantity in ("frequency", "damping"):
            y, std = (np.asarray(getattr(seen, quantity + end)) for end in ("", "_std"))
            off = np.asarray(getattr(model, quantity)) - y
            clear = np.abs(off) > settings().judgement.clear * std
            if clear.mean() > settings().steady.clear_share:
                span = (float(x[clear].min()), float(x[clear].max()))
                percent = 100.0 * float(np.median(off[clear] / y[clear]))
                found.append(Observable(name, mode, quantity, span, percent, called))
    return tuple(sorted(found, key=lambda each: -abs(each.difference_percent)))
