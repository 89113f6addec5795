"""A modal test: functions and their fit, coherence, and poles of rising order."""

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iwanjax.plotting.style import DOUBLE_COLUMN, GREY, PALETTE, paper_style, set_up

if TYPE_CHECKING:
    from iwanjax.modal_analysis import ModalTest


@paper_style()
def plot_modal_test(test: "ModalTest") -> Figure:
    """Composite frequency response with the fitted one, coherence, and the stabilisation chart.

    The composite is the root mean square over all sensors and inputs; below it what the modes
    leave, and the averages' scatter. In the chart poles of modes have colours, others are grey.

    Parameters
    ----------
    test : ModalTest
        Of :func:`iwanjax.modal_test`.

    Returns
    -------
    Figure
    """
    figure, axes = plt.subplots(
        3,
        1,
        figsize=(DOUBLE_COLUMN, 5.4),
        height_ratios=(3, 1, 2),
        sharex=True,
        layout="constrained",
    )
    set_up(*axes)
    _functions(axes[0], test)
    _coherence(axes[1], test)
    _chart(axes[2], test)
    for ax in axes:
        for f in test.frequency:
            ax.axvline(f, color=GREY, linewidth=0.4, linestyle=":")
    axes[-1].set_xlabel("Frequency (Hz)")
    axes[-1].set_xlim(*test.responses.frequency[[0, -1]])
    return figure


def _composite(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(np.abs(values) ** 2, axis=(1, 2)))


def _functions(ax: Axes, test: "ModalTest") -> None:
    known = test.responses
    f = known.frequency
    ax.semilogy(f, _composite(known.frf), ".", color="black", markersize=2.5, label="measured")
    ax.semilogy(f, _composite(test.fitted), color=PALETTE[0], label=f"{len(test.frequency)} modes")
    left = _composite(test.fitted - known.frf)
    ax.semilogy(f, left, color=PALETTE[1], linewidth=0.6, label="left")
    if np.all(np.isfinite(known.frf_std)):
        scatter = _composite(known.frf_std)
        ax.semilogy(f, scatter, color=PALETTE[2], linewidth=0.6, label="scatter")
    ax.set_ylabel("Decays" if known.excitation == "decay" else "Response / force")
    ax.legend(loc="best", ncols=4)


def _coherence(ax: Axes, test: "ModalTest") -> None:
    known = test.responses
    ax.set_ylabel("Coherence")
    ax.set_ylim(-0.05, 1.05)
    if known.averages <= len(known.inputs):
        ax.text(0.5, 0.5, "one average per input", transform=ax.transAxes, ha="center", va="center")
        return
    for name, each, color in zip(
        known.sensors, known.coherence.T, _colors(known.sensors), strict=True
    ):
        ax.plot(known.frequency, each, color=color, linewidth=0.6, label=name)
    if len(known.sensors) <= len(PALETTE):
        ax.legend(loc="lower right", ncols=len(known.sensors))


def _chart(ax: Axes, test: "ModalTest") -> None:
    poles = test.stabilisation
    other = poles.mode < 0
    ax.plot(poles.frequency[other], poles.order[other], "x", color="0.7", markersize=2.5)
    for k, color in enumerate(_colors(test.frequency)):
        own = poles.mode == k
        ax.plot(poles.frequency[own], poles.order[own], "o", color=color, markersize=2.5)
    ax.set_ylabel("Order")


def _colors(of: "np.ndarray | tuple[str, ...]") -> list[str]:
    return [PALETTE[k % len(PALETTE)] for k in range(len(of))]
