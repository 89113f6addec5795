"""A law in a file of 40 lines is a joint, an element, a hypothesis and a line of the table."""

from pathlib import Path

import numpy as np
import own_law
import pytest
from typer.testing import CliRunner

import iwanjax as ij
from iwanjax.cli import app
from iwanjax.discrepancy import StudyRecording
from iwanjax.joints import JOINTS
from iwanjax.studies import load_study

C, W = 60.0, 0.05
RATE, N, FINE = 1024.0, 700, 64
M, K = np.diag([1.0, 1.5]), np.array([[1.5e5, -6e4], [-6e4, 6e4]])
DAMPING = 2e-5 * K
PLACES = {"m1-ground": [1.0, 0.0], "m2-ground": [0.0, 1.0], "m1-m2": [-1.0, 1.0]}

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


def pulse(t, peak):
    return peak * np.sin(np.pi * (t - 0.04) / 0.01) ** 2 if 0.04 < t < 0.05 else 0.0


def recorded(struck: int, peak: float, use: str) -> StudyRecording:
    """Semi-implicit Euler in small steps, the law between both masses."""
    random = np.random.default_rng(round(peak))
    dt, row = 1.0 / (RATE * FINE), np.array(PLACES["m1-m2"])
    u, v, seen, push = np.zeros(2), np.zeros(2), [], []
    for i in range(N * FINE):
        f = np.zeros(2)
        f[struck] = pulse(i * dt, peak)
        a = (f - DAMPING @ v - K @ u - row * force(row @ v)) / np.diag(M)
        if i % FINE == 0:
            seen.append(a)
            push.append(f)
        v = v + dt * a
        u = u + dt * v
    response = np.array(seen)
    noise = 5e-3 * np.std(response) * random.standard_normal(response.shape)
    return StudyRecording(f"{use} {peak:g}", response + noise, np.array(push), use=use)


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
    (line,) = [x for x in result.stdout.splitlines() if x.split()[0] == "relieved_damper"]
    assert "c [force*time/length], w [length/time]" in line
    assert line.endswith("Shock absorber with a relief valve: F = c w tanh(v/w)")


def test_a_diagnosis_finds_it_at_its_place():
    model = ij.JointedStructure(ij.LinearStructure(M, DAMPING, K), {})
    hits = [(0, 40.0, "fit"), (1, 160.0, "fit"), (0, 90.0, "hold_out")]
    found = ij.diagnose(
        model,
        [recorded(*hit) for hit in hits],
        RATE,
        places=PLACES,
        inputs=np.eye(2),
        sensors={"a1": [1.0, 0.0], "a2": [0.0, 1.0]},
        hypotheses=(
            "viscous_damping",
            "quadratic_damping",
            "coulomb_friction",
            "cubic_stiffness",
            "relieved_damper",
        ),
    )
    first = found.what[0]
    assert first.label == "relieved_damper@m1-m2"
    assert first.probability > 0.9
    c, w = first.parameters
    assert (c.info.name, w.info.name) == ("c", "w")
    assert c.value == pytest.approx(C, rel=0.05)
    assert w.value == pytest.approx(W, rel=0.05)
    assert "shock absorber" in found.statement().lower()
    assert found.after.hold_out < 1.3 * found.noise_floor.hold_out
