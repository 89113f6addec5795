"""The verb ``curves``: measured frequency and damping against amplitude."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from iwanjax.config import Study
from iwanjax.curves import ModalCurves
from iwanjax.plotting import plot_curves, plot_merged, plot_ringdown
from iwanjax.verbs.measured import Hit, MeasuredMode, measured_modes
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
    modes = measured_modes(study)
    labels = file_names(mode.name for mode in modes)
    with results(out) as folder:
        arrays: dict[str, np.ndarray] = {}
        for label, mode in zip(labels, modes, strict=True):
            common = curve_arrays(common_curve(mode))
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
    lines = [line for mode in modes for line in _lines(mode)]
    return [*lines, *(f"wrote {out / f'curves_{label}.png'}" for label in labels)]


def common_curve(mode: MeasuredMode) -> ModalCurves:
    """The mode's one curve: of the only hit, the merged one, or of the hit with most levels."""
    if mode.merged is not None:
        return mode.merged.curves
    return max((hit.curves for hit in mode.hits), key=lambda curves: curves.amplitude.size)


def _draw(mode: MeasuredMode, label: str, folder: Path) -> None:
    everything = [hit.curves for hit in (*mode.hits, *mode.held_out)]
    if mode.merged is not None:
        save(plot_merged(mode.merged), folder / f"curves_{label}.png")
    else:
        save(plot_curves(everything), folder / f"curves_{label}.png")
    for hit in mode.hits[:1]:
        if hit.ringdown is not None:
            save(plot_ringdown(hit.ringdown), folder / f"ringdown_{label}.png")


def _told(mode: MeasuredMode) -> dict[str, Any]:
    """A mode for curves.json."""
    common = common_curve(mode)
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


def _lines(mode: MeasuredMode) -> list[str]:
    """A mode for the screen."""
    common = common_curve(mode)
    a, f, z = (np.asarray(x) for x in (common.amplitude, common.frequency, common.damping))
    order = np.argsort(a)
    low, high = order[0], order[-1]
    unit = f" {common.unit}" if common.unit else ""
    lines = [
        f"{mode.name}: {len(mode.hits)} recording(s) to fit, {len(mode.held_out)} held out; "
        f"{common.quantity} {a[low]:.3g} to {a[high]:.3g}{unit}: {f[low]:.6g} to {f[high]:.6g} Hz, "
        f"damping {100 * z[low]:.3g} to {100 * z[high]:.3g} %"
    ]
    if mode.merged is not None:
        f_rms, z_rms = (
            float(np.sqrt(np.mean(np.square(x))))
            for x in (mode.merged.frequency_spread, mode.merged.damping_spread)
        )
        lines.append(
            f"{mode.name}: at equal amplitude the recordings lie {f_rms:.2g} Hz and "
            f"{100 * z_rms:.2g} % damping (rms) about their mean"
        )
    return lines + [f"{mode.name}: left out {reason}" for reason in mode.skipped]
