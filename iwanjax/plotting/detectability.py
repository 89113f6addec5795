"""What a plan of recordings finds: forces from which effects show, and what should be added."""

import math
from itertools import product
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iwanjax.plotting.style import DOUBLE_COLUMN, GREY, PALETTE, paper_style, set_up

if TYPE_CHECKING:
    from iwanjax.planning import Detectability

# Added measurements that are shown; forces beyond so many times the median are cut off.
_ADDED, _FAR = 8, 1e4
_MARKERS = ("o", "s", "^", "D")


@paper_style()
def plot_detectability(found: "Detectability") -> Figure:
    """Smallest force of each kind at each place that is found, and what to measure besides.

    Left, root-mean-square of the force from which an effect is found in nine of ten repetitions,
    and, at the end of its line, from which it is told from all others as well. Right, by how much
    one recording or one sensor more brings the latter down, as a geometric mean over all effects.

    Parameters
    ----------
    found : Detectability
        Of :meth:`iwanjax.Study.detectability`.

    Returns
    -------
    Figure
    """
    forces = [e for e in found.smallest if math.isfinite(e.force) and e.force > 0.0]
    places = list(dict.fromkeys(e.where for e in forces))
    height = 1.6 + 0.24 * max(len(places), min(len(found.added), _ADDED))
    figure, (sizes, added) = plt.subplots(
        1,
        2,
        figsize=(DOUBLE_COLUMN, height),
        width_ratios=(3, 2),
        layout="constrained",
    )
    set_up(sizes, added)
    kinds = dict.fromkeys(e.kind for e in forces)
    looks = dict(zip(kinds, product(_MARKERS, PALETTE), strict=False))
    shown = 0.6 / max(len(looks), 1)
    farthest = _FAR * sorted(e.force for e in forces)[len(forces) // 2] if forces else math.inf
    for each in forces:
        marker, colour = looks[each.kind]
        y = places.index(each.where) + shown * (list(looks).index(each.kind) - len(looks) / 2.0)
        end = min(each.force * each.named / each.found, farthest)
        sizes.plot([each.force, end], [y, y], color=colour, linewidth=0.8)
        sizes.plot(each.force, y, marker, color=colour)
    for kind, (marker, colour) in looks.items():
        sizes.plot([], [], marker, color=colour, label=kind.replace("_", " "))
    sizes.set_xscale("log")
    sizes.set_yticks(range(len(places)), places)
    sizes.set_ylim(len(places) - 0.4, -0.6)
    sizes.set_xlabel(
        "Force that is found, root mean square (unit of force);\n"
        "lines end where it is told from all others"
    )
    figure.legend(loc="outside upper center", ncols=4)
    _more(added, found)
    return figure


def _more(ax: Axes, found: "Detectability") -> None:
    """What helps most, the best at the top."""
    best = found.added[:_ADDED]
    at = range(len(best))
    ax.barh(at, [each.named for each in best], color=PALETTE[0], height=0.5, label="told apart")
    ax.plot([each.found for each in best], at, "o", color=PALETTE[1], label="found")
    ax.axvline(1.0, color=GREY, linewidth=0.6)
    ax.set_yticks(at, [each.label for each in best])
    ax.set_ylim(max(len(best), 1) - 0.4, -0.6)
    ax.set_xlim(0.0, 1.1)
    ax.set_xlabel("Sizes with it, over those without")
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
