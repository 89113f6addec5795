"""Pictures of a diagnosis: what they are scaled to, and labels that can be read."""

import itertools
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest

from iwanjax.discrepancy.findings import RestoringForce
from iwanjax.plotting.diagnosis import plot_diagnosis, plot_restoring
from iwanjax.plotting.style import plain_ticks


def test_a_rival_far_beyond_what_a_place_needs_does_not_set_the_scale():
    x = np.linspace(-1.0, 1.0, 9)
    found = RestoringForce(
        "cubic_stiffness",
        "J1",
        "deflection",
        x,
        x**3,
        x,
        x**3,
        0.0 * x,
        0.1 + 0.0 * x,
        {"cubic_stiffness": x**3, "stiffness_error": 50.0 * x},
    )
    (ax,) = plot_restoring(SimpleNamespace(restoring=found)).axes
    assert ax.get_ylim() == pytest.approx((-2.0, 2.0))
    (band,) = (each for each in ax.collections if each.get_label() == "recovered, 95 %")
    edges = band.get_paths()[0].get_extents()
    assert (edges.y0, edges.y1) == pytest.approx((-1.2, 1.2))
    plt.close("all")


@pytest.mark.parametrize("behind", [[0.0], [0.0, 0.3], [0.0, 40.0, 2.5e5]])
def test_the_first_suspect_is_nought_behind_itself(behind):
    kind = SimpleNamespace(name="cubic_stiffness")
    run = SimpleNamespace(floors=lambda: {"hit": 0.01}, floors_95=lambda: {"hit": 0.02})
    what = [
        SimpleNamespace(kind=kind, where=f"m{i}", log_evidence=-x) for i, x in enumerate(behind)
    ]
    shown = SimpleNamespace(
        baseline="joints refitted", by_recording={"hit": (0.3, 0.02)}, what=what, runs=(run, run)
    )
    figure = plot_diagnosis(shown)
    figure.canvas.draw()
    rivals = figure.axes[1]
    # Their ends on paper: the first is on the axis, where the axis says nought.
    ends = [bar.get_window_extent().x1 for bar in rivals.patches]
    assert ends == pytest.approx([rivals.transData.transform((x, 0.0))[0] for x in behind])
    assert ends[0] == pytest.approx(rivals.get_window_extent().x0)
    assert {0.0, 1.0} <= set(rivals.get_xticks())
    plt.close("all")


@pytest.mark.parametrize(
    ("low", "high"),
    [(1.2e-4, 2.8e-4), (2.1e-6, 4.9e-6), (1e-4, 6e-4), (1.02e-5, 6e-4), (3.0, 4.0), (0.2, 9.0)],
)
def test_a_short_logarithmic_axis_has_a_few_labels_that_keep_apart(low, high):
    figure, ax = plt.subplots(figsize=(3.0, 1.0))
    ax.plot([low, high], [0.0, 1.0])
    ax.set_xscale("log")
    plain_ticks(ax.xaxis, low, high)
    figure.canvas.draw()
    labels = [*ax.xaxis.get_ticklabels(), *ax.xaxis.get_ticklabels(minor=True)]
    boxes = [label.get_window_extent() for label in labels if label.get_text()]
    within = ax.get_window_extent()
    inside = sorted((b for b in boxes if within.x0 <= b.x0 and b.x1 <= within.x1), key=_left)
    assert len(inside) >= 2
    assert all(a.x1 < b.x0 for a, b in itertools.pairwise(inside))
    plt.close("all")


def _left(box) -> float:
    return box.x0
