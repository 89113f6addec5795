"""Low-amplitude updating: what the frequencies were, are and should be, and what was learnt."""

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iwanjax.plotting.style import DOUBLE_COLUMN, GREY, PALETTE, paper_style, set_up

if TYPE_CHECKING:
    from iwanjax.updating.linear_solution import LinearSolution

_BEFORE, _AFTER = PALETTE[1], PALETTE[0]


@paper_style()
def plot_linear(solution: "LinearSolution") -> Figure:
    """Errors of the frequencies before and after, and each parameter between prior and data.

    Left, relative errors with the measurement's own deviations (two of them) as bars on a
    scale that is linear about zero; right, the factor by which each parameter has moved from
    where it started, with two deviations of the prior (grey) and of the estimate.
    Undetermined parameters are open.

    Parameters
    ----------
    solution : LinearSolution
        Of :func:`iwanjax.update_linear`.

    Returns
    -------
    Figure
    """
    rows = max(len(solution.parameters), solution.frequency.size)
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(DOUBLE_COLUMN, 0.9 + 0.24 * rows), layout="constrained"
    )
    set_up(left, right)
    _errors(left, solution)
    _factors(right, solution)
    figure.legend(loc="outside lower center", ncols=4)
    return figure


def _errors(ax: Axes, solution: "LinearSolution") -> None:
    f, at = solution.measured_frequency, np.arange(solution.frequency.size)[::-1]
    deviation = 200.0 * solution.frequency_std / f
    before = 100.0 * (solution.frequency_before / f - 1.0)
    ax.axvline(0.0, color=GREY, linewidth=0.6)
    ax.plot(before, at, "o", color=_BEFORE, label="as given")
    after = 100.0 * solution.error
    ax.errorbar(after, at, xerr=deviation, fmt="s", color=_AFTER, label="updated", capsize=2)
    linear, largest = max(np.max(deviation), 1e-3), np.max(np.abs([before, after]))
    ax.set_xscale("symlog", linthresh=linear)
    decades = 10.0 ** np.arange(np.ceil(np.log10(linear)), np.ceil(np.log10(largest)) + 1)
    ticks = np.concatenate([-decades[::-1], [0.0], decades])
    low, high = ax.get_xlim()
    inside = ticks[(ticks > low) & (ticks < high)]
    ax.set_xticks(inside, [f"{each:g}" for each in inside], minor=False)
    ax.set_yticks(at, [f"{each:.5g} Hz" for each in f])
    ax.set_ylim(-0.6, at.size - 0.4)
    ax.set_xlabel("Frequency error (%)")


def _factors(ax: Axes, solution: "LinearSolution") -> None:
    # Here, because it loads the optimisers, which other figures do not need.
    from iwanjax.updating.solution import prior_deviation

    started = {p.name: p for p in solution.started}
    at = np.arange(len(solution.parameters))[::-1]
    for y, p in zip(at, solution.parameters, strict=True):
        begin = started[p.name].value
        if not p.fixed:
            width = np.exp(2.0 * prior_deviation(started[p.name]) / begin)
            ax.plot([1.0 / width, width], [y, y], color="0.85", linewidth=6, solid_capstyle="butt")
        factor, std = p.value / begin, solution.std[p.name] / p.value
        known = solution.determined.get(p.name, True)
        ax.errorbar(
            factor,
            y,
            xerr=[[factor * (1.0 - np.exp(-2.0 * std))], [factor * (np.exp(2.0 * std) - 1.0)]],
            fmt="s",
            color=_AFTER,
            mfc=_AFTER if known else "white",
            capsize=2,
        )
    ax.plot([], [], color="0.85", linewidth=6, label="prior, 2 deviations")
    if not all(solution.determined.values()):
        ax.plot([], [], "s", color=_AFTER, mfc="white", label="undetermined")
    ax.axvline(1.0, color=GREY, linewidth=0.6)
    ax.set_xscale("log")
    ax.set_yticks(at, [p.name for p in solution.parameters])
    ax.set_ylim(-0.6, at.size - 0.4)
    ax.set_xlabel("Factor on the starting value")
