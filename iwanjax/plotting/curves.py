"""Frequency and damping against amplitude."""

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.plotting.style import PALETTE, SINGLE_COLUMN, paper_style, set_up, with_unit
from iwanjax.types import ArrayLike

DAMPING_LABEL = r"Damping ratio $\zeta$ (–)"

# Curves of few levels show them one by one.
_FEW_LEVELS = 40
# Opacity of the bands of two deviations and of one, which lies upon it.
_SHADES = ((2.0, 0.15), (1.0, 0.2))
# Horizontal bars of the amplitude's deviation, as many as stay legible.
_BARS = 12
# A band may reach below zero; on a logarithmic axis it ends this far below its curve.
_LOWEST_SHARE = 0.1


@paper_style()
def plot_curves(curves: ModalCurves | Sequence[ModalCurves], *, shift: bool = False) -> Figure:
    """Frequency above damping ratio, against a common amplitude.

    A single curve is a line, with its levels as points where they are few, one and two
    standard deviations as shades, and the amplitude's deviation as horizontal bars.
    Curves with leading axes are thin translucent lines, one for each of the batch, without
    deviations. Levels that are NaN are missing.

    Parameters
    ----------
    curves : ModalCurves or sequence of ModalCurves
        Several share the axes and are told apart by ``name``.
    shift : bool
        Whether to show the frequency's shift from its value at the lowest amplitude, Hz.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For something that is not ModalCurves, for nothing, and for amplitudes of
        different quantities or units.
    """
    several = [curves] if isinstance(curves, ModalCurves) else list(curves)
    _check(several)
    figure, (upper, lower) = plt.subplots(
        2, 1, sharex=True, figsize=(SINGLE_COLUMN, 3.8), layout="constrained"
    )
    set_up(upper, lower)
    colors = [PALETTE[i % len(PALETTE)] for i in range(len(several))]
    for each, color in zip(several, colors, strict=True):
        draw_curves(upper, lower, each, color=color, shift=shift)
    upper.set_ylabel(frequency_label(shift))
    lower.set_ylabel(DAMPING_LABEL)
    lower.set_xlabel(amplitude_label(several[0]))
    figure.align_ylabels([upper, lower])
    handles = [
        Line2D([], [], color=color, label=each.name or f"curve {i + 1}")
        for i, (each, color) in enumerate(zip(several, colors, strict=True))
    ]
    if len(several) > 1 or several[0].name:
        figure.legend(handles=handles, loc="outside upper center", ncols=min(3, len(several)))
    return figure


def frequency_label(shift: bool) -> str:
    """Label of the frequency axis."""
    return r"Frequency shift $\Delta f$ (Hz)" if shift else "Frequency $f$ (Hz)"


def amplitude_label(curves: ModalCurves) -> str:
    """Label of the amplitude axis, from what the curves say of themselves."""
    quantity = f"{curves.quantity} amplitude"
    return with_unit(quantity[0].upper() + quantity[1:], curves.unit)


def draw_curves(
    frequency_axes: Axes,
    damping_axes: Axes,
    curves: ModalCurves,
    *,
    color: str,
    shift: bool = False,
) -> None:
    """Add curves to a panel for frequency and one for damping; arguments as ``plot_curves``'s."""
    frequency = np.asarray(curves.frequency)
    amplitude = np.asarray(curves.amplitude)
    if shift:
        known = np.isfinite(frequency) & np.isfinite(amplitude)
        lowest = np.argmin(np.where(known, amplitude, np.inf), axis=-1)[..., None]
        frequency = frequency - np.take_along_axis(frequency, lowest, axis=-1)
    damping = np.asarray(curves.damping)
    damping = np.where(damping > 0, damping, np.nan)
    frequency_axes.set_xscale("log")
    damping_axes.set(xscale="log", yscale="log")
    panels = (
        (frequency_axes, frequency, curves.frequency_std),
        (damping_axes, damping, curves.damping_std),
    )
    for ax, value, deviation in panels:
        if value.size == value.shape[-1]:
            _draw_one(ax, amplitude, value, deviation, curves.amplitude_std, color)
        else:
            x, y = (lanes.reshape(-1, lanes.shape[-1]).T for lanes in (amplitude, value))
            # Translucent, so that many lines show where they are dense.
            ax.plot(x, y, color=color, linewidth=0.6, alpha=max(0.05, x.shape[1] ** -0.5))


def _draw_one(
    ax: Axes,
    amplitude: np.ndarray,
    value: np.ndarray,
    deviation: ArrayLike | None,
    amplitude_deviation: ArrayLike | None,
    color: str,
) -> None:
    """A line with what is known of its uncertainty."""
    x, y = amplitude.ravel(), value.ravel()
    ax.plot(x, y, color=color, marker="." if x.size <= _FEW_LEVELS else "")
    if deviation is not None and np.any(np.isfinite(y)):
        std = np.ravel(deviation)
        floor = _LOWEST_SHARE * np.nanmin(y) if ax.get_yscale() == "log" else -np.inf
        for factor, opacity in _SHADES:
            lower = np.maximum(y - factor * std, floor)
            band = ax.fill_between(
                x, lower, y + factor * std, color=color, alpha=opacity, linewidth=0.0
            )
            # Where a band is cut off the axis ends too, as it would if the band went on.
            band.sticky_edges.y.append(float(floor))
    if amplitude_deviation is not None:
        shown = slice(None, None, -(-x.size // _BARS))
        std = np.ravel(amplitude_deviation)
        ax.errorbar(x[shown], y[shown], xerr=std[shown], fmt="none", ecolor=color, elinewidth=0.7)


def _check(curves: Sequence[ModalCurves]) -> None:
    """Whether curves can share their axes."""
    if not curves:
        raise InputError("plot_curves: nothing to draw")
    for each in curves:
        if not isinstance(each, ModalCurves):
            raise InputError(f"plot_curves expects ModalCurves, got {type(each).__name__}")
    kinds = sorted({with_unit(each.quantity, each.unit) for each in curves})
    if len(kinds) > 1:
        raise InputError(
            f"plot_curves: the curves are against different amplitudes ({'; '.join(kinds)}); "
            "bring them to one with ModalCurves.scaled"
        )
