"""A study diagnoses by whatever it was given: the same verdicts as the function of each kind."""

import numpy as np
import pytest
from discrepancy.histories import forced_oscillator as forced
from numpy.testing import assert_allclose

import iwanjax as ij
from iwanjax.discrepancy import StudyRecording

CUBIC = ("cubic_stiffness",)
STIFF = ij.LinearSpring(k=0.2 * forced.STIFFNESS)


def oscillator():
    """Half stiffness in a spring that counts as the joint."""
    linear = forced.linear()
    rest = ij.LinearStructure(linear.M, linear.C, np.asarray(linear.K) - float(STIFF.k))
    return ij.JointedStructure(rest, {"spring": (forced.ROW, STIFF)})


@pytest.fixture(scope="module")
def histories():
    said: list[str] = []
    measured = [(forced.recording(900, level, seed)) for level, seed in ((400.0, 1), (400.0, 2))]
    uses = ("fit", "hold_out")
    recordings = [
        ij.Measurement(
            ij.as_recording(
                x, f, sampling_rate=forced.RATE, sensors="d", inputs="f", quantity="displacement"
            ),
            use=use,
            name=use,
        )
        for (x, f), use in zip(measured, uses, strict=True)
    ]
    study = ij.Study(
        oscillator(),
        recordings,
        sensors={"d": forced.ROW},
        inputs={"f": forced.ROW},
        hypotheses=CUBIC,
        name="driven",
    )
    expected = ij.diagnose(
        oscillator(),
        [StudyRecording(use, x, f, use) for (x, f), use in zip(measured, uses, strict=True)],
        forced.RATE,
        places={"spring": forced.ROW},
        inputs=[forced.ROW],
        sensors={"d": forced.ROW},
        quantity="displacement",
        hypotheses=CUBIC,
    )
    return study.diagnose(progress=said.append), expected, said


def test_time_histories_judge_the_structure(histories):
    found, expected, said = histories
    assert list(found) == ["driven"]
    verdict = found.only
    assert (verdict.what[0].kind.name, verdict.what[0].where) == ("cubic_stiffness", "spring")
    assert_allclose(verdict.what[0].parameters[0].value, forced.CUBIC, rtol=0.05)
    assert verdict.statement() == expected.statement()
    assert_allclose(verdict.after.hold_out, expected.after.hold_out, rtol=1e-9)
    assert list(verdict.by_recording) == ["fit", "hold_out"]
    assert "predicting the held-out recordings" in said


def test_a_verdict_is_told_under_its_name(histories):
    assert histories[0].summary().startswith("driven: ")
    assert "cubic spring" in histories[0].summary()


def test_loops_judge_a_joint(monkeypatch):
    d = np.concatenate([np.linspace(0, 3, 40), np.linspace(3, -3, 80), np.linspace(-3, 3, 80)])
    joint = ij.Jenkins(F_S=1.0, K_T=1.0)
    force = np.asarray(ij.hysteresis(joint, d))
    loops = [ij.ForceLoop(scale * d, scale * force, f"l{scale}") for scale in (1.0, 2.0)]
    called = watched(monkeypatch, "diagnose_loops")
    study = ij.Study(
        ij.three_mass(joint=joint),
        [loops[0], ij.Measurement(loops[1], use="hold_out", joint="J1")],
        hypotheses=CUBIC,
        budget=60.0,
    )
    assert dict(study.diagnose()) == {"J1": "verdict"}
    (arguments, options) = called
    assert arguments[0] == joint
    assert (arguments[1], arguments[2]) == ([loops[0]], [loops[1]])
    assert set(arguments[3]) == {"J1.F_S", "J1.K_T"}
    assert (options["hypotheses"], options["budget"], options["name"]) == (CUBIC, 60.0, "J1")


def test_curves_judge_the_modes_of_a_structure(monkeypatch):
    curves = [curves_of(amplitude) for amplitude in (1.0, 2.0)]
    called = watched(monkeypatch, "diagnose_modes")
    study = ij.Study(
        ij.three_mass(),
        [ij.Measurement(curves[0], mode=1), ij.Measurement(curves[1], mode=1, use="hold_out")],
        rows={"m3": [0, 0, 1]},
        seed=3,
    )
    assert dict(study.diagnose(budget=5.0)) == {"study": "verdict"}
    arguments, options = called
    assert arguments[1] == {1: curves[0]}
    assert arguments[2] == {1: [curves[1]]}
    assert list(options["places"]) == ["J1", "m3"]
    assert (options["seed"], options["budget"]) == (3, 5.0)


def test_curves_judge_a_single_mode(monkeypatch):
    curves = [curves_of(amplitude) for amplitude in (1.0, 2.0)]
    called = watched(monkeypatch, "diagnose_curves")
    study = ij.Study(
        recordings=[curves[0], ij.Measurement(curves[1], use="hold_out")],
        modal=[{"name": "m", "band": (0.05, 0.2), "joint": {"type": "jenkins"}}],
    )
    assert dict(study.diagnose()) == {"m": "verdict"}
    arguments, options = called
    assert arguments[0] is ij.Jenkins
    assert [each.amplitude.tolist() for each in arguments[1]] == [curves[0].amplitude.tolist()]
    assert [each.amplitude.tolist() for each in arguments[2]] == [curves[1].amplitude.tolist()]
    assert (options["name"], options["mode"]) == ("m", 0)


def curves_of(amplitude):
    a = amplitude * np.geomspace(0.1, 1.0, 6)
    deviations = {"frequency_std": np.full(6, 1e-4), "damping_std": np.full(6, 1e-4)}
    return ij.ModalCurves(a, 0.1 - 1e-3 * a, 1e-3 + 1e-3 * a, quantity="displacement", **deviations)


def watched(monkeypatch, name):
    """What the function of a kind is called with, which then answers at once."""
    called = []

    def answer(*arguments, **options):
        called.extend((arguments, options))
        return "verdict"

    monkeypatch.setattr(f"iwanjax.studies.diagnoses.{name}", answer)
    return called
