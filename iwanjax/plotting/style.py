"""The look that all figures share, applied without touching matplotlib's global settings."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import (
    LogFormatterSciNotation,
    LogLocator,
    MaxNLocator,
    NullFormatter,
    ScalarFormatter,
    StrMethodFormatter,
)

from iwanjax.types import ArrayLike

# Okabe and Ito's colours, which the colour-blind can tell apart; their yellow is lost on white.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
GREY = "0.4"

SINGLE_COLUMN, DOUBLE_COLUMN = 3.5, 7.2
"""Widths of figures, in."""

# Axes that span less than this factor get more labels than one a decade.
_FEW_DECADES = 100.0
# Labels at 1, 2 and 5 that such an axis needs, and the most at other round numbers.
_FEWEST_LABELS, _MOST_LABELS = 2, 4
# Axes that begin below this have powers of ten.
_SMALL = 5e-4

_SETTINGS: dict[Any, Any] = {
    "figure.dpi": 150,
    "figure.facecolor": "white",
    "axes.facecolor": "white",
    "axes.edgecolor": "black",
    "axes.labelcolor": "black",
    "text.color": "black",
    "font.family": "sans-serif",
    "font.size": 8.0,
    "axes.labelsize": 8.0,
    "axes.titlesize": 8.0,
    "axes.titleweight": "bold",
    "axes.linewidth": 0.6,
    "axes.grid": False,
    "axes.formatter.useoffset": False,
    "axes.formatter.use_mathtext": True,
    "axes.formatter.limits": (-3, 4),
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.2,
    "lines.linewidth": 1.2,
    "lines.markersize": 4.0,
    "mathtext.fontset": "dejavusans",
}


@contextmanager
def paper_style() -> Iterator[None]:
    """Apply the package's settings for the time of one figure, as context or as decorator.

    Unlike ``matplotlib.rc_context`` it puts back only what it has set: the first figure of
    a notebook switches to interactive mode, which has to last.
    """
    before = {key: mpl.rcParams[key] for key in _SETTINGS}
    try:
        mpl.rcParams.update(_SETTINGS)
        yield
    finally:
        mpl.rcParams.update(before)


def set_up(*axes: Axes) -> None:
    """Give panels their ticks and a light grid.

    Ticks are made when the figure is drawn, after :func:`paper_style` has ended, and would
    follow the global settings if they were not told otherwise.
    """
    for ax in axes:
        ax.set_axisbelow(True)
        ax.grid(visible=True, which="major", color="0.9", linewidth=0.5, linestyle="-")
        ax.tick_params(
            which="both",
            direction="in",
            top=True,
            right=True,
            width=0.6,
            color="black",
            labelcolor="black",
            labelsize=7.0,
        )
        ax.tick_params(which="major", length=3.0)
        ax.tick_params(which="minor", length=1.5)


def single_panel(height: float) -> tuple[Figure, Axes]:
    """One panel as wide as a column, of so many inches."""
    figure, ax = plt.subplots(figsize=(SINGLE_COLUMN, height), layout="constrained")
    set_up(ax)
    return figure, ax


def stacked_panels(heights: Sequence[float], height: float) -> tuple[Figure, np.ndarray]:
    """Panels over one another with one abscissa, as wide as a column, of so many inches in all."""
    figure, axes = plt.subplots(
        len(heights),
        1,
        sharex=True,
        figsize=(SINGLE_COLUMN, height),
        height_ratios=tuple(heights),
        layout="constrained",
    )
    set_up(*axes)
    return figure, axes


def draw_band(
    ax: Axes, x: ArrayLike, middle: np.ndarray, deviation: np.ndarray, label: str | None = None
) -> None:
    """Two deviations on either side of a curve."""
    ax.fill_between(
        x,
        middle - 2.0 * deviation,
        middle + 2.0 * deviation,
        color=PALETTE[0],
        alpha=0.25,
        linewidth=0.0,
        label=label,
    )


def amplitude_spectrum(x: np.ndarray, sampling_rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Lines above zero, Hz, and amplitudes under a Hann window, where a sine has its own."""
    window = np.hanning(x.size)
    amplitude = 2.0 * np.abs(np.fft.rfft(x * window)) / window.sum()
    return np.fft.rfftfreq(x.size, 1.0 / sampling_rate)[1:], amplitude[1:]


def with_unit(quantity: str, unit: str) -> str:
    """Axis label: the quantity, and its unit in brackets where it is known."""
    return f"{quantity} ({unit})" if unit else quantity


def mark_amplitude(ax: Axes, x: float, text: str = "", *, rising: bool = False) -> None:
    """Thin dotted line at an amplitude, with a word where a falling (rising) curve leaves room."""
    ax.axvline(x, color=GREY, linestyle=":", linewidth=0.8, zorder=1.5)
    if text:
        ax.annotate(
            text,
            (x, 0.97 if rising else 0.03),
            xycoords=("data", "axes fraction"),
            xytext=(-2, 0),
            textcoords="offset points",
            ha="right",
            va="top" if rising else "bottom",
            rotation=90,
            color=GREY,
            fontsize=7.0,
        )


def plain_ticks(axis: Axis, low: float, high: float) -> None:
    """Labels at 1, 2 and 5 (1 and 3) where a logarithmic axis spans less than two decades.

    Matplotlib's own then run into each other, or there are none. Where fewer than two of these
    are within, labels at round numbers.
    """
    if high >= _FEW_DECADES * low:
        return
    whole = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    labelled = np.outer((1.0, 2.0, 5.0), whole)
    if np.sum((labelled >= low) & (labelled <= high)) < _FEWEST_LABELS:
        axis.set_major_locator(MaxNLocator(_MOST_LABELS))
        plain = ScalarFormatter(useMathText=True)
        plain.set_powerlimits((-3, 4))
        axis.set_major_formatter(plain)
    else:
        powers = LogFormatterSciNotation(minor_thresholds=(np.inf, np.inf))
        # Written as powers, three in each of several decades run into each other again.
        wide = low <= _SMALL and high > 10.0 * low
        axis.set_major_locator(LogLocator(subs=(1.0, 3.0) if wide else (1.0, 2.0, 5.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}") if low > _SMALL else powers)
    axis.set_minor_formatter(NullFormatter())
