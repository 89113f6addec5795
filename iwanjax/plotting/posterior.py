"""What a posterior says of the parameters, and of the curves."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.plotting.columns import Column, columns_of, offset
from iwanjax.plotting.curves import amplitude_label
from iwanjax.plotting.fit import (
    MEASURED,
    MODEL,
    draw_measured,
    label_panels,
    measured_handles,
    panels_for,
    set_limits,
)
from iwanjax.plotting.scales import Scale
from iwanjax.plotting.style import GREY, paper_style, set_up

if TYPE_CHECKING:
    from iwanjax.estimation.parameters import Parameter
    from iwanjax.updating.posterior import Band, Posterior

# Size of a panel, and of what is left and below for labels, above and right, and between, in.
_PANEL, _LABELS, _EDGE, _GAP = 0.85, 0.8, 0.08, 0.06
# Labels stand here, as far from the panels as the longest ticks ask for, in.
_LABEL_AT = 0.38
# Deviation that smooths the histograms of two parameters, bins.
_SMOOTH = 1.2
# Shares of the draws within the contours.
_CONTOURS = (0.68, 0.95)
# Shares of the draws within the bands of the curves, with the opacity of each.
_BANDS = ((0.9, 0.2), (0.5, 0.3))


@paper_style()
def plot_posterior(posterior: "Posterior") -> Figure:
    """Every parameter's distribution, and that of every pair.

    On the diagonal the draws' histogram, the prior's density (dashed) and the fit's
    estimate (vertical line); below it the areas that hold 68 and 95 per cent of the draws
    of each pair and the estimate (cross). Noise scales have neither prior nor estimate
    drawn. Strengths whose central 95 per cent span more than a factor of five are on a logarithmic
    axis, and the density is that of the logarithm; values that differ in their last digits
    are shown by their distance from the number in the label.

    Parameters
    ----------
    posterior : Posterior
        Result of :func:`iwanjax.sample_posterior`.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For something that is not a Posterior, or holds no draws.
    """
    _check(posterior)
    parameters = {p.name: p for p in posterior.solution.parameters}
    scales = [
        Scale.of(name, values, parameters.get(name)) for name, values in posterior.samples.items()
    ]
    shown = [
        scale.of_values(v) for scale, v in zip(scales, posterior.samples.values(), strict=True)
    ]
    count = len(scales)
    figure, panels = _corner(count)
    set_up(*panels.ravel())
    for i in range(count):
        _draw_one(panels[i, i], scales[i], shown[i], parameters.get(scales[i].name))
        for j in range(count):
            ax = panels[i, j]
            if j > i:
                ax.remove()
            elif j < i:
                _draw_pair(ax, (scales[j], scales[i]), (shown[j], shown[i]))
        _label_panel(panels[count - 1, i], panels[i, 0] if i else None, scales[i].label)
    _set_ticks(panels, scales)
    figure.legend(
        handles=[
            *(
                Patch(facecolor=MEASURED, alpha=opacity, label=f"{100 * share:.0f} % of the draws")
                for share, opacity in zip(_CONTOURS, (0.7, 0.35), strict=True)
            ),
            Line2D([], [], color=GREY, linestyle="--", linewidth=0.9, label="prior"),
            Line2D([], [], color=MODEL, linewidth=0.9, marker="+", label="fit"),
        ],
        loc="upper right",
    )
    return figure


@paper_style()
def plot_bands(posterior: "Posterior") -> Figure:
    """Measured frequency and damping over the ranges that the posterior predicts.

    The line is the median, the shades hold 50 and 90 per cent of the draws: they are the
    parameters' share of the uncertainty, not where a further measurement would lie.

    Parameters
    ----------
    posterior : Posterior
        Result of :func:`iwanjax.sample_posterior`.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For something that is not a Posterior, or holds no draws.
    """
    _check(posterior)
    columns = columns_of(posterior.solution)
    figure, panels = panels_for(len(columns), residuals=False)
    bands = {share: posterior.bands(share) for share, _ in _BANDS}
    first = 0
    for column, (f, zeta) in zip(columns, panels.T, strict=True):
        own = slice(first, first + len(column.measured))
        first = own.stop
        for share, opacity in _BANDS:
            line = _joined(column, bands[share][own])
            for ax, value in ((f, line.frequency - column.base), (zeta, line.damping)):
                low, middle, high = value
                ax.fill_between(
                    line.amplitude, low, high, color=MODEL, alpha=opacity, linewidth=0.0
                )
                if share == _BANDS[-1][0]:
                    ax.plot(line.amplitude, middle, color=MODEL, linewidth=0.9, zorder=2.4)
        draw_measured(f, zeta, column)
        set_limits(f, zeta, column)
        zeta.set_xlabel(amplitude_label(column.measured[0]))
        if len(columns) > 1:
            f.set_title(column.measured[0].name)
    label_panels(panels, columns)
    figure.legend(
        handles=[
            *measured_handles(columns, posterior.solution),
            Line2D([], [], color=MODEL, linewidth=0.9, label="median"),
            Patch(facecolor=MODEL, alpha=0.45, label="50 %"),
            Patch(facecolor=MODEL, alpha=0.2, label="90 %"),
        ],
        loc="outside upper center",
        ncols=4,
    )
    return figure


def _corner(count: int) -> tuple[Figure, np.ndarray]:
    """Square panels at fixed places: a layout engine would space them by their tick labels."""
    size = _LABELS + count * (_PANEL + _GAP) + _EDGE
    near, far = _LABELS / size, 1.0 - _EDGE / size
    figure, panels = plt.subplots(
        count,
        count,
        squeeze=False,
        figsize=(size, size),
        gridspec_kw={
            "left": near,
            "bottom": near,
            "right": far,
            "top": far,
            "wspace": _GAP / _PANEL,
            "hspace": _GAP / _PANEL,
        },
    )
    return figure, panels


def _label_panel(bottom: Axes, left: Axes | None, label: str) -> None:
    """Labels in line with each other."""
    # In shares of a panel, which is what the places of labels are counted in.
    away = -_LABEL_AT / _PANEL
    bottom.set_xlabel(label, fontsize=7.0, verticalalignment="top")
    bottom.xaxis.set_label_coords(0.5, away)
    if left is not None:
        left.set_ylabel(label, fontsize=7.0, verticalalignment="bottom")
        left.yaxis.set_label_coords(away, 0.5)


def _draw_one(ax: Axes, scale: Scale, shown: np.ndarray, parameter: "Parameter | None") -> None:
    """Histogram, prior and estimate of one parameter."""
    edges = scale.edges
    density, _ = np.histogram(shown, edges)
    # Draws beyond the axis count too, as they do in the prior's density.
    density = density / (shown.size * (edges[1] - edges[0]))
    ax.stairs(density, edges, color=MEASURED, fill=True, alpha=0.35)
    ax.stairs(density, edges, color=MEASURED, linewidth=0.8)
    if parameter is not None:
        at = np.linspace(scale.low, scale.high, 300)
        ax.plot(at, _prior_density(parameter, scale, at), color=GREY, linestyle="--", linewidth=0.9)
    if scale.estimate is not None:
        ax.axvline(scale.estimate, color=MODEL, linewidth=0.9)
    ax.set_ylim(0.0, 1.15 * float(np.max(density)) or 1.0)
    ax.set_xlim(*scale.ends)
    ax.set_yticks([])
    ax.grid(visible=False)


def _prior_density(parameter: "Parameter", scale: Scale, at: np.ndarray) -> np.ndarray:
    """The prior's density per unit of the axis, nothing beyond the parameter's bounds."""
    values = scale.to_values(at)
    density = np.exp(np.asarray(parameter.prior.log_density(jnp.asarray(values))))
    slope = values * math.log(10.0) if scale.logarithmic else 10.0**scale.power
    inside = (values >= parameter.lower) & (values <= parameter.upper)
    return np.where(inside, density * slope, 0.0)


def _draw_pair(ax: Axes, scales: tuple[Scale, Scale], shown: tuple[np.ndarray, ...]) -> None:
    """Areas that hold most of the draws of two parameters, and the estimate."""
    x, y = scales
    counts, _, _ = np.histogram2d(*shown, bins=(x.edges, y.edges))
    from scipy.ndimage import gaussian_filter  # here, because it takes a third of a second

    smooth = gaussian_filter(counts, _SMOOTH, mode="nearest")
    levels = sorted({_level(smooth, share) for share in _CONTOURS})
    # The outer bins reach to the ends of the axes, so that areas do not stop short of a bound.
    grid = [
        np.concatenate([edges[:1], 0.5 * (edges[1:] + edges[:-1]), edges[-1:]])
        for edges in (x.edges, y.edges)
    ]
    smooth = np.pad(smooth, 1, mode="edge").T
    if levels and levels[-1] < smooth.max():
        for level, opacity in zip(levels, (0.35, 0.5), strict=False):
            ax.contourf(*grid, smooth, [level, np.inf], colors=[MEASURED], alpha=opacity)
        ax.contour(*grid, smooth, levels, colors=[MEASURED], linewidths=0.6)
    if x.estimate is not None and y.estimate is not None:
        ax.plot(x.estimate, y.estimate, "+", color=MODEL, markersize=6.0, markeredgewidth=1.0)
    ax.set_xlim(*x.ends)
    ax.set_ylim(*y.ends)
    ax.grid(visible=False)


def _level(density: np.ndarray, share: float) -> float:
    """The density above which this share of the whole lies."""
    falling = np.sort(density.ravel())[::-1]
    total = np.cumsum(falling)
    return float(falling[min(np.searchsorted(total, share * total[-1]), falling.size - 1)])


def _set_ticks(panels: np.ndarray, scales: Sequence[Scale]) -> None:
    """A few labels at the left and at the bottom only."""
    last = len(scales) - 1
    for i in range(last + 1):
        for j in range(i + 1):
            ax = panels[i, j]
            scales[j].place_ticks(ax.xaxis)
            if j < i:
                scales[i].place_ticks(ax.yaxis)
            ax.tick_params(
                labelsize=6.0, labelbottom=i == last, labelleft=j == 0 and i > 0, length=2.0
            )
            ax.tick_params(axis="both", labelrotation=45.0)


def _joined(column: Column, bands: "Sequence[Band]") -> "Band":
    """The bands of all hits as one, with rising amplitudes, where the column has its points."""
    from iwanjax.updating.posterior import Band

    frequencies = []
    for i, band in enumerate(bands):
        frequency = band.frequency
        if column.shift:
            hit = column.measured[i]
            aligned = ModalCurves(
                hit.amplitude, column.aligned(i), hit.damping, frequency_std=hit.frequency_std
            )
            frequency = frequency - offset(aligned, frequency[1])
        frequencies.append(frequency)
    amplitude = np.concatenate([band.amplitude for band in bands])
    rising = np.argsort(amplitude)
    return Band(
        amplitude[rising],
        np.concatenate(frequencies, axis=1)[:, rising],
        np.concatenate([band.damping for band in bands], axis=1)[:, rising],
    )


def _check(posterior: "Posterior") -> None:
    from iwanjax.updating.posterior import Posterior

    if not isinstance(posterior, Posterior):
        raise InputError(f"expected a Posterior, got {type(posterior).__name__}")
    if not posterior.chain.size:
        raise InputError("the posterior holds no draws; give it more steps")
