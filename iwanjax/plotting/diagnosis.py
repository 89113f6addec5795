"""A diagnosis at a glance: how far off each recording is, before and after, and the rivals."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from iwanjax.discrepancy.verdict import Diagnosis
from iwanjax.plotting.style import DOUBLE_COLUMN, PALETTE, SINGLE_COLUMN, paper_style, set_up


@paper_style()
def plot_diagnosis(diagnosis: Diagnosis) -> Figure:
    """Prediction errors of every recording, and the evidence for what was tried.

    Left, the root mean square of predicted less measured over that of measured in a free run:
    with the joints refitted, and with the first suspect added; a dotted line is what noise
    alone would leave in the held-out ones. Right, where something is missing, how much less
    likely each rival makes the data than the first suspect.

    Parameters
    ----------
    diagnosis : Diagnosis
        Result of :func:`iwanjax.diagnose`.

    Returns
    -------
    Figure
    """
    names = list(diagnosis.by_recording)
    both = np.array([diagnosis.by_recording[name] for name in names])
    wide = bool(diagnosis.what)
    figure, panels = plt.subplots(
        1,
        1 + wide,
        squeeze=False,
        figsize=(DOUBLE_COLUMN if wide else SINGLE_COLUMN, 2.6),
        layout="constrained",
    )
    errors = panels[0, 0]
    set_up(*panels[0])
    at = np.arange(len(names))
    errors.semilogy(at, both[:, 0], "o", color=PALETTE[0], label="joints refitted")
    if diagnosis.detected:
        errors.semilogy(at, both[:, 1], "s", color=PALETTE[1], label="with the first suspect")
    floor = diagnosis.noise_floor.hold_out
    if np.isfinite(floor):
        errors.axhline(floor, color="0.4", linestyle=":", linewidth=0.8, label="noise alone")
    errors.set_xticks(at, names, rotation=30, ha="right")
    errors.set_ylabel("Relative error of prediction (–)")
    figure.legend(loc="outside upper center", ncols=3)
    if wide:
        rivals = panels[0, 1]
        shown = diagnosis.what[:10]
        labels = [f"{each.kind.name}\n{each.where}" for each in shown]
        behind = [diagnosis.what[0].log_evidence - each.log_evidence for each in shown]
        rows = np.arange(len(labels))[::-1]
        rivals.barh(rows, np.maximum(behind, 0.5), color=PALETTE[0], height=0.6)
        rivals.set_xscale("log")
        rivals.set_yticks(rows, labels)
        rivals.set_xlabel("Log evidence behind the first (–)")
    return figure
