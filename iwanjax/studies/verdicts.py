"""Diagnoses of a study as plain values: each one as it is, those of modes or parts together."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

from iwanjax.discrepancy import CurveRun, Diagnosis
from iwanjax.discrepancy.findings import Errors, Suspect
from iwanjax.discrepancy.judgement import together
from iwanjax.effects.estimate import Estimate
from iwanjax.effects.kinds import UnnamedKind


def as_json(
    verdicts: Mapping[str, Diagnosis], files: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """What diagnosis.json says of a study: one diagnosis, or several as one.

    Of several, the verdict is that of :func:`~iwanjax.discrepancy.judgement.together`, and an
    error the root mean square of the parts' errors; each stands under ``modes`` or ``parts``.

    Parameters
    ----------
    verdicts : mapping of str to Diagnosis
        Result of :meth:`iwanjax.Study.diagnose`.
    files : mapping of str to str, optional
        Of verdicts with a law that has no name, the file that it was saved to.

    Returns
    -------
    dict
        Lists, strings, numbers and dictionaries of them.
    """
    saved = files or {}
    parts = {name: _of_one(verdict, saved.get(name)) for name, verdict in verdicts.items()}
    if len(parts) == 1:
        return next(iter(parts.values()))
    each = list(parts.values())
    whole = together([verdict.verdict for verdict in verdicts.values()])
    single_modes = isinstance(next(iter(verdicts.values())).runs[0], CurveRun)
    return {
        "verdict": whole.name,
        "detected": whole.detected,
        "probability_nothing_missing": whole.nothing,
        "probability_something_else": whole.something_else,
        "what": sorted(_joined(each, "what"), key=lambda suspect: -suspect["probability"]),
        "joints": {name: values for part in each for name, values in part["joints"].items()},
        "linear_model": {},
        "places": _joined(each, "places"),
        "observables": _joined(each, "observables"),
        "fit": {
            errors: _root_mean_square([part["fit"][errors] for part in each])
            for errors in ("before", "after", "noise_floor")
        },
        "noise": _joined(each, "noise"),
        "force_noise": _joined(each, "force_noise"),
        "noise_floor_is_lower_bound": any(part["noise_floor_is_lower_bound"] for part in each),
        "refused": _joined(each, "refused"),
        "indistinguishable": _joined(each, "indistinguishable"),
        "warnings": _joined(each, "warnings"),
        "failures": _joined(each, "failures"),
        "complete": all(part["complete"] for part in each),
        "seconds": sum(part["seconds"] for part in each),
        "statement": " ".join(part["statement"] for part in each),
        "modes" if single_modes else "parts": parts,
    }


def _of_one(verdict: Diagnosis, file: str | None) -> dict[str, Any]:
    return {
        "verdict": verdict.verdict.name,
        "detected": verdict.detected,
        "probability_nothing_missing": verdict.probability_nothing_missing,
        "probability_something_else": verdict.probability_something_else,
        "what": [
            {
                "kind": getattr(each.kind, "catalogued", each.kind.name),
                "form": getattr(each.kind, "variant", ""),
                "where": each.where,
                "probability": each.probability,
                "log_evidence": each.log_evidence,
                "parameters": _parameters(each.parameters),
                "joint_with": list(each.joint_with),
            }
            | _unnamed(verdict, each, file)
            for each in verdict.what
        ],
        "places": [each._asdict() for each in verdict.places],
        "joints": {each.name: _parameters(each.parameters) for each in verdict.joints},
        "linear_model": {each.name: _parameters(each.parameters) for each in verdict.modes},
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
            "before": _errors(verdict.before),
            "after": _errors(verdict.after),
            "noise_floor": _errors(verdict.noise_floor),
            "noise_floor_95": _errors(verdict.noise_floor_95),
            "parameter_spread": _errors(verdict.parameter_spread),
        },
        "noise": [each._asdict() for each in verdict.noise],
        "force_noise": [each._asdict() for each in verdict.force_noise],
        "noise_floor_is_lower_bound": verdict.noise_floor_is_lower_bound,
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


def _unnamed(verdict: Diagnosis, suspect: Suspect, file: str | None) -> dict[str, Any]:
    """What is said of a law that has no name beside what is said of all."""
    force = verdict.unnamed
    if force is None or not isinstance(suspect.kind, UnnamedKind):
        return {}
    return {
        "description": force.description,
        "nearest": [{"kind": name, "probability": p} for name, p in force.nearest.items()],
        "terms": force.terms,
        "file": file,
    }


def _errors(errors: Errors) -> dict[str, float]:
    return {"fit": errors.fit, "hold_out": errors.hold_out}


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


def _joined(parts: Iterable[Mapping[str, Any]], name: str) -> list[Any]:
    """A list of every part, one after the other."""
    return [each for part in parts for each in part[name]]


def _root_mean_square(parts: list[dict[str, float]]) -> dict[str, float]:
    """Of the parts' errors, for fitted recordings and for those held out."""
    return {
        use: math.sqrt(sum(part[use] ** 2 for part in parts) / len(parts))
        for use in ("fit", "hold_out")
    }
