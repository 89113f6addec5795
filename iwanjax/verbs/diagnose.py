"""The verb ``diagnose``: what a study's model is missing, by its recordings."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure

from iwanjax.discrepancy import CurveRun, Diagnosis, LoopRun, ModesRun
from iwanjax.errors import attempted
from iwanjax.plotting import (
    plot_diagnosis,
    plot_explained,
    plot_loops,
    plot_places,
    plot_prediction,
    plot_restoring,
    plot_unnamed,
)
from iwanjax.report.page import NamedParagraph, PageSection, PageTable, render
from iwanjax.report.words import with_deviation
from iwanjax.studies import Study
from iwanjax.studies.verdicts import as_json
from iwanjax.verbs.output import file_names, results, save, say, version, write_json

# Parts of a report's lead after the verdict.
_PARTS = ("Improvement", "Doubt", "Measure next")
# Differences by mode that a report lists.
_MODES = 12


def run(study: Study, out: Path, budget: float | None = None) -> list[str]:
    """Write diagnosis.json, pictures and report.html; lines for the screen."""
    verdicts = dict(study.diagnose(budget=budget, progress=say))
    # Several modes have their pictures under their own names.
    ends = [f"_{label}" for label in file_names(verdicts)] if len(verdicts) > 1 else [""]
    with results(out) as folder:
        sections, files = [], {}
        for (name, verdict), end in zip(verdicts.items(), ends, strict=True):
            failures = list(verdict.failures)
            pictures = _pictures(verdict, folder, end, failures)
            verdicts[name] = replace(verdict, failures=tuple(failures))
            if verdict.unnamed is not None:
                files[name] = verdict.unnamed.law.save(folder / f"unnamed_law{end}.npz").name
            sections.append(_section(name, verdict, pictures))
        content = {"study": study.name, "iwanjax": version()} | as_json(verdicts, files)
        write_json(folder / "diagnosis.json", content)
        lead = [
            f"{name}: {verdict.statement()}" if len(verdicts) > 1 else verdict.statement()
            for name, verdict in verdicts.items()
        ]
        page = render(study.name, _lead(verdicts), sections, f"Written by iwanjax {version()}.")
        (folder / "report.html").write_text(page, encoding="utf-8")
    return [*lead, f"wrote {out / 'report.html'}"]


def _lead(verdicts: Mapping[str, Diagnosis]) -> list[str | NamedParagraph]:
    """Each verdict first; then how much better predictions get, the doubt, what to do next."""
    lead: list[str | NamedParagraph] = []
    for name, verdict in verdicts.items():
        first, *others = verdict.report()
        lead.append(NamedParagraph(name, first) if len(verdicts) > 1 else first)
        lead += [
            NamedParagraph(title, text) for title, text in zip(_PARTS, others, strict=True) if text
        ]
    return lead


def _pictures(
    verdict: Diagnosis, folder: Path, end: str, failures: list[str]
) -> list[tuple[str, bytes]]:
    """Captions and pictures, the verdict's own first; one that fails is named instead."""
    plots: list[tuple[str, str, Callable[[Diagnosis], Figure]]] = [
        (
            "Errors of every recording"
            + (", and how far the rivals are behind." if verdict.what else "."),
            "diagnosis",
            plot_diagnosis,
        )
    ]
    if isinstance(verdict.runs[0], CurveRun | ModesRun):
        caption = (
            "Frequency and damping as measured and as the models before and after have them; "
            "below, what either leaves, over the deviation of each point."
        )
        plots.append((caption, "prediction", plot_explained))
    elif isinstance(verdict.runs[0], LoopRun):
        caption = (
            "Force against deflection as measured and as the models before and after have it; "
            "below, what either leaves, over the force's deviation."
        )
        plots.append((caption, "prediction", plot_loops))
    else:
        caption = (
            "The last recording, held out where one is, in free run: measured, predicted before "
            "and after, and the spectrum of what is left."
        )
        plots.append((caption, "prediction", plot_prediction))
    if verdict.restoring is not None:
        caption = (
            "The force that acted at the place, recovered sample by sample; the band holds it at "
            "95 %, if the model is right elsewhere. A law that leaves the band is wrong there. "
            "Lines are the laws fitted."
        )
        plots.append((caption, "restoring_force", plot_restoring))
    if verdict.unnamed is not None:
        caption = (
            "The force that no name fits over the deflection of its place: in the recording of the "
            "largest deflection, and its virgin curve with the band that holds it at 95 %."
        )
        plots.append((caption, "unnamed_law", plot_unnamed))
    if verdict.scores:
        caption = (
            "Where: the probability that something acts at a place, whatever it is, and what each "
            "kind there would explain of what the joints cannot."
        )
        plots.append((caption, "places", plot_places))
    pictures = []
    for caption, name, plot in plots:
        path = folder / f"{name}{end}.png"
        drawn = attempted(
            f"the picture {path.name}",
            lambda plot=plot, path=path: save(plot(verdict), path),
            None,
            failures,
        )
        if drawn is not None:
            pictures.append((caption, drawn))
    return pictures


def _section(name: str, verdict: Diagnosis, pictures: list[tuple[str, bytes]]) -> PageSection:
    """What a verdict rests on: its pictures and its tables."""
    static = isinstance(verdict.runs[0], CurveRun | LoopRun | ModesRun)
    models = (verdict.baseline.capitalize(), "With the first suspect")[: 1 + bool(verdict.what)]
    recordings = PageTable(
        ("Recording", *models),
        tuple(
            (name, *(f"{error:.3g}" for error in errors[: len(models)]))
            for name, errors in verdict.by_recording.items()
        ),
        "Root mean square of predicted less measured over that of measured"
        + ("." if static else ", free run."),
    )
    rivals = PageTable(
        ("Kind", "Where", "Parameters", "Probability", "Log evidence"),
        tuple(
            (
                each.kind.name,
                each.where,
                ", ".join(
                    f"{p.info.name} {p.value:.4g}"
                    + (f" ± {p.std:.2g}" if math.isfinite(p.std) else "")
                    for p in each.parameters
                ),
                f"{each.probability:.3f}",
                f"{each.log_evidence:.1f}",
            )
            for each in verdict.what
        ),
        "What was tried together with the joints; evidence less that of the best.",
        words=(0, 1, 2),
    )
    modes = PageTable(
        ("Recording", "Mode", "Quantity", "Amplitudes", "Model less measured"),
        tuple(
            (
                each.recording,
                each.name,
                each.quantity,
                f"{each.amplitude[0]:.3g} to {each.amplitude[1]:.3g}",
                f"{each.difference_percent:+.2g} %",
            )
            for each in verdict.observables[:_MODES]
        ),
        f"Frequency and damping that the model gets wrong, its {verdict.baseline}.",
        words=(0, 1, 2),
    )
    joints, linear = (
        PageTable(
            (what, "Parameter", "Value", "Deviation", "Unit"),
            tuple(
                (each.name, p.info.name, *with_deviation(p.value, p.std), p.info.dimension)
                for each in refitted
                for p in each.parameters
            ),
            caption + (", with the first suspect." if verdict.what else "."),
            words=(0, 1, 4),
        )
        for what, refitted, caption in (
            ("Joint", verdict.joints, f"The {verdict.baseline}"),
            ("Mode", verdict.modes, "The linear model as refitted within its trust"),
        )
    )
    tables = [recordings]
    tables += [rivals] * bool(verdict.what) + [joints] * bool(verdict.joints)
    tables += [linear] * bool(verdict.modes) + [modes] * bool(verdict.observables)
    title = f"{name}: what it rests on" if static else "What it rests on"
    return PageSection(title, (), tuple(pictures), tuple(tables))
