"""A law in a file of 40 lines is a joint, an element, a hypothesis and a line of the table."""

from pathlib import Path

import numpy as np
import own_law
import pytest
from two_masses import diagnosed
from typer.testing import CliRunner

import iwanjax as ij
from iwanjax.cli import app
from iwanjax.joints import JOINTS
from iwanjax.studies import load_study

C, W = 60.0, 0.05

STUDY = """
name: damped
model:
  builder: three_mass
  options: {mass: 10, stiffness: 9, zeta: 1e-4}
  joints:
    - {name: J1, type: relieved_damper, parameters: {c: 0.3, w: 1e-4}}
"""


@pytest.fixture(autouse=True)
def registered():
    ij.register_joint("relieved_damper", own_law.RelievedDamper)
    yield
    del JOINTS["relieved_damper"]


def force(v):
    return C * W * np.tanh(v / W)


def test_it_takes_forty_lines():
    assert Path(own_law.__file__).read_text(encoding="utf-8").count("\n") <= 40


def test_hysteresis_drives_it():
    d, dt = 0.01 * np.sin(np.linspace(0.0, 9.0, 300)), 0.002
    found = ij.hysteresis(own_law.RelievedDamper(C, W), d, dt=dt)
    np.testing.assert_allclose(found, force(np.diff(d, prepend=0.0) / dt), rtol=1e-13)


def test_a_study_has_it_for_a_joint(tmp_path):
    (tmp_path / "study.yaml").write_text(STUDY)
    structure = load_study(tmp_path / "study.yaml").structure
    assert structure is not None
    (joint,) = structure.elements
    assert isinstance(joint, own_law.RelievedDamper)
    # Struck so hard that the valve is wide open: a constant force against the motion.
    push, dt = np.zeros((600, 3)), 0.01
    push[:50, 1] = 40.0
    found = ij.simulate(structure, push, dt, sensors=structure.rows)
    rate = np.ravel(found.velocity)
    open_, joint_force = np.abs(rate) > 1e-3, np.ravel(found.joint_force)
    assert np.mean(open_) > 0.9
    np.testing.assert_allclose(joint_force[open_], 3e-5 * np.sign(rate[open_]), rtol=1e-6)


def test_the_table_of_laws_lists_it():
    result = CliRunner().invoke(app, ["laws"])
    (line,) = [x for x in result.stdout.splitlines() if x.split()[:1] == ["relieved_damper"]]
    assert "c [force*time/length], w [length/time]" in line
    assert line.endswith("Shock absorber with a relief valve: F = c w tanh(v/w)")


@pytest.mark.long
def test_a_diagnosis_finds_it_at_its_place():
    rivals = ("viscous_damping", "quadratic_damping", "coulomb_friction", "cubic_stiffness")
    found = diagnosed(lambda: lambda d, v, moved: force(v), (*rivals, "relieved_damper"))
    first = found.what[0]
    assert first.label == "relieved_damper@m1-m2"
    assert first.probability > 0.9
    c, w = first.parameters
    assert (c.info.name, w.info.name) == ("c", "w")
    assert c.value == pytest.approx(C, rel=0.05)
    assert w.value == pytest.approx(W, rel=0.05)
    assert "shock absorber" in found.statement().lower()
    assert found.after.hold_out < 1.3 * found.noise_floor.hold_out
