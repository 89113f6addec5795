"""A study diagnoses by whatever it was given: the same verdicts as the function of each kind."""

import re
from dataclasses import dataclass

import numpy as np
import pytest
from discrepancy.histories import forced_oscillator as forced
from numpy.testing import assert_allclose

import iwanjax as ij
from iwanjax.discrepancy import StudyRecording, diagnose_histories

CUBIC = ("cubic_stiffness",)
JENKINS = ij.Jenkins(F_S=1.0, K_T=1.0)
STIFF = ij.LinearSpring(k=0.2 * forced.STIFFNESS)


def oscillator():
    """Half stiffness in a spring that counts as the joint."""
    linear = forced.linear()
    rest = ij.LinearStructure(linear.M, linear.C, np.asarray(linear.K) - float(STIFF.k))
    return ij.JointedStructure(rest, {"spring": (forced.ROW, STIFF)})


@pytest.fixture(scope="module")
def histories():
    said: list[str] = []
    measured = [forced.recording(900, 60.0, seed) for seed in (1, 2)]
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
    expected = diagnose_histories(
        oscillator(),
        [StudyRecording(use, x, f, use) for (x, f), use in zip(measured, uses, strict=True)],
        forced.RATE,
        rows={"spring": forced.ROW},
        sensors={"d": forced.ROW},
        inputs={"f": forced.ROW},
        quantity="displacement",
        hypotheses=CUBIC,
    )
    return study.diagnose(progress=said.append), expected, said


@pytest.mark.long
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
    loops = [loop_of(scale) for scale in (1.0, 2.0)]
    called = watched(monkeypatch, "diagnose_loops")
    study = ij.Study(
        ij.three_mass(joint=JENKINS),
        [loops[0], ij.Measurement(loops[1], use="hold_out", joint="J1")],
        hypotheses=CUBIC,
        budget=60.0,
    )
    assert dict(study.diagnose()) == {"J1": "verdict"}
    (arguments, options) = called
    assert arguments[0] == JENKINS
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
    assert list(options["rows"]) == ["J1", "m3"]
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


def test_the_function_takes_a_study(monkeypatch):
    called = watched(monkeypatch, "diagnose_loops")
    study = ij.Study(ij.three_mass(joint=JENKINS), loop_of(1.0))
    assert dict(ij.diagnose(study, budget=3.0)) == {"J1": "verdict"}
    assert called[1]["budget"] == 3.0


def test_the_function_takes_a_structure_and_recordings(monkeypatch):
    """Responses of sensors and forces at inputs, and free decays; two ways to hold one out."""
    called = watched(monkeypatch, "diagnose_histories", answer=Said())
    x, f = forced.recording(900, 400.0, 1)
    words = {"sampling_rate": forced.RATE, "sensors": "d", "quantity": "displacement"}
    hit = ij.as_recording(x, f, inputs="f", name="hit", **words)
    decay = ij.as_recording(x, name="decay", **words)
    answer = ij.diagnose(
        oscillator(),
        [hit, ij.Measurement(decay, use="hold_out", start=0.1)],
        hold_out=hit,
        rows={"mass": forced.ROW},
        sensors={"d": forced.ROW},
        inputs={"f": forced.ROW},
        hypotheses=["cubic_stiffness"],
        noise={"d": 1e-3},
        seed=4,
    )
    assert [(each.name, each.quantity) for each in answer.sensors] == [("d", "displacement")]
    (_, recordings, rate), options = called
    assert rate == forced.RATE
    assert [each.use for each in recordings] == ["fit", "hold_out", "hold_out"]
    assert_allclose(recordings[0].force, f)
    assert recordings[1].force is None
    assert list(options["rows"]) == ["spring", "mass"]
    assert (options["hypotheses"], options["noise"]) == (CUBIC, {"d": 1e-3})
    assert (options["seed"], options["budget"]) == (4, 1800.0)


def test_the_function_takes_a_structure_and_curves_by_mode(monkeypatch):
    called = watched(monkeypatch, "diagnose_modes")
    curves = [curves_of(amplitude) for amplitude in (1.0, 2.0, 3.0)]
    found = ij.diagnose(ij.three_mass(), {0: curves[0], 1: curves[1]}, hold_out={1: [curves[2]]})
    assert found == "verdict"
    assert called[0][1] == {0: curves[0], 1: curves[1]}
    assert called[0][2] == {0: [], 1: [curves[2]]}


@pytest.mark.parametrize("joint", ["jenkins", ij.Jenkins])
def test_the_function_takes_a_kind_of_joint_and_curves(monkeypatch, joint):
    called = watched(monkeypatch, "diagnose_curves", "dispatch")
    curves = [curves_of(amplitude) for amplitude in (1.0, 2.0)]
    assert ij.diagnose(joint, curves[0], hold_out=curves[1:], budget=2.0) == "verdict"
    assert called[0] == (joint, curves[:1], curves[1:])
    assert called[1]["budget"] == 2.0


def test_the_function_takes_a_joint_and_its_loops(monkeypatch):
    called = watched(monkeypatch, "diagnose_loops", "dispatch")
    loops = [loop_of(scale) for scale in (1.0, 2.0)]
    assert ij.diagnose(JENKINS, loops, noise=0.01, hypotheses=CUBIC) == "verdict"
    assert called[0] == (JENKINS, loops, [])
    assert (called[1]["noise"], called[1]["hypotheses"]) == (0.01, CUBIC)


@pytest.mark.parametrize(
    ("arguments", "options", "said"),
    [
        (("a_study",), {"seed": 1}, "seed does not belong to a study; the study holds its own"),
        (("a_study", "a_loop"), {}, "recordings does not belong to a study"),
        ((3.0, "a_loop"), {}, "got a float; expected a Study, a JointedStructure, a joint"),
        (("jenkins", "a_loop"), {}, "got a ForceLoop for a joint's class or name; expected Modal"),
        (("jenkins", []), {"noise": 1.0}, "noise does not belong to a joint's class or name"),
        (("jenkin", []), {}, "jenkins"),
        (("a_joint", "a_curve"), {}, "got a ModalCurves for a joint; expected ForceLoops"),
        (("a_joint", "a_loop"), {"rows": {"a": [1.0]}}, "rows does not belong to a joint"),
        (("a_joint", "a_loop"), {"noise": {"a": 1.0}}, "expected one number, the force's"),
        (("a_structure", "a_loop"), {}, "got ForceLoop for a structure"),
        (("a_structure", "a_curve"), {"noise": 1.0}, "expected {sensor: standard deviation}"),
        (("a_structure",), {}, "got no recordings for a structure; expected Recordings or Modal"),
    ],
)
def test_what_does_not_belong_to_a_model_gets_one_clear_line(arguments, options, said):
    objects = {
        "a_study": ij.Study(ij.three_mass()),
        "a_structure": ij.three_mass(),
        "a_joint": JENKINS,
        "a_loop": loop_of(1.0),
        "a_curve": curves_of(1.0),
    }
    given = [objects.get(each, each) if isinstance(each, str) else each for each in arguments]
    with pytest.raises(ij.InputError, match=re.escape(said)) as caught:
        ij.diagnose(*given, **options)
    assert "\n" not in str(caught.value)


def loop_of(scale):
    d = np.concatenate([np.linspace(0, 3, 40), np.linspace(3, -3, 80), np.linspace(-3, 3, 80)])
    return ij.ForceLoop(scale * d, scale * np.asarray(ij.hysteresis(JENKINS, d)), f"l{scale}")


def curves_of(amplitude):
    a = amplitude * np.geomspace(0.1, 1.0, 6)
    deviations = {"frequency_std": np.full(6, 1e-4), "damping_std": np.full(6, 1e-4)}
    return ij.ModalCurves(a, 0.1 - 1e-3 * a, 1e-3 + 1e-3 * a, quantity="displacement", **deviations)


@dataclass(frozen=True)
class Said:
    """A verdict as far as a study adds to it."""

    warnings: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()


def watched(monkeypatch, name, module="diagnoses", answer="verdict"):
    """What the function of a kind is called with, which then answers at once."""
    called = []

    def answered(*arguments, **options):
        called.extend((arguments, options))
        return answer

    monkeypatch.setattr(f"iwanjax.studies.{module}.{name}", answered)
    return called
