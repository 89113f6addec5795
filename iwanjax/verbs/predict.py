"""The verb ``predict``: the fitted structure against recordings that it was not fitted to."""

from pathlib import Path
from typing import Any

import numpy as np

from iwanjax.plotting import plot
from iwanjax.studies import Study
from iwanjax.studies.predicted import Comparison, PredictedMode, PredictedRecording
from iwanjax.studies.predictions import held_out
from iwanjax.studies.study import silent
from iwanjax.verbs.fit import parameters
from iwanjax.verbs.output import (
    file_names,
    results,
    save,
    say,
    version,
    write_arrays,
    write_json,
)


def run(
    study: Study, out: Path, posterior: bool = False, draws: int = 100, probability: float = 0.9
) -> list[str]:
    """Write predict.json, predict.npz and a picture of each recording; lines for the screen.

    The chain of a posterior is kept in the folder under the name that the verb of that name gives
    it, which therefore goes on with it, and the other way round.
    """
    # Nothing is fitted for what cannot be predicted.
    held_out(study.setup, draws, probability, silent)
    say("fitting")
    fits = study.fit()
    with results(out) as folder:
        posteriors = None
        if posterior:
            labels = zip(fits, file_names(fits), strict=True)
            chains = {name: out / f"posterior_{label}.h5" for name, label in labels}
            posteriors = study.posterior(fits, chains=chains, progress=True)
        found = study.predict(fits, posteriors, draws=draws, probability=probability, progress=say)
        arrays: dict[str, np.ndarray] = {}
        for label, each in zip(file_names(found), found.values(), strict=True):
            save(plot(each), folder / f"predict_{label}.png")
            arrays |= {f"{label}_{name}": array for name, array in _arrays(each).items()}
        write_arrays(folder / "predict.npz", arrays)
        write_json(
            folder / "predict.json",
            {
                "study": study.name,
                "iwanjax": version(),
                "parameters": parameters(fits.only.solution),
                "predictions": [_told(each) for each in found.values()],
            },
        )
    lines = [line for each in found.values() for line in each.summary().splitlines()]
    return [*lines, f"wrote {out / 'predict.json'}"]


def _arrays(found: PredictedRecording) -> dict[str, np.ndarray]:
    """A prediction for predict.npz."""
    arrays = {
        "sensors": np.array(found.sensors),
        "modes": np.array([mode.name for mode in found.modes]),
        "time": found.time,
        "window_time": found.window_time,
        "noise": found.noise,
    }
    arrays |= _parts("response", found.response) | _parts("amplitude", found.amplitude)
    arrays["amplitude_relative_error"] = found.amplitude.relative
    for label, mode in zip(file_names(each.name for each in found.modes), found.modes, strict=True):
        arrays |= _parts(f"{label}_component", mode.component)
        arrays |= _parts(f"{label}_amplitude", mode.amplitude)
        arrays[f"{label}_amplitude_relative_error"] = mode.amplitude.relative
        if mode.curves is not None:
            curves = mode.curves
            arrays |= {
                f"{label}_modal_displacement": curves.amplitude,
                f"{label}_frequency_std": curves.frequency_std,
                f"{label}_damping_std": curves.damping_std,
            }
            arrays |= _parts(f"{label}_frequency", curves.frequency)
            arrays |= _parts(f"{label}_damping", curves.damping)
    return arrays


def _parts(name: str, compared: Comparison) -> dict[str, np.ndarray]:
    return {f"{name}_{part}": array for part, array in compared._asdict().items()}


def _told(found: PredictedRecording) -> dict[str, Any]:
    """A prediction for predict.json."""
    of_sensors = zip(
        found.sensors,
        found.response.error,
        found.floor,
        found.noise,
        found.spread,
        found.covered,
        found.amplitude.error,
        strict=True,
    )
    return {
        "recording": found.name,
        "quantity": found.quantity,
        "unit": found.unit,
        "source": found.source,
        "draws": found.draws,
        "probability": found.probability,
        "frequencies_up_to_an_offset": found.shifted,
        "integration_error": found.error_estimated,
        "sensors": {
            sensor: {
                "error": error,
                "noise_floor": floor,
                "noise": noise,
                "parameters": spread,
                "covered": covered,
                "amplitude_error": amplitude,
            }
            for sensor, error, floor, noise, spread, covered, amplitude in of_sensors
        },
        "shown": found.shown,
        "modes": [_told_of_mode(mode) for mode in found.modes],
        "summary": found.summary(),
    }


def _told_of_mode(mode: PredictedMode) -> dict[str, Any]:
    curves = mode.curves
    return {
        "name": mode.name,
        "error": float(mode.component.error),
        "filter_error": mode.leakage,
        "filtered_error": mode.filtered_error,
        "amplitude_error": float(mode.amplitude.error),
        "frequency_error_hz": None if curves is None else curves.frequency_error,
        "damping_error_percent": None if curves is None else curves.damping_error,
        "reason": mode.reason or None,
    }
