"""A recording that a model was not fitted to, predicted and measured (thesis Sec. 3.4.4)."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
import scipy.special

from iwanjax.results import AbstractResult
from iwanjax.signals.recording import sampling_rate
from iwanjax.structures import JointedStructure
from iwanjax.tables import Block, Grid


class Comparison(NamedTuple):
    """A quantity that was measured, beside its prediction and the band of that.

    Attributes
    ----------
    measured, predicted : (samples, ...) array
        Along time, or along the levels of a curve; NaN where one is not known.
    lower, upper : (samples, ...) array
        Ends of the central range of predictions, by what the fit leaves open of the parameters
        alone: the noise of the measurement is not in it.
    """

    measured: np.ndarray
    predicted: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @property
    def error(self) -> np.ndarray:
        """Root mean square of predicted less measured over that of measured, (...)."""
        known = np.isfinite(self.measured) & np.isfinite(self.predicted)
        off, size = (
            np.sum(np.where(known, x, 0.0) ** 2, axis=0)
            for x in (self.predicted - self.measured, self.measured)
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.sqrt(off / size)

    @property
    def relative(self) -> np.ndarray:
        """Predicted over measured, less 1: (samples, ...), of an amplitude its error in time."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.predicted / self.measured - 1.0

    def column(self, i: int) -> "Comparison":
        """Of one sensor or mode."""
        return Comparison(*(each[:, i] for each in self))


class PredictedCurves(NamedTuple):
    """Instantaneous frequency and damping of a mode in one recording, at measured amplitudes.

    Attributes
    ----------
    amplitude : (levels,) array
        Modal displacement, mass-normalised.
    frequency, damping : Comparison of (levels,) arrays
        Hz, 1: measured and predicted by one estimator; NaN beyond what the prediction reaches.
    frequency_std, damping_std : (levels,) array
        Of what was measured.
    frequency_error, damping_error : float
        Root mean squares, Hz and per cent, where the damping is known to a tenth.
    """

    amplitude: np.ndarray
    frequency: Comparison
    damping: Comparison
    frequency_std: np.ndarray
    damping_std: np.ndarray
    frequency_error: float
    damping_error: float


@dataclass(frozen=True, eq=False)
class PredictedMode(AbstractResult):
    """What one mode adds to a sensor's response, predicted and measured.

    Attributes
    ----------
    name : str
        Of the mode, ``"mode 0"``.
    component : Comparison of (N,) arrays
        In the sensor's unit: predicted by (3.36), measured by (3.37).
    amplitude : Comparison of (windows,) arrays
        Of the same, in the windows of the prediction.
    leakage : float
        What the filter (3.37) makes of the predicted sensors less (3.36), rms over that of (3.36):
        as much of the error is not the model's, but motion that the filter takes for this mode, of
        rigid bodies and higher modes while the force acts above all.
    filtered_error : float
        As ``component.error`` where predicted sensors go through the filter, too.
    curves : PredictedCurves or None
        None where the recording shows no decay of the mode; predicted NaN where only the
        prediction shows none.
    reason : str
        Why, else empty.
    """

    name: str
    component: Comparison = field(repr=False)
    amplitude: Comparison = field(repr=False)
    leakage: float
    filtered_error: float
    curves: PredictedCurves | None = field(repr=False)
    reason: str = ""

    def _cells(self) -> tuple[str, ...]:
        shares = (
            self.component.error,
            self.leakage,
            self.filtered_error,
            self.amplitude.error,
        )
        cells = self.name, *map(_percent, shares)
        if self.curves is None or not np.isfinite(self.curves.frequency_error):
            return *cells, "-", "-"
        f, zeta = self.curves.frequency_error, self.curves.damping_error
        return *cells, f"{f:.2g} Hz", f"{zeta:.2g} %"


@dataclass(frozen=True, eq=False)
class PredictedRecording(AbstractResult):
    r"""Result of :meth:`iwanjax.Study.predict`: one recording held out, predicted and measured.

    Attributes
    ----------
    name : str
        Of the recording.
    sensors : tuple of str
        Columns of ``response``.
    quantity, unit : str
        What they measure.
    time : (N,) array
        s, on the recording's own axis.
    response : Comparison of (N, sensors) arrays
        At the sensors; its ``error`` is the relative rms error of each.
    noise : (sensors,) array
        Standard deviation of each sensor's noise, as the study gives it or the recording shows.
    covered : (sensors,) array
        Share of the samples in the central band of parameters and noise together, which should be
        ``probability``; less where the model itself is wrong.
    spread : (sensors,) array
        What open parameters leave, as ``response.error``: rms of the draws about the prediction.
    window_time : (windows,) array
        Middle of each window, s.
    amplitude : Comparison of (windows, sensors) arrays
        Amplitude :math:`\sqrt{2(\overline{a^2} - \sigma^2)}` in windows of one period of the lowest
        mode in ``modes``; NaN where noise :math:`\sigma` is more than half of the mean square.
    modes : tuple of PredictedMode
        The modes that were fitted, at the sensor ``shown``.
    shown : str
        The sensor that moves most.
    probability : float
        Of all bands.
    draws : int
        Parameter sets that the bands are made of.
    source : {"fit", "posterior"}
        Where they were drawn from: the covariance of the fit or the chain of the posterior.
    shifted : bool
        Whether the fit compared frequencies up to an offset, so that phases drift apart.
    error_estimated : float
        Of the integration itself, as :class:`iwanjax.SimulatedResponse` has it.
    structure : JointedStructure
        The updated model.
    """

    name: str
    sensors: tuple[str, ...]
    quantity: str
    unit: str
    time: np.ndarray = field(repr=False)
    response: Comparison = field(repr=False)
    noise: np.ndarray
    covered: np.ndarray
    spread: np.ndarray
    window_time: np.ndarray = field(repr=False)
    amplitude: Comparison = field(repr=False)
    modes: tuple[PredictedMode, ...]
    shown: str
    probability: float
    draws: int
    source: Literal["fit", "posterior"]
    shifted: bool
    error_estimated: float
    structure: JointedStructure = field(repr=False)

    @property
    def floor(self) -> np.ndarray:
        """What noise alone would leave of an exact model, as ``response.error``, (sensors,)."""
        return self.noise / np.sqrt(np.mean(self.response.measured**2, axis=0))

    def _blocks(self) -> tuple[Block, ...]:
        """Errors by sensor and by mode."""
        share = f"{100 * self.probability:g} %"
        source = "the fit's covariance" if self.source == "fit" else "the posterior"
        head = (
            f"{self.name}: {self.quantity} of {len(self.sensors)} sensor(s), not fitted, predicted "
            f"from rest by its forces; bands of {share} by {self.draws} draws from {source}"
        )
        columns = ("sensor", "error", "noise alone", "parameters", f"in {share}", "amplitude")
        told = [head, Grid(columns, tuple(self._rows_of_sensors()))]
        if self.modes:
            columns = (f"mode at {self.shown}", "error", "of the filter", "both filtered")
            cells = tuple(mode._cells() for mode in self.modes)
            told.append(Grid((*columns, "amplitude", "frequency", "damping"), cells))
        told += [f"  {mode.name}: {mode.reason}" for mode in self.modes if mode.reason]
        if self.shifted:
            told.append(
                "  Frequencies were fitted up to an offset, so that phases drift apart: compare "
                "amplitudes, or fit with reference: absolute."
            )
        return tuple(told)

    def _rows_of_sensors(self) -> Iterator[tuple[str, ...]]:
        values = (self.response.error, self.floor, self.spread, self.covered, self.amplitude.error)
        for sensor, *each in zip(self.sensors, *values, strict=True):
            yield sensor, *map(_percent, each)


def _percent(share: float | np.ndarray) -> str:
    return f"{100.0 * float(share):.3g} %" if np.isfinite(share) else "-"


def compared(
    measured: np.ndarray, predicted: np.ndarray, drawn: np.ndarray, probability: float
) -> Comparison:
    """With the central range of the draws, (draws, ...), that are known."""
    tail = 0.5 * (1.0 - probability)
    known = np.any(np.isfinite(drawn), axis=0) & np.isfinite(predicted)
    # Of draws without NaN in a tenth of the time.
    quantile = np.quantile if np.all(np.isfinite(drawn)) else np.nanquantile
    lower, upper = (
        np.where(known, quantile(np.where(known, drawn, 0.0), end, axis=0), np.nan)
        for end in (tail, 1.0 - tail)
    )
    return Comparison(measured, predicted, lower, upper)


def covered(
    measured: np.ndarray, drawn: np.ndarray, noise: np.ndarray, probability: float
) -> np.ndarray:
    """Share of samples in the central band of draws and noise, for each sensor.

    The prediction of a sample is a mixture of normal distributions about the draws; measured is in
    the band where its distribution function is between the tails.
    """
    tail = 0.5 * (1.0 - probability)
    found = np.empty(len(noise))
    for i, deviation in enumerate(np.maximum(noise, np.finfo(float).tiny)):
        with np.errstate(over="ignore"):
            below = scipy.special.ndtr((measured[:, i] - drawn[..., i]) / deviation).mean(axis=0)
        found[i] = np.mean((below >= tail) & (below <= 1.0 - tail))
    return found


class Windows(NamedTuple):
    """Windows of so many samples, and the middles of them, s."""

    length: int
    middle: np.ndarray

    @classmethod
    def of(cls, time: np.ndarray, frequency: float) -> "Windows":
        """Of one period of a frequency, Hz, over samples at times (N,)."""
        length = int(np.clip(round(sampling_rate(time) / frequency), 1, time.size))
        whole = time[: time.size // length * length]
        return cls(length, whole.reshape(-1, length).mean(axis=1))

    def compared(
        self,
        measured: np.ndarray,
        predicted: np.ndarray,
        drawn: np.ndarray,
        noise: np.ndarray,
        probability: float,
    ) -> tuple[Comparison, Comparison]:
        """Samples (N, columns), and amplitudes (windows, columns), of draws (draws, N, columns)."""
        square = self._mean_square(measured)
        with np.errstate(invalid="ignore"):
            amplitude = np.where(
                square > 2.0 * noise**2, np.sqrt(2.0 * (square - noise**2)), np.nan
            )
        best, all_draws = (np.sqrt(2.0 * self._mean_square(x)) for x in (predicted, drawn))
        return (
            compared(measured, predicted, drawn, probability),
            compared(amplitude, best, all_draws, probability),
        )

    def _mean_square(self, x: np.ndarray) -> np.ndarray:
        """Of (..., N, columns) in each window, (..., windows, columns)."""
        whole = x[..., : len(self.middle) * self.length, :]
        shape = (*x.shape[:-2], len(self.middle), self.length, x.shape[-1])
        return np.mean(whole.reshape(shape) ** 2, axis=-2)
