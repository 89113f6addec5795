"""The verb ``detectability``: what a study's recordings would show of each effect."""

from pathlib import Path

from iwanjax.plotting import plot_detectability
from iwanjax.studies import Study
from iwanjax.verbs.output import results, save, say, version, write_json

# Lines for the screen; the files hold all.
_PAIRS, _ADDED = 6, 3


def run(study: Study, out: Path) -> list[str]:
    """Write detectability.json, detectability.npz and detectability.png; lines for the screen."""
    found = study.detectability(progress=say)
    with results(out) as folder:
        content = {"study": study.name, "iwanjax": version(), **found.to_dict()}
        write_json(folder / "detectability.json", content)
        found.save(folder / "detectability.npz")
        (folder / "detectability.txt").write_text(found.summary() + "\n", encoding="utf-8")
        save(plot_detectability(found), folder / "detectability.png")
    lines = [
        f"not told apart at twice the smallest size: {pair.first} and {pair.second}"
        + (f"; {pair.decides} would help ({pair.factor:.1f} times)" if pair.decides else "")
        for pair in found.alike[:_PAIRS]
    ]
    if len(found.alike) > _PAIRS:
        lines.append(f"and {len(found.alike) - _PAIRS} pairs more")
    lines += [
        f"to add: {each.label}: sizes told apart become {each.named:.2f} times as large"
        for each in found.added[:_ADDED]
        if each.named < 1.0
    ]
    return [*lines, *found.warnings, f"wrote {out / 'detectability.txt'} and .png, .json, .npz"]
