"""The verb ``trial``: how often a diagnosis of a study's recordings would be right."""

from pathlib import Path
from typing import Any

from iwanjax.plotting import plot_trial
from iwanjax.studies import Study
from iwanjax.verbs.output import results, save, say, version, write_json


def run(study: Study, out: Path, **asked: Any) -> list[str]:
    """Write trial.json, trial.npz, trial.txt and trial.png; lines for the screen."""
    found = study.trial(out, progress=say, **asked)
    with results(out) as folder:
        content = {"study": study.name, "iwanjax": version(), **found.to_dict()}
        counts = [each._asdict() for each in found.counts]
        briers = {each.what: each.brier for each in found.forecasts} | {"all": found.brier}
        write_json(folder / "trial.json", {**content, "counts": counts, "brier": briers})
        found.save(folder / "trial.npz")
        (folder / "trial.txt").write_text(found.summary() + "\n", encoding="utf-8")
        save(plot_trial(found), folder / "trial.png")
    lines = [f"{each.what}: {each.hits} of {each.of}" for each in found.counts]
    return [
        *lines,
        f"Brier score of its probabilities: {found.brier:.3f}",
        f"wrote {out / 'trial.txt'} and .png, .json, .npz",
    ]
