"""A diagnosis in pictures: how far off, where, which law, and what is left."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from iwanjax.discrepancy.diagnosis import Diagnosis
from iwanjax.discrepancy.histories.validation import FreeRun
from iwanjax.errors import InputError
from iwanjax.plotting.style import (
    DOUBLE_COLUMN,
    GREY,
    PALETTE,
    SINGLE_COLUMN,
    amplitude_spectrum,
    draw_band,
    paper_style,
    set_up,
    single_panel,
)

# Rivals that are shown, rows of the map of places, and samples that are looked at closely.
_RIVALS, _ROWS, _CLOSE = 8, 14, 160


@paper_style()
def plot_diagnosis(diagnosis: Diagnosis) -> Figure:
    """Prediction errors of every recording, and the evidence for what was tried.

    Left, the root mean square of predicted less measured over that of measured:
    with the joints refitted, and with what was found added; bars are what noise alone would
    leave. Right, where something is missing, how much less likely
    each rival makes the data than the first suspect.

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
    # Long names below leave less room for the rivals' beside them.
    height = 2.2 + 0.045 * max(map(len, names))
    figure, panels = plt.subplots(
        1,
        1 + wide,
        squeeze=False,
        figsize=(DOUBLE_COLUMN if wide else SINGLE_COLUMN, height),
        layout="constrained",
    )
    errors = panels[0, 0]
    set_up(*panels[0])
    at = np.arange(len(names))
    errors.semilogy(at, both[:, 0], "o", color=PALETTE[0], label=diagnosis.baseline)
    if diagnosis.what:
        errors.semilogy(at, both[:, 1], "s", color=PALETTE[1], label="with what was found")
    usual, high = diagnosis.runs[1].floors(), diagnosis.runs[1].floors_95()
    low = [usual[name] for name in names]
    errors.vlines(at, low, [high[name] for name in names], color=GREY, linewidth=1.0)
    errors.semilogy(at, low, "_", color=GREY, markersize=14, label="noise alone, to 95 %")
    errors.set_xticks(at, names, rotation=30, ha="right")
    errors.set_ylabel("Relative error of prediction (–)")
    figure.legend(loc="outside upper center", ncols=3)
    if wide:
        rivals = panels[0, 1]
        shown = diagnosis.what[:_RIVALS]
        labels = [f"{each.kind.name}\n{each.where}" for each in shown]
        behind = [diagnosis.what[0].log_evidence - each.log_evidence for each in shown]
        rows = np.arange(len(labels))[::-1]
        rivals.barh(rows, behind, color=PALETTE[0], height=0.6)
        # From nought, which the first is behind itself, and beyond 1 by powers of ten.
        rivals.set_xscale("symlog", linthresh=1.0)
        rivals.set_xlim(0.0, max(1.0, rivals.get_xlim()[1]))
        rivals.set_yticks(rows, labels, fontsize=6)
        rivals.set_xlabel("Log evidence behind the first (–)")
    return figure


@paper_style()
def plot_prediction(diagnosis: Diagnosis, recording: str | None = None) -> Figure:
    """Measured against predicted from rest, before and after: over time, closely, by frequency.

    Left, what was measured and, over it, what each prediction leaves of it; in the middle, the
    curves themselves where the model before is farthest off; right, the spectra of what was
    measured and of what is left.

    Parameters
    ----------
    diagnosis : Diagnosis
        Result of :func:`iwanjax.diagnose`.
    recording : str, optional
        Which; the last one (held out, where one is) by default.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        For an unknown recording, and a diagnosis of curves (:func:`plot_explained`).
    """
    before, after = diagnosis.runs
    if not (isinstance(before, FreeRun) and isinstance(after, FreeRun)):
        raise InputError("plot_prediction: this diagnosis is of curves; draw it by plot_explained")
    names = list(before.names)
    if recording is not None and recording not in names:
        raise InputError(f"plot_prediction: no recording {recording!r}; it has {', '.join(names)}")
    i = names.index(recording) if recording is not None else len(names) - 1
    measured = before.measured[i]
    channel = int(np.argmax(np.sum(before.error[i] ** 2, axis=0)))
    y = measured[:, channel]
    t = np.arange(len(y)) / diagnosis.sampling_rate
    curves = [
        ("measured", y, "black"),
        (diagnosis.baseline, y - before.error[i, :, channel], PALETTE[0]),
    ]
    if diagnosis.what:
        curves.append(("with what was found", y - after.error[i, :, channel], PALETTE[1]))
    figure, panels = plt.subplots(
        1, 3, figsize=(DOUBLE_COLUMN, 2.3), layout="constrained", width_ratios=(1.2, 1, 1)
    )
    set_up(*panels)
    farthest = int(np.argmax(np.abs(before.error[i, :, channel])))
    first = min(max(0, farthest - _CLOSE // 2), max(0, len(y) - _CLOSE))
    close = slice(first, first + _CLOSE)
    panels[0].plot(t, y, color="0.8", linewidth=0.5)
    for number, (label, curve, colour) in enumerate(curves):
        style = "--" if number else "-"
        panels[1].plot(t[close], curve[close], style, color=colour, linewidth=0.9, label=label)
        if number:
            panels[0].plot(t, y - curve, color=colour, linewidth=0.5)
    rest = [(y - curve, colour) for _, curve, colour in curves[1:]]
    for x, colour in [(y, "black"), *rest]:
        panels[2].semilogy(
            *amplitude_spectrum(x, diagnosis.sampling_rate), color=colour, linewidth=0.6
        )
    sensor = diagnosis.sensors[channel] if diagnosis.sensors else None
    unit = (sensor and sensor.unit) or "recording's unit"
    seen = f"{sensor.name} (grey), left over" if sensor else "Measured (grey), left over"
    panels[0].set_ylabel(f"{seen}\n({unit})")
    for panel in panels[:2]:
        panel.set_xlabel("Time (s)")
    panels[2].set_xlabel("Frequency (Hz)")
    panels[2].set_ylabel("Measured, and residuals")
    for panel, title in zip(panels, ("whole", "where farthest off", "spectrum"), strict=True):
        panel.set_title(f"{names[i]}: {title}")
    figure.legend(loc="outside lower center", ncols=3)
    return figure


@paper_style()
def plot_places(diagnosis: Diagnosis) -> Figure:
    """Where something acts, and what each kind there would take off the residual before any refit.

    Bars are the probability that something acts at a place, whatever it is, with the share of the
    residual that all laws there explain together; where laws were tested one by one only, the map
    alone.

    Parameters
    ----------
    diagnosis : Diagnosis
        Result of :func:`iwanjax.diagnose`.

    Returns
    -------
    Figure
    """
    kinds = list(dict.fromkeys(score.kind for score in diagnosis.scores))
    tested = diagnosis.places[:_ROWS]
    every = [each.where for each in (tested or diagnosis.scores)]
    places = list(dict.fromkeys(every))[:_ROWS]
    drop = np.full((len(places), len(kinds)), np.nan)
    for score in reversed(diagnosis.scores):
        if score.where in places:
            drop[places.index(score.where), kinds.index(score.kind)] = 100.0 * score.drop
    figure, panels = plt.subplots(
        1,
        1 + bool(tested),
        squeeze=False,
        sharey=True,
        figsize=(DOUBLE_COLUMN, 1.3 + 0.22 * len(places)),
        layout="constrained",
        width_ratios=(1, 3)[-1 - bool(tested) :],
    )
    ax = panels[0, -1]
    image = ax.imshow(np.clip(drop, 0.0, 100.0), cmap="cividis", vmin=0.0, aspect="auto")
    ax.set_xticks(np.arange(len(kinds)), kinds, rotation=40, ha="right", fontsize=7)
    ax.set_yticks(np.arange(len(places)), places, fontsize=7)
    ax.tick_params(length=0)
    for each in diagnosis.found:
        if each.where in places and each.kind.name in kinds:
            at = (kinds.index(each.kind.name), places.index(each.where))
            ax.plot(*at, "o", color=PALETTE[1], markersize=9, fillstyle="none", markeredgewidth=2)
    bar = figure.colorbar(image, ax=ax, pad=0.01)
    bar.set_label("Residual\nexplained (%)", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    if tested:
        bars = panels[0, 0]
        bars.barh(
            np.arange(len(tested)),
            [each.probability for each in tested],
            color=PALETTE[0],
            height=0.6,
        )
        for row, each in enumerate(tested):
            words = f"{each.probability:.2f} ({100.0 * each.reduction:.0f} %)"
            at, side, colour = (
                (each.probability, "right", "white")
                if each.probability > 0.5
                else (each.probability, "left", "black")
            )
            bars.text(at, row, f" {words} ", ha=side, va="center", color=colour, fontsize=6)
        bars.set_xlim(0.0, 1.0)
        bars.set_xlabel("Probability that something\nacts there (residual that\nall laws explain)")
    return figure


@paper_style()
def plot_restoring(diagnosis: Diagnosis) -> Figure:
    """The force recovered at the suspect's place, with the chosen law and its rivals.

    The band holds the force that acted, at 95 %; bars are how samples scatter within a bin.

    Parameters
    ----------
    diagnosis : Diagnosis
        Result of :func:`iwanjax.diagnose`, with a force among what was found.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        Where no force was recovered.
    """
    found = diagnosis.restoring
    if found is None:
        raise InputError("plot_restoring: no force was recovered; the first suspect is none")
    figure, ax = single_panel(2.8)
    ax.plot(found.x, found.force, ".", color="0.75", markersize=1.5, rasterized=True)
    draw_band(ax, found.centre, found.middle, found.deviation, "recovered, 95 %")
    ax.errorbar(
        found.centre,
        found.middle,
        found.spread,
        fmt="o",
        color="black",
        markersize=2.5,
        linewidth=0.6,
        label="recovered, median and spread",
    )
    for i, (name, law) in enumerate(list(found.laws.items())[:4]):
        ax.plot(
            found.centre,
            law,
            "-" if i == 0 else "--",
            color=PALETTE[(i + 1) % len(PALETTE)],
            linewidth=1.4 if i == 0 else 0.8,
            label=name,
        )
    # A rival may be far beyond what the place needs: it leaves the picture, not the scale to it.
    reach = 2.0 * max(float(np.max(np.abs(x))) for x in (found.middle, found.laws[found.kind]))
    if reach > 0:
        ax.set_ylim(-reach, reach)
    ax.locator_params(axis="x", nbins=5)
    ax.set_xlabel(f"{found.over.capitalize()} of {found.where} (model's unit)")
    ax.set_ylabel("Missing force (model's unit)")
    ax.legend(loc="best")
    return figure


@paper_style()
def plot_unnamed(diagnosis: Diagnosis) -> Figure:
    """A force that no name fits, over the deflection of its place.

    In the recording of the largest deflection, with the virgin curve; the band holds that at 95 %,
    if the model is right elsewhere.

    Parameters
    ----------
    diagnosis : Diagnosis
        Result of :func:`iwanjax.diagnose`, with a law that has no name.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        Where no such law was fitted.
    """
    found = diagnosis.unnamed
    if found is None:
        raise InputError("plot_unnamed: no general law was fitted; the verdict has a name or none")
    figure, ax = single_panel(2.8)
    ax.plot(*found.path, color="0.6", linewidth=0.5, label="in the hardest recording")
    d, force = found.backbone
    draw_band(ax, d, force, found.deviation)
    ax.plot(d, force, color=PALETTE[0], linewidth=1.4, label="virgin curve, 95 %")
    ax.set_xlabel(f"Deflection of {found.where} (model's unit)")
    ax.set_ylabel("Force (model's unit)")
    ax.legend(loc="best")
    return figure
