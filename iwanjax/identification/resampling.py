"""Recordings of several sampling rates at one: which rate that is, and how they get there."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from jaxtyping import Float

from iwanjax.identification.initial_state import initial_state
from iwanjax.identification.recordings import (
    StudyRecording,
    as_given,
    cleaned,
    in_quiet,
    noise_of,
)
from iwanjax.settings.conditioning import CONDITIONING
from iwanjax.signals.clipping import clipped_samples
from iwanjax.signals.comparison_band import END
from iwanjax.signals.sensor_noise import QUIET_BANDS, WHOLE_BAND, in_compared_band

# How far rates may differ that are one.
_SAME = 1e-6


@dataclass(frozen=True)
class ResamplingSettings:
    """Which rate recordings are compared at, and the filter that takes them there.

    Attributes
    ----------
    segment : int, samples
        Of a spectrum's segments.
    plenty : int, samples
        Of the longest recording to fit, above which even recordings of one rate are brought to a
        lower one: below that a fit is short anyway, and is left as it was measured.
    above_noise : float
        Density over that of the noise up to which a band holds no more than noise: the least of 20
        bands, by which noise is told, is up to 40 % too small.
    cut : float
        Share of the lower sampling rate at which half passes: a recorder's own filter.
    span : int, samples
        Of the lower rate on either side that a resampled value depends on.
    beta : float
        Kaiser's: 80 dB, which this span reaches 0.05 of the lower rate beyond the cut.
    finest : int
        Largest denominator of a ratio of two rates.
    """

    segment: int = 1024
    plenty: int = 20_000
    above_noise: float = 2.0
    cut: float = 0.4
    span: int = 24
    beta: float = 8.0
    finest: int = 10_000


def working_rate(
    recordings: Sequence[StudyRecording],
    rates: Sequence[float],
    settings: ResamplingSettings | None = None,
    highest: float = math.inf,
) -> float:
    """The lowest rate of the study, Hz, at which the recordings to fit still show all they do.

    That is their highest frequency with more than noise. A recording that is clipped keeps its
    rate at least, for a filtered limit is none. Where more than plenty of samples would be left
    a whole fraction of the rate is taken instead, as long as that shows it all.

    Parameters
    ----------
    recordings : sequence of StudyRecording
        At least one to fit.
    rates : sequence of float
        Of each, Hz.
    settings : ResamplingSettings, optional
        What is enough.
    highest : float
        Up to which the linear model is known, Hz: what is above is none of its errors. Then a
        whole fraction of the rate is taken, of which periodic recordings hold whole samples.
    """
    by = settings or ResamplingSettings()
    fitted = [(x, r) for x, r in zip(recordings, rates, strict=True) if x.use == "fit"]
    if not fitted:
        return min(rates)
    few = max(len(x.response) for x, _ in fitted) <= by.plenty
    if few and highest == math.inf and len(set(rates)) == 1:
        return rates[0]  # whatever the recordings show
    least = max(r if _clipped(x) else _highest(x, r, by) / END for x, r in fitted)
    if highest < math.inf:
        least = min(least, highest / END)
    chosen = min((rate for rate in rates if rate >= least), default=max(rates))
    if highest < math.inf:
        periods = [len(x.response) for x in recordings if x.initial == "periodic"]
        parts = range(max(1, math.floor(chosen / least)), 0, -1)
        return chosen / next(k for k in parts if all(n % k == 0 for n in periods))
    longest = max(len(x.response) * chosen / r for x, r in fitted)
    return chosen / max(1, math.floor(chosen / least)) if longest > by.plenty else chosen


def _clipped(recording: StudyRecording) -> bool:
    """Whether any of its channels is."""
    columns = [*recording.response.T, *(() if recording.force is None else recording.force.T)]
    return any(clipped_samples(column) for column in columns)


def _highest(recording: StudyRecording, rate: float, by: ResamplingSettings) -> float:
    """The highest compared frequency above which the structure moves no more than noise, Hz.

    Nor than a right model may be off by.
    """
    from scipy.signal import welch

    response = recording.response[:, recording.measured].astype(float)
    response = response - response.mean(axis=0)
    f, density = welch(response, rate, nperseg=min(by.segment, len(response)), axis=0)
    f, density = f[f <= END * rate], density[f <= END * rate]
    noise = 2.0 * in_quiet(recording).deviation[recording.measured] ** 2 / rate
    more = np.cumsum((density - by.above_noise * noise)[::-1], axis=0)[::-1] * f[1]
    moves = np.any(more > (CONDITIONING.model_error * np.std(response, axis=0)) ** 2, axis=1)
    return float(f[np.flatnonzero(moves)[-1]] if np.any(moves) else f[1])


def at_rate(
    recording: StudyRecording,
    rate: float,
    new: float,
    given: Float[np.ndarray, " sensors"],
    settings: ResamplingSettings | None = None,
) -> StudyRecording:
    r"""A recording at another rate, force and response through the same zero-phase filter.

    What is linear between them stays as it was. What the filter cannot know at the ends is cut
    off, unless the recording begins at rest or is periodic; where a force acts at once after rest,
    rest is put before it. Noise is that of the same density, :math:`\sigma\sqrt{f_{new}/f}`, as
    the filter leaves no white noise to measure it by; but where it was read off bands, those that
    remain say more of coloured noise than bands that nobody compares any more.

    Parameters
    ----------
    recording : StudyRecording
        As measured.
    rate, new : float
        Hz.
    given : (sensors,) array
        Noise that the study states, NaN where it does not.
    settings : ResamplingSettings, optional
        Of the filter.
    """
    by = settings or ResamplingSettings()
    ratio = Fraction(new / rate).limit_denominator(by.finest)
    if ratio == 1:
        return recording
    from scipy.signal import resample_poly  # here, because it takes a second to import

    up, down = ratio.numerator, ratio.denominator
    most = max(up, down)
    at = np.arange(-by.span * most, by.span * most + 1)
    taps = np.sinc(2.0 * by.cut * at / most) * np.kaiser(len(at), by.beta)
    initial = initial_state(recording)
    known = replace(recording, initial=initial)
    span = math.ceil(by.span * max(1.0, rate / new))
    # A whole number of new samples, so that the first old one stays a sample.
    beyond = down * math.ceil(2 * span / down)
    at_rest, periodic = initial == "rest", initial == "periodic"

    def filtered(x: np.ndarray, before: str) -> np.ndarray:
        wide = np.pad(x.astype(float), [(beyond, 0), (0, 0)], before)  # type: ignore[call-overload]
        after = "wrap" if periodic else "edge"
        wide = np.vstack([wide, np.pad(x, [(0, 2 * span), (0, 0)], after)[len(x) :]])
        return resample_poly(wide, up, down, axis=0, window=taps / taps.sum())

    force = recording.force
    clean = None if force is None else cleaned(force.astype(float))
    begin = 0 if at_rest or periodic else span
    if at_rest and clean is not None:
        begin = min(0, clean.first - span)
    end = len(recording.response) - (0 if periodic else span)
    # Places of the new samples among the old ones.
    first, last = (math.ceil((beyond + n) * up / down) for n in (begin, end))
    kept = slice(first, last)
    before = "wrap" if periodic else "edge"
    response = filtered(np.where(recording.measured, recording.response, 0.0), before)
    response[:, ~recording.measured] = np.nan
    if force is not None and clean is not None:
        # Of a hit that is cut off with the beginning its noise alone would be left, and drive the
        # model as a force that never ends.
        cut_off = not clean.endless and 0 < clean.last <= begin
        force = clean.clean if cut_off else force
        force = filtered(force, "constant" if at_rest else before)[kept]
    noise = noise_of(known).where(~np.isnan(given), as_given(given))
    noise = noise.times(math.sqrt(new / rate))
    # A limit that was filtered is none: what it cut off goes through the same filter.
    lost = None if clean is None else recording.cut_off(clean.clean)
    if lost is not None:
        lost = filtered(lost, "constant" if at_rest else before)[kept]
    of_forces = known.force_noise
    if of_forces is not None:
        of_forces = of_forces.times(math.sqrt(new / rate))
    found = replace(
        known,
        response=response[kept],
        force=force,
        noise=None,
        force_noise=of_forces,
        lost=lost,
    )
    if new < rate:
        by_bands = np.isin(noise.source, (QUIET_BANDS, WHOLE_BAND))
        felt = None if force is None else cleaned(force).clean
        noise = noise.where(by_bands, in_compared_band(found.response, felt))
    return replace(found, noise=noise)


def at_one_rate(
    recordings: Sequence[StudyRecording],
    rates: Sequence[float],
    given: np.ndarray,
    highest: float = math.inf,
) -> tuple[list[StudyRecording], float, tuple[str, ...]]:
    """All at the working rate, that rate in Hz, and what has been done to which of them.

    The linear model is known up to the frequency ``highest``, Hz.
    """
    # Of rates told by rounded times the first stands for all.
    rates = [next(r for r in rates if math.isclose(r, own, rel_tol=_SAME)) for own in rates]
    rate = working_rate(recordings, rates, highest=highest)
    found, told = [], []
    for each, own in zip(recordings, rates, strict=True):
        found.append(at_rate(each, own, rate, given))
        if found[-1] is each:
            continue
        line = f"{each.name} was measured at {own:.6g} Hz and is compared at {rate:.6g} Hz"
        if own < rate:
            line += f"; it shows nothing above {0.5 * own:.6g} Hz"
        if any(map(clipped_samples, each.response.T)):
            line += "; it is clipped, which a filter hides: measure it at the others' rate"
        told.append(line)
    return found, rate, tuple(told)
