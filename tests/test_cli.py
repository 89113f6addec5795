import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

import iwanjax
from iwanjax.cli import app
from iwanjax.joints import JOINTS
from iwanjax.quasistatic import qsma
from iwanjax.structures import three_mass

STUDY = """\
name: chain
model: {builder: three_mass}
qsma:
  modes: [0, 1]
  alpha: {from: 1e-3, to: 1e2, count: 9}
  zeta0: 1e-4
"""


SLIDER = """\
name: slider
model:
  file: model.npz
  joints:
    - {name: a/b, row: only, type: jenkins, parameters: {F_S: 1, K_T: 1}}
qsma: {alpha: [0.1, 10]}
"""


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def study(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(STUDY)
    return path


def check_refused(result, *words):
    assert result.exit_code == 2
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    for word in words:
        assert word in line


def test_qsma_writes_numbers_and_pictures(study, tmp_path):
    out = tmp_path / "results" / "chain"
    result = run("qsma", study, "--out", out)
    assert result.exit_code == 0, result.stderr
    assert result.stderr == ""
    assert result.stdout.splitlines()[-1] == f"wrote {out / 'qsma.png'}"
    assert sorted(file.name for file in out.iterdir()) == [
        "joint_J1.png",
        "qsma.json",
        "qsma.npz",
        "qsma.png",
    ]
    expected = qsma(three_mass(), [0, 1], np.geomspace(1e-3, 1e2, 9), 1e-4)
    with np.load(out / "qsma.npz") as file:
        arrays = dict(file)
    assert_allclose(arrays["alpha"], expected.alpha, rtol=1e-12)
    assert_allclose(arrays["amplitude"], expected.q, rtol=1e-9)
    assert_allclose(arrays["frequency"], expected.curves.frequency, rtol=1e-9)
    assert_allclose(arrays["damping"], expected.curves.damping, rtol=1e-9)
    assert arrays["deflection"].shape == (2, 9, 1)
    summary = json.loads((out / "qsma.json").read_text())
    assert summary["study"] == "chain"
    assert summary["iwanjax"] == iwanjax.__version__
    assert [mode["mode"] for mode in summary["modes"]] == [0, 1]
    first = summary["modes"][0]
    assert_allclose(first["omega_0_hz"], three_mass().modes().frequency[0], rtol=1e-12)
    assert first["converged"] == first["levels"] == 9
    assert first["messages"] == []
    assert_allclose(first["frequency_hz"]["low"], arrays["frequency"][0, 0])
    assert_allclose(first["damping"]["high"], arrays["damping"][0, -1])
    for picture in out.glob("*.png"):
        assert picture.read_bytes().startswith(b"\x89PNG")


def test_the_shape_reaches_the_analysis(study, tmp_path):
    study.write_text(STUDY + "  shape: updated\n")
    assert run("qsma", study, "--out", tmp_path).exit_code == 0
    levels = np.geomspace(1e-3, 1e2, 9)
    expected = qsma(three_mass(), [0, 1], levels, 1e-4, shape="updated").curves
    linear = qsma(three_mass(), [0, 1], levels, 1e-4).curves
    found = np.load(tmp_path / "qsma.npz")["frequency"]
    assert_allclose(found, expected.frequency, rtol=1e-9)
    assert not np.allclose(found, linear.frequency, rtol=1e-6)


def test_results_replace_older_ones_and_leave_the_rest(study, tmp_path):
    (tmp_path / "qsma.json").write_text("old")
    (tmp_path / "notes.txt").write_text("mine")
    assert run("qsma", study, "--out", tmp_path).exit_code == 0
    assert json.loads((tmp_path / "qsma.json").read_text())["study"] == "chain"
    assert (tmp_path / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize(("alpha", "converged"), [("[0.1, 10]", 1), ("[10, 20]", 0)])
def test_levels_without_equilibrium_are_told(tmp_path, alpha, converged):
    """A mass held by nothing but a slider of strength 1."""
    path = tmp_path / "study.yaml"
    path.write_text(SLIDER.replace("[0.1, 10]", alpha))
    one, labels = np.ones((1, 1)), np.array(["only"])
    arrays: dict[str, Any] = {"M": one, "C": 0 * one, "K": 0 * one}
    arrays |= {"rows": one, "sensor_rows": one, "input_rows": one}
    arrays |= {"row_labels": labels, "sensor_labels": labels, "input_labels": labels}
    np.savez(tmp_path / "model.npz", **arrays)
    result = run("qsma", path, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.stderr
    assert result.stderr.startswith("warning: ")
    assert "no static equilibrium" in result.stderr
    (mode,) = json.loads((tmp_path / "out" / "qsma.json").read_text())["modes"]
    assert mode["converged"] == converged
    assert (mode["frequency_hz"]["low"] is None) == (converged == 0)
    assert "no static equilibrium" in mode["messages"][0]
    assert (tmp_path / "out" / "joint_a_b.png").is_file()


BAD_STUDIES = {
    "misspelt key": (STUDY.replace("zeta0", "zeta"), ["study.yaml:6: qsma.zeta", "'zeta0'"]),
    "not YAML": (STUDY + "  - a", ["study.yaml:7: not valid YAML"]),
    "no qsma section": (STUDY[: STUDY.index("qsma")], ["study.yaml: ", "qsma: {modes: [0]"]),
    "no such model": (SLIDER, ["study.yaml:3: model.file", "model.npz: does not exist"]),
    "no such mode": (STUDY.replace("[0, 1]", "[7]"), ["study.yaml:4: qsma.modes[0]", "got 7"]),
}


@pytest.mark.parametrize(("text", "words"), BAD_STUDIES.values(), ids=BAD_STUDIES)
def test_a_bad_study_gives_one_line_and_no_results(tmp_path, text, words):
    path = tmp_path / "study.yaml"
    path.write_text(text)
    check_refused(run("qsma", path, "--out", tmp_path / "out"), *words)
    assert not (tmp_path / "out").exists()


def test_no_study_at_all(tmp_path):
    check_refused(run("qsma", tmp_path / "a.yaml", "--out", tmp_path / "out"), "a.yaml: No such")


def test_an_output_that_is_a_file(study, tmp_path):
    (tmp_path / "out").write_text("mine")
    for out in (tmp_path / "out", tmp_path / "out" / "deeper"):
        check_refused(run("qsma", study, "--out", out), f"--out {out}", "expected a folder")
    assert (tmp_path / "out").read_text() == "mine"


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write")
def test_an_output_without_permission(study, tmp_path):
    folder = tmp_path / "out"
    folder.mkdir(mode=0o555)
    check_refused(run("qsma", study, "--out", folder), f"--out {folder}", "Permission")


def test_nothing_is_left_half_written(study, tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", full)
    out = tmp_path / "out"
    check_refused(run("qsma", study, "--out", out), f"--out {out}", "No space left")
    assert list(out.iterdir()) == []


def test_version_and_help():
    assert run("--version").stdout == f"iwanjax {iwanjax.__version__}\n"
    text = run("--help").stdout
    assert "bolted joints" in text
    for verb in ("curves", "fit", "posterior", "qsma", "simulate"):
        assert f"  iwanjax {verb}" in text
        assert "STUDY" in run(verb, "--help").stdout
    assert "FILE" in run("inspect", "--help").stdout


def test_laws_are_a_table_of_all_joint_types():
    *lines, empty, note = run("laws").stdout.splitlines()
    assert len(lines) == 1 + len(JOINTS)
    assert empty == ""
    assert "In brackets" in note
    told = {line.split()[0]: line for line in lines}
    assert JOINTS.keys() < told.keys()
    assert "k [force/length], gap [length]" in told["gap"]
    assert "gap_contact" in told["gap"]
    assert "iwan_joint" in told["iwan4"]
    assert "Clearance" in told["gap"]


@pytest.mark.parametrize("arguments", [["qsma"], ["qsma", "a.yaml"], ["qsmaa"], ["--verson"]])
def test_usage_errors(arguments):
    result = run(*arguments)
    assert result.exit_code == 2
    assert "Error: " in result.stderr
    assert "─" not in result.stderr


def test_as_a_process_of_its_own(study, tmp_path):
    """In its own process the command sets the precision itself, whatever the environment says."""

    def process(*arguments):
        return subprocess.run(
            [sys.executable, "-W", "error", "-m", "iwanjax", *arguments],
            env={**os.environ, "JAX_ENABLE_X64": "0"},
            cwd=tmp_path,
            capture_output=True,
            text=True,
        )

    good = process("qsma", "study.yaml", "--out", "out")
    assert (good.returncode, good.stderr) == (0, "")
    assert good.stdout.splitlines()[-1] == f"wrote {Path('out') / 'qsma.png'}"
    study.write_text(STUDY.replace("name:", "nme:"))
    bad = process("qsma", "study.yaml", "--out", "bad")
    assert (bad.returncode, bad.stdout) == (2, "")
    assert bad.stderr == (
        "study.yaml:1: nme: unknown key; expected one of name, qsma, simulate, modes, bands, "
        "bounds, priors, values, fixed, ringdown, fit, posterior, noise, hypotheses, budget, seed, "
        "model, recordings; did you mean 'name'?\n"
    )
