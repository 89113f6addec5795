"""The verb ``modal``: modes of a study's structure by its modal test."""

from pathlib import Path

import numpy as np

from iwanjax.modal_analysis import ModalTest
from iwanjax.plotting import plot_modal_test
from iwanjax.structures.model_file import Model
from iwanjax.studies import Study
from iwanjax.verbs.output import results, save, version, write_arrays, write_json


def run(study: Study, out: Path) -> list[str]:
    """Write modal.json, modal.npz, modal.png and model.npz; lines for the screen."""
    test = study.modal_test()
    with results(out) as folder:
        write_json(folder / "modal.json", {"study": study.name, **_summary(test)})
        test.save(folder / "modal.npz")
        # Figures close themselves, so that a folder of studies does not fill the memory.
        save(plot_modal_test(test), folder / "modal.png")
        model = study.setup.model
        if model is not None:
            write_arrays(folder / "model.npz", _arrays(model))
    return [*test.summary().splitlines(), f"wrote {out / 'modal.png'} and {out / 'model.npz'}"]


def _summary(test: ModalTest) -> dict[str, object]:
    known = test.responses
    return {
        "iwanjax": version(),
        "excitation": known.excitation,
        "averages": known.averages,
        "sensors": known.sensors,
        "inputs": known.inputs,
        "driving_points": test.sites,
        "mass_normalised": test.scaled,
        "modes": [
            {
                "frequency_hz": {"value": f, "std": f_std},
                "damping": {"value": z, "std": z_std},
                "shape": dict(zip(known.sensors, phi, strict=True)),
                "shape_std": dict(zip(known.sensors, phi_std, strict=True)),
            }
            for f, f_std, z, z_std, phi, phi_std in zip(
                test.frequency,
                test.frequency_std,
                test.damping,
                test.damping_std,
                test.shapes.T,
                test.shapes_std.T,
                strict=True,
            )
        ],
        "assurance": test.assurance,
        "misfit": dict(zip(known.sensors, test.misfit, strict=True)),
        "scatter": dict(zip(known.sensors, test.scatter, strict=True)),
        "converged": test.converged,
        "warnings": test.warnings,
    }


def _arrays(model: Model) -> dict[str, np.ndarray]:
    """A model file's arrays."""
    found = {name: np.asarray(getattr(model.structure, name)) for name in "MCK"}
    for labels, matrix, rows in (
        ("row_labels", "rows", model.rows),
        ("sensor_labels", "sensor_rows", model.sensors),
        ("input_labels", "input_rows", model.inputs),
    ):
        found[labels] = np.array(list(rows))
        found[matrix] = np.stack(list(rows.values()))
    return found
