"""A recording that was not fitted, beside its prediction: in time, by mode, against amplitude."""

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from iwanjax.plotting.curves import DAMPING_LABEL, frequency_label
from iwanjax.plotting.fit import MEASURED, MODEL
from iwanjax.plotting.style import (
    DOUBLE_COLUMN,
    GREY,
    paper_style,
    plain_ticks,
    set_up,
    with_unit,
)

if TYPE_CHECKING:
    from iwanjax.studies.predicted import Comparison, PredictedCurves, PredictedRecording

# Modes that are drawn, the largest ones.
_MOST_MODES = 3
# Windows from where the response begins that are drawn sample by sample.
_FIRST = 8
# Share of its peak at which a response begins.
_BEGINS = 0.02


@paper_style()
def plot_predicted(prediction: "PredictedRecording") -> Figure:
    """A recording held out and its prediction.

    Above: the beginning of the response of the sensor that moves most, and its amplitude over all
    of the time, both in windows of one period of the lowest mode; a dotted line marks the noise's.
    Below, for each of the modes that move it most: the amplitude of its part of that response, and
    its frequency and damping against amplitude with bars of one deviation. Bands are central
    ranges of the prediction by what the fit leaves open of the parameters.

    Parameters
    ----------
    prediction : PredictedRecording
        Of :meth:`iwanjax.Study.predict`.

    Returns
    -------
    Figure
    """
    # The amplitude of a mode that the noise hides throughout is not known.
    sizes = [np.nanmax(np.append(mode.amplitude.measured, 0.0)) for mode in prediction.modes]
    chosen = sorted(np.argsort(-np.array(sizes), kind="stable")[:_MOST_MODES].tolist())
    modes = [prediction.modes[i] for i in chosen]
    figure = plt.figure(
        figsize=(DOUBLE_COLUMN, 0.5 + 1.75 * (1 + len(modes))), layout="constrained"
    )
    grid = figure.add_gridspec(1 + len(modes), 6)
    first, whole = (figure.add_subplot(grid[0, part]) for part in (slice(3), slice(3, 6)))
    set_up(first, whole)
    column = prediction.sensors.index(prediction.shown)
    _draw_beginning(first, prediction, column)
    time = prediction.window_time
    noise = np.sqrt(2.0) * prediction.noise[column]
    _draw_amplitude(whole, time, prediction.amplitude.column(column))
    quantity = prediction.quantity.capitalize()
    first.set_ylabel(with_unit(f"{quantity} {prediction.shown}", prediction.unit))
    whole.set_ylabel(with_unit("Amplitude", prediction.unit))
    left = [first]
    for row, mode in enumerate(modes, start=1):
        parts = [slice(2 * i, 2 * i + 2) for i in range(3)] if mode.curves else [slice(6)]
        axes = [figure.add_subplot(grid[row, part]) for part in parts]
        set_up(*axes)
        left.append(axes[0])
        _draw_amplitude(axes[0], time, mode.amplitude)
        axes[0].set_ylabel(
            with_unit(f"{mode.name.capitalize()} at {prediction.shown}", prediction.unit)
        )
        if mode.curves is not None:
            _draw_curves(axes[1], axes[2], mode.curves)
    for ax in (whole, *left):
        ax.set_xlabel("Time $t$ (s)")
    figure.align_ylabels(left)
    share = f"{100 * prediction.probability:g} %"
    handles = [
        Line2D([], [], color=MEASURED, label=f"measured, {prediction.name}"),
        Line2D([], [], color=MODEL, linestyle="--", label="predicted"),
        Patch(facecolor=MODEL, alpha=0.25, label=f"central {share} by open parameters"),
    ]
    if noise > whole.get_ylim()[0]:
        whole.axhline(noise, color=GREY, linestyle=":", linewidth=0.8)
        handles.append(Line2D([], [], color=GREY, linestyle=":", label="amplitude of the noise"))
    figure.legend(handles=handles, loc="outside upper center", ncols=4)
    return figure


def _draw_beginning(ax: Axes, prediction: "PredictedRecording", column: int) -> None:
    """Some windows of a sensor's response, sample by sample."""
    found, time = prediction.response.column(column), prediction.time
    size = np.abs(found.measured)
    begin = int(np.argmax(size > _BEGINS * size.max()))
    windows = prediction.window_time
    step = windows[1] - windows[0] if windows.size > 1 else time[-1] - time[0]
    shown = slice(begin, int(np.searchsorted(time, time[begin] + _FIRST * step)) + 1)
    _draw_band(ax, time[shown], found.lower[shown], found.upper[shown])
    ax.plot(time[shown], found.measured[shown], color=MEASURED, linewidth=1.0)
    ax.plot(time[shown], found.predicted[shown], color=MODEL, linewidth=0.9, linestyle="--")
    ax.set_xlim(time[shown][0], time[shown][-1])


def _draw_amplitude(ax: Axes, time: np.ndarray, found: "Comparison") -> None:
    """Amplitudes in windows; as low as they fall after their peak."""
    ax.set_yscale("log")
    known = np.nan_to_num(found.measured)
    falling = known[int(np.argmax(known)) :]
    if np.any(known):
        low, high = 0.8 * float(np.min(falling[falling > 0.0])), 1.25 * float(known.max())
        ax.set_ylim(low, high)
        # Larger numbers are powers of ten.
        if high < 1e4:
            plain_ticks(ax.yaxis, low, high)
    _draw_band(ax, time, found.lower, found.upper)
    ax.plot(time, found.measured, color=MEASURED, linewidth=1.0)
    # Before it is moved it has no amplitude, which a logarithmic axis would begin in a wall.
    moving = np.where(found.predicted > 0.0, found.predicted, np.nan)
    ax.plot(time, moving, color=MODEL, linewidth=0.9, linestyle="--")
    ax.set_xlim(time[0], time[-1])


def _draw_curves(f: Axes, zeta: Axes, curves: "PredictedCurves") -> None:
    """Frequency and damping against amplitude."""
    pairs = (
        (f, curves.frequency, curves.frequency_std, frequency_label(shift=False)),
        (zeta, curves.damping, curves.damping_std, DAMPING_LABEL),
    )
    order = np.argsort(curves.amplitude)
    for ax, found, deviation, label in pairs:
        ax.set_xscale("log")
        x = curves.amplitude[order]
        _draw_band(ax, x, found.lower[order], found.upper[order])
        ax.errorbar(
            x,
            found.measured[order],
            yerr=deviation[order],
            fmt=".",
            color=MEASURED,
            markersize=4.0,
            elinewidth=0.7,
        )
        ax.plot(x, found.predicted[order], color=MODEL, linewidth=0.9, linestyle="--")
        plain_ticks(ax.xaxis, float(x[0]), float(x[-1]))
        # To the left, as the axis's power of ten stands at its right end.
        ax.set_xlabel("Modal displacement", loc="left")
        ax.set_ylabel(label)


def _draw_band(ax: Axes, x: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> None:
    ax.fill_between(x, lower, upper, color=MODEL, alpha=0.25, linewidth=0.0)
