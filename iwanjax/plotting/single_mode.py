"""Decays of several modes at once, beside what each mode would do alone."""

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from iwanjax.discrepancy.single_mode import ModeComparison
from iwanjax.dynamics.decays import ModalDecays
from iwanjax.errors import InputError
from iwanjax.plotting.curves import DAMPING_LABEL, frequency_label
from iwanjax.plotting.style import DOUBLE_COLUMN, PALETTE, SINGLE_COLUMN, paper_style, set_up

_AMPLITUDE = "Modal displacement"
_POINTS = 2000


@paper_style()
def plot_modes(comparisons: Sequence[ModeComparison], *, names: Sequence[str] = ()) -> Figure:
    """Measured frequency and damping, the mode taken alone, and the coupled prediction.

    A column for each mode (Figs. 2.5 to 2.7 of the thesis side by side): points are what the
    decays show, each decay in its colour; thin lines in the same colour are predicted with
    the other modes' amplitudes, the thick grey one with the mode alone.

    Parameters
    ----------
    comparisons : sequence of ModeComparison
        Of :func:`iwanjax.compare_modes`; several structures' or hits' may be joined.
    names : sequence of str, optional
        Of the decays, for the legend, by case.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For nothing to draw.
    """
    if not comparisons:
        raise InputError("plot_modes: nothing to draw; no decay could be analysed")
    modes = sorted({each.mode for each in comparisons})
    cases = sorted({each.case for each in comparisons})
    figure, panels = plt.subplots(
        2,
        len(modes),
        sharex="col",
        squeeze=False,
        figsize=(DOUBLE_COLUMN if len(modes) > 1 else SINGLE_COLUMN, 4.2),
        layout="constrained",
    )
    set_up(*panels.ravel())
    for (upper, lower), mode in zip(panels.T, modes, strict=True):
        those = [each for each in comparisons if each.mode == mode]
        alone = those[0].alone
        for ax, row in ((upper, 1), (lower, 2)):
            ax.plot(alone[0], alone[row], color="0.75", linewidth=2.4, zorder=1.0)
        for each in those:
            color = PALETTE[cases.index(each.case) % len(PALETTE)]
            for ax, column in ((upper, 0), (lower, 1)):
                ax.plot(each.amplitude, each.measured[:, column], ".", color=color, markersize=3.0)
                ax.plot(each.amplitude, each.coupled[:, column], color=color, linewidth=0.8)
        upper.set_title(f"mode {mode}")
        upper.set_xscale("log")
        lower.set(xscale="log", yscale="log", xlabel=_AMPLITUDE)
    panels[0, 0].set_ylabel(frequency_label(False))
    panels[1, 0].set_ylabel(DAMPING_LABEL)
    figure.align_ylabels(panels[:, 0])
    handles = [
        Line2D([], [], color="black", marker=".", linestyle="", label="decay"),
        Line2D([], [], color="black", linewidth=0.8, label="predicted with the other modes"),
        Line2D([], [], color="0.75", linewidth=2.4, label="the mode alone"),
        *(
            Line2D([], [], color=PALETTE[cases.index(i) % len(PALETTE)], label=names[i])
            for i in cases
            if i < len(names)
        ),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=min(5, len(handles)))
    return figure


@paper_style()
def plot_decays(decays: ModalDecays, case: int = 0) -> Figure:
    """Amplitudes and damping of all modes over time, after one hit (Fig. 2.8 of the thesis).

    Parameters
    ----------
    decays : ModalDecays
        Of :func:`iwanjax.modal_decays`, or of :func:`iwanjax.dynamics.measured_decays`.
    case : int
        Which of them.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For a case that is not there.
    """
    if not 0 <= case < len(decays.ringdowns):
        raise InputError(f"plot_decays: case {case}; there are {len(decays.ringdowns)}")
    figure, (upper, lower) = plt.subplots(
        2, 1, sharex=True, figsize=(SINGLE_COLUMN, 3.8), layout="constrained"
    )
    set_up(upper, lower)
    step = max(1, decays.time.size // _POINTS)
    for i, mode in enumerate(decays.modes):
        color = PALETTE[i % len(PALETTE)]
        envelope = decays.envelope[case, ::step, i]
        upper.semilogy(decays.time[::step], envelope, color=color, label=f"mode {mode}")
        each = decays.ringdowns[case][i]
        if each is not None:
            lower.semilogy(each.time, np.asarray(each.curves.damping), ".-", color=color)
    upper.set_ylabel(_AMPLITUDE)
    lower.set_ylabel(DAMPING_LABEL)
    lower.set_xlabel("Time (s)")
    figure.align_ylabels([upper, lower])
    figure.legend(loc="outside upper center", ncols=3)
    return figure
