"""The embedded study of a spring that a model lacks: its data, and what a diagnosis says of it."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import readme

import iwanjax as ij
from iwanjax.effects.wording import noun

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


@pytest.fixture(scope="module")
def third():
    """The README's third example, which diagnoses this study."""
    saved = CONFIGS.parent / "verdict.npz"
    try:
        names, printed = readme.run(readme.examples()[2])
        assert saved.is_file()
    finally:
        saved.unlink(missing_ok=True)
    return names, printed


@pytest.fixture(scope="module")
def verdict(third):
    return third[0]["verdict"]


def test_the_readme_finds_what_is_concealed_and_simulates_with_it(third):
    names, printed = third
    assert "A cubic spring is missing between m3 and ground" in printed
    assert names["verdict"].model.labels == ("J1", "cubic_stiffness@m3-ground")
    assert bool(names["again"].balanced)
    code = [line for line in readme.examples()[2].splitlines() if line]
    assert len(code) <= 10


def test_the_concealed_spring_is_found_and_predicts_the_hit_held_out(verdict):
    truth = json.loads((FOLDER / "truth.json").read_text())["concealed"]
    assert verdict.verdict.name == "something_missing"
    first = verdict.what[0]
    assert (first.kind.name, first.where) == (truth["kind"], truth["where"])
    assert first.probability > 0.95
    (k3,) = first.parameters
    assert k3.value == pytest.approx(truth["k3"], abs=max(2.0 * k3.std, 0.01 * truth["k3"]))
    assert verdict.after.hold_out < 1.5 * verdict.noise_floor.hold_out
    assert verdict.before.hold_out > 0.1


def test_the_next_best_explanation_is_next_by_evidence(verdict):
    """All are excluded here: one more than another by hundreds of thousands."""
    behind = [each.log_evidence for each in verdict.what]
    assert behind == sorted(behind, reverse=True)
    rival = max(verdict.what[1:], key=lambda each: each.log_evidence)
    assert (rival.kind.name, rival.where) == ("gap_contact", "m3-ground")
    said = noun(rival.kind, rival.where)
    assert f"The next best explanation, {said}, is excluded" in verdict.report().doubt


def test_the_corrected_model_simulates_and_the_diagnosis_is_saved(verdict, tmp_path):
    """By the integrator of `simulate`, from the measured force: its steps are samples apart."""
    study = ij.load_study(CONFIGS / "concealed_spring.yaml")
    with np.load(FOLDER / "hit4.npz") as held:
        push, measured = held["force"] * np.eye(3)[1], held["response"]

    def off(model):
        shown = np.asarray(ij.simulate(model, push, 1 / 2048).acceleration)
        return np.sqrt(np.mean((shown - measured) ** 2) / np.mean(measured**2))

    assert off(verdict.model) < 0.04 < 0.1 * off(study.structure)
    again = ij.Diagnosis.load(verdict.save(tmp_path / "verdict.npz"))
    assert again.summary() == verdict.summary()
    assert again.model.labels == verdict.model.labels == ("J1", "cubic_stiffness@m3-ground")
    assert "m3 and ground" in again._repr_html_()


def test_its_picture_says_which_sensor_and_unit(verdict):
    (whole, *_) = ij.plotting.plot_prediction(verdict).axes
    assert whole.get_ylabel() in {f"a{i} (grey), left over\n(m/s^2)" for i in (1, 2, 3)}
