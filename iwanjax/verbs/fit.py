"""The verb ``fit``: joint parameters from a study's recordings."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from iwanjax.plotting import plot
from iwanjax.report.fit import FitEntry, fit_report, measured_pictures
from iwanjax.signals.hilbert import RingDown
from iwanjax.signals.merge import MergedCurves
from iwanjax.studies import MeasuredMode, Study, StudyResults
from iwanjax.studies.fits import StudyFit
from iwanjax.updating import FitSolution
from iwanjax.verbs.output import (
    curve_arrays,
    file_names,
    results,
    save,
    version,
    write_arrays,
    write_json,
)

Pictures = tuple[tuple[str, bytes], ...]
"""Captions, and PNG."""


def run(study: Study, out: Path) -> list[str]:
    """Write fit.json, fit.npz, pictures and report.html; lines for the screen."""
    found, measured = fits_and_pictures(study)
    with results(out) as folder:
        pictures = write_fits(study, found, folder)
        page = fit_report(study.name, entries(found, pictures, measured))
        (folder / "report.html").write_text(page, encoding="utf-8")
    lines = [line for each in found.values() for line in each.summary().splitlines()]
    return [*lines, f"wrote {out / 'report.html'}"]


def fits_and_pictures(study: Study) -> tuple[StudyResults[StudyFit], list[Pictures]]:
    """A study's fits, and for each the pictures of what was measured.

    These are drawn while the kernels of the fit are compiled, which leaves the interpreter
    alone.
    """
    curves = study.curves()
    modes = list(curves.values())
    each = [[mode] for mode in modes] if study.structure is None else [modes]
    with ThreadPoolExecutor(1) as other:
        drawn = other.submit(lambda: [measured_pictures(*_shown(fitted)) for fitted in each])
        found = study.fit(curves)
    return found, drawn.result()


def write_fits(study: Study, found: StudyResults[StudyFit], folder: Path) -> list[bytes]:
    """fit.json, fit.npz and a picture of each fit, which is returned."""
    arrays: dict[str, np.ndarray] = {}
    pictures = []
    for label, each in zip(file_names(found), found.values(), strict=True):
        pictures.append(save(plot(each), folder / f"fit_{label}.png"))
        solution = each.solution
        arrays[f"{label}_covariance"] = solution.covariance
        for i, pair in enumerate(zip(solution.measured, solution.predicted, strict=True)):
            for kind, curves in zip(("measured", "predicted"), pair, strict=True):
                named = curve_arrays(curves)
                arrays |= {f"{label}_{kind}{i}_{name}": array for name, array in named.items()}
    write_arrays(folder / "fit.npz", arrays)
    write_json(
        folder / "fit.json",
        {
            "study": study.name,
            "iwanjax": version(),
            "fits": [_told(each) for each in found.values()],
        },
    )
    return pictures


def entries(
    found: StudyResults[StudyFit], pictures: Sequence[bytes], measured: Sequence[Pictures]
) -> list[FitEntry]:
    """A study's fits for its report, with their pictures."""
    return [
        FitEntry(
            each.name,
            each.solution,
            *_shown(each.modes),
            each.exponents,
            each.held_out,
            fit_picture=picture,
            measured_pictures=drawn,
        )
        for each, picture, drawn in zip(found.values(), pictures, measured, strict=True)
    ]


def _shown(modes: Sequence[MeasuredMode]) -> tuple[tuple[RingDown, ...], MergedCurves | None]:
    """What is drawn of the measurements behind a fit: of a single mode only."""
    if len(modes) != 1:
        return (), None
    mode = modes[0]
    return tuple(hit.ringdown for hit in mode.hits if hit.ringdown is not None), mode.merged


def _told(each: StudyFit) -> dict[str, Any]:
    """A fit for fit.json."""
    solution = each.solution
    return {
        "name": each.name,
        "modes": [mode.name for mode in each.modes],
        "parameters": parameters(solution),
        "derived": {
            name: {
                "value": value,
                "std": std,
                "determined": solution.follows(name),
                "at_least": solution.least(name),
            }
            for name, (value, std) in solution.derived.items()
        },
        "misfit": solution.misfit,
        "misfit_frequency": solution.misfit_frequency,
        "misfit_damping": solution.misfit_damping,
        "converged": solution.converged,
        "runs": solution.runs,
        "most_probable": solution.most_probable,
        "model_error": None if solution.model_error is None else solution.model_error._asdict(),
        "coupling": None
        if solution.coupling is None
        else [
            {
                "mode": each.mode,
                "modes": list(each.modes),
                "frequency_hz": each.frequency.tolist(),
                "damping": each.damping.tolist(),
            }
            for each in solution.coupling
        ],
        "agreeing": solution.agreeing,
        "active_bounds": solution.active_bounds,
        "undetermined": [
            {"components": d.components, "narrowing": d.narrowing} for d in solution.undetermined
        ],
        "free_exponents": None
        if each.exponents is None
        else {
            name: getattr(each.exponents, name)
            for name in ("frequency", "damping", "c_1", "chi", "zeta_0")
        },
        "held_out": [
            {
                "recording": row.name,
                "frequency_error_hz": row.frequency_error,
                "damping_error_percent": row.damping_error,
                "frequency_repeatability_hz": row.frequency_repeatability,
                "damping_repeatability_percent": row.damping_repeatability,
            }
            for row in each.held_out
        ],
        "seconds": each.seconds,
        "summary": solution.summary(),
    }


def parameters(solution: FitSolution) -> dict[str, dict[str, Any]]:
    """Estimates with all that is known of them."""
    return {
        p.name: {
            "value": p.value,
            "std": solution.std[p.name],
            "unit": p.unit,
            "meaning": p.meaning,
            "lower": p.lower,
            "upper": p.upper,
            "fixed": p.fixed,
            "determined": solution.determined.get(p.name, False),
            "on_bound": p.name in solution.active_bounds,
        }
        for p in solution.parameters
    }
