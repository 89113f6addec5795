"""Recordings of a shaker, of unequal length, of models without joints; and what fails late.

The oscillator is integrated by ``forced_oscillator``, which shares nothing with the package.
"""

import importlib
import json
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
import yaml
from forced_oscillator import (
    CUBIC,
    MASS,
    NOISE,
    RATE,
    ROW,
    STIFFNESS,
    damper,
    linear,
    recording,
)
from typer.testing import CliRunner

import iwanjax as ij
from iwanjax.cli import app
from iwanjax.discrepancy import StudyRecording, diagnose_histories
from iwanjax.discrepancy.histories.time_steps import StudyData
from iwanjax.discrepancy.histories.validation import free_run
from iwanjax.identification.predictor import predictor
from iwanjax.signals.comparison_band import END
from iwanjax.signals.sensor_noise import BESIDE_MODEL

WEAK, STRONG = 5.0, 30.0
# (use, samples, level, seed).
EQUAL = (("fit", 900, WEAK, 1), ("fit", 900, STRONG, 2), ("hold_out", 900, STRONG, 3))
UNEQUAL = (("fit", 500, WEAK, 1), ("fit", 900, STRONG, 2), ("hold_out", 3000, STRONG, 3))


def transients(those, **options):
    return [
        StudyRecording(f"{use} {seed}", *recording(samples, level, seed, **options), use)
        for use, samples, level, seed in those
    ]


def diagnosed(structure, recordings, **options):
    return diagnose_histories(
        structure,
        recordings,
        RATE,
        rows={"mass-ground": ROW},
        sensors={"x": ROW},
        inputs={"f": ROW},
        quantity="displacement",
        **options,
    )


def taken(recordings):
    """Both sides as a diagnosis takes them, its noise not known."""
    rows = jnp.asarray(ROW[None])
    by, modal = predictor(
        ij.JointedStructure(linear(), {}), rows, rows, RATE, "displacement", (), 2
    )
    return StudyData.of(recordings, by, modal, np.full(1, np.nan))


def test_no_fit_runs_through_the_length_of_what_is_held_out():
    sides = taken(transients(UNEQUAL))
    assert sides.fitted.data.response.shape == (2, 900, 1)
    assert sides.held[0][0].data.response.shape == (2, 3000, 1)


def with_spring(damping=0.05, share=0.3):
    """A share of the stiffness in a joint of its own, a linear one."""
    one = np.ones((1, 1))
    rest = ij.LinearStructure(MASS * one, damper(damping) * one, (1.0 - share) * STIFFNESS * one)
    return ij.JointedStructure(rest, {"J1": (ROW, ij.LinearSpring(k=share * STIFFNESS))})


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """The verb on recordings of three lengths, no joint in the model."""
    folder = tmp_path_factory.mktemp("forced")
    one = np.ones((1, 1))
    np.savez(
        folder / "model.npz",
        **{"M": MASS * one, "C": damper(0.05) * one, "K": STIFFNESS * one},
        **{"row_labels": ["mass-ground"], "rows": one},
        **{"sensor_labels": ["x"], "sensor_rows": one},
        **{"input_labels": ["mass"], "input_rows": one},
    )
    entries = []
    for use, samples, level, seed in UNEQUAL:
        response, force = recording(samples, level, seed)
        name = f"{use}{seed}.npz"
        np.savez(folder / name, response=response, force=force)
        entries.append(
            {
                "file": name,
                "use": use,
                "sampling_rate": RATE,
                "response": {"array": "response", "sensors": ["x"], "quantity": "displacement"},
                "force": {"array": "force", "inputs": ["mass"]},
            }
        )
    study = {"name": "forced", "model": {"file": "model.npz"}, "recordings": entries}
    (folder / "study.yaml").write_text(yaml.safe_dump(study))
    out = folder / "out"
    result = CliRunner().invoke(app, ["diagnose", str(folder / "study.yaml"), "--out", str(out)])
    assert result.exit_code == 0, result.output
    return json.loads((out / "diagnosis.json").read_text()), out


@pytest.mark.long
def test_a_spring_is_found_in_a_model_without_joints(told):
    verdict, out = told
    first = verdict["what"][0]
    assert (first["kind"], first["where"]) == ("cubic_stiffness", "mass-ground")
    assert first["parameters"]["k3"]["value"] == pytest.approx(CUBIC, rel=0.01)
    after, floor = verdict["fit"]["after"], verdict["fit"]["noise_floor"]
    assert after["hold_out"] < 1.5 * floor["hold_out"]
    assert after["hold_out"] < 0.05 * verdict["fit"]["before"]["hold_out"]
    assert verdict["failures"] == []
    assert (out / "restoring_force.png").stat().st_size > 10_000


@pytest.mark.long
def test_a_response_that_never_decays_tells_no_damping(told):
    assert told[0]["observables"] == []


def test_a_linear_model_misses_nothing_in_linear_recordings():
    found = diagnosed(
        ij.JointedStructure(linear(), {}),
        transients(UNEQUAL, cubic=0.0),
    )
    assert not found.detected
    assert found.after.hold_out < 1.5 * found.noise_floor.hold_out
    assert [each.recording for each in found.noise] == list(found.by_recording)
    for each in found.noise:
        assert each.source == "over the whole band"
        assert each.lower == each.deviation == each.upper
        assert abs(each.deviation - NOISE) < 3.0 * each.std < 0.5 * NOISE


def test_coloured_noise_is_told_by_what_the_right_model_leaves():
    """Three times the white noise, and most of it slow: no quiet band shows it all."""

    def coloured(samples: int, seed: int) -> np.ndarray:
        spectrum = np.fft.rfft(np.random.default_rng(seed).standard_normal(samples))
        f = np.fft.rfftfreq(samples)
        spectrum[0], spectrum[1:] = 0.0, spectrum[1:] * np.sqrt(1.0 + 0.3 / f[1:])
        noise = np.fft.irfft(spectrum, samples)
        return 3.0 * NOISE * noise[:, None] / np.std(noise)

    recordings = [
        replace(each, response=each.response + coloured(len(each.response), i))
        for i, each in enumerate(transients(UNEQUAL))
    ]
    found = diagnosed(
        ij.JointedStructure(linear(), {}), recordings, hypotheses=("cubic_stiffness",)
    )
    assert [each.label for each in found.what] == ["cubic_stiffness@mass-ground"]
    assert found.what[0].probability > 0.99
    # The weak one is nearly linear.
    assert [each.source for each in found.noise] == ["over the whole band", *2 * [BESIDE_MODEL]]
    for i, each in enumerate(found.noise):
        slow = coloured(UNEQUAL[i][1], i)[:, 0]
        compared = np.abs(np.fft.rfft(slow)[1 : int(END * len(slow))]) ** 2
        true = np.sqrt(NOISE**2 + np.mean(compared) / len(slow))
        assert abs(each.deviation / true - 1.0) < 2.0 * each.std / each.deviation < 0.15
    assert abs(found.after.fit / found.noise_floor.fit - 1.0) < 0.05
    assert 0.9 < found.after.hold_out / found.noise_floor.hold_out < 1.1


@pytest.mark.long
def test_a_short_recording_beside_a_long_one_hides_no_force():
    """Until a silent motion has decayed to 1e-154, whose square is zero."""
    those = (("fit", 300, 3.0 * STRONG, 1), ("fit", 4000, WEAK, 2))
    found = diagnosed(
        with_spring(0.2),
        transients(those, damping=0.2),
        hypotheses=("cubic_stiffness",),
    )
    assert found.detected
    assert found.what[0].parameters[0].value == pytest.approx(CUBIC, rel=0.02)


@pytest.mark.long
def test_a_force_is_recovered_where_one_acts_throughout():
    found = diagnosed(with_spring(), transients(EQUAL), hypotheses=("cubic_stiffness",))
    assert found.failures == ()
    assert found.restoring is not None
    inner = np.abs(found.restoring.centre) < 0.8 * np.abs(found.restoring.centre).max()
    law = CUBIC * found.restoring.centre**3
    off = found.restoring.middle - law
    assert np.abs(off[inner]).max() < 0.05 * np.abs(law).max()


def failing(*arguments, **options):
    raise ValueError("zero-size array to reduction operation\nminimum")


@pytest.mark.long
def test_what_fails_late_costs_no_verdict(told, monkeypatch, tmp_path):
    """The held-out run, the modes' differences, the restoring force, a picture."""
    # A function of the same name hides the module.
    module = importlib.import_module("iwanjax.discrepancy.histories.diagnose")
    monkeypatch.setattr(module, "restoring_force", failing)
    monkeypatch.setattr(module, "observables", failing)
    monkeypatch.setattr("iwanjax.verbs.diagnose.plot_prediction", failing)
    monkeypatch.setattr("iwanjax.discrepancy.histories.time_steps.free_run", only_fitted())
    _, out = told
    study, again = out.parent / "study.yaml", tmp_path / "out"
    result = CliRunner().invoke(app, ["diagnose", str(study), "--out", str(again)])
    assert result.exit_code == 0, result.output
    verdict = json.loads((again / "diagnosis.json").read_text())
    assert verdict["what"][0]["kind"] == "cubic_stiffness"
    assert verdict["fit"]["after"]["hold_out"] is None
    assert verdict["fit"]["after"]["fit"] == pytest.approx(told[0]["fit"]["after"]["fit"])
    failures = verdict["failures"]
    assert [each.split(" failed")[0] for each in failures] == [
        "predicting the held-out recordings",
        "comparing the modes",
        "recovering the restoring force",
        "the picture prediction.png",
    ]
    report = (again / "report.html").read_text()
    for each in failures:
        assert "(ValueError: zero-size array to reduction operation minimum)" in each
        assert each in verdict["statement"]
        assert each in report
    assert (again / "diagnosis.png").stat().st_size > 10_000
    assert not (again / "prediction.png").exists()


def only_fitted():
    """Free runs of what was fitted, and none of what was held out."""

    def run(problem, fitted, other, batches):
        if batches[0][0].names[0].startswith("hold_out"):
            failing()
        return free_run(problem, fitted, other, batches)

    return run


@pytest.mark.parametrize("samples", [400, 900, 3000])
def test_noise_beside_a_motion_that_never_rests(samples):
    """Third differences say 8 times it."""
    recordings = transients((("fit", samples, WEAK, 1),))
    (noise,) = taken(recordings).fitted.noise.ravel()
    assert 0.75 * NOISE < noise < 1.25 * NOISE


def test_a_record_of_a_shaker_never_comes_free():
    (shaken,) = transients(EQUAL[:1])
    assert shaken.released == len(shaken.response)
    hit = np.zeros((900, 1))
    hit[40:50, 0] = np.hanning(10)
    assert 45 < StudyRecording("hit", shaken.response, hit).released < 60
    assert StudyRecording("decay", shaken.response, None).released == 0
