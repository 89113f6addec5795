"""Modes' curves as the joints alone explain them, and with what they lack."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from iwanjax.discrepancy.diagnosis import Diagnosis
from iwanjax.discrepancy.findings import Prediction
from iwanjax.discrepancy.steady.runs import CurveRun, ModesRun
from iwanjax.errors import InputError
from iwanjax.plotting.curves import DAMPING_LABEL, amplitude_label, frequency_label
from iwanjax.plotting.style import (
    DOUBLE_COLUMN,
    GREY,
    PALETTE,
    paper_style,
    plain_ticks,
    set_up,
)

_BEFORE, _AFTER, _HELD_OUT = PALETTE[0], PALETTE[1], PALETTE[2]
# Residual panels reach at least this far, deviations, and grow no further than this.
_LEAST, _MOST = 3.0, 30.0


@paper_style()
def plot_explained(diagnosis: Diagnosis) -> Figure:
    """Measured frequency and damping of modes, the models before and after, and residuals.

    Points are measured, with bars of one standard deviation; diamonds were held out. Lines are
    the joint alone and, where something is missing, the joint with what was found. Below,
    measured less either model over the stated deviation.

    Parameters
    ----------
    diagnosis : Diagnosis
        Result of :func:`iwanjax.diagnose` by curves.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For a diagnosis of time histories.
    """
    before, after = (_by_mode(run) for run in diagnosis.runs)
    figure, panels = plt.subplots(
        2 * len(before),
        2,
        figsize=(DOUBLE_COLUMN, 0.6 + 2.8 * len(before)),
        height_ratios=(1.0, 0.45) * len(before),
        layout="constrained",
    )
    set_up(*panels.ravel())
    styles = [(before, _BEFORE, "--", "joints alone" if len(before) > 1 else "joint alone")]
    if diagnosis.what:
        styles.append((after, _AFTER, "-", "with what was found"))
    for i, label in enumerate(before):
        models = [(runs[label], colour, style) for runs, colour, style, _ in styles]
        _mode(panels[2 * i : 2 * i + 2], label, models)
    handles = [Line2D([], [], color=GREY, marker="o", ls="", markersize=3.0, label="measured")]
    if any(run.fitted < len(run.measured) for run in before.values()):
        held = Line2D([], [], color=_HELD_OUT, marker="D", ls="", markersize=3.0, label="held out")
        held.set_markerfacecolor("none")
        handles.append(held)
    for _, colour, style, label in styles:
        handles.append(Line2D([], [], color=colour, ls=style, label=label))
    figure.legend(handles=handles, loc="outside upper center", ncols=4)
    return figure


def _by_mode(run: Prediction) -> dict[str, CurveRun]:
    """Curves of each mode under its name; a single one has none."""
    if isinstance(run, ModesRun):
        return dict(zip(run.labels, run.modes, strict=True))
    if isinstance(run, CurveRun):
        return {"": run}
    raise InputError("plot_explained: expected a diagnosis of curves; see plot_prediction")


def _mode(panels: np.ndarray, label: str, models: list[tuple[CurveRun, str, str]]) -> None:
    """Both quantities of one mode, their residuals below."""
    before = models[0][0]
    for column, quantity in zip(panels.T, ("frequency", "damping"), strict=True):
        column[1].sharex(column[0])
        column[0].tick_params(labelbottom=False)
        _measured(column[0], before, quantity)
        for run, colour, style in models:
            _model(column[0], run, quantity, colour, style, joined=run is before)
        _residuals(column[1], models, quantity)
        column[1].set_xlabel(amplitude_label(before.measured[0]))
        column[1].set_ylabel(r"$\Delta/\sigma$ (–)")
        x = np.concatenate([np.asarray(each.amplitude) for each in before.measured])
        column[0].set_xscale("log")
        plain_ticks(column[1].xaxis, x.min(), x.max())
    panels[0, 0].set_title(label, loc="left")
    panels[0, 0].set_ylabel(frequency_label(False))
    panels[0, 1].set_ylabel(DAMPING_LABEL)
    panels[0, 1].set_yscale("log")


def _measured(ax: Axes, run: CurveRun, quantity: str) -> None:
    for i, curve in enumerate(run.measured):
        held = i >= run.fitted
        ax.errorbar(
            np.asarray(curve.amplitude),
            np.asarray(getattr(curve, quantity)),
            yerr=np.asarray(getattr(curve, f"{quantity}_std")),
            fmt="D" if held else "o",
            color=_HELD_OUT if held else GREY,
            markersize=2.2 if held else 1.6,
            markerfacecolor="none" if held else GREY,
            markeredgewidth=0.5,
            elinewidth=0.4,
        )


def _model(
    ax: Axes, run: CurveRun, quantity: str, colour: str, style: str, *, joined: bool
) -> None:
    """One line where joints alone say it all; one for each hit where another mode differs."""
    pairs = [
        (np.asarray(each.amplitude), np.asarray(getattr(each, quantity))) for each in run.predicted
    ]
    if joined:
        pairs = [tuple(map(np.concatenate, zip(*pairs, strict=True)))]
    for x, y in pairs:
        rising = np.argsort(x)
        ax.plot(x[rising], y[rising], style, color=colour, linewidth=1.1, zorder=2.6)


def _residuals(ax: Axes, models: list[tuple[CurveRun, str, str]], quantity: str) -> None:
    largest = _LEAST
    for level, style in ((0.0, "-"), (2.0, ":"), (-2.0, ":")):
        ax.axhline(level, color=GREY, linestyle=style, linewidth=0.5, zorder=1.6)
    for run, colour, _ in models:
        for seen, model in zip(run.measured, run.predicted, strict=True):
            off = np.asarray(getattr(seen, quantity)) - np.asarray(getattr(model, quantity))
            off = off / np.asarray(getattr(seen, f"{quantity}_std"))
            ax.plot(np.asarray(seen.amplitude), off, ".", color=colour, markersize=2.0)
            largest = max(largest, float(np.max(np.abs(off))))
    ax.set_ylim(-min(largest, _MOST) * 1.1, min(largest, _MOST) * 1.1)
    ax.grid(visible=False)
