"""Held-out curves that differ from fitted ones at equal amplitude."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.discrepancy.steady.runs import CurveRun
from iwanjax.settings.stages import settings


class Disagreement(NamedTuple):
    """A held-out curve where it overlaps with those that were fitted.

    Attributes
    ----------
    recording : str
        Its name.
    amplitude : (float, float)
        Where it overlaps, in ``unit``.
    unit : str
        Of the amplitude.
    frequency : float
        Measured less what explains the fitted curves, mean, Hz.
    damping : float
        The same over the measured damping.
    """

    recording: str
    amplitude: tuple[float, float]
    unit: str
    frequency: float
    damping: float

    def __str__(self) -> str:
        """In a sentence."""
        low, high = self.amplitude
        return (
            f"{self.recording} was measured on another state of the mode than the fitted "
            f"recordings: at amplitudes that these cover ({low:.3g} to {high:.3g} {self.unit}) its "
            f"frequency is {abs(self.frequency):.2g} Hz {_side(self.frequency)} and its damping "
            f"{abs(100.0 * self.damping):.2g} % {_side(self.damping)} what explains them. No "
            "law of amplitude does both, and this difference is held against none; a "
            "shaker's added mass, other modes that move at the same time, or bolts tightened anew "
            "do it"
        )


def disagreements(run: CurveRun, deviations: Sequence[ModalCurves]) -> dict[int, Disagreement]:
    """Held-out curves that differ where a model explains those that were fitted, by their number.

    Parameters
    ----------
    run : CurveRun
        A model that leaves no more than deviations of the fitted curves.
    deviations : sequence of ModalCurves
        At the levels of all curves, deviations of the measured and of the model together.
    """
    known = settings().judgement
    fitted, floors = list(run.by_recording().values()), list(run.floors().values())
    first = slice(run.fitted)
    if np.linalg.norm(fitted[first]) > known.unexplained * np.linalg.norm(floors[first]):
        return {}
    covered = np.concatenate([np.asarray(each.amplitude) for each in run.measured[first]])
    # What the fitted levels themselves are known to, which the model cannot be better than.
    shares = [_stds(seen) / _units(seen) for seen in run.measured[first]]
    own = np.median(np.concatenate(shares, axis=1), axis=1)
    found = {}
    for i in range(run.fitted, len(run.measured)):
        seen, model, std = run.measured[i], run.predicted[i], deviations[i]
        x = np.asarray(seen.amplitude)
        inside = (x >= covered.min()) & (x <= covered.max())
        if not inside.any():
            continue
        off = ((_values(seen) - _values(model)) / _units(seen))[:, inside]
        by = (_stds(std) / _units(seen))[:, inside]
        mean = off.mean(axis=1)
        # An offset is common to all levels: it does not average out, and its deviation neither.
        sure = np.hypot(np.sqrt(np.mean(by**2, axis=1)), own)
        if np.any(np.abs(mean) > known.clear * sure):
            span = (float(x[inside].min()), float(x[inside].max()))
            found[i] = Disagreement(
                run.names[i], span, seen.unit or run.measured[0].unit, *map(float, mean)
            )
    return found


def offset_by(curves: ModalCurves, known: Disagreement) -> ModalCurves:
    """A curve whose deviations hold what it differs from the others by."""
    offset = np.array([[known.frequency], [known.damping]]) * _units(curves)
    return _deviating(curves, np.hypot(_stds(curves), offset))


def deviating_by_both(one: ModalCurves, other: ModalCurves) -> ModalCurves:
    """A curve with the deviations of both."""
    return _deviating(one, np.hypot(_stds(one), _stds(other)))


def _values(curves: ModalCurves) -> np.ndarray:
    """Frequency and damping, (2, levels)."""
    return np.stack([np.asarray(curves.frequency), np.asarray(curves.damping)])


def _units(curves: ModalCurves) -> np.ndarray:
    """What they are compared in: Hz, and shares of the damping."""
    return np.stack([np.ones(curves.damping.shape), np.asarray(curves.damping)])


def _stds(curves: ModalCurves) -> np.ndarray:
    """Their deviations."""
    assert curves.frequency_std is not None
    assert curves.damping_std is not None
    return np.stack([np.asarray(curves.frequency_std), np.asarray(curves.damping_std)])


def _deviating(curves: ModalCurves, both: np.ndarray) -> ModalCurves:
    return eqx.tree_at(lambda c: (c.frequency_std, c.damping_std), curves, tuple(both))


def _side(off: float) -> str:
    return "above" if off > 0.0 else "below"
