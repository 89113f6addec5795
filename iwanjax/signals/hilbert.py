"""Frequency and damping against amplitude from a free decay, by the Hilbert transform."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

import numpy as np

from iwanjax.curves import QUANTITIES, ModalCurves
from iwanjax.errors import InputError
from iwanjax.results import AbstractResult
from iwanjax.signals.clipping import refuse_clipped
from iwanjax.signals.decay import Span, centred, decay_span, measured_noise, plan_intervals
from iwanjax.signals.decay_checks import (
    LEAST_DECAY,
    checked_signal,
    refuse_beats,
    refuse_no_decay,
)
from iwanjax.signals.decay_slopes import Decay, DecaySlopes
from iwanjax.signals.filters import analytic_signal, band_pass_gain, check_band
from iwanjax.signals.harmonic import without_harmonic
from iwanjax.signals.interval_lines import decay_lines, line_slopes
from iwanjax.signals.kalman_decay import kalman_slopes
from iwanjax.signals.peak_decay import peak_slopes
from iwanjax.signals.polynomial_decay import polynomial_slopes
from iwanjax.signals.short_time_decay import short_time_slopes
from iwanjax.types import ArrayLike

_FEWEST_INTERVALS = 3

Estimator = Literal["lines", "polynomial", "peaks", "short_time", "kalman"]
"""What makes frequency and damping of a decay's envelope and phase."""
_OTHERS: dict[str, Callable[[Decay], DecaySlopes]] = {
    "polynomial": polynomial_slopes,
    "peaks": peak_slopes,
    "short_time": short_time_slopes,
    "kalman": kalman_slopes,
}


@dataclass(frozen=True, eq=False)
class RingDown(AbstractResult):
    r"""A free decay taken apart: result of :func:`ringdown`.

    Attributes
    ----------
    curves : ModalCurves
        Amplitude, frequency and damping with their standard deviations at the midpoint of
        each interval, in the order of time: amplitudes fall.
    time : (levels,) array
        Midpoints of the intervals, s from the first sample.
    edges : (levels + 1,) array
        Ends of the intervals, s.
    signal_time : (N,) array
        Times of ``envelope`` and ``phase``, s: from the start of the free decay on.
    envelope : (N,) array
        exp(psi_1), in the signal's unit (2.18).
    phase : (N,) array
        psi_2, rad, unwrapped (2.17).
    noise : (levels,) array
        Deviation of the band-passed signal's noise around each interval, in its unit.
    band : (float, float)
        Hz.
    remarks : tuple of str
        What was left out of the record, and what another band would show.
    """

    curves: ModalCurves
    time: np.ndarray
    edges: np.ndarray
    signal_time: np.ndarray = field(repr=False)
    envelope: np.ndarray = field(repr=False)
    phase: np.ndarray = field(repr=False)
    noise: np.ndarray = field(repr=False)
    band: tuple[float, float]
    remarks: tuple[str, ...] = ()


def ringdown_curves(
    signal: ArrayLike, sampling_rate: float, band: tuple[float, float], **options: Any
) -> ModalCurves:
    """Frequency and damping against amplitude: ``ringdown(...).curves``.

    Parameters
    ----------
    signal : (N,) array_like
        One channel, with one mode in the band.
    sampling_rate : float
        Hz.
    band : (float, float)
        Corners of the band-pass, Hz.
    **options
        As for :func:`ringdown`.

    Returns
    -------
    ModalCurves

    Raises
    ------
    InputError
        As :func:`ringdown`.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> t = np.arange(4096) / 2048
    >>> decay = np.exp(-3 * t) * np.cos(2 * np.pi * 118 * t)
    >>> curves = ij.ringdown_curves(decay, 2048, band=(90, 150), quantity="velocity")
    >>> round(float(curves.damping[0]), 5)  # 3 / (2 pi 118)
    0.00405
    """
    return ringdown(signal, sampling_rate, band, **options).curves


def ringdown(
    signal: ArrayLike,
    sampling_rate: float,
    band: tuple[float, float],
    quantity: str = "velocity",
    *,
    unit: str = "",
    name: str = "",
    start: float | None = None,
    end: float | None = None,
    precision: float = 0.02,
    order: int = 3,
    estimator: Estimator = "lines",
) -> RingDown:
    r"""Hilbert analysis of a free decay with piecewise-linear fits (thesis Sec. 2.2.2).

    The analytic signal of the band-passed channel is :math:`\exp(\psi_1 + i\psi_2)`. In
    each interval of time a line is fitted to :math:`\psi_1` and to :math:`\psi_2`; their
    slopes :math:`\alpha < 0` and :math:`\omega` give, at the interval's midpoint,

    .. math:: f = \frac{\sqrt{\omega^2+\alpha^2}}{2\pi}, \qquad
              \zeta = \frac{-\alpha}{\sqrt{\omega^2+\alpha^2}}

    (2.21), which is printed without the minus sign. Unlike the thesis's each interval has
    a line of its own, so that the errors of different points are independent. A line's
    slope is an average of the derivative over its interval (with a parabola as weight); the
    neighbours' slopes give the curvature that turns it into the midpoint's value.

    **Convention.** The amplitude is the peak of the fundamental, in the signal's own
    quantity; :meth:`ModalCurves.as_quantity` converts by (2.22). The damping is that of the
    acceleration's envelope whatever was measured,
    :math:`\alpha + (2-k)\,\mathrm{d}\ln\omega/\mathrm{d}t` with k = 0, 1, 2 for
    displacement, velocity, acceleration: of the three it is the one that equals the energy
    lost per cycle, :math:`D/(2\pi\omega^2q^2)`, when a Masing joint's frequency changes with
    amplitude. The envelope of displacement shows more, by twice
    :math:`-\mathrm{d}\ln\omega/\mathrm{d}\ln q` (checked against discrete sliders).

    **Largest amplitude.** ``curves.largest`` is that of the band-passed record up to the decay's
    end, forced motion included: joints with memory go by it. After a sudden hit the filter makes
    it up to 4 per cent too large.

    **What is left out** the result's ``remarks`` say: forced vibration before a shaker lets go; the
    second harmonic of a mode near half the frequency, which is taken off; the beginning, where a
    narrow band's filter has not settled, with what a band twice as wide would show.

    **Deviations** come from the noise that each interval's own residual shows near the
    carrier, carried through the fits; twice the correction from average to midpoint is
    added where it exceeds its own noise, as beside the kink at the onset of macroslip, and what an
    interval's line bends more than its neighbours explain, as upon a step. They
    do not know of other modes in the band, of
    temperature, or of the next hit's bolts: see :func:`merge_curves`.

    Parameters
    ----------
    signal : (N,) array_like
        One channel or modal coordinate, with one mode in the band.
    sampling_rate : float
        Hz.
    band : (float, float)
        Corners of the zero-phase Butterworth band-pass, Hz.
    quantity : {"velocity", "displacement", "acceleration"}
        What the signal is.
    unit, name : str
        Labels for plots and reports.
    start, end : float, optional
        The span of the free decay, s from the first sample. By default it starts after the
        last rise of the envelope (the last contact), or where it begins to fall after it was
        driven, and ends where the noise comes within
        a factor of six of the envelope. Where the filter has not settled nothing is used.
    precision : float
        Relative deviation of the damping that an interval is made long enough for, as far
        as the amplitude changes neither by less than 8 nor by more than 40 per cent in it.
    order : int
        Order of the Butterworth prototype.
    estimator : {"lines", "polynomial", "peaks", "short_time", "kalman"}
        Lines in intervals, as above, whose points are independent; one polynomial over the whole
        decay, of the order that predicts best; lines through the logarithms and the times of the
        peaks; a damped sine fitted to each interval; or a Kalman smoother. All tell points at the
        same intervals, with deviations; those of a polynomial and of the smoother are correlated,
        which a fit does not know.

    Returns
    -------
    RingDown

    Raises
    ------
    InputError
        For a signal that is not a row of finite numbers, too short, clipped, without
        decay, or lost in noise; for a band outside (0, half the sampling rate).

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> t = np.arange(4096) / 2048
    >>> decay = np.exp(-3 * t) * np.cos(2 * np.pi * 118 * t)
    >>> ring = ij.ringdown(decay, 2048, (90, 150), "velocity")
    >>> round(float(ring.curves.frequency[0]), 2)
    118.0
    """
    x = checked_signal(signal)
    band = check_band(band, sampling_rate, order)
    if quantity not in QUANTITIES:
        raise InputError(f"quantity = {quantity!r}: expected one of {', '.join(QUANTITIES)}")
    if not 0.0 < precision < 1.0:
        raise InputError(f"precision = {precision!r}: expected a fraction, for instance 0.02")
    if estimator not in get_args(Estimator):
        raise InputError(
            f"estimator = {estimator!r}: expected one of {', '.join(get_args(Estimator))}"
        )
    labels = {"quantity": quantity, "unit": unit, "name": name}
    span = decay_span(x, sampling_rate, band, order, start, end)
    remarks = []
    harmonic = without_harmonic(x, sampling_rate, band, order, span.first, span.stop)
    if harmonic is not None:
        x = harmonic.signal
        span = decay_span(
            x, sampling_rate, band, order, harmonic.start if start is None else start, end
        )
        remarks.append(
            "the second harmonic of a mode near half the frequency, "
            f"{abs(harmonic.coefficient):.3g} times its amplitude squared, is taken off"
        )
    if span.first > span.contact:
        remarks.append(
            f"until {span.first / sampling_rate:.4g} s something drives it: left out, "
            f"{(span.first - span.contact) / sampling_rate:.3g} s"
        )
    found, begins = _analysed(x, sampling_rate, band, span, precision, order, labels, estimator)
    if begins < LEAST_DECAY:
        told = (
            f"the filter of ({band[0]:g}, {band[1]:g}) Hz takes {span.settled / sampling_rate:.3g} "
            f"s to settle: {found.time.size} points, from {100 * begins:.0f} % of the amplitude on"
        )
        wider = _with_a_wider_band(x, sampling_rate, found, begins, order, span)
        remarks += [told + wider] if wider or begins < LEAST_DECAY**2 else []
    return replace(found, remarks=tuple(remarks))


def _with_a_wider_band(
    x: np.ndarray, sampling_rate: float, found: RingDown, begins: float, order: int, span: Span
) -> str:
    """What a band twice as wide would show, for the end of a remark; nothing where that is less."""
    f = np.asarray(found.curves.frequency)
    width = found.band[1] - found.band[0]
    middle = 0.5 * float(f.min() + f.max())
    low, high = middle - width, middle + width
    if not 0.0 < low < high < 0.5 * sampling_rate:
        return ""
    start, end = (each / sampling_rate for each in (span.first, span.stop))
    try:
        wider = decay_span(x, sampling_rate, (low, high), order, start, end)
        more, share = _analysed(x, sampling_rate, (low, high), wider, 0.02, order, {})
    except InputError:
        return ""
    if LEAST_DECAY * share <= begins:
        return ""
    return f"; ({low:.4g}, {high:.4g}) Hz gives {more.time.size}, from {100 * share:.0f} % on"


def _analysed(
    x: np.ndarray,
    sampling_rate: float,
    band: tuple[float, float],
    span: Span,
    precision: float,
    order: int,
    labels: dict[str, str],
    estimator: str = "lines",
) -> tuple[RingDown, float]:
    """The decay in a span, and its first amplitude over that with which the span begins."""
    derivatives = QUANTITIES[labels.get("quantity", "velocity")]
    z = analytic_signal(centred(x[span.first : span.stop]), sampling_rate, band, order)
    refuse_clipped(x[span.first : span.stop][span.settled :])
    psi_1, psi_2 = np.log(np.abs(z)), np.unwrap(np.angle(z))
    noise = measured_noise(z, sampling_rate, band, order, span.settled)
    refuse_no_decay(psi_1, slice(span.settled, noise.stop), band, noise)
    edges = plan_intervals(psi_1, sampling_rate, band, noise, span.settled, precision)
    if edges.size - 1 < _FEWEST_INTERVALS:
        raise InputError(
            f"ringdown: the {(edges[-1] - edges[0]) / sampling_rate:.3g} s between the filter's "
            "settling and the noise are too short for three intervals; widen the band or record "
            "longer"
        )
    time = np.arange(z.size) / sampling_rate
    decay = Decay(z, sampling_rate, edges, noise, band)
    lines = decay_lines(decay)
    # From where the record begins: the hit itself may have gone further than what is left of it.
    whole = analytic_signal(centred(x[: span.stop]), sampling_rate, band, order)

    def unfiltered(found: DecaySlopes) -> tuple[DecaySlopes, np.ndarray]:
        passed = np.log(band_pass_gain(found.omega / (2.0 * math.pi), band, order))
        return found.before_the_filter(passed), passed

    own = _OTHERS.get(estimator)
    slopes, passed = unfiltered(line_slopes(lines) if own is None else own(decay))
    largest = float(np.max(np.abs(whole))) / float(np.exp(passed[0]))
    # A beat bends lines as well: by what the noise leaves of them it is seen.
    bent, _ = unfiltered(line_slopes(lines, steps=False))
    refuse_beats(bent.curves(derivatives, largest, {}), band)
    curves = slopes.curves(derivatives, largest, labels)
    begin = span.first / sampling_rate
    released = np.max(np.abs(whole[span.first : span.first + span.settled + 1])) / np.exp(passed[0])
    found = RingDown(
        curves,
        begin + slopes.time,
        begin + edges / sampling_rate,
        begin + time,
        np.abs(z) / np.exp(np.interp(time, slopes.time, passed)),
        psi_2,
        np.sqrt(noise.at(0.5 * (edges[1:] + edges[:-1])) * (band[1] - band[0])),
        band,
    )
    return found, float(np.asarray(curves.amplitude)[0] / released)
