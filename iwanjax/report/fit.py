"""The report of a fit: what was found, what it rests on, what remains open."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Protocol

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from iwanjax.errors import InputError
from iwanjax.plotting.curves import plot_curves
from iwanjax.plotting.fit import plot_fit
from iwanjax.plotting.joints import plot_joint
from iwanjax.plotting.posterior import plot_bands, plot_posterior
from iwanjax.plotting.ringdown import plot_merged, plot_ringdown
from iwanjax.quasistatic.modal import ModalOscillator
from iwanjax.report.page import Callout, NamedParagraph, PageSection, PageTable, png, render
from iwanjax.report.words import (
    bounds,
    cautions,
    explanation,
    findings,
    length_unit,
    listed,
    macroslip,
    number,
    open_questions,
    parameter_row,
    rivals,
    with_deviation,
)
from iwanjax.signals.hilbert import RingDown
from iwanjax.signals.merge import MergedCurves
from iwanjax.structures import JointedStructure
from iwanjax.studies.fits import HeldOut
from iwanjax.updating.posterior import Posterior
from iwanjax.updating.problem import modal_unit
from iwanjax.updating.solution import FitSolution

# A prediction this much worse than the hits repeat each other still counts as good.
_AS_GOOD = 1.5
# Share of the posterior that an estimate should lie within.
_WITHIN = 0.99
# Joints of a structure that get a figure, and hits that get a line each.
_MOST_JOINTS, _MOST_HITS = 4, 7
_JOINT_LEVELS = 120

_DERIVED = {
    "K_inf": ("force/length", "stiffness beside the joint"),
    "phi_max": ("length", "displacement from which all sliders slip"),
    "R": ("", "coefficient of the slider distribution"),
    "S": ("force/length", "strength of the slider distribution's Dirac share"),
}


class Statement(Protocol):
    """Something that was found out besides, and says it in a sentence."""

    def statement(self) -> str:
        """The sentence."""
        ...


@dataclass(frozen=True, eq=False)
class FitEntry:
    """One fit in a report.

    Parameters
    ----------
    name : str
        Of the mode, for headings.
    solution : FitSolution
        The fit.
    ringdowns : tuple of RingDown
        The decays behind the curves; the first is drawn.
    merged : MergedCurves, optional
        The hits in one curve.
    exponents : object with a ``statement()``, optional
        The power laws of the curves in words.
    held_out : tuple of HeldOut
        Hits that were not fitted; plain tuples of the same fields are taken too.
    posterior : Posterior, optional
        Sampled from this fit on.
    fit_picture, posterior_picture : bytes, optional
        These two as PNG, where :func:`~iwanjax.plotting.plot_fit` and
        :func:`~iwanjax.plotting.plot_posterior` have drawn them already.
    measured_pictures : tuple of (str, bytes), optional
        The same of :func:`measured_pictures`.
    """

    name: str
    solution: FitSolution
    ringdowns: tuple[RingDown, ...] = ()
    merged: MergedCurves | None = None
    exponents: Statement | None = None
    held_out: tuple[HeldOut, ...] = ()
    posterior: Posterior | None = None
    fit_picture: bytes | None = None
    posterior_picture: bytes | None = None
    measured_pictures: tuple[tuple[str, bytes], ...] | None = None

    def __post_init__(self) -> None:
        """Take plain tuples for held-out hits."""
        object.__setattr__(self, "held_out", tuple(HeldOut(*row) for row in self.held_out))


def fit_report(title: str, entries: Sequence[FitEntry]) -> str:
    """A report of one or several fits as one self-contained HTML page.

    The result comes first in plain sentences; then for each fit the figures and tables
    that they rest on.

    Parameters
    ----------
    title : str
        Heading.
    entries : sequence of FitEntry
        In the order they shall appear.

    Returns
    -------
    str
        HTML, to be written to a file as UTF-8.

    Raises
    ------
    InputError
        For no entries.
    """
    if not entries:
        raise InputError("fit_report: no fits; expected at least one FitEntry")
    lead = [text for entry in entries for text in _lead(entry, named=len(entries) > 1)]
    return render(title, lead, [_section(entry) for entry in entries], _footer())


def _lead(entry: FitEntry, *, named: bool) -> list[str | NamedParagraph]:
    """How well it explains the data, what was found, what is open, what rests on a bound."""
    s = entry.solution
    groups = (
        (explanation(s), _prediction(entry)),
        (findings(s), macroslip(s)),
        (open_questions(s), rivals(s), bounds(s)),
        (f"{entry.exponents.statement().rstrip('.')}." if entry.exponents else "",),
    )
    texts = [" ".join(filter(None, group)) for group in groups]
    texts = [text for text in texts if text]
    first = NamedParagraph(entry.name, texts[0]) if named and entry.name else texts[0]
    return [first, *texts[1:]]


def _prediction(entry: FitEntry) -> str:
    """How well hits are predicted that were not fitted."""
    if not entry.held_out:
        return ""
    worst_f = max(row.frequency_error for row in entry.held_out)
    worst_zeta = max(row.damping_error for row in entry.held_out)
    count = len(entry.held_out)
    whose = f"the held-out {entry.held_out[0].name}" if count == 1 else f"{count} held-out hits"
    text = f"It predicts {whose} to {number(worst_f, 2)} Hz and "
    text += f"{number(worst_zeta, 2)} % of the damping"
    pairs = [
        (error, repeatability)
        for row in entry.held_out
        for error, repeatability in (
            (row.frequency_error, row.frequency_repeatability),
            (row.damping_error, row.damping_repeatability),
        )
        if repeatability is not None and math.isfinite(repeatability) and repeatability > 0
    ]
    if not pairs:
        return f"{text}."
    ratio = max(error / repeatability for error, repeatability in pairs)
    if ratio <= _AS_GOOD:
        return f"{text}, which is as well as hits repeat each other."
    return f"{text}, up to {number(ratio, 2)} times as far off as hits are from each other."


def _section(entry: FitEntry) -> PageSection:
    paragraphs: list[str | Callout | NamedParagraph] = [
        *cautions(entry.solution),
        *_posterior_cautions(entry),
    ]
    s = entry.solution
    if s.agreeing > 1:
        paragraphs.append(f"{s.agreeing} of {s.runs} runs of the search ended at this minimum.")
    tables = [_parameters(entry)]
    if entry.held_out:
        tables.append(_held_out(entry.held_out))
    if entry.posterior is not None:
        tables.append(posterior_table(entry.posterior))
    return PageSection(entry.name or "Fit", tuple(paragraphs), tuple(figures(entry)), tuple(tables))


def figures(entry: FitEntry) -> list[tuple[str, bytes]]:
    """Captions and pictures; each figure is closed once it is a picture."""
    s = entry.solution
    held = [row.curves for row in entry.held_out if row.curves is not None]
    found = [
        _pictured(
            "Measured and fitted frequency and damping; beneath each, measured less fitted over "
            "the stated deviation.",
            lambda: plot_fit(s, held),
            entry.fit_picture,
        )
    ]
    if entry.posterior is not None and entry.posterior.chain.size:
        posterior = entry.posterior
        found += [
            _pictured(
                "Ranges of frequency and damping that the posterior of the parameters predicts.",
                lambda: plot_bands(posterior),
            ),
            _pictured(
                "Posterior of every parameter and of every pair. s_f and s_ζ are the factors on "
                "the stated deviations of frequency and damping.",
                lambda: plot_posterior(posterior),
                entry.posterior_picture,
            ),
        ]
    measured = entry.measured_pictures
    if measured is None:
        measured = measured_pictures(entry.ringdowns, entry.merged)
    return [*found, *measured, *_joint_figures(s)]


def measured_pictures(
    ringdowns: Sequence[RingDown], merged: MergedCurves | None
) -> tuple[tuple[str, bytes], ...]:
    """Captions and pictures of what a fit rests on: the hits, and the first decay.

    Parameters
    ----------
    ringdowns : sequence of RingDown
        The decays behind the curves; the first is drawn.
    merged : MergedCurves or None
        The hits in one curve.
    """
    found = []
    hits = [r.curves for r in ringdowns]
    if merged is not None:
        caption = "Every hit, their common curve, and where a further hit would lie."
        found.append(_pictured(caption, lambda: plot_merged(merged)))
    elif 0 < len(hits) <= _MOST_HITS:
        found.append(_pictured("The hits with their deviations.", lambda: plot_curves(hits)))
    if ringdowns:
        first = ringdowns[0]
        name = first.curves.name
        caption = (
            f"The decay of {name} as it was analysed, band-pass "
            if name
            else "The first decay as it was analysed, band-pass "
        ) + f"{first.band[0]:g} to {first.band[1]:g} Hz."
        found.append(_pictured(caption, lambda: plot_ringdown(first)))
    return tuple(found)


def _joint_figures(solution: FitSolution) -> list[tuple[str, bytes]]:
    """The fitted joint up to the largest measured amplitude, or the joints of a structure."""
    found = []
    if isinstance(solution.model, ModalOscillator):
        joint = solution.model.joint
        largest = float(np.max(np.asarray(solution.problem.measured.q)))
        levels = largest * np.geomspace(1e-3, 1.0, _JOINT_LEVELS)
        length = length_unit(solution.measured[0])
        force = f"{length}/s²" if length else ""
        caption = (
            "The fitted joint, force per unit modal mass, up to the largest measured "
            f"displacement, {number(largest)} {length}".rstrip()
            + "."
        )
        try:
            draw = _pictured(
                caption, lambda: plot_joint(joint, levels, length_unit=length, force_unit=force)
            )
        except InputError:
            # A joint whose force depends on rate has no loop without a frequency.
            return []
        return [draw]
    if isinstance(solution.model, JointedStructure):
        for label, joint in list(solution.model.joints.items())[:_MOST_JOINTS]:
            try:
                found.append(_pictured(f"The fitted joint {label}.", lambda j=joint: plot_joint(j)))
            except InputError:
                continue
    return found


def _pictured(
    caption: str, draw: Callable[[], Figure], drawn: bytes | None = None
) -> tuple[str, bytes]:
    if drawn is not None:
        return caption, drawn
    figure = draw()
    try:
        return caption, png(figure)
    finally:
        plt.close(figure)


def _parameters(entry: FitEntry) -> PageTable:
    s = entry.solution
    rows = [parameter_row(p, s) for p in s.parameters]
    for name, (value, std) in s.derived.items():
        unit, meaning = _DERIVED.get(name.rpartition(".")[2], ("", "follows from the above"))
        least = s.least(name)
        if least is not None:
            told = (f"at least {number(least)}", "largest deflection")
        elif s.follows(name):
            told = with_deviation(value, std)
        else:
            told = (number(value), "not determined")
        rows.append((name, *told, modal_unit(unit, s.measured[0]), "–", meaning))
    return PageTable(
        ("Parameter", "Value", "Deviation", "Unit", "Prior", "Meaning"),
        tuple(rows),
        "Estimates. Priors: ends where uniform, else the central 90 %. Rows without a prior are "
        "fixed or follow from the others.",
        words=(0, 3, 5),
    )


def _held_out(rows: Sequence[HeldOut]) -> PageTable:
    def cell(value: float | None) -> str:
        return "–" if value is None or not math.isfinite(value) else number(value, 2)

    return PageTable(
        (
            "Hit",
            "Frequency error (Hz)",
            "Repeatability (Hz)",
            "Damping error (%)",
            "Repeatability (%)",
        ),
        tuple(
            (
                row.name,
                cell(row.frequency_error),
                cell(row.frequency_repeatability),
                cell(row.damping_error),
                cell(row.damping_repeatability),
            )
            for row in rows
        ),
        "Hits that were not fitted: root mean square error of the prediction, beside the "
        "deviation from hit to hit.",
    )


def posterior_table(posterior: Posterior) -> PageTable:
    """Medians, 90 % intervals and effective numbers of samples of the parameters."""
    samples = posterior.samples
    rows = []
    for name in posterior.names:
        low, high = posterior.interval(name)
        # A 90 per cent interval is 3.3 deviations wide.
        std = (high - low) / 3.3
        rows.append(
            (
                name,
                with_deviation(float(np.median(samples[name])), std)[0],
                f"{with_deviation(low, std)[0]} to {with_deviation(high, std)[0]}",
                f"{posterior.effective[name]:.0f}",
            )
        )
    return PageTable(
        ("Parameter", "Median", "Central 90 %", "Independent draws"),
        tuple(rows),
        "Posterior. The noise scales are factors on the stated deviations.",
    )


def _posterior_cautions(entry: FitEntry) -> list[Callout]:
    """Where a posterior is too short, or is not where the fit is."""
    posterior = entry.posterior
    if posterior is None:
        return []
    found = []
    if not posterior.enough:
        least = min(posterior.effective.values())
        short = (
            f"it got to {least:.0f} of {posterior.wanted} independent draws"
            if least < posterior.wanted
            else "it is too short to tell how many of its draws are independent"
        )
        found.append(
            Callout(
                f"The posterior is not long enough: {short}. Its ranges may still move; run it "
                "again to go on."
            )
        )
    if not posterior.chain.size:
        return found
    apart = []
    for name, value in entry.solution.values.items():
        if name not in posterior.names or name in entry.solution.active_bounds:
            continue
        low, high = posterior.interval(name, _WITHIN)
        if not low <= value <= high:
            apart.append(f"{name} = {number(value)} outside {number(low)} to {number(high)}")
    if apart:
        found.append(
            Callout(
                f"The fit lies outside the central {100 * _WITHIN:.0f} % of its posterior: "
                f"{listed(apart)}. It sits in a narrow minimum that holds little of what the "
                "curves allow."
            )
        )
    return found


def _footer() -> str:
    try:
        return f"Written by iwanjax {version('iwanjax')}."
    except PackageNotFoundError:
        return "Written by iwanjax."
