"""The key ``model.test``: a study's linear model from its own low-level recordings."""

import numpy as np
import pytest
from typer.testing import CliRunner

import iwanjax as ij
from iwanjax.cli import app

STUDY = """name: chain
model:
  test: {test}
recordings:
  - file: low.npz
    use: fit
    sampling_rate: 128
    response: {array: response, sensors: [a1, a2], quantity: acceleration}
    force: {array: force, inputs: [F]}
"""
TEST = "{recordings: [low.npz], band: [3, 16], driving_points: {F: a1}}"
M, K = np.eye(2), np.array([[6000.0, -2500.0], [-2500.0, 5000.0]])
C = 0.002 * K


def recorded(path):
    """Periods of a steady state, by the structure's own matrices."""
    random, count = np.random.default_rng(0), 2048
    f = np.fft.rfftfreq(count, 1.0 / 128.0)
    force = np.where((f > 2.0) & (f < 20.0), np.exp(2j * np.pi * random.random(f.size)), 0.0)
    shown = np.zeros((f.size, 2), complex)
    for i in np.flatnonzero(force):
        w = 2.0 * np.pi * f[i]
        shown[i] = -(w**2) * np.linalg.solve(K - w**2 * M + 1j * w * C, [force[i], 0.0])
    response, drive = np.fft.irfft(shown, count, axis=0), np.fft.irfft(force, count)
    response = np.tile(response, (4, 1))
    response += 1e-3 * np.std(response) * random.standard_normal(response.shape)
    np.savez(path, response=response, force=np.tile(drive, 4))


@pytest.fixture
def study(tmp_path):
    recorded(tmp_path / "low.npz")

    def written(test=TEST):
        path = tmp_path / "study.yaml"
        path.write_text(STUDY.replace("{test}", test))
        return path

    return written


def test_a_string_is_the_study_s_own_recording(study, tmp_path):
    loaded = ij.load_study(study())
    test = loaded.modal_test()
    squares, Phi = np.linalg.eigh(K)
    omega = np.sqrt(squares)
    np.testing.assert_allclose(test.frequency, omega / (2.0 * np.pi), rtol=1e-4)
    np.testing.assert_allclose(test.damping, 0.5 * 0.002 * omega, rtol=1e-2)
    np.testing.assert_allclose(np.abs(test.shapes), np.abs(Phi), rtol=1e-2)
    assert set(loaded.setup.model.rows) == {"a1-ground", "a2-ground", "a2-a1"}
    assert loaded.setup.trust == test.trust  # the test's deviations where nothing is said
    again = ij.load_study(study(TEST + "\n  trust: {frequencies: 0.01}"))
    assert again.setup.trust.frequencies == (0.01,)
    # The command writes the model, which a study can name as its file.
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["modal", str(study()), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert {"modal.json", "modal.npz", "modal.png", "model.npz"} <= {x.name for x in out.iterdir()}
    other = tmp_path / "other.yaml"
    other.write_text("name: other\nmodel: {file: out/model.npz}\n")
    known, written = loaded.structure, ij.load_study(other).structure
    np.testing.assert_allclose(written.structure.K, known.structure.K)


@pytest.mark.parametrize(
    ("test", "message"),
    [
        ("{recordings: [low.npz], band: [3, 16]}", "model.test: shapes are not mass-normalised"),
        (TEST.replace("F: a1", "F: a9"), "model.test: driving_points: no sensor 'a9'"),
        (TEST.replace("low.npz", "high.npz"), "high.npz does not exist"),
        (TEST.replace("band: [3, 16]", "order: 1"), "order = 1: expected 2 at least"),
        (TEST.replace("band", "bands"), "unknown key"),
        (TEST + "\n  file: model.npz", "got both file and test"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(study, test, message):
    with pytest.raises(ij.InputError, match=r"study\.yaml:") as told:
        ij.load_study(study(test))
    assert message in str(told.value)


def test_a_study_without_one_has_no_modal_verb(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text("name: chain\nmodel: {builder: three_mass}\n")
    result = CliRunner().invoke(app, ["modal", str(path), "--out", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert "there is no modal test; add for instance model: {test:" in result.stderr
