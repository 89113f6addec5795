"""The README's examples are true."""

import json
import os
import re
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
from numpy.testing import assert_allclose

import iwanjax as ij

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def examples():
    return re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)


def run(code):
    names: dict = {}
    before = Path.cwd()
    os.chdir(ROOT)
    try:
        exec(code, names)
    finally:
        os.chdir(before)
        plt.close("all")
    return names


@pytest.fixture(scope="module")
def first(examples):
    return run(examples[0])


def test_the_first_goes_from_hits_to_the_true_joint(first, examples):
    solution = first["fit"].solution
    truth = json.loads((ROOT / "configs" / "modal_ringdown" / "truth.json").read_text())
    for name, value in solution.values.items():
        assert abs(value - truth["parameters"][name]) < 3.0 * solution.std[name], name
    assert "chi" in first["fit"].summary()
    code = [line for line in examples[0].splitlines() if line]
    assert len(code) <= 10


def test_its_simulated_hit_decays_as_the_joint_was_fitted(first):
    velocity = first["decay"].velocity[:, 0]
    found = ij.ringdown_curves(velocity, 2048.0, band=(90.0, 150.0), quantity="velocity")
    there = found.as_quantity("displacement")
    model = first["fit"].solution.model
    f, zeta = model.ringdown_frequency_and_damping(there.amplitude)
    # 35 steps in a cycle are off by 0.4 % of the frequency's fall, 70 by 0.1 %.
    assert_allclose((model.f_0 - found.frequency) / (model.f_0 - f), 1.0, atol=5e-3)
    assert_allclose(found.damping, zeta, rtol=0.01)


def test_the_second_is_the_same_study_without_a_file(first, examples, capsys):
    curves = run(examples[1])["study"].curves()["mode1"]
    expected = first["study"].curves()["mode1"]
    assert "3 recording(s) to fit, 1 held out" in capsys.readouterr().out
    assert len(curves.held_out) == 1
    for name in ("amplitude", "frequency", "damping", "damping_std"):
        assert_allclose(getattr(curves.curves, name), getattr(expected.curves, name), rtol=1e-9)


def test_the_third_finds_what_is_concealed_and_simulates_with_it(examples, capsys):
    try:
        found = run(examples[2])
        assert (ROOT / "verdict.npz").is_file()
    finally:
        (ROOT / "verdict.npz").unlink(missing_ok=True)
    assert "A cubic spring is missing between m3 and ground" in capsys.readouterr().out
    assert found["verdict"].model.labels == ("J1", "cubic_stiffness@m3-ground")
    assert bool(found["again"].balanced)
    code = [line for line in examples[2].splitlines() if line]
    assert len(code) <= 10


def test_the_fourth_has_the_gradient_it_prints(examples, capsys):
    damping = run(examples[3])["damping"]
    _, gradient = (float(word) for word in capsys.readouterr().out.split())
    expected = float(damping(-0.5 + 1e-5) - damping(-0.5 - 1e-5)) / 2e-5
    assert gradient == pytest.approx(expected, rel=1e-5)


def test_the_study_of_matrices_can_be_read(tmp_path):
    (text,) = re.findall(r"```yaml\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    (tmp_path / "study.yaml").write_text(text)
    (tmp_path / "job.sti").write_text("1 1 2.0\n1 2 -1.0\n2 2 2.0\n3 3 1.0\n4 4 1.0\n")
    (tmp_path / "job.mas").write_text("1 1 1.0\n2 2 1.0\n3 3 1.0\n4 4 1.0\n")
    (tmp_path / "job.dof").write_text("12.1\n40.1\n7.3\n9.3\n")
    study = ij.load_study(tmp_path / "study.yaml")
    assert study.structure is not None
    assert study.structure.rows.tolist() == [[-1.0, 1.0, 0.0, 0.0]]


def test_there_are_no_others(examples):
    assert len(examples) == 4
