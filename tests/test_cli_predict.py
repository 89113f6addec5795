"""The verb predict: recordings held out, predicted by a study's fitted structure."""

import json

import numpy as np
import pytest
from bolted_chain import ROWS, TRUTH, K, M, damping
from known_fit import INPUTS, RATE, SENSORS, N, chain, hit, known_fit
from typer.testing import CliRunner

import iwanjax as ij
from iwanjax.cli import app
from iwanjax.studies import Study

STUDY = f"""\
name: chain
model:
  file: model.npz
  joints: [{{name: J1, row: J1, type: iwan4, parameters: {json.dumps(TRUTH)}}}]
modes: [0, 1]
fit: {{starts: 2, reference: absolute}}
posterior: {{effective: 10, walkers: 20, most_steps: 60}}
recordings:
  - {{file: hit0.npz, use: fit, response: &a {{array: response, sensors: [a1, a2, a3],
      quantity: acceleration, unit: m/s^2}}, force: &f {{array: force, inputs: [m1, m3, base]}}}}
  - {{file: hit1.npz, use: hold_out, response: *a, force: *f}}
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("chain")
    np.savez(
        folder / "model.npz",
        **{"M": M, "C": damping(), "K": K, "row_labels": list(ROWS), "rows": list(ROWS.values())},
        **{"sensor_labels": list(SENSORS), "sensor_rows": list(SENSORS.values())},
        **{"input_labels": list(INPUTS), "input_rows": list(INPUTS.values())},
    )
    for i, (peak, place) in enumerate([(40.0, "m3"), (60.0, "m1")]):
        found = hit(chain(), peak, 0.05, i, place)
        arrays = {"time": found.time, "response": found.response, "force": found.force}
        np.savez(folder / f"hit{i}.npz", **arrays)
    (folder / "study.yaml").write_text(STUDY)
    return folder / "study.yaml"


def run(study, out, *options):
    return CliRunner().invoke(app, ["predict", str(study), "--out", str(out), *options])


def fitted(monkeypatch):
    """A fit that need not be searched for."""
    deviations = {"J1.K_T": 0.01, "mode1.zeta_0": 0.1}

    def fit(self):
        return known_fit(deviations, tuple(self.curves().values()))

    monkeypatch.setattr(Study, "fit", fit)


def test_numbers_and_a_picture_are_written(study, tmp_path, monkeypatch):
    fitted(monkeypatch)
    out = tmp_path / "results"
    result = run(study, out, "--draws", "5")
    assert result.exit_code == 0, result.stderr
    names = sorted(file.name for file in out.iterdir())
    assert names == ["predict.json", "predict.npz", "predict_hit1.npz.png"]
    assert (out / names[2]).read_bytes().startswith(b"\x89PNG")
    assert "hit1.npz: 1536 samples, 5 parameter sets" in result.stderr
    assert "noise alone" in result.stdout
    told = json.loads((out / "predict.json").read_text())
    assert (told["study"], told["iwanjax"]) == ("chain", ij.__version__)
    assert told["parameters"]["J1.K_T"]["std"] == pytest.approx(0.01 * TRUTH["K_T"])
    (one,) = told["predictions"]
    assert (one["recording"], one["source"], one["draws"]) == ("hit1.npz", "fit", 5)
    assert one["sensors"]["a3"]["error"] < 0.01
    assert [mode["name"] for mode in one["modes"]] == ["mode 1"]
    assert one["modes"][0]["frequency_error_hz"] < 0.05
    with np.load(out / "predict.npz") as file:
        arrays = dict(file)
    assert arrays["hit1.npz_response_upper"].shape == (N, 3)
    assert list(arrays["hit1.npz_sensors"]) == list(SENSORS)
    assert arrays["hit1.npz_time"][1] == pytest.approx(1.0 / RATE)
    assert arrays["hit1.npz_mode_1_component_measured"].shape == (N,)


def test_what_cannot_be_predicted_costs_one_line_and_no_fit(study, tmp_path):
    text = study.read_text().replace("use: hold_out", "use: fit")
    other = study.with_name("fitted.yaml")
    other.write_text(text)
    result = run(other, tmp_path / "out")
    assert result.exit_code == 2
    assert len(result.stderr.splitlines()) == 1
    assert "fitted.yaml: predict needs a recording that no fit sees" in result.stderr
    assert not (tmp_path / "out").exists()
    assert run(study, tmp_path / "out", "--draws", "0").exit_code == 2


@pytest.mark.long
def test_a_posterior_is_sampled_first_and_its_chain_kept(study, tmp_path):
    out = tmp_path / "results"
    result = run(study, out, "--posterior", "--draws", "5")
    assert result.exit_code == 0, result.stderr
    assert (out / "posterior_chain.h5").is_file()
    (one,) = json.loads((out / "predict.json").read_text())["predictions"]
    assert one["source"] == "posterior"
