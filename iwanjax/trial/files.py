"""A trial's study as files, and its truth, sealed until the verdict is there."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from iwanjax.errors import InputError
from iwanjax.trial.plan import ConcealedTrial
from iwanjax.trial.simulation import TrialBase, TrialResponses

STUDY = "study.yaml"


def write_study(base: TrialBase, trial: ConcealedTrial, folder: Path) -> None:
    """Write the model, the recordings and the study that names them, and nothing of the truth."""
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(folder / "model.npz", allow_pickle=False, **_model(base))
    for i in range(len(base.takes)):
        np.savez(folder / f"rec{i + 1}.npz", allow_pickle=False, **_arrays(trial.responses, i))
    content = yaml.safe_dump(_study(base, trial), sort_keys=False)
    (folder / STUDY).write_text(content, encoding="utf-8")


def _model(base: TrialBase) -> dict[str, np.ndarray]:
    structure = base.structure
    arrays: dict[str, np.ndarray] = {"M": structure.M, "C": structure.C, "K": structure.K}
    for labels, matrix, rows in (
        ("row_labels", "rows", structure.rows),
        ("sensor_labels", "sensor_rows", structure.sensors),
        ("input_labels", "input_rows", structure.inputs),
    ):
        arrays[labels] = np.array(list(rows))
        arrays[matrix] = np.stack(list(rows.values()))
    return arrays


def _arrays(responses: TrialResponses, i: int) -> dict[str, np.ndarray]:
    response = responses.response[i][:, responses.takes[i].measured]
    return {
        "time": np.arange(len(response)) / responses.structure.rate,
        "response": response.astype(np.float32),
        "force": responses.force[i].astype(np.float32),
    }


def _study(base: TrialBase, trial: ConcealedTrial) -> dict[str, Any]:
    structure = base.structure
    joints = [
        {
            "name": name,
            "row": name,
            "type": "iwan4",
            "parameters": dict(zip(("F_S", "K_T", "chi", "beta"), map(float, joint), strict=True)),
        }
        for name, joint in structure.joints.items()
    ]
    sensors = np.array(list(structure.sensors))
    recordings = [
        {
            "file": f"rec{i}.npz",
            "use": take.use,
            "sampling_rate": structure.rate,
            "response": {
                "array": "response",
                "sensors": sensors[take.measured].tolist(),
                "quantity": base.quantity,
            },
            "force": {"array": "force", "inputs": list(structure.inputs)},
        }
        for i, take in enumerate(base.takes, 1)
    ]
    model: dict[str, Any] = {"file": "model.npz", "joints": joints}
    if base.trust is not None:
        frequencies, damping = base.trust.tolist()
        model["trust"] = {"frequencies": frequencies, "damping": damping}
    content = {"name": f"trial{trial.number:03d}", "model": model, "recordings": recordings}
    if (tried := told(base, trial)) != base.kinds:
        content["hypotheses"] = list(tried)
    return content


def told(base: TrialBase, trial: ConcealedTrial) -> tuple[str, ...]:
    """The kinds that a diagnosis is told of: all that it knows, less one that is left out."""
    hidden = trial.kind if trial.sort == "left_out" else None
    return tuple(kind for kind in base.kinds if kind != hidden)


def truth_of(base: TrialBase, trial: ConcealedTrial) -> dict[str, Any]:
    """What is concealed; nobody can guess it from its hash, since the joints are drawn too."""
    effect = trial.effect
    return {
        "sort": trial.sort,
        "kind": trial.kind,
        "where": None if effect is None else effect.where,
        "strength": trial.strength,
        "values": [] if effect is None else [float(np.ravel(v)[0]) for v in effect.values],
        "joints": {name: list(values) for name, values in trial.joints.items()},
        "noise": base.noise.tolist(),
    }


def seal(truth: Mapping[str, Any]) -> tuple[str, str]:
    """The truth as text, and its SHA-256."""
    text = json.dumps(truth, indent=1, sort_keys=True)
    return text, hashlib.sha256(text.encode()).hexdigest()


def opened(path: Path, sealed: str) -> dict[str, Any]:
    """The truth of a file whose hash was kept.

    Raises
    ------
    InputError
        Where the file is not the one that was sealed.
    """
    text = path.read_text(encoding="utf-8")
    if hashlib.sha256(text.encode()).hexdigest() != sealed:
        raise InputError(
            f"{path}: is not what was sealed before the diagnosis; begin in another folder"
        )
    return json.loads(text)
