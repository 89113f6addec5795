"""Loops of a joint as it explains them alone, and with what it lacks."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from iwanjax.discrepancy.diagnosis import Diagnosis
from iwanjax.discrepancy.steady.runs import LoopRun
from iwanjax.errors import InputError
from iwanjax.plotting.style import DOUBLE_COLUMN, GREY, PALETTE, paper_style, set_up, with_unit

_BEFORE, _AFTER = PALETTE[0], PALETTE[1]
# Loops side by side: the last of those fitted, then those held out; residuals reach so far at
# least, in deviations.
_MOST, _LEAST = 3, 3.0


@paper_style()
def plot_loops(diagnosis: Diagnosis) -> Figure:
    """Measured loops, the models before and after, and residuals.

    Points are measured. Lines are the joint alone and, where something is missing, the joint
    with what was found. Below, measured less either model over the force's deviation. Of many
    loops the last ones are shown, those held out among them.

    Parameters
    ----------
    diagnosis : Diagnosis
        Result of :func:`iwanjax.diagnose` of a joint.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For a diagnosis of time histories or curves.
    """
    before, after = diagnosis.runs
    if not (isinstance(before, LoopRun) and isinstance(after, LoopRun)):
        raise InputError("plot_loops: expected a diagnosis of loops; see plot_prediction")
    count = len(before.measured)
    held = max(1, _MOST - (count - before.fitted))
    shown = [*range(max(0, before.fitted - held), count)][:_MOST]
    figure, panels = plt.subplots(
        2,
        len(shown),
        sharex="col",
        figsize=(DOUBLE_COLUMN, 3.4),
        height_ratios=(1.0, 0.45),
        layout="constrained",
        squeeze=False,
    )
    set_up(*panels.ravel())
    models = [(before, _BEFORE, "--", "joint alone")]
    if diagnosis.what:
        models.append((after, _AFTER, "-", "with what was found"))
    for (top, bottom), i in zip(panels.T, shown, strict=True):
        measured = before.measured[i]
        top.plot(measured.d, measured.force, ".", color=GREY, markersize=2.0, zorder=2.2)
        for run, colour, style, _ in models:
            top.plot(measured.d, run.predicted[i], style, color=colour, linewidth=0.9, zorder=2.6)
        held_out = " (held out)" if i >= before.fitted else ""
        top.set_title(before.names[i] + held_out)
        bottom.set_xlabel(with_unit("Deflection $d$", measured.unit))
        _residuals(bottom, models, i)
    panels[0, 0].set_ylabel(with_unit("Force $F$", before.measured[shown[0]].force_unit))
    panels[1, 0].set_ylabel(r"$\Delta/\sigma$ (–)")
    handles = [Line2D([], [], color=GREY, marker=".", ls="", label="measured")]
    handles += [Line2D([], [], color=c, ls=style, label=label) for _, c, style, label in models]
    figure.legend(handles=handles, loc="outside upper center", ncols=3)
    return figure


def _residuals(ax: Axes, models: list[tuple[LoopRun, str, str, str]], i: int) -> None:
    largest = _LEAST
    for level, style in ((0.0, "-"), (2.0, ":"), (-2.0, ":")):
        ax.axhline(level, color=GREY, linestyle=style, linewidth=0.5, zorder=1.6)
    for run, colour, _, _ in models:
        off = (run.measured[i].force - run.predicted[i]) / run.noise[i]
        ax.plot(run.measured[i].d, off, ".", color=colour, markersize=1.5)
        largest = max(largest, float(np.max(np.abs(off))))
    ax.set_ylim(-1.1 * largest, 1.1 * largest)
    ax.grid(visible=False)
