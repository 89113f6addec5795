"""The README's examples are true; the third one is in test_embedded_diagnosis.py."""

import json
import re

import pytest
import readme
from numpy.testing import assert_allclose
from readme import ROOT, run
from typer.testing import CliRunner

import iwanjax as ij
from iwanjax.cli import app
from iwanjax.config.study import read_study


@pytest.fixture(scope="module")
def examples():
    return readme.examples()


@pytest.fixture(scope="module")
def first(examples):
    return run(examples[0])[0]


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


def test_the_second_is_the_same_study_without_a_file(first, examples):
    names, printed = run(examples[1])
    curves = names["study"].curves()["mode1"]
    expected = first["study"].curves()["mode1"]
    assert "3 recording(s) to fit, 1 held out" in printed
    assert len(curves.held_out) == 1
    for name in ("amplitude", "frequency", "damping", "damping_std"):
        assert_allclose(getattr(curves.curves, name), getattr(expected.curves, name), rtol=1e-9)


def test_the_fourth_has_the_gradient_it_prints(examples):
    names, printed = run(examples[3])
    damping = names["damping"]
    _, gradient = (float(word) for word in printed.split())
    expected = float(damping(-0.5 + 1e-5) - damping(-0.5 - 1e-5)) / 2e-5
    assert gradient == pytest.approx(expected, rel=1e-5)


def test_the_study_of_matrices_can_be_read(tmp_path):
    (text,) = readme.examples("yaml")
    (tmp_path / "study.yaml").write_text(text)
    (tmp_path / "job.sti").write_text("1 1 2.0\n1 2 -1.0\n2 2 2.0\n3 3 1.0\n4 4 1.0\n")
    (tmp_path / "job.mas").write_text("1 1 1.0\n2 2 1.0\n3 3 1.0\n4 4 1.0\n")
    (tmp_path / "job.dof").write_text("12.1\n40.1\n7.3\n9.3\n")
    study = ij.load_study(tmp_path / "study.yaml")
    assert study.structure is not None
    assert study.structure.rows.tolist() == [[-1.0, 1.0, 0.0, 0.0]]


def test_there_are_no_others(examples):
    assert len(examples) == 4


@pytest.mark.parametrize("to_the_end", [False, pytest.param(True, marks=pytest.mark.long)])
def test_two_commands_lead_from_a_folder_to_a_verdict(tmp_path, monkeypatch, to_the_end):
    lines = re.findall(
        r"^iwanjax ((?:inspect|diagnose) .*?) +#", (ROOT / "README.md").read_text(), re.M
    )
    assert [line.split()[0] for line in lines] == ["inspect", "diagnose"]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    for line in lines if to_the_end else lines[:1]:
        done = CliRunner().invoke(app, line.split())
        assert done.exit_code == 0, done.output
    uses = [entry.use for entry in read_study(tmp_path / "look" / "study.yaml").recordings]
    assert uses == ["fit"] * 3 + ["hold_out"]
    if to_the_end:
        told = json.loads((tmp_path / "results" / "hits" / "diagnosis.json").read_text())
        assert told["verdict"] == "nothing_missing"
