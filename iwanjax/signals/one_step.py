"""One-step-ahead errors of linear predictors: noise that no smooth spectrum shows."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from iwanjax.signals.noise import CHANCE, NoiseLevel

# Of the moments: the one that moves least, and the one that moves most.
_QUARTER = 0.25


class OneStepErrors(NamedTuple):
    """Errors of prediction from one sample to the next.

    Attributes
    ----------
    least : NoiseLevel
        While the sensor moves least; NaN where the record is too short.
    steady : (sensors,) array of bool
        Whether their squares have nothing to do with the size of the motion: what a linear model
        does not follow then does not come from the motion either.
    """

    least: NoiseLevel
    steady: np.ndarray


def one_step_errors(
    response: Float[np.ndarray, "N sensors"],
    force: Float[np.ndarray, "N inputs"] | None,
    spoilt: Bool[np.ndarray, "N sensors"],
    *,
    lags: int,
) -> OneStepErrors:
    r"""Errors of a linear predictor of each sensor, fitted to the quarter that moves least.

    .. math:: y_n = c + \sum_{l=1}^L a_l\, y_{n-l} + \sum_{l=0}^L b_l\, f_{n-l} + e_n

    whatever the structure's modes are, and whatever the noise's colour: the variance of e is the
    geometric mean of its spectrum at least (Kolmogorov 1941), and with white noise beside a motion
    it exceeds the noise's by as much as its past leaves the motion uncertain, 5 to 15 %. What a
    structure does beyond linear, and a model cannot predict, is less the less it moves. Noise of a
    force is in them too, but not as its structure amplifies it.

    Parameters
    ----------
    response : (N, sensors) array
        As measured.
    force : (N, inputs) array or None
        Inputs that are zero throughout count for nothing.
    spoilt : (N, sensors) array of bool
        Samples that show no motion, clipped ones: neither predicted nor used to predict.
    lags : int
        Samples of the past, L, at most: as long as there are twice as many errors as unknowns.

    Returns
    -------
    OneStepErrors
    """
    N = len(response)
    acting = np.zeros((N, 0)) if force is None else force[:, np.any(force != 0, axis=0)]
    # A quarter of the record, less the first past, has to be twice as long as what is fitted to it.
    lags = min(lags, int(_QUARTER * N / (2.0 * (1 + acting.shape[1]) + _QUARTER)) - 1)
    each = [_of_sensor(y, acting, bad, lags) for y, bad in zip(response.T, spoilt.T, strict=True)]
    deviation, freedom, steady = (np.array(x) for x in zip(*each, strict=True))
    return OneStepErrors(NoiseLevel(deviation, freedom), steady.astype(bool))


def _of_sensor(
    y: np.ndarray, force: np.ndarray, spoilt: np.ndarray, lags: int
) -> tuple[float, float, bool]:
    """Deviation and freedom while it moves least, and whether errors are as large elsewhere."""
    from scipy.special import ndtri

    nothing = np.nan, np.nan, False
    if lags < 1 or not np.all(np.isfinite(y)):
        return nothing
    y = y - np.mean(y)
    past = np.lib.stride_tricks.sliding_window_view(y, lags + 1)
    acted = [np.lib.stride_tricks.sliding_window_view(f, lags + 1) for f in force.T]
    usable = ~np.any(np.lib.stride_tricks.sliding_window_view(spoilt, lags + 1), axis=1)
    moves = np.mean(past[:, :-1] ** 2, axis=1)
    if not np.any(usable):
        return nothing
    low, high = np.quantile(moves[usable], [_QUARTER, 1.0 - _QUARTER])
    still, most = (np.flatnonzero(usable & part) for part in (moves <= low, moves >= high))

    def equations(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        ones = np.ones((len(rows), 1))
        columns = [past[rows, :-1], *(each[rows] for each in acted), ones]
        return np.concatenate(columns, axis=1), past[rows, -1]

    A, b = equations(still)
    freedom = len(A) - A.shape[1]
    if freedom < A.shape[1]:
        return nothing
    found = np.linalg.lstsq(A, b, rcond=None)[0]
    least = float(np.sum((b - A @ found) ** 2)) / freedom
    # Both quarters by one predictor: fitted to the one alone it would be a worse one elsewhere.
    B, c = equations(most)
    A, b = np.vstack([A, B]), np.concatenate([b, c])
    square = (b - A @ np.linalg.lstsq(A, b, rcond=None)[0]) ** 2
    motion = np.sqrt(moves[np.concatenate([still, most])])
    # Of many pairs that have nothing to do with each other it is normal with variance 1 / n.
    correlation = np.corrcoef(square, motion)[0, 1]
    steady = correlation * np.sqrt(len(b)) <= ndtri(1.0 - CHANCE)
    return float(np.sqrt(least)), float(freedom), bool(steady)
