"""A fitted model over the curves it was fitted to, and what it leaves unexplained."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.plotting.columns import Column, columns_of
from iwanjax.plotting.curves import DAMPING_LABEL, amplitude_label, frequency_label
from iwanjax.plotting.joints import landmark
from iwanjax.plotting.style import (
    DOUBLE_COLUMN,
    GREY,
    PALETTE,
    SINGLE_COLUMN,
    mark_amplitude,
    paper_style,
    plain_ticks,
    set_up,
)
from iwanjax.quasistatic.modal import ModalOscillator

if TYPE_CHECKING:
    from iwanjax.studies.fits import StudyFit
    from iwanjax.updating.solution import FitSolution

MEASURED, MODEL, HELD_OUT = PALETTE[0], PALETTE[1], PALETTE[2]
"""Colours of the three kinds of curves in these figures."""

# The axis goes this factor beyond the amplitudes.
_BEYOND = 1.15
# A landmark this far beyond the measured amplitudes is still shown.
_NEAR = 2.0
# Damping that spans more than this factor is drawn on a logarithmic axis.
_WIDE = 3.0
# More points than these are drawn small, and more still without every bar.
_MANY = 60
# The lightest shade is this far on the way to white.
_LIGHTEST = 0.55
# Points whose deviation is a larger share of their damping do not stretch the axis.
_KNOWN = 0.5
# A bar that reaches below zero ends this far below its point on a logarithmic axis.
_LOWEST_SHARE = 0.1
# Share of the range that is left free above and below.
_MARGIN = 0.06
# Residual panels reach at least this far, deviations.
_LEAST_RESIDUAL = 2.6


@paper_style()
def plot_fit(solution: "FitSolution", held_out: Sequence[ModalCurves] = ()) -> Figure:
    """Measured frequency and damping, the fitted model, and the residuals under each.

    Points are measured, with bars of one standard deviation; each hit has its shade. The
    line is the model, its band one deviation of the fit, linearised (a parameter that rests
    on a bound does not widen it). A dotted line marks the amplitude at which the joint
    reaches macroslip, where that is near the measured ones and no other minimum is as good.
    Residuals are measured less model over the stated deviation; lines mark one and two of
    them.

    An oscillator has all hits in one column; a structure has a column for each mode.
    Where frequencies were compared up to an offset, their shift is shown.

    Parameters
    ----------
    solution : FitSolution
        Result of :func:`iwanjax.fit`.
    held_out : sequence of ModalCurves
        Hits that were not fitted, against the same quantity as those that were. For several
        modes of a structure they bear the name of the mode's fitted curve.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For something that is not a FitSolution, and held-out hits that belong to no mode or
        are against another quantity.
    """
    _check(solution, held_out)
    columns = columns_of(solution, held_out)
    figure, panels = panels_for(len(columns), residuals=True)
    for column, (f, f_residual, zeta, zeta_residual) in zip(columns, panels.T, strict=True):
        draw_model(f, zeta, column)
        draw_measured(f, zeta, column)
        set_limits(f, zeta, column)
        _draw_residuals(f_residual, zeta_residual, column)
        where = _landmark(solution, column)
        if where is not None:
            for ax in (f, f_residual, zeta, zeta_residual):
                # The falling frequency leaves room above itself towards large amplitudes.
                mark_amplitude(ax, where[0], where[1] if ax is f else "", rising=True)
        zeta_residual.set_xlabel(amplitude_label(column.measured[0]))
        if len(columns) > 1:
            f.set_title(column.measured[0].name)
    label_panels(panels, columns)
    handles = [
        *measured_handles(columns, solution),
        Line2D([], [], color=MODEL, label="model"),
        Patch(facecolor=MODEL, alpha=0.25, label=r"$\pm\sigma$ of the fit"),
    ]
    narrow = len(columns) == 1 and len(handles) > 3
    figure.legend(handles=handles, loc="outside upper center", ncols=2 if narrow else 4)
    return figure


def panels_for(columns: int, *, residuals: bool) -> tuple[Figure, np.ndarray]:
    """A figure with a panel each for frequency and damping, and slim ones beneath if wanted."""
    rows = 4 if residuals else 2
    figure, panels = plt.subplots(
        rows,
        columns,
        sharex="col",
        squeeze=False,
        figsize=(SINGLE_COLUMN if columns == 1 else DOUBLE_COLUMN, 5.2 if residuals else 3.8),
        height_ratios=(1.0, 0.38, 1.0, 0.38) if residuals else None,
        layout="constrained",
    )
    set_up(*panels.ravel())
    return figure, panels


def label_panels(panels: np.ndarray, columns: Sequence[Column]) -> None:
    """Labels on the left of all rows."""
    residuals = len(panels) == 4
    left = panels[:, 0]
    left[0].set_ylabel(frequency_label(columns[0].shift))
    left[2 if residuals else 1].set_ylabel(DAMPING_LABEL)
    if residuals:
        left[1].set_ylabel(r"$\Delta/\sigma$ (–)")
        left[3].set_ylabel(r"$\Delta/\sigma$ (–)")
    left[0].figure.align_ylabels(list(left))


def draw_model(f: Axes, zeta: Axes, column: Column) -> None:
    """The model's line and band."""
    line = column.model
    x = np.asarray(line.amplitude)
    for ax, value, std in (
        (f, np.asarray(line.frequency) - column.base, line.frequency_std),
        (zeta, np.asarray(line.damping), line.damping_std),
    ):
        ax.plot(x, value, color=MODEL, zorder=2.6)
        if std is not None:
            std = np.asarray(std)
            ax.fill_between(
                x, value - std, value + std, color=MODEL, alpha=0.25, linewidth=0.0, zorder=2.5
            )


def draw_measured(f: Axes, zeta: Axes, column: Column) -> None:
    """Points with bars, the fitted hits in shades of one colour."""
    hits = (*column.measured, *column.held_out)
    for i, (hit, look) in enumerate(zip(hits, _looks(column), strict=True)):
        _draw_points(f, hit, column.aligned(i) - column.base, hit.frequency_std, look)
        _draw_points(zeta, hit, np.asarray(hit.damping), hit.damping_std, look)


def set_limits(f: Axes, zeta: Axes, column: Column) -> None:
    """Axes that show the line and all points that are known well enough."""
    hits = (*column.measured, *column.held_out)
    damping = np.concatenate([_ends(hit, "damping", np.asarray(hit.damping)) for hit in hits])
    frequency = np.concatenate(
        [_ends(hit, "frequency", column.aligned(i)) - column.base for i, hit in enumerate(hits)]
    )
    x = np.concatenate([np.asarray(hit.amplitude) for hit in hits])
    x = x[np.isfinite(x)]
    inside = slice(*np.searchsorted(np.asarray(column.model.amplitude), [x.min(), x.max()]))
    frequency = np.append(frequency, np.asarray(column.model.frequency)[inside] - column.base)
    damping = np.append(damping, np.asarray(column.model.damping)[inside])
    damping = damping[damping > 0]
    wide = damping.size > 0 and damping.max() > _WIDE * damping.min()
    f.set(xscale="log", xlim=(x.min() / _BEYOND, x.max() * _BEYOND))
    zeta.set(xscale="log", yscale="log" if wide else "linear")
    plain_ticks(zeta.xaxis, x.min(), x.max())
    if wide:
        plain_ticks(zeta.yaxis, damping.min(), damping.max())
    f.set_ylim(*_widened(frequency))
    if damping.size:
        zeta.set_ylim(*(np.exp(_widened(np.log(damping))) if wide else _widened(damping)))


def measured_handles(columns: Sequence[Column], solution: "FitSolution") -> list[Line2D]:
    """Legend of the points."""
    count = max(len(column.measured) for column in columns)
    dots = {"linestyle": "", "markersize": 4.0}
    text = "measured" if count == 1 else f"measured, {count} hits"
    if solution.coupling is not None:
        text += ", less what other modes did"
    handles = [Line2D([], [], color=MEASURED, marker=".", label=text, **dots)]
    if any(column.held_out for column in columns):
        style = {"marker": "D", "markerfacecolor": "none", "markeredgewidth": 0.7}
        handles.append(Line2D([], [], color=HELD_OUT, label="held out", **dots | style))
    return handles


@dataclass(frozen=True)
class _Look:
    """How the points of a hit are drawn."""

    color: str
    marker: str
    size: float
    width: float


def _looks(column: Column) -> list[_Look]:
    """Shades of one colour for the fitted hits, the first darkest; diamonds for the others."""
    many = sum(hit.amplitude.size for hit in (*column.measured, *column.held_out)) > _MANY
    width = 0.4 if many else 0.7
    count = len(column.measured)
    steps = _LIGHTEST * np.arange(count) / max(1, count - 1)
    blue, white = np.array(to_rgb(MEASURED)), np.ones(3)
    shades = [to_hex((1.0 - step) * blue + step * white) for step in steps]
    fitted = [_Look(shade, ".", 2.5 if many else 4.0, width) for shade in shades]
    held = _Look(HELD_OUT, "D", 2.0 if many else 3.0, width)
    return [*fitted, *(held for _ in column.held_out)]


def _draw_points(
    ax: Axes, hit: ModalCurves, value: np.ndarray, std: object, look: _Look
) -> ErrorbarContainer:
    """Points and bars; a bar ends above zero where its point does."""
    bars = None
    if std is not None:
        down = np.asarray(std)
        if ax.get_yscale() == "log" or np.all(value[np.isfinite(value)] > 0):
            down = np.where(value > 0, np.minimum(down, (1.0 - _LOWEST_SHARE) * value), down)
        bars = np.stack([down, np.asarray(std)])
    return ax.errorbar(
        np.asarray(hit.amplitude),
        value,
        yerr=bars,
        fmt=look.marker,
        color=look.color,
        markersize=look.size,
        markerfacecolor=look.color if look.marker == "." else "none",
        markeredgewidth=look.width,
        elinewidth=look.width,
    )


def _draw_residuals(f: Axes, zeta: Axes, column: Column) -> None:
    """Measured less model over the stated deviation."""
    hits = (*column.measured, *column.held_out)
    for ax, name in ((f, "frequency"), (zeta, "damping")):
        for level, style in ((0.0, "-"), (1.0, "--"), (-1.0, "--"), (2.0, ":"), (-2.0, ":")):
            ax.axhline(level, color=GREY, linestyle=style, linewidth=0.5, zorder=1.6)
        largest = _LEAST_RESIDUAL
        for i, (hit, look) in enumerate(zip(hits, _looks(column), strict=True)):
            std = getattr(hit, f"{name}_std")
            if std is None:
                continue
            value = column.aligned(i) if name == "frequency" else np.asarray(hit.damping)
            shown = (value - np.asarray(getattr(column.explained[i], name))) / np.asarray(std)
            filled = look.color if look.marker == "." else "none"
            ax.plot(
                np.asarray(hit.amplitude),
                shown,
                look.marker,
                color=look.color,
                markersize=0.8 * look.size,
                markerfacecolor=filled,
                markeredgewidth=look.width,
            )
            if np.any(np.isfinite(shown)):
                largest = max(largest, 1.1 * float(np.nanmax(np.abs(shown))))
        ax.set_ylim(-largest, largest)
        ax.grid(visible=False)
        ax.locator_params(axis="y", nbins=4)


def _landmark(solution: "FitSolution", column: Column) -> tuple[float, str] | None:
    """Where an oscillator's joint changes its character, if that is near what was measured."""
    if not isinstance(solution.model, ModalOscillator) or solution.rivals:
        return None
    special = landmark(solution.model.joint)
    if special is None:
        return None
    first = column.measured[0]
    curve = solution.model.curves([special.deflection]).as_quantity(first.quantity)
    where = float(curve.amplitude[0])
    x = np.concatenate([np.asarray(hit.amplitude) for hit in (*column.measured, *column.held_out)])
    if not np.nanmin(x) / _NEAR < where < np.nanmax(x) * _NEAR:
        return None
    return where, special.event


def _ends(hit: ModalCurves, name: str, value: np.ndarray) -> np.ndarray:
    """Ends of the bars of the points that are known well enough to be looked at."""
    std = getattr(hit, f"{name}_std")
    if std is None:
        return value[np.isfinite(value)]
    std, damping_std = (
        np.asarray(std),
        np.asarray(hit.damping_std if hit.damping_std is not None else np.zeros(value.size)),
    )
    known = np.isfinite(value) & (damping_std < _KNOWN * np.asarray(hit.damping))
    known = known if np.any(known) else np.isfinite(value)
    return np.concatenate([(value - std)[known], (value + std)[known]])


def _widened(values: np.ndarray) -> tuple[float, float]:
    low, high = float(np.min(values)), float(np.max(values))
    margin = _MARGIN * (high - low) or 1e-3 * abs(high)
    return low - margin, high + margin


def _check(solution: "FitSolution", held_out: Sequence[ModalCurves]) -> None:
    from iwanjax.updating.solution import FitSolution

    if not isinstance(solution, FitSolution):
        raise InputError(f"plot_fit expects a FitSolution, got {type(solution).__name__}")
    first, names = solution.measured[0], [curve.name for curve in solution.measured]
    several = len(names) > 1 and not isinstance(solution.model, ModalOscillator)
    for each in held_out:
        if not isinstance(each, ModalCurves):
            raise InputError(f"plot_fit: held_out holds a {type(each).__name__}")
        if (each.quantity, each.unit) != (first.quantity, first.unit):
            raise InputError(
                f"plot_fit: a held-out hit is against {amplitude_label(each)}, the fitted ones "
                f"against {amplitude_label(first)}; bring it to that with ModalCurves.as_quantity"
            )
        if several and each.name not in names:
            raise InputError(
                f"plot_fit: a held-out hit is called {each.name!r}, the modes that were fitted "
                f"are called {', '.join(names)}"
            )


def plot_study_fit(fit: "StudyFit", **options: Any) -> Figure:
    """A fit of a study with the curves that it has not seen; options of :func:`plot_fit`."""
    held_out = [row.curves for row in fit.held_out if row.curves is not None]
    return plot_fit(fit.solution, held_out, **options)
