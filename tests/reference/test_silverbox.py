"""Silverbox (Wigren and Schoukens 2013): an electronic oscillator with a cubic spring.

Recordings nobody here made, driven throughout, of 3500 to 40 500 samples; skipped where they are
not at hand. The linear part comes from the lowest level, by a fit that shares nothing with the
package; no joint is in the model, and the whole arrow is held out.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from iwanjax.cli import app

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
FOLDER = CONFIGS / "silverbox"


@pytest.fixture(scope="module")
def recording(reference_data):
    path = reference_data / "silverbox" / "SNLS80mV.mat"
    if not path.is_file():
        pytest.skip(f"no {path}")
    return path


@pytest.fixture(scope="module")
def stiffness():
    with np.load(FOLDER / "model.npz") as model:
        return float(model["K"][0, 0])


@pytest.fixture(scope="module")
def told(recording, tmp_path_factory):
    folder = tmp_path_factory.mktemp("silverbox")
    text = (CONFIGS / "silverbox.yaml").read_text(encoding="utf-8")
    text = text.replace("../../shared/data/silverbox/SNLS80mV.mat", recording.as_posix())
    text = text.replace("silverbox/model.npz", (FOLDER / "model.npz").as_posix())
    (folder / "study.yaml").write_text(text, encoding="utf-8")
    out = folder / "out"
    result = CliRunner().invoke(app, ["diagnose", str(folder / "study.yaml"), "--out", str(out)])
    assert result.exit_code == 0, result.output
    return json.loads((out / "diagnosis.json").read_text())


def test_the_script_beside_the_model_makes_it(recording, tmp_path):
    script = [sys.executable, str(FOLDER / "make_model.py"), str(recording)]
    subprocess.run([*script, "--out", str(tmp_path)], check=True)
    with np.load(FOLDER / "model.npz") as kept, np.load(tmp_path / "model.npz") as made:
        for name in "MCK":
            np.testing.assert_allclose(made[name], kept[name], rtol=1e-6)


def test_the_cubic_spring_and_nothing_else_is_found(told, stiffness):
    assert told["failures"] == []
    assert told["verdict"] == "something_missing"
    first, *rivals = told["what"]
    assert (first["kind"], first["where"]) == ("cubic_stiffness", "mass")
    assert first["probability"] > 0.95
    assert first["joint_with"] == []
    assert all(each["probability"] < 0.02 for each in rivals)
    # k3 over k, 1/V^2: Runge-Kutta fits of m, c, k, k3 and the zero of the output say 3.93 to 3.95,
    # with a damping that grows by the deflection's square 4.00.
    k3 = first["parameters"]["k3"]
    assert k3["value"] / stiffness == pytest.approx(3.95, rel=0.02)


def test_the_arrow_is_predicted_to_two_hundredths(told):
    """Those fits leave 0.88 %; with the zero as it is 1.7 %, the linear part as it is 2.7 %.

    1.4 % here: the low level's noise is told as 0.015 mV, and weighs its misfit more.
    """
    assert told["fit"]["before"]["hold_out"] > 0.25
    assert told["fit"]["after"]["hold_out"] < 0.02


@pytest.mark.xfail(
    strict=True,
    reason="the low level's noise is told as 0.015 mV, where one-step errors of linear models are "
    "0.035 mV: it weighs too much, and its misfit widens what is stated",
)
@pytest.mark.parametrize(
    ("number", "limit"), [("k3.std", 0.4), ("hold_out", 0.0105), ("parameter_spread", 0.05)]
)
def test_what_was_reached_before_the_noise_was_told_too_low(told, number, limit):
    fit = told["fit"]
    found = {
        "k3.std": told["what"][0]["parameters"]["k3"]["std"],
        "hold_out": fit["after"]["hold_out"],
        "parameter_spread": fit["parameter_spread"]["hold_out"],
    }
    assert found[number] < limit


def test_the_noise_is_told_beside_the_motion(told):
    """0.1 to 0.25 mV, of 54 mV: no more than a perfect model leaves.

    Above 0.42 of the rate, where nothing is driven, all parts show 0.01 to 0.02 mV of white noise;
    the quietest band below, 0.3 mV by itself, holds harmonics that the cubic spring makes.
    """
    floor = told["fit"]["noise_floor"]
    assert floor["hold_out"] < told["fit"]["after"]["hold_out"]
    assert 0.1e-3 / 54e-3 < floor["hold_out"] < 0.25e-3 / 54e-3
