"""Poorer recordings of a concealed case: to see when a verdict gives up, and whether it errs first.

`python tests/concealed/degrade.py OUT CASE_FOLDER [CASE_FOLDER ...]`
"""

import argparse
import json
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import yaml

NOISE, FORCE_NOISE, LENGTH = 5.0, 0.01, 0.5
"""Times the sensors' noise; share of the force's peak; share of the samples."""

Arrays = dict[str, np.ndarray]


def noisier(arrays: Arrays, noise: float, rng: np.random.Generator) -> Arrays:
    """Five times the sensors' noise, of which one is in the recording."""
    more = noise * np.sqrt(NOISE**2 - 1.0) * rng.standard_normal(arrays["response"].shape)
    return arrays | {"response": (arrays["response"] + more).astype(np.float32)}


def shorter(arrays: Arrays, noise: float, rng: np.random.Generator) -> Arrays:
    """The first half of a recording."""
    half = int(LENGTH * len(arrays["time"]))
    return {name: array[:half] for name, array in arrays.items()}


def without_a_sensor(arrays: Arrays, noise: float, rng: np.random.Generator) -> Arrays:
    """All sensors but the last."""
    return arrays | {"response": arrays["response"][:, :-1]}


def rough_force(arrays: Arrays, noise: float, rng: np.random.Generator) -> Arrays:
    """Noise of one per cent of the force's peak on the force."""
    force = arrays["force"]
    more = FORCE_NOISE * np.abs(force).max() * rng.standard_normal(force.shape)
    return arrays | {"force": (force + more).astype(np.float32)}


WAYS: Mapping[str, Callable[[Arrays, float, np.random.Generator], Arrays]] = {
    each.__name__: each for each in (noisier, shorter, without_a_sensor, rough_force)
}


def write(folder: Path, way: str, out: Path) -> None:
    """A case with all its recordings poorer in one way, as another study."""
    out.mkdir(parents=True, exist_ok=True)
    study = yaml.safe_load((folder / "study.yaml").read_text())
    noise = json.loads((folder / "truth.json").read_text())["noise"]
    for name in ("truth.json", study["model"]["file"]):
        shutil.copy(folder / name, out / name)
    rng = np.random.default_rng(0)
    for recording in study["recordings"]:
        with np.load(folder / recording["file"]) as file:
            np.savez(out / recording["file"], **WAYS[way](dict(file), noise, rng))  # type: ignore[arg-type]
        if way == without_a_sensor.__name__:
            recording["response"]["sensors"] = recording["response"]["sensors"][:-1]
    (out / "study.yaml").write_text(yaml.safe_dump(study, sort_keys=False))


def main(arguments: list[str] | None = None) -> None:
    """Write each case once in every way into folders OUT/caseNN_way."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("cases", type=Path, nargs="+", metavar="CASE_FOLDER")
    chosen = parser.parse_args(arguments)
    for folder in chosen.cases:
        for way in WAYS:
            write(folder, way, chosen.out / f"{folder.name}_{way}")


if __name__ == "__main__":
    main()
