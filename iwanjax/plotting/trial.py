"""What came of trials: what was said of what was concealed, and whether probabilities hold."""

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from iwanjax.plotting.style import DOUBLE_COLUMN, GREY, PALETTE, paper_style, set_up
from iwanjax.trial.outcome import jeffreys_interval

if TYPE_CHECKING:
    from iwanjax.trial import TrialResult

# Of the forecasts that a reliability diagram puts together.
_EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
_MARKERS = ("o", "s", "^")


@paper_style()
def plot_trial(found: "TrialResult") -> Figure:
    """Left, what was said of what was concealed; right, how often what was probable was true.

    On the right every point stands for forecasts of about the same probability: how often they
    came true, with 90 % intervals (Jeffreys). Honest probabilities lie on the diagonal.

    Parameters
    ----------
    found : TrialResult
        Of :meth:`iwanjax.Study.trial`.

    Returns
    -------
    Figure
    """
    height = 2.6 + 0.16 * max(len(found.confusion[0]), 4)
    figure, (table, reliable) = plt.subplots(
        1, 2, figsize=(DOUBLE_COLUMN, height), width_ratios=(3, 2), layout="constrained"
    )
    _confusion(table, found)
    set_up(reliable)
    reliable.plot([0.0, 1.0], [0.0, 1.0], color=GREY, linewidth=0.6)
    for i, forecast in enumerate(found.forecasts):
        if forecast.true.size:
            label = f"{forecast.what}\n(Brier score {forecast.brier:.3f})"
            shift = 0.012 * (i - 1)
            _reliability(reliable, forecast.probability, forecast.true, i, shift, label)
    reliable.set_xlim(-0.03, 1.03)
    reliable.set_ylim(-0.03, 1.03)
    reliable.set_aspect("equal")
    reliable.set_xlabel("Probability given")
    reliable.set_ylabel("Share that was true")
    reliable.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22))
    return figure


def _confusion(ax: Axes, found: "TrialResult") -> None:
    """Counts, the concealed downwards; verdicts that are right in another colour."""
    rows, columns, counts = found.confusion
    right = np.zeros(counts.shape, int)
    for each in found.outcomes:
        right[rows.index(each.row), columns.index(each.column)] += each.right
    shade = counts / max(int(counts.max()), 1)
    for i, j in np.argwhere(counts):
        colour = PALETTE[0] if right[i, j] else PALETTE[1]
        alpha = 0.15 + 0.35 * float(shade[i, j])
        ax.add_patch(Rectangle((j - 0.5, i - 0.5), 1, 1, color=colour, alpha=alpha, lw=0))
        of = f"{right[i, j]} of {counts[i, j]}" if 0 < right[i, j] < counts[i, j] else counts[i, j]
        ax.text(j, i, str(of), ha="center", va="center")
    ax.set_xlim(-0.5, len(columns) - 0.5)
    ax.set_ylim(len(rows) - 0.5, -0.5)
    ax.set_xticks(range(len(columns)), [c.replace("_", " ") for c in columns], rotation=90)
    ax.set_yticks(range(len(rows)), [r.replace("_", " ") for r in rows])
    ax.set_xlabel("Said")
    ax.set_ylabel("Concealed")
    ax.tick_params(length=0)
    ax.set_title(
        "Blue: right (of a law left out, its place and no wrong name); orange: not", weight="normal"
    )


def _reliability(
    ax: Axes, probability: np.ndarray, true: np.ndarray, i: int, shift: float, label: str
) -> None:
    inside = np.clip(np.searchsorted(_EDGES, probability, side="right") - 1, 0, len(_EDGES) - 2)
    x, y, bars = [], [], []
    for each in np.unique(inside):
        chosen = inside == each
        hits, n = int(true[chosen].sum()), int(chosen.sum())
        share = hits / n
        low, high = jeffreys_interval(hits, n)
        x.append(float(probability[chosen].mean()) + shift)
        y.append(share)
        # The interval of few and rare hits may begin above their share.
        bars.append((max(share - low, 0.0), max(high - share, 0.0)))
    ax.errorbar(
        x,
        y,
        np.transpose(bars),
        fmt=_MARKERS[i],
        color=PALETTE[i],
        elinewidth=0.8,
        capsize=2,
        label=label,
    )
