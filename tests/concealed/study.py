"""Write concealed cases as studies: model, recordings, study.yaml, and the truth beside them.

`python tests/concealed/study.py OUT [--set NAME] [--only N ...]`
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
import yaml

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from concealed.cases import CASES
from concealed.hammer import measure
from concealed.plan import SETS, Case
from concealed.structures import Structure

from iwanjax.trial.acquisition import saturate
from iwanjax.trial.simulation import FORCE_NOISE


def model_arrays(structure: Structure) -> dict[str, np.ndarray]:
    named = {"row": structure.rows, "sensor": structure.sensors, "input": structure.inputs}
    arrays: dict[str, np.ndarray] = {"M": structure.M, "C": structure.C, "K": structure.K}
    for name, rows in named.items():
        arrays[f"{name}_labels"] = np.array(list(rows))
        arrays["rows" if name == "row" else f"{name}_rows"] = np.stack(list(rows.values()))
    return arrays


def _study(case: Case, name: str) -> dict:
    joints = [
        {
            "name": joint,
            "row": joint,
            "type": "iwan4",
            "parameters": dict(zip(("F_S", "K_T", "chi", "beta"), values, strict=True)),
        }
        for joint, values in case.given.items()
    ]
    recordings = [
        {
            "file": f"rec{i}.npz",
            "use": hit.use,
            "sampling_rate": int(case.structure.rate),
            "response": {
                "array": "response",
                "sensors": list(case.structure.sensors),
                "quantity": "acceleration",
            },
            "force": {"array": "force", "inputs": [hit.place]},
        }
        for i, hit in enumerate(case.hits, 1)
    ]
    return {
        "name": name,
        "model": {"file": "model.npz", "joints": joints},
        "recordings": recordings,
    }


def truth_of(case: Case, noise: float) -> dict:
    """What is concealed: one kind and place, or lists of them for a pair."""
    kinds = [effect.kind for effect in case.effects]
    places = [effect.where for effect in case.effects]
    single = len(case.effects) == 1
    return {
        "kind": "none" if not kinds else kinds[0] if single else kinds,
        "where": None if not kinds else places[0] if single else places,
        "joints": {name: list(values) for name, values in case.true.items()},
        "noise": noise,
        "parameters": [
            {"place": effect.where, "values": [float(v) for v in effect.values]}  # type: ignore[arg-type]
            for effect in case.effects
        ],
    }


def write(case: Case, folder: Path) -> None:
    """Simulate a case and write its study and its truth into a folder."""
    structure = case.structure
    response, force = measure(structure, case.true, case.effects, case.hits)
    hardest = case.hits.index(case.hardest)
    noise = case.noise * float(np.sqrt(np.mean(response[:, hardest] ** 2)))
    rng = np.random.default_rng(case.seed)
    response = response + noise * rng.standard_normal(response.shape)
    response = saturate("sensor", list(structure.sensors), case.effects, response)
    level = FORCE_NOISE * np.abs(force).max(axis=0)
    force = force + level * rng.standard_normal(force.shape)

    folder.mkdir(parents=True, exist_ok=True)
    np.savez(folder / "model.npz", **model_arrays(structure))  # type: ignore[arg-type]
    clock = np.arange(structure.samples) / structure.rate
    for i in range(len(case.hits)):
        np.savez(
            folder / f"rec{i + 1}.npz",
            time=clock,
            response=response[:, i].astype(np.float32),
            force=force[:, i, None].astype(np.float32),
        )
    text = yaml.safe_dump(_study(case, folder.name), sort_keys=False)
    (folder / "study.yaml").write_text(text)
    (folder / "truth.json").write_text(json.dumps(truth_of(case, noise), indent=1))


def main(arguments: list[str] | None = None) -> None:
    """Write the chosen cases into folders OUT/caseNN."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("--set", choices=tuple(SETS), help="one of the sets of cases")
    parser.add_argument("--only", type=int, nargs="+", metavar="N")
    chosen = parser.parse_args(arguments)
    wanted = {case.number for case in (SETS[chosen.set] if chosen.set else CASES)}
    for case in CASES:
        if case.number not in wanted:
            continue
        if chosen.only and case.number not in chosen.only:
            continue
        start = time.perf_counter()
        folder = chosen.out / f"case{case.number:02d}"
        write(case, folder)
        print(f"{folder}  {time.perf_counter() - start:.1f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
