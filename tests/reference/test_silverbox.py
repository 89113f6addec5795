"""Silverbox (Wigren and Schoukens 2013): an electronic oscillator with a cubic spring.

Recordings nobody here made, driven throughout, of 3500 to 40 500 samples; skipped where they are
not at hand. The linear part comes from the lowest level, by a fit that shares nothing with the
package; no joint is in the model, and the whole arrow is held out.
"""

import json

import numpy as np
import pytest
import scipy.io
import scipy.optimize
import yaml
from typer.testing import CliRunner

from iwanjax.cli import app

RATE = 1e7 / 2**14
OFFSET = 6.2e-3
"""V, of the input where it rests."""
# Samples from rest: the end, an arrow's low beginning; some of the multisines; the whole arrow.
PARTS = {
    "low": (slice(127_500, 131_072), "fit"),
    "multisine": (slice(40_580, 46_580), "fit"),
    "arrow": (slice(0, 40_496), "hold_out"),
}


def linear_response(force, m, c, k):
    """Of an oscillator from rest, the force band-limited and silent from its end on."""
    omega = 2.0 * np.pi * np.fft.rfftfreq(2 * len(force), 1.0 / RATE)
    shown = np.fft.rfft(force, 2 * len(force)) / (k - m * omega**2 + 1j * c * omega)
    return np.fft.irfft(shown)[: len(force)]


def identified(force, response):
    """m, c and k that suit a record best, from 68 Hz and 5 % of critical damping."""
    omega = 2.0 * np.pi * 68.0
    begin = np.array([1.0 / omega**2, 0.1 / omega, 1.0])

    def off(logarithm):
        return linear_response(force, *(begin * np.exp(logarithm))) - response

    found = scipy.optimize.least_squares(off, np.zeros(3), x_scale=0.1)
    return begin * np.exp(found.x)


@pytest.fixture(scope="module")
def told(reference_data, tmp_path_factory):
    path = reference_data / "silverbox" / "SNLS80mV.mat"
    if not path.is_file():
        pytest.skip(f"no {path}")
    both = scipy.io.loadmat(path)
    force, response = both["V1"].ravel() - OFFSET, both["V2"].ravel()
    folder = tmp_path_factory.mktemp("silverbox")
    part = PARTS["low"][0]
    m, c, k = (x * np.ones((1, 1)) for x in identified(force[part], response[part]))
    named = {"row": ["mass"], "sensor": ["x"], "input": ["V1"]}
    labels = {f"{name}_labels": each for name, each in named.items()}
    rows = {name: np.ones((1, 1)) for name in ("rows", "sensor_rows", "input_rows")}
    np.savez(folder / "model.npz", M=m, C=c, K=k, **labels, **rows)
    entries = []
    for name, (part, use) in PARTS.items():
        pair = {"response": response[part, None], "force": force[part, None]}
        np.savez(folder / f"{name}.npz", **pair)
        entries.append(
            {
                "file": f"{name}.npz",
                "use": use,
                "sampling_rate": RATE,
                "response": {"array": "response", "sensors": ["x"], "quantity": "displacement"},
                "force": {"array": "force", "inputs": ["V1"]},
            }
        )
    study = {"name": "silverbox", "model": {"file": "model.npz"}, "recordings": entries}
    (folder / "study.yaml").write_text(yaml.safe_dump(study))
    out = folder / "out"
    result = CliRunner().invoke(app, ["diagnose", str(folder / "study.yaml"), "--out", str(out)])
    assert result.exit_code == 0, result.output
    return json.loads((out / "diagnosis.json").read_text()), float(k[0, 0])


def test_the_cubic_spring_is_found_and_predicts_the_arrow(told):
    verdict, k = told
    assert verdict["failures"] == []
    assert verdict["verdict"] == "something_missing"
    first = verdict["what"][0]
    assert (first["kind"], first["where"]) == ("cubic_stiffness", "mass")
    # k3 over k, 1/V^2: a fit by half kicks in plain loops says 3.90.
    assert first["parameters"]["k3"]["value"] / k == pytest.approx(3.9, rel=0.02)
    assert verdict["fit"]["before"]["hold_out"] > 0.25
    assert verdict["fit"]["after"]["hold_out"] < 0.035


def test_the_noise_is_told_beside_the_motion(told):
    """0.1 to 0.25 mV, of 54 mV: no more than a perfect model leaves.

    Above 0.42 of the rate, where nothing is driven, all parts show 0.01 to 0.02 mV of white noise;
    the quietest band below, 0.3 mV by itself, holds harmonics that the cubic spring makes.
    """
    floor = told[0]["fit"]["noise_floor"]
    assert floor["hold_out"] < told[0]["fit"]["after"]["hold_out"]
    assert 0.1e-3 / 54e-3 < floor["hold_out"] < 0.25e-3 / 54e-3
