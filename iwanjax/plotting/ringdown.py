"""A free decay as it was analysed, and several hits in one curve."""

import math
from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.plotting.curves import (
    DAMPING_LABEL,
    amplitude_label,
    draw_curves,
    frequency_label,
    plot_curves,
)
from iwanjax.plotting.style import (
    DOUBLE_COLUMN,
    GREY,
    PALETTE,
    amplitude_spectrum,
    paper_style,
    plain_ticks,
    set_up,
    stacked_panels,
    with_unit,
)
from iwanjax.signals.contents import FileContents
from iwanjax.signals.hilbert import RingDown
from iwanjax.signals.merge import MergedCurves
from iwanjax.studies import MeasuredMode

_LIGHT, _UNUSED = "0.7", "0.9"
# More samples than this make a vector graphic slow and look no different.
_MOST_SAMPLES = 4000
# Points whose deviation is a larger share of their value do not stretch the axis.
_KNOWN = 0.25
# Share of the points' own range that is left free above and below them.
_MARGIN = 0.08


@paper_style()
def plot_contents(contents: FileContents, recording: int = 0) -> Figure:
    """Time histories and amplitude spectra of a file's channels, one row each.

    Parameters
    ----------
    contents : FileContents
        Result of :func:`iwanjax.signals.file_contents`.
    recording : int
        Which of the recordings that are sound, counted from 0.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        Where there is no such recording.
    """
    if not 0 <= recording < len(contents.sound):
        raise InputError(
            f"plot_contents: recording = {recording}; {contents.path} has {len(contents.sound)} "
            "that can be used"
        )
    shown = contents.sound[recording]
    rows = (*shown.channels, *shown.inputs)
    figure, axes = plt.subplots(
        len(rows),
        2,
        figsize=(DOUBLE_COLUMN, 1.2 * len(rows) + 0.6),
        sharex="col",
        squeeze=False,
        layout="constrained",
    )
    set_up(*axes.flat)
    every = max(1, shown.size // _MOST_SAMPLES)
    for (left, right), channel in zip(axes, rows, strict=True):
        x = shown.channel(channel.name)
        left.plot(shown.time[::every], x[::every], color=PALETTE[0], linewidth=0.6)
        left.set_ylabel(with_unit(channel.name, channel.unit))
        right.semilogy(
            *amplitude_spectrum(x - x.mean(), shown.sampling_rate), color=PALETTE[0], linewidth=0.6
        )
    axes[-1, 0].set_xlabel("Time $t$ (s)")
    axes[-1, 1].set_xlabel("Frequency (Hz)")
    axes[-1, 0].set_xlim(shown.time[0], shown.time[-1])
    axes[-1, 1].set_xlim(0.0, 0.5 * shown.sampling_rate)
    return figure


@paper_style()
def plot_ringdown(ringdown: RingDown) -> Figure:
    """Envelope, frequency and damping against time, with the signal they were fitted to.

    Points are the intervals' values at their midpoints, bars one standard deviation. Thin
    lines are the envelope and the instantaneous frequency before any fit. In the shaded
    spans the filter has not settled or the noise is too near; nothing of them was used.

    Parameters
    ----------
    ringdown : RingDown
        Result of :func:`iwanjax.signals.hilbert.ringdown`.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For something that is not a RingDown.
    """
    if not isinstance(ringdown, RingDown):
        raise InputError(f"plot_ringdown expects a RingDown, got {type(ringdown).__name__}")
    r, c = ringdown, ringdown.curves
    figure, axes = stacked_panels((1.2, 1.0, 1.0), 4.8)
    upper, middle, lower = axes
    _shade_unused(axes, r)

    shown = slice(None, None, -(-r.signal_time.size // _MOST_SAMPLES))
    upper.semilogy(r.signal_time[shown], r.envelope[shown], color=_LIGHT, linewidth=0.8)
    upper.plot(r.time, np.asarray(c.amplitude), ".", color=PALETTE[0])
    upper.plot(r.time, r.noise, color=PALETTE[1], linestyle="--", linewidth=0.9)
    upper.set_ylim(*_envelope_limits(r))
    upper.set_ylabel(amplitude_label(c))

    instantaneous = np.gradient(r.phase, r.signal_time) / (2.0 * np.pi)
    middle.plot(r.signal_time[shown], instantaneous[shown], color=_LIGHT, linewidth=0.4, alpha=0.7)
    _draw_points(middle, r.time, c.frequency, c.frequency_std)
    # Deviations of a frequency are small beside it: what counts is the shift.
    middle.set_ylim(*_limits(c, "frequency"))
    middle.set_ylabel(frequency_label(shift=False))

    _draw_points(lower, r.time, c.damping, c.damping_std)
    lower.set_ylim(*_limits(c, "damping"))
    lower.set_ylabel(DAMPING_LABEL)
    lower.set_xlabel("Time $t$ (s)")
    lower.set_xlim(r.signal_time[0], r.signal_time[-1])

    figure.align_ylabels(list(axes))
    figure.legend(
        handles=[
            Line2D([], [], color=PALETTE[0], marker=".", linestyle="", label="fit at midpoints"),
            Line2D([], [], color=_LIGHT, linewidth=0.8, label="band-passed signal"),
            Line2D([], [], color=PALETTE[1], linestyle="--", label="noise in the band"),
            Patch(facecolor=_UNUSED, label="not used"),
        ],
        loc="outside upper center",
        ncols=2,
    )
    return figure


@paper_style()
def plot_merged(merged: MergedCurves) -> Figure:
    """Every hit's frequency and damping, their common curve, and where the next hit would lie.

    Shades are one and two standard deviations of a further hit. The lowest panel takes
    them apart, relative to the common curve: what differs from hit to hit (solid) and what
    the noise leaves unknown of a single hit (dashed).

    Parameters
    ----------
    merged : MergedCurves
        Result of :func:`iwanjax.signals.merge.merge_curves`.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For something that is not MergedCurves.
    """
    if not isinstance(merged, MergedCurves):
        raise InputError(f"plot_merged expects MergedCurves, got {type(merged).__name__}")
    figure, axes = stacked_panels((1.0, 1.0, 0.7), 5.2)
    upper, middle, lower = axes
    for hit in merged.hits:
        for ax, name in ((upper, "frequency"), (middle, "damping")):
            known = _known(hit, name)
            ax.plot(
                np.asarray(hit.amplitude),
                np.where(known, np.asarray(getattr(hit, name)), np.nan),
                color=_LIGHT,
                linewidth=0.5,
                zorder=1.8,
            )
    draw_curves(upper, middle, merged.next_hit, color=PALETTE[0])
    upper.set_ylim(*_limits(merged.next_hit, "frequency", 2.0, merged.hits))
    middle.set_ylim(*_limits(merged.next_hit, "damping", 2.0, merged.hits, logarithmic=True))
    _draw_deviations(lower, merged)
    upper.set_ylabel(frequency_label(shift=False))
    middle.set_ylabel(DAMPING_LABEL)
    lower.set_ylabel("Relative\ndeviation (–)")
    lower.set_xlabel(amplitude_label(merged.curves))
    plain_ticks(middle.yaxis, *middle.get_ylim())
    plain_ticks(lower.xaxis, *lower.get_xlim())
    figure.align_ylabels(list(axes))
    figure.legend(
        handles=[
            Line2D([], [], color=PALETTE[0], label="common curve"),
            Line2D([], [], color=_LIGHT, linewidth=0.8, label=f"{len(merged.hits)} hits"),
            Patch(facecolor=PALETTE[0], alpha=0.35, label=r"next hit, $\pm\sigma$, $\pm 2\sigma$"),
        ],
        loc="outside upper center",
        ncols=3,
    )
    figure.legend(
        handles=[
            Line2D([], [], color=PALETTE[0], label="frequency"),
            Line2D([], [], color=PALETTE[1], label="damping"),
            Line2D([], [], color=GREY, label="hit to hit"),
            Line2D([], [], color=GREY, linestyle="--", label="noise"),
        ],
        loc="outside lower center",
        ncols=4,
    )
    return figure


def _shade_unused(axes: np.ndarray, r: RingDown) -> None:
    for ax in axes:
        for begin, end in ((r.signal_time[0], r.edges[0]), (r.edges[-1], r.signal_time[-1])):
            ax.axvspan(begin, end, facecolor=_UNUSED, edgecolor="none", zorder=0.5)


def _draw_points(ax: Axes, time: np.ndarray, value: object, deviation: object) -> None:
    ax.errorbar(
        time,
        np.asarray(value),
        yerr=np.asarray(deviation),
        fmt=".",
        color=PALETTE[0],
        elinewidth=0.7,
    )


def _known(curves: ModalCurves, name: str) -> np.ndarray:
    """Levels whose damping is known well enough to be looked at; the frequency then is too."""
    value, std = np.asarray(curves.damping), np.asarray(curves.damping_std)
    known = std < _KNOWN * value
    return known if np.any(known) else np.isfinite(np.asarray(getattr(curves, name)))


def _limits(
    curves: ModalCurves,
    name: str,
    deviations: float = 1.0,
    beside: Sequence[ModalCurves] = (),
    *,
    logarithmic: bool = False,
) -> tuple[float, float]:
    """An axis that shows the known points with their bars, whatever the others do.

    Parameters
    ----------
    curves : ModalCurves
        Drawn with its deviations.
    name : str
        ``"frequency"`` or ``"damping"``.
    deviations : float
        How many of them the bars reach.
    beside : sequence of ModalCurves
        Drawn as lines.
    logarithmic : bool
        Whether the axis is.
    """
    known = _known(curves, name)
    value = np.asarray(getattr(curves, name))[known]
    std = deviations * np.asarray(getattr(curves, f"{name}_std"))[known]
    lines = [np.asarray(getattr(each, name))[_known(each, name)] for each in beside]
    ends = np.concatenate([value - std, value + std, *lines])
    if logarithmic:
        ends = np.log(ends[ends > 0])
    low, high = float(np.min(ends)), float(np.max(ends))
    margin = _MARGIN * (high - low) or 1e-3 * abs(high)
    limits = low - margin, high + margin
    return (math.exp(limits[0]), math.exp(limits[1])) if logarithmic else limits


def _envelope_limits(r: RingDown) -> tuple[float, float]:
    """From a little below the noise, whatever the envelope's zeros do, to above its top."""
    return 0.5 * float(np.min(r.noise)), 2.0 * float(np.max(r.envelope))


def _draw_deviations(ax: Axes, merged: MergedCurves) -> None:
    """Repeatability and estimator of frequency and damping, relative to the common curve."""
    amplitude = np.asarray(merged.curves.amplitude)
    for color, name in ((PALETTE[0], "frequency"), (PALETTE[1], "damping")):
        value = np.asarray(getattr(merged.curves, name))
        for style, kind in (("-", "repeatability"), ("--", "estimator")):
            deviation = getattr(merged, f"{name}_{kind}")
            # Where the noise explains all scatter there is none to draw on a logarithmic axis.
            share = np.where(deviation > 0, deviation / value, np.nan)
            ax.plot(amplitude, share, color=color, linestyle=style)
    ax.set(xscale="log", yscale="log")


def plot_measured(mode: MeasuredMode, **options: Any) -> Figure:
    """A mode's recordings and their common curve; options of :func:`plot_merged`, or of curves."""
    if mode.merged is not None:
        return plot_merged(mode.merged, **options)
    return plot_curves([hit.curves for hit in (*mode.hits, *mode.held_out)], **options)
