"""Agreement in frequency against agreement in damping: sampled sets, and the Pareto front."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iwanjax.plotting.style import GREY, PALETTE, paper_style, single_panel

if TYPE_CHECKING:
    from iwanjax.updating.pareto import ParetoFront
    from iwanjax.updating.sampled import SampledFits


@paper_style()
def plot_sampled(sampled: "SampledFits") -> Figure:
    """Deviation of the damping over that of the frequency, a dot for each set (Fig. 3.7).

    Parameters
    ----------
    sampled : SampledFits
        Of :func:`iwanjax.sample_fits`.

    Returns
    -------
    Figure
    """
    figure, ax = _axes()
    _dots(ax, sampled)
    at = sampled.front
    ax.plot(
        sampled.frequency_rmsd[at],
        100.0 * sampled.damping_rmsd[at],
        "o",
        color=PALETTE[0],
        label="not beaten in both",
    )
    figure.legend(loc="outside upper center", ncols=2)
    return figure


@paper_style()
def plot_front(front: "ParetoFront") -> Figure:
    """The Pareto front before the sampled sets that it was started from.

    Parameters
    ----------
    front : ParetoFront
        Of :func:`iwanjax.pareto_front`.

    Returns
    -------
    Figure
    """
    figure, ax = _axes()
    _dots(ax, front.sampled)
    f, zeta = front.frequency_rmsd, 100.0 * front.damping_rmsd
    ax.plot(f, zeta, "o-", color=PALETTE[0], label="Pareto front")
    at = front.chosen
    ax.plot(f[at], zeta[at], "D", color=PALETTE[1], markersize=6.0, label="nearest to both")
    figure.legend(loc="outside upper center", ncols=3)
    return figure


def _axes() -> tuple[Figure, Axes]:
    figure, ax = single_panel(2.9)
    ax.set(xscale="log", yscale="log")
    ax.set_xlabel("RMSD of frequency (Hz)")
    ax.set_ylabel("RMSD of damping ratio (%)")
    return figure, ax


def _dots(ax: Axes, sampled: "SampledFits") -> None:
    known = np.isfinite(sampled.frequency_rmsd)
    ax.plot(
        sampled.frequency_rmsd[known],
        100.0 * sampled.damping_rmsd[known],
        ".",
        color=GREY,
        markersize=2.0,
        label="sampled sets",
        rasterized=True,
    )
