"""The verb ``curves``: measured frequency and damping against amplitude."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from iwanjax.plotting import plot, plot_ringdown
from iwanjax.studies import Hit, MeasuredMode, Study
from iwanjax.verbs.output import (
    curve_arrays,
    file_names,
    results,
    save,
    version,
    write_arrays,
    write_json,
)


def run(study: Study, out: Path) -> list[str]:
    """Write curves.json, curves.npz, a curves file per mode, pictures; lines for the screen."""
    modes = list(study.curves().values())
    labels = file_names(mode.name for mode in modes)
    with results(out) as folder:
        arrays: dict[str, np.ndarray] = {}
        for label, mode in zip(labels, modes, strict=True):
            common = curve_arrays(mode.curves)
            write_arrays(folder / f"curves_{label}.npz", common)
            arrays |= {f"{label}_{name}": array for name, array in common.items()}
            for i, hit in enumerate((*mode.hits, *mode.held_out)):
                each = curve_arrays(hit.curves)
                arrays |= {f"{label}_hit{i}_{name}": array for name, array in each.items()}
            _draw(mode, label, folder)
        write_arrays(folder / "curves.npz", arrays)
        write_json(
            folder / "curves.json",
            {
                "study": study.name,
                "iwanjax": version(),
                "modes": [_told(mode) for mode in modes],
            },
        )
    lines = [line for mode in modes for line in mode.summary().splitlines()]
    return [*lines, *(f"wrote {out / f'curves_{label}.png'}" for label in labels)]


def _draw(mode: MeasuredMode, label: str, folder: Path) -> None:
    save(plot(mode), folder / f"curves_{label}.png")
    for hit in mode.hits[:1]:
        if hit.ringdown is not None:
            save(plot_ringdown(hit.ringdown), folder / f"ringdown_{label}.png")


def _told(mode: MeasuredMode) -> dict[str, Any]:
    """A mode for curves.json."""
    common = mode.curves
    told: dict[str, Any] = {
        "name": mode.name,
        "band_hz": mode.band,
        "quantity": common.quantity,
        "unit": common.unit,
        **curve_arrays(common),
        "hits": _hits(mode.hits, "fit") + _hits(mode.held_out, "hold_out"),
        "skipped": mode.skipped,
    }
    if mode.merged is not None:
        merged = mode.merged
        told["repeatability"] = {
            "frequency_hz": merged.frequency_repeatability,
            "damping": merged.damping_repeatability,
            "frequency_spread_hz": merged.frequency_spread,
            "damping_spread": merged.damping_spread,
            "frequency_estimator_hz": merged.frequency_estimator,
            "damping_estimator": merged.damping_estimator,
            "hits": merged.count,
        }
    return told


def _hits(hits: Sequence[Hit], use: str) -> list[dict[str, Any]]:
    return [{"recording": hit.name, "use": use, **curve_arrays(hit.curves)} for hit in hits]
