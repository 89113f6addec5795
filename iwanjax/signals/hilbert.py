"""Frequency and damping against amplitude from a free decay, by the Hilbert transform."""

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from iwanjax.curves import QUANTITIES, ModalCurves
from iwanjax.errors import InputError
from iwanjax.results import AbstractResult
from iwanjax.signals.clipping import refuse_clipped
from iwanjax.signals.decay import Span, centred, decay_span, measured_noise, plan_intervals
from iwanjax.signals.decay_checks import (
    LEAST_DECAY,
    NORMAL,
    SURE,
    checked_signal,
    refuse_beats,
    refuse_no_decay,
)
from iwanjax.signals.filters import analytic_signal, band_pass_gain, check_band
from iwanjax.signals.harmonic import without_harmonic
from iwanjax.types import ArrayLike

# Multiples of the correction to the midpoint and of that to the acceleration's envelope that
# are taken as their deviations: beside a kink the first is wrong by up to twice itself, the
# second is known to a tenth.
_DOUBT, _DOUBT_OF_CONVENTION = 2.0, 0.1
_FEWEST_INTERVALS = 3


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
    found, begins = _analysed(x, sampling_rate, band, span, precision, order, labels)
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
    lines = _fit_lines(psi_1, psi_2, sampling_rate, edges, noise.at(edges))
    passed = np.log(band_pass_gain(lines.omega / (2.0 * math.pi), band, order))
    lines = _before_the_filter(lines, passed)
    # From where the record begins: the hit itself may have gone further than what is left of it.
    whole = analytic_signal(centred(x[: span.stop]), sampling_rate, band, order)
    largest = float(np.max(np.abs(whole))) / float(np.exp(passed[0]))
    curves = _curves(lines, derivatives, largest, **labels)
    # A beat bends lines as well: by what the noise leaves of them it is seen.
    refuse_beats(_curves(lines, derivatives, largest, steps=False), band)
    begin = span.first / sampling_rate
    released = np.max(np.abs(whole[span.first : span.first + span.settled + 1])) / np.exp(passed[0])
    found = RingDown(
        curves,
        begin + lines.middle,
        begin + edges / sampling_rate,
        begin + np.arange(z.size) / sampling_rate,
        np.abs(z) / np.exp(np.interp(np.arange(z.size) / sampling_rate, lines.middle, passed)),
        psi_2,
        np.sqrt(noise.at(0.5 * (edges[1:] + edges[:-1])) * (band[1] - band[0])),
        band,
    )
    return found, float(curves.amplitude[0] / released)


@dataclass(frozen=True)
class _Lines:
    """Lines fitted to psi_1 and psi_2 in each interval, with variances."""

    middle: np.ndarray
    width: np.ndarray
    height: np.ndarray
    height_variance: np.ndarray
    rate: np.ndarray
    omega: np.ndarray
    slope_variance: np.ndarray
    rate_bend: np.ndarray
    omega_bend: np.ndarray


def _fit_lines(
    psi_1: np.ndarray,
    psi_2: np.ndarray,
    sampling_rate: float,
    edges: np.ndarray,
    density: np.ndarray,
) -> _Lines:
    """Least-squares lines; noise is white near the carrier, with a density at each edge."""
    rows = []
    for i in range(edges.size - 1):
        a, b = edges[i], edges[i + 1]
        t = np.arange(a, b) / sampling_rate
        middle = 0.5 * (t[0] + t[-1])
        lever = (t - middle) / np.sum((t - middle) ** 2)
        bend = _bend(t)
        mean = np.full(t.size, 1.0 / t.size)
        # In-phase noise of the envelope and of the phase, relative to the amplitude.
        variance = 0.5 * (density[i] + density[i + 1]) * sampling_rate * np.exp(-2.0 * psi_1[a:b])
        rows.append(
            (
                middle,
                t.size / sampling_rate,
                mean @ psi_1[a:b],
                mean**2 @ variance,
                lever @ psi_1[a:b],
                lever @ psi_2[a:b],
                lever**2 @ variance,
                bend @ psi_1[a:b],
                bend @ psi_2[a:b],
            )
        )
    return _Lines(*np.array(rows).T)


def _bend(t: np.ndarray) -> np.ndarray:
    """Weights for the slope over the second half of an interval less that over the first."""
    halves = np.array_split(t, 2)
    levers = [(part - part.mean()) / np.sum((part - part.mean()) ** 2) for part in halves]
    return np.concatenate([-levers[0], levers[1]])


def _before_the_filter(lines: _Lines, passed: np.ndarray) -> _Lines:
    """Lines of the envelope as it was before a gain, exp(passed), that moves with frequency.

    Beside another mode the band's corner may be near: a third of the amplitude is lost there.
    """
    return replace(
        lines,
        height=lines.height - passed,
        rate=lines.rate - np.gradient(passed, lines.middle),
    )


def _curves(
    lines: _Lines, derivatives: int, largest: float, *, steps: bool = True, **labels: str
) -> ModalCurves:
    """Values at the midpoints from the lines' averages, and what follows from them."""
    to_middle, to_slope = _midpoint_operators(lines.middle, lines.width)
    rate, omega = to_middle @ lines.rate, to_middle @ lines.omega
    noise = to_middle**2 @ lines.slope_variance
    correction = to_middle - np.eye(lines.middle.size)
    # What the noise does to a correction is in its variance already.
    own = SURE * (correction**2 @ lines.slope_variance)

    # A slope over half an interval has eight times the variance.
    bend_variance = 16.0 * lines.slope_variance

    def left(slopes: np.ndarray, bend: np.ndarray) -> np.ndarray:
        # A step within an interval bends its line more than the neighbours' slopes do, and the
        # value at the middle is that of either side: they alone would not tell.
        step = bend - 0.5 * (to_slope @ slopes) * lines.width
        # What bends all lines, such as a beat, is none.
        common = NORMAL * np.median(np.abs(step))
        own_bend = SURE**2 * np.maximum(bend_variance, common**2)
        more = np.maximum(step**2 - own_bend, 0.0) if steps else 0.0
        return _DOUBT**2 * np.maximum((correction @ slopes) ** 2 - own, 0.0) + more

    # A line at its middle is the mean, which lies off the curve by its curvature.
    height = lines.height - to_slope @ lines.rate * lines.width**2 / 24.0
    amplitude = np.exp(height)
    convention = (2 - derivatives) * (to_slope @ lines.omega) / omega
    rate_std = np.sqrt(
        noise + left(lines.rate, lines.rate_bend) + (_DOUBT_OF_CONVENTION * convention) ** 2
    )
    rate = rate + convention
    natural = np.hypot(omega, rate)
    return ModalCurves(
        amplitude,
        natural / (2.0 * math.pi),
        -rate / natural,
        amplitude_std=amplitude * np.sqrt(lines.height_variance),
        frequency_std=np.sqrt(noise + left(lines.omega, lines.omega_bend)) / (2.0 * math.pi),
        damping_std=rate_std / natural,
        largest=max(largest, float(np.max(amplitude))),
        **labels,
    )


def _midpoint_operators(middle: np.ndarray, width: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrices from the lines' slopes to the derivative and its slope at the midpoints.

    The slope of a line of width h is the derivative's average with a parabola as weight,
    whose variance is h^2/20. A quadratic through the averages of three neighbours gives
    the value at the middle.
    """
    count = middle.size
    value, slope = np.zeros((count, count)), np.zeros((count, count))
    for i in range(count):
        first = min(max(i - 1, 0), count - 3)
        near = slice(first, first + 3)
        dt = (middle[near] - middle[i]) / width[i]
        spread = (width[near] / width[i]) ** 2 / 20.0
        averages = np.column_stack([np.ones(3), dt, dt**2 + spread])
        inverse = np.linalg.inv(averages)
        value[i, near], slope[i, near] = inverse[0], inverse[1] / width[i]
    return value, slope
