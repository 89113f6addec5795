"""The verb ``posterior``: what a study's recordings say of the parameters, sampled."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from iwanjax.plotting import plot_posterior
from iwanjax.report.fit import fit_report
from iwanjax.studies import Study
from iwanjax.updating import Posterior
from iwanjax.verbs.fit import entries, fits_and_pictures, write_fits
from iwanjax.verbs.output import file_names, results, save, version, write_arrays, write_json


def run(study: Study, out: Path) -> list[str]:
    """Write posterior.json, posterior.npz, the chains, pictures and report.html.

    The chains (posterior_MODE.h5) are kept in the folder while they grow, so that the same
    command goes on where it was interrupted.
    """
    found, measured = fits_and_pictures(study)
    labels = file_names(found)
    chains = {
        name: out / f"posterior_{label}.h5" for name, label in zip(found, labels, strict=True)
    }
    with results(out) as folder:
        posteriors = study.posterior(found, chains=chains, progress=True)
        rows = []
        pictures = write_fits(study, found, folder)
        arrays: dict[str, np.ndarray] = {}
        for label, posterior, entry in zip(
            labels, posteriors.values(), entries(found, pictures, measured), strict=True
        ):
            drawn = save(plot_posterior(posterior), folder / f"posterior_{label}.png")
            rows.append(replace(entry, posterior=posterior, posterior_picture=drawn))
            arrays[f"{label}_names"] = np.array(posterior.names)
            arrays[f"{label}_chain"] = posterior.chain
            arrays[f"{label}_log_density"] = posterior.log_density
        write_arrays(folder / "posterior.npz", arrays)
        write_json(
            folder / "posterior.json",
            {
                "study": study.name,
                "iwanjax": version(),
                "posteriors": [
                    {"name": name, **_told(posterior)} for name, posterior in posteriors.items()
                ],
            },
        )
        (folder / "report.html").write_text(fit_report(study.name, rows), encoding="utf-8")
    lines = [
        line
        for name, posterior in posteriors.items()
        for line in f"{name}: {posterior.summary()}".splitlines()
    ]
    return [*lines, f"wrote {out / 'report.html'}"]


def _told(posterior: Posterior) -> dict[str, Any]:
    """A posterior for posterior.json."""
    return {
        "parameters": {
            name: {
                "mean": float(np.mean(values)),
                "std": float(np.std(values)),
                "median": float(np.median(values)),
                "interval_68": posterior.interval(name, 0.6827),
                "interval_90": posterior.interval(name, 0.9),
                "interval_95": posterior.interval(name, 0.95),
                "effective_samples": posterior.effective[name],
                "autocorrelation_steps": posterior.autocorrelation[name],
            }
            for name, values in posterior.samples.items()
        },
        "enough": posterior.enough,
        "effective_samples_wanted": posterior.wanted,
        "acceptance": posterior.acceptance,
        "steps": posterior.chain.shape[0],
        "burnt": posterior.burnt,
        "walkers": posterior.chain.shape[1],
        "summary": posterior.summary(),
    }
