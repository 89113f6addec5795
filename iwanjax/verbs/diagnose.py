"""The verb ``diagnose``: what a study's model is missing, by its recordings."""

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from iwanjax.config import Study
from iwanjax.discrepancy import Diagnosis, Transient, diagnose
from iwanjax.errors import InputError
from iwanjax.plotting import plot_diagnosis, plot_places, plot_prediction, plot_restoring
from iwanjax.report.page import Section, Table, render
from iwanjax.signals import Recording
from iwanjax.verbs.measured import recordings_of
from iwanjax.verbs.output import results, save, version, write_json

# Differences by mode that a report lists.
_MODES = 12


def run(study: Study, out: Path, budget: float | None = None) -> list[str]:
    """Write diagnosis.json, a picture and report.html; lines for the screen."""
    model, structure = study.model, study.structure
    if model is None or structure is None:
        raise InputError(
            f"{study.path}: diagnose needs a structure with joints so far; this study has single "
            "modes"
        )
    if not model.rows or not model.sensors or not model.inputs:
        raise InputError(
            f"{study.path}: diagnose needs a model with named rows, sensors and inputs"
        )
    found = [
        (entry, recording)
        for entry in study.recordings
        if entry.kind == "transient"
        for recording in recordings_of(entry)
    ]
    if not found:
        raise InputError(
            f"{study.path}: no recordings of kind transient; diagnose needs time histories with "
            "force so far"
        )
    sensors, quantity, rate = _common(study, [recording for _, recording in found])
    transients = [
        Transient(
            entry.name,
            np.asarray(recording.response),
            _forces(study, recording, entry.place),
            entry.use,
        )
        for entry, recording in found
    ]
    limit = budget if budget is not None else study.budget
    verdict = diagnose(
        structure,
        transients,
        rate,
        places=model.rows,
        inputs=np.stack(list(model.inputs.values())),
        sensors={name: model.sensors[name] for name in sensors},
        quantity=quantity,
        hypotheses=study.hypotheses,
        noise=[study.noise.get(name, math.nan) for name in sensors],
        budget=math.inf if limit is None else limit,
        seed=study.seed,
        progress=lambda line: print(f"  {line}", file=sys.stderr, flush=True),
    )
    with results(out) as folder:
        pictures = _pictures(verdict, folder)
        write_json(folder / "diagnosis.json", told(study.name, verdict))
        page = _report(study.name, verdict, pictures)
        (folder / "report.html").write_text(page, encoding="utf-8")
    return [verdict.statement(), f"wrote {out / 'report.html'}"]


def _common(study: Study, recordings: list[Recording]) -> tuple[list[str], Any, float]:
    """Sensors, quantity and sampling rate that all recordings have in common."""
    assert study.model is not None
    first = recordings[0]
    names = [channel.name for channel in first.channels]
    quantities = {channel.quantity for recording in recordings for channel in recording.channels}
    for recording in recordings:
        if [channel.name for channel in recording.channels] != names:
            raise InputError(
                f"{study.path}: recordings with different sensors; expected {', '.join(names)} in "
                "all"
            )
        if not math.isclose(recording.sampling_rate, first.sampling_rate, rel_tol=1e-6):
            raise InputError(
                f"{study.path}: recordings of {first.sampling_rate:g} and "
                f"{recording.sampling_rate:g} Hz; expected one sampling rate"
            )
    unknown = [name for name in names if name not in study.model.sensors]
    if unknown:
        raise InputError(
            f"{study.path}: sensor {unknown[0]!r} is not in the model; it has "
            f"{', '.join(study.model.sensors)}"
        )
    if len(quantities) != 1 or not quantities <= {"acceleration", "velocity", "displacement"}:
        raise InputError(
            f"{study.path}: sensors measure {', '.join(sorted(map(str, quantities)))}; expected "
            "all acceleration, velocity or displacement"
        )
    return names, quantities.pop(), first.sampling_rate


def _forces(study: Study, recording: Recording, place: str) -> np.ndarray:
    """Forces at all inputs of the model, zero where none was measured."""
    assert study.model is not None
    inputs = list(study.model.inputs)
    if recording.force is None:
        raise InputError(f"{place}: has no force; diagnose needs it so far")
    force = np.zeros((recording.force.shape[0], len(inputs)))
    names = [channel.name for channel in recording.inputs]
    for name, column in zip(names, np.asarray(recording.force).T, strict=True):
        if name not in inputs:
            raise InputError(f"{place}: input {name!r} is not in the model: {', '.join(inputs)}")
        force[:, inputs.index(name)] = column
    return force


def told(study: str, verdict: Diagnosis) -> dict[str, Any]:
    """A diagnosis for diagnosis.json."""

    def pair(errors: tuple[float, float]) -> dict[str, float]:
        return {"fit": errors[0], "hold_out": errors[1]}

    return {
        "study": study,
        "iwanjax": version(),
        "detected": verdict.detected,
        "probability_nothing_missing": verdict.probability_nothing_missing,
        "probability_something_else": verdict.probability_something_else,
        "what": [
            {
                "kind": each.kind.name,
                "where": each.where,
                "probability": each.probability,
                "log_evidence": each.log_evidence,
                "parameters": {
                    p.info.name: {
                        "value": p.value,
                        "std": p.std if math.isfinite(p.std) else None,
                        "unit": p.info.dimension,
                    }
                    for p in each.parameters
                },
                "joint_with": list(each.joint_with),
            }
            for each in verdict.what
        ],
        "observables": [
            {
                "recording": each.recording,
                "mode": each.mode,
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
        },
        "indistinguishable": [list(each) for each in verdict.indistinguishable],
        "warnings": list(verdict.warnings),
        "complete": verdict.complete,
        "seconds": verdict.seconds,
        "statement": verdict.statement(),
    }


def _pictures(verdict: Diagnosis, folder: Path) -> list[tuple[str, bytes]]:
    """Captions and pictures, the verdict's own first."""
    drawn = [
        (
            "Errors of every recording, and how far the rivals are behind.",
            "diagnosis",
            plot_diagnosis(verdict),
        ),
        (
            "The last recording, held out where one is, from rest under the measured force: "
            "measured, predicted before and after, and the spectrum of what is left.",
            "prediction",
            plot_prediction(verdict),
        ),
    ]
    if verdict.restoring is not None:
        told = (
            "What the place needs: the chosen law and what the recordings leave beside it, sample "
            "by sample; it bends away from the law where that is wrong. Lines are the laws fitted."
        )
        drawn.append((told, "restoring_force", plot_restoring(verdict)))
    if verdict.scores:
        told = "Where: what each kind at each place would explain of what the joints cannot."
        drawn.append((told, "places", plot_places(verdict)))
    return [(told, save(figure, folder / f"{name}.png")) for told, name, figure in drawn]


def _report(title: str, verdict: Diagnosis, pictures: list[tuple[str, bytes]]) -> str:
    """The verdict in words, its picture and its tables."""
    recordings = Table(
        ("Recording", "Joints refitted", "With the first suspect"),
        tuple(
            (name, f"{before:.3g}", f"{after:.3g}" if verdict.detected else "–")
            for name, (before, after) in verdict.by_recording.items()
        ),
        "Root mean square of predicted less measured over that of measured, free run.",
    )
    rivals = Table(
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
    modes = Table(
        ("Recording", "Mode", "Quantity", "Amplitudes", "Model less measured"),
        tuple(
            (
                each.recording,
                str(each.mode),
                each.quantity,
                f"{each.amplitude[0]:.3g} to {each.amplitude[1]:.3g}",
                f"{each.difference_percent:+.2g} %",
            )
            for each in verdict.observables[:_MODES]
        ),
        "Frequency and damping that the model with its joints refitted gets wrong.",
        words=(0, 2),
    )
    tables = [recordings]
    tables += [rivals] * bool(verdict.what) + [modes] * bool(verdict.observables)
    section = Section("What it rests on", (), tuple(pictures), tuple(tables))
    return render(title, [verdict.statement()], [section], f"Written by iwanjax {version()}.")
