"""The verb ``diagnose``: what a study's model is missing, by its recordings."""

import math
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from iwanjax.discrepancy import CurveRun, Diagnosis, LoopRun, ModesRun
from iwanjax.discrepancy.failures import attempted
from iwanjax.discrepancy.findings import Estimate
from iwanjax.discrepancy.judgement import together
from iwanjax.plotting import (
    plot_diagnosis,
    plot_explained,
    plot_loops,
    plot_places,
    plot_prediction,
    plot_restoring,
)
from iwanjax.report.page import NamedParagraph, PageSection, PageTable, render
from iwanjax.report.words import with_deviation
from iwanjax.studies import Study
from iwanjax.verbs.output import file_names, results, save, version, write_json

# Parts of a report's lead after the verdict.
_PARTS = ("Improvement", "Doubt", "Measure next")
# Differences by mode that a report lists.
_MODES = 12


def run(study: Study, out: Path, budget: float | None = None) -> list[str]:
    """Write diagnosis.json, pictures and report.html; lines for the screen."""
    verdicts = dict(study.diagnose(budget=budget, progress=_say))
    # Several modes have their pictures under their own names.
    ends = [f"_{label}" for label in file_names(verdicts)] if len(verdicts) > 1 else [""]
    with results(out) as folder:
        sections = []
        for (name, verdict), end in zip(verdicts.items(), ends, strict=True):
            failures = list(verdict.failures)
            pictures = _pictures(verdict, folder, end, failures)
            verdicts[name] = replace(verdict, failures=tuple(failures))
            sections.append(_section(name, verdict, pictures))
        write_json(folder / "diagnosis.json", told(study.name, verdicts))
        lead = [
            f"{name}: {verdict.statement()}" if len(verdicts) > 1 else verdict.statement()
            for name, verdict in verdicts.items()
        ]
        page = render(study.name, _lead(verdicts), sections, f"Written by iwanjax {version()}.")
        (folder / "report.html").write_text(page, encoding="utf-8")
    return [*lead, f"wrote {out / 'report.html'}"]


def _say(line: str) -> None:
    print(f"  {line}", file=sys.stderr, flush=True)


def _lead(verdicts: Mapping[str, Diagnosis]) -> list[str | NamedParagraph]:
    """Each verdict first; then how much better predictions get, the doubt, what to do next."""
    lead: list[str | NamedParagraph] = []
    for name, verdict in verdicts.items():
        first, *others = verdict.told()
        lead.append(NamedParagraph(name, first) if len(verdicts) > 1 else first)
        lead += [
            NamedParagraph(title, text) for title, text in zip(_PARTS, others, strict=True) if text
        ]
    return lead


def told(study: str, verdicts: Mapping[str, Diagnosis]) -> dict[str, Any]:
    """Diagnoses for diagnosis.json: one as it is, those of modes or of parts taken together."""
    each = {name: _told(verdict) for name, verdict in verdicts.items()}
    first = {"study": study, "iwanjax": version()}
    if len(each) == 1:
        return first | next(iter(each.values()))
    parts = list(each.values())
    suspects = [suspect for part in parts for suspect in part["what"]]

    def mean(errors: str) -> dict[str, float]:
        rows = [part["fit"][errors] for part in parts]
        return {
            use: math.sqrt(sum(row[use] ** 2 for row in rows) / len(rows))
            for use in ("fit", "hold_out")
        }

    whole = together([verdict.verdict for verdict in verdicts.values()])
    return first | {
        "verdict": whole.name,
        "detected": whole.detected,
        "probability_nothing_missing": whole.nothing,
        "probability_something_else": whole.something_else,
        "what": sorted(suspects, key=lambda suspect: -suspect["probability"]),
        "joints": {name: each for part in parts for name, each in part["joints"].items()},
        "observables": [each for part in parts for each in part["observables"]],
        "fit": {errors: mean(errors) for errors in ("before", "after", "noise_floor")},
        "refused": [each for part in parts for each in part["refused"]],
        "indistinguishable": [pair for part in parts for pair in part["indistinguishable"]],
        "warnings": [line for part in parts for line in part["warnings"]],
        "failures": [line for part in parts for line in part["failures"]],
        "complete": all(part["complete"] for part in parts),
        "seconds": sum(part["seconds"] for part in parts),
        "statement": " ".join(part["statement"] for part in parts),
        "modes" if isinstance(next(iter(verdicts.values())).runs[0], CurveRun) else "parts": each,
    }


def _told(verdict: Diagnosis) -> dict[str, Any]:
    """One diagnosis."""

    def pair(errors: tuple[float, float]) -> dict[str, float]:
        return {"fit": errors[0], "hold_out": errors[1]}

    return {
        "verdict": verdict.verdict.name,
        "detected": verdict.detected,
        "probability_nothing_missing": verdict.probability_nothing_missing,
        "probability_something_else": verdict.probability_something_else,
        "what": [
            {
                "kind": each.kind.name,
                "where": each.where,
                "probability": each.probability,
                "log_evidence": each.log_evidence,
                "parameters": _parameters(each.parameters),
                "joint_with": list(each.joint_with),
            }
            for each in verdict.what
        ],
        "joints": {each.name: _parameters(each.parameters) for each in verdict.joints},
        "observables": [
            {
                "recording": each.recording,
                "mode": each.mode,
                "mode_name": each.name,
                "quantity": each.quantity,
                "amplitude": list(each.amplitude),
                "difference_percent": each.difference_percent,
            }
            for each in verdict.observables
        ],
        "recordings": {
            name: {"before": before, "after": after}
            for name, (before, after) in verdict.by_recording.items()
        },
        "fit": {
            "before": pair(verdict.before),
            "after": pair(verdict.after),
            "noise_floor": pair(verdict.noise_floor),
            "noise_floor_95": pair(verdict.noise_floor_95),
            "parameter_spread": pair(verdict.parameter_spread),
        },
        "refused": [
            {"what": each.label, "before": each.before, "after": each.after}
            for each in verdict.refused
        ],
        "indistinguishable": [list(each) for each in verdict.indistinguishable],
        "warnings": list(verdict.warnings),
        "failures": list(verdict.failures),
        "complete": verdict.complete,
        "seconds": verdict.seconds,
        "statement": verdict.statement(),
    }


def _parameters(estimates: Iterable[Estimate]) -> dict[str, Any]:
    """Values with deviations and units, by name."""
    return {
        p.info.name: {
            "value": p.value,
            "std": p.std if math.isfinite(p.std) else None,
            "unit": p.info.dimension,
        }
        for p in estimates
    }


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
        told = (
            "Frequency and damping as measured and as the models before and after have them; "
            "below, what either leaves, over the deviation of each point."
        )
        plots.append((told, "prediction", plot_explained))
    elif isinstance(verdict.runs[0], LoopRun):
        told = (
            "Force against deflection as measured and as the models before and after have it; "
            "below, what either leaves, over the force's deviation."
        )
        plots.append((told, "prediction", plot_loops))
    else:
        told = (
            "The last recording, held out where one is, in free run: measured, predicted before "
            "and after, and the spectrum of what is left."
        )
        plots.append((told, "prediction", plot_prediction))
    if verdict.restoring is not None:
        told = (
            "What the place needs: the chosen law and what the recordings leave beside it, sample "
            "by sample; it bends away from the law where that is wrong. Lines are the laws fitted."
        )
        plots.append((told, "restoring_force", plot_restoring))
    if verdict.scores:
        told = "Where: what each kind at each place would explain of what the joints cannot."
        plots.append((told, "places", plot_places))
    found = []
    for told, name, plot in plots:
        path = folder / f"{name}{end}.png"
        drawn = attempted(
            f"the picture {path.name}",
            lambda plot=plot, path=path: save(plot(verdict), path),
            None,
            failures,
        )
        if drawn is not None:
            found.append((told, drawn))
    return found


def _section(name: str, verdict: Diagnosis, pictures: list[tuple[str, bytes]]) -> PageSection:
    """What a verdict rests on: its pictures and its tables."""
    static = isinstance(verdict.runs[0], CurveRun | LoopRun | ModesRun)
    models = ("Joints refitted", "With the first suspect")[: 1 + bool(verdict.what)]
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
        "Frequency and damping that the model with its joints refitted gets wrong.",
        words=(0, 1, 2),
    )
    joints = PageTable(
        ("Joint", "Parameter", "Value", "Deviation", "Unit"),
        tuple(
            (each.name, p.info.name, *with_deviation(p.value, p.std), p.info.dimension)
            for each in verdict.joints
            for p in each.parameters
        ),
        "The joints as refitted" + (", with the first suspect." if verdict.what else "."),
        words=(0, 1, 4),
    )
    tables = [recordings]
    tables += [rivals] * bool(verdict.what) + [joints] * bool(verdict.joints)
    tables += [modes] * bool(verdict.observables)
    title = f"{name}: what it rests on" if static else "What it rests on"
    return PageSection(title, (), tuple(pictures), tuple(tables))
