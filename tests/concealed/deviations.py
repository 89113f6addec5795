"""Whether stated deviations hold: what a record says of sizes and joints, beside the truth.

`python tests/concealed/deviations.py RECORD.json FOLDER`

RECORD is one of `frozen.py record`; FOLDER holds the cases with the truth beside each. Counted are
the sizes of effects that are named rightly and the parameters of the study's own joints in every
verdict that is right. A number is taken as determined where its deviation is finite and smaller
than the number itself: the others claim nothing.
"""

import argparse
import json
import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from iwanjax.trial.effects import PARAMETERS

IWAN = PARAMETERS["iwan_joint"]
# What the package calls a truth that it states in other terms: the name, and the value from the
# truth's and the sampling rate.
OTHERWISE: dict[str, tuple[str, Callable[[float, float], float]]] = {
    "gain": ("gain_error", lambda value, rate: value - 1.0),
    "intervals": ("delay", lambda value, rate: value / rate),
    "factor_F_S": ("F_S_change", lambda value, rate: math.log(value)),
    "factor_K_T": ("K_T_change", lambda value, rate: math.log(value)),
}


@dataclass(frozen=True)
class Stated:
    """One number with its deviation, beside the truth."""

    case: str
    kind: str
    where: str
    name: str
    value: float
    deviation: float
    truth: float

    @property
    def determined(self) -> bool:
        """Whether the deviation claims anything."""
        return 0.0 < self.deviation < abs(self.value)

    @property
    def off(self) -> float:
        """Distance from the truth in stated deviations."""
        return abs(self.value - self.truth) / self.deviation

    def __str__(self) -> str:
        return (
            f"{self.case} {self.kind}@{self.where} {self.name} = {self.value:.6g} "
            f"+- {self.deviation:.2g}, truth {self.truth:.6g}: {self.off:.1f} deviations"
        )


def _sizes(truth: dict[str, Any], rate: float) -> Iterator[tuple[str, str, str, float]]:
    """Kind, place, name and value of every size that is concealed."""
    kinds, places = truth["kind"], truth["where"]
    if isinstance(kinds, str):
        kinds, places = [kinds], [places]
    for kind, where, each in zip(kinds, places, truth["parameters"], strict=False):
        for name, value in zip(PARAMETERS[kind], each["values"], strict=False):
            called, in_terms = OTHERWISE.get(name, (name, lambda value, rate: value))
            yield kind, where, called, in_terms(value, rate)


def stated(name: str, found: dict[str, Any], truth: dict[str, Any], rate: float) -> list[Stated]:
    """All numbers of a verdict that is right, those of drifting joints left out."""
    if not found["right"] or "parameters" not in truth:
        return []
    entries = {(each["kind"], each["where"]): each["parameters"] for each in found["what"]}
    rows = []
    for kind, where, called, value in _sizes(truth, rate):
        if called in (given := entries.get((kind, where), {})):
            rows.append((kind, where, called, given[called], value))
    drifts = truth["where"] if truth["kind"] == "joint_drift" else None
    for joint, values in truth["joints"].items():
        for called, value in zip(IWAN, values, strict=True):
            if joint != drifts and called in (given := found["joints"].get(joint, {})):
                rows.append(("joint", joint, called, given[called], value))
    return [
        Stated(name, kind, where, called, each["value"], each["std"], value)
        for kind, where, called, each, value in rows
        if each["std"] is not None
    ]


def _line(name: str, some: list[Stated]) -> str:
    within = [sum(each.off <= limit for each in some) / len(some) for limit in (1.0, 2.0)]
    return f"{name:24} | {100 * within[0]:4.0f} % | {100 * within[1]:4.0f} % | {len(some):3d}"


def _of_folder(name: str, found: dict[str, Any], folder: Path) -> list[Stated]:
    """The same of a case whose truth lies beside it."""
    truth = json.loads((folder / name / "truth.json").read_text())
    study = yaml.safe_load((folder / name / "study.yaml").read_text())
    rate = float(study["recordings"][0].get("sampling_rate", math.nan))
    return stated(name, found, truth, rate)


def coverage(record: dict[str, Any], folder: Path) -> str:
    """Shares within one and two deviations, by parameter and by effect, and what lies beyond."""
    right = [(name, each) for name, each in record.items() if "error" not in each]
    every = [each for name, found in right for each in _of_folder(name, found, folder)]
    known = [each for each in every if each.determined]
    if not known:
        return "no number is determined in a verdict that is right"
    truths = {name: " + ".join(record[name]["truth"]) or "nothing" for name in record}
    groups: dict[str, list[Stated]] = {"all": known}
    for key in (
        lambda each: "sizes" if each.kind != "joint" else "joints",
        lambda each: f"{'joint' if each.kind == 'joint' else 'size'} {each.name}",
        lambda each: "in " + "+".join(x.split("@")[0] for x in truths[each.case].split(" + ")),
    ):
        for value in sorted({key(each) for each in known}):
            groups[value] = [each for each in known if key(each) == value]
    far = sorted((each for each in known if each.off > 2.0), key=lambda each: -each.off)
    cases = {each.case for each in known}
    kept = [max(each.off for each in known if each.case == case) <= 2.0 for case in cases]
    head = f"{'':24} | 1 dev. | 2 dev. | numbers"
    return "\n".join(
        [
            head,
            *(_line(name, some) for name, some in groups.items()),
            f"{len(every) - len(known)} numbers are not determined",
            f"{sum(kept)} of {len(kept)} cases have every number within 2 deviations",
            *(f"beyond 2: {each}" for each in far),
        ]
    )


def main(arguments: list[str] | None = None) -> None:
    """Print the coverage of a record."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("record", type=Path)
    parser.add_argument("folder", type=Path)
    chosen = parser.parse_args(arguments)
    record = json.loads(chosen.record.read_text())
    here = {name: each for name, each in record.items() if (chosen.folder / name).is_dir()}
    print(coverage(here, chosen.folder))


if __name__ == "__main__":
    main()
