"""By mode and amplitude: how frequency and damping differ between recordings and the model."""

from collections.abc import Mapping, Sequence

import numpy as np

from iwanjax.curves import ModalCurves
from iwanjax.discrepancy.findings import Observable
from iwanjax.discrepancy.histories.validation import FreeRun
from iwanjax.errors import InputError
from iwanjax.identification.problem import HistoryProblem
from iwanjax.settings.histories import IllustrationSettings
from iwanjax.settings.stages import settings
from iwanjax.signals import ringdown_curves


def observables(
    problem: HistoryProblem, run: FreeRun, sampling_rate: float, released: Mapping[str, int]
) -> tuple[Observable, ...]:
    """Clear differences of a free run, the largest first.

    Recordings whose decays are too short or too close to the noise say nothing, nor do those
    that a force drives to their end.

    Parameters
    ----------
    problem : HistoryProblem
        That the model was fitted with.
    run : FreeRun
        Of the model, against all recordings.
    sampling_rate : float
        Hz.
    released : mapping of str to int
        By recording, the sample from which on no force acts any more.
    """
    predictor, known = problem.predictor, problem.settings.illustration
    frequency = np.sqrt(np.maximum(np.asarray(predictor.omega2), 0.0)) / (2.0 * np.pi)
    shapes = np.abs(np.asarray(predictor.sensors))
    elastic = [i for i, f in enumerate(frequency) if f > 0]
    found: list[Observable] = []
    for i, name in enumerate(run.names):
        free = slice(released[name], None)
        measured = run.measured[i][free]
        predicted = measured - run.error[i][free]
        for number, mode in enumerate(elastic):
            band = _band(frequency[elastic], number, known)
            if band[1] > known.highest * sampling_rate:
                break
            channel = int(np.argmax(shapes[:, mode] * np.any(measured != 0, axis=0)))
            quiet = np.all(measured == 0, axis=1)
            both = [
                _curves(x[~quiet, channel], sampling_rate, band, predictor.quantity)
                for x in (measured, predicted)
            ]
            if both[0] is not None and both[1] is not None:
                called = f"mode {number} ({frequency[mode]:.4g} Hz)"
                found += _differences(name, number, called, both[0], both[1], known.levels)
    return tuple(sorted(found, key=lambda each: -abs(each.difference_percent)))


def _band(frequency: np.ndarray, number: int, known: IllustrationSettings) -> tuple[float, float]:
    """About one mode, short of its neighbours."""
    f = frequency[number]
    gaps = [abs(other - f) for i, other in enumerate(frequency) if i != number]
    half = min([known.band * f, *(known.band_share * gap for gap in gaps)])
    return float(f - half), float(f + half)


def _curves(
    signal: np.ndarray, rate: float, band: tuple[float, float], quantity: str
) -> ModalCurves | None:
    try:
        return ringdown_curves(signal, rate, band, quantity=quantity)
    except InputError:
        return None


def _differences(
    name: str, mode: int, called: str, measured: ModalCurves, predicted: ModalCurves, count: int
) -> Sequence[Observable]:
    a, b = (np.asarray(x.amplitude) for x in (measured, predicted))
    low, high = max(a.min(), b.min()), min(a.max(), b.max())
    if not low < high:
        return []
    levels = np.geomspace(low, high, count)
    found = []
    for quantity in ("frequency", "damping"):
        values, stds = [], []
        for x, curves in ((a, measured), (b, predicted)):
            order = np.argsort(x)
            value = np.asarray(getattr(curves, quantity))[order]
            std = getattr(curves, f"{quantity}_std")
            values.append(np.interp(levels, x[order], value))
            spread = np.zeros_like(value) if std is None else np.asarray(std)[order]
            stds.append(np.interp(levels, x[order], spread))
        off = values[1] - values[0]
        if np.median(np.abs(off) / np.hypot(*stds).clip(1e-300)) > settings().judgement.clear:
            percent = 100.0 * float(np.median(off / values[0]))
            span = (float(low), float(high))
            found.append(Observable(name, mode, quantity, span, percent, called))
    return found
