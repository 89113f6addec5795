"""The embedded study of a spring that a model lacks: its data, and what a diagnosis says of it."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import iwanjax as ij

CONFIGS = Path(__file__).resolve().parents[1] / "configs"
FOLDER = CONFIGS / "concealed_spring"


def test_the_script_beside_the_data_makes_them(tmp_path):
    script = [sys.executable, str(FOLDER / "make_hits.py"), "--out", str(tmp_path)]
    subprocess.run(script, check=True)
    truth = (json.loads((at / "truth.json").read_text()) for at in (FOLDER, tmp_path))
    kept, made = truth
    assert made["concealed"] == kept["concealed"]
    assert made["joints"] == kept["joints"]
    for path in sorted(FOLDER.glob("*.npz")):
        with np.load(path) as kept, np.load(tmp_path / path.name) as made:
            for name in kept.files:
                if kept[name].dtype.kind == "f":
                    size = np.abs(kept[name]).max()
                    np.testing.assert_allclose(made[name], kept[name], rtol=0, atol=1e-6 * size)
                else:
                    np.testing.assert_array_equal(made[name], kept[name])


def test_the_concealed_spring_is_found_and_predicts_the_hit_held_out():
    truth = json.loads((FOLDER / "truth.json").read_text())["concealed"]
    verdict = ij.load_study(CONFIGS / "concealed_spring.yaml").diagnose().only
    assert verdict.verdict.name == "something_missing"
    first = verdict.what[0]
    assert (first.kind.name, first.where) == (truth["kind"], truth["where"])
    assert first.probability > 0.95
    (k3,) = first.parameters
    assert k3.value == pytest.approx(truth["k3"], abs=max(2.0 * k3.std, 0.01 * truth["k3"]))
    assert verdict.after.hold_out < 1.5 * verdict.noise_floor.hold_out
    assert verdict.before.hold_out > 0.1
