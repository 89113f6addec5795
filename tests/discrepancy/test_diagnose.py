"""A concealed force is found where it is, and nothing where there is none."""

import json
from functools import cache

import chain
import numpy as np
import pytest
from typer.testing import CliRunner

import iwanjax as ij
from iwanjax.cli import app
from iwanjax.discrepancy import ForceKind, Transient, diagnose, register_kind
from iwanjax.joints import ParameterInfo

TRIED = ("stiffness_error", "cubic_stiffness", "gap_contact", "quadratic_damping")
K3 = 3e10
SENSORS = {"a1": np.array([1.0, 0.0]), "a2": np.array([0.0, 1.0])}


def nothing(u, v):
    return np.zeros(2)


def cubic(u, v):
    return np.array([K3 * u[0] ** 3, 0.0])


CONCEALED = {"nothing": nothing, "cubic": cubic}


@cache
def recordings(name):
    return tuple(
        Transient(f"rec{i}", *chain.recorded(hit, CONCEALED[name]), hit.use)
        for i, hit in enumerate(chain.HITS)
    )


@cache
def structure():
    linear = ij.LinearStructure(*chain.matrices())
    joint = ij.Iwan4(**chain.GIVEN)
    return ij.JointedStructure(linear, {"J1": (np.array(chain.ROWS["J1"]), joint)})


@cache
def verdict(name):
    return diagnose(
        structure(),
        recordings(name),
        chain.RATE,
        places=chain.ROWS,
        inputs=np.eye(2),
        sensors=SENSORS,
        hypotheses=TRIED,
    )


def test_nothing_is_found_where_nothing_is_missing():
    found = verdict("nothing")
    assert not found.detected
    assert found.what == ()
    assert found.probability_nothing_missing > 0.99
    assert found.before.hold_out < 0.02
    assert found.statement().startswith("Nothing is missing")


def test_a_concealed_cubic_spring_is_found_where_it_is():
    found = verdict("cubic")
    assert found.detected
    first = found.what[0]
    assert (first.kind.name, first.where) == ("cubic_stiffness", "m1-ground")
    assert first.probability > 0.9
    assert first.parameters[0].value == pytest.approx(K3, rel=0.05)
    assert found.after.hold_out < 0.25 * found.before.hold_out
    assert found.noise_floor.hold_out < found.after.hold_out
    assert found.probability_nothing_missing < 1e-3
    assert "cubic_stiffness" in found.statement()


def test_the_picture_has_every_recording():
    figure = ij.plot(verdict("cubic"))
    labels = [tick.get_text() for tick in figure.axes[0].get_xticklabels()]
    assert labels == [each.name for each in recordings("cubic")]
    assert len(figure.axes) == 2
    assert len(ij.plot(verdict("nothing")).axes) == 1


BAD = {
    "no fit": ({"use": "hold_out"}, {}, "no recording to fit"),
    "force": ({"force": np.zeros((chain.SAMPLES, 2))}, {}, "rec: the force is zero throughout"),
    "NaN": ({"response": np.full((chain.SAMPLES, 2), np.nan)}, {}, "rec: response holds NaN"),
    "dead": ({"response": np.zeros((chain.SAMPLES, 2))}, {}, "rec: sensor 0 shows nothing"),
    "sensors": ({"response": np.ones((chain.SAMPLES, 3))}, {}, r"expected \(N, 2\)"),
    "inputs": ({"force": np.ones((chain.SAMPLES, 1))}, {}, "force has shape"),
    "kind": ({}, {"hypotheses": ("cubic_stifness",)}, "did you mean 'cubic_stiffness'"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_recordings_get_one_clear_line(case):
    changed, options, message = BAD[case]
    random = np.random.default_rng(0)
    good = {
        "response": random.standard_normal((chain.SAMPLES, 2)),
        "force": random.standard_normal((chain.SAMPLES, 2)),
    }
    bad = Transient("rec", **(good | changed))
    with pytest.raises(ij.InputError, match=message) as caught:
        diagnose(
            structure(),
            [bad],
            chain.RATE,
            places=chain.ROWS,
            inputs=np.eye(2),
            sensors=SENSORS,
            **options,
        )
    assert "\n" not in str(caught.value)


def test_a_kind_of_ones_own_is_taken_once():
    own = ForceKind(
        "test_only",
        "for this test",
        ParameterInfo("s", "force/length", "size"),
        lambda motion, shape, memory: (motion.d, memory),
        "none",
    )
    register_kind(own)
    register_kind(own)
    try:
        with pytest.raises(ij.InputError, match="is taken"):
            register_kind(ForceKind("test_only", "", own.size, own.unit_force, ""))
    finally:
        del ij.discrepancy.CATALOGUE["test_only"]


def written(folder, recs):
    """The chain as a study with files."""
    M, C, K = chain.matrices()
    np.savez(
        folder / "model.npz",
        M=M,
        C=C,
        K=K,
        row_labels=np.array(list(chain.ROWS)),
        rows=np.array(list(chain.ROWS.values())),
        sensor_labels=np.array(["a1", "a2"]),
        sensor_rows=np.eye(2),
        input_labels=np.array(["m1", "m2"]),
        input_rows=np.eye(2),
    )
    values = ", ".join(f"{k}: {v}" for k, v in chain.GIVEN.items())
    lines = [
        "name: chain",
        f"hypotheses: [{', '.join(TRIED)}]",
        "model:",
        "  file: model.npz",
        "  joints:",
        f"  - {{name: J1, row: J1, type: iwan4, parameters: {{{values}}}}}",
        "recordings:",
    ]
    for each in recs:
        time = np.arange(len(each.response)) / chain.RATE
        np.savez(folder / f"{each.name}.npz", time=time, response=each.response, force=each.force)
        lines.append(
            f"- {{file: {each.name}.npz, use: {each.use}, sampling_rate: {chain.RATE}, response: "
            "{array: response, sensors: [a1, a2], quantity: acceleration}, force: "
            "{array: force, inputs: [m1, m2]}}"
        )
    path = folder / "study.yaml"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_the_verb_writes_the_verdict(tmp_path):
    study, out = written(tmp_path, recordings("cubic")), tmp_path / "out"
    result = CliRunner().invoke(app, ["diagnose", str(study), "--out", str(out)])
    assert result.exit_code == 0, result.output
    told = json.loads((out / "diagnosis.json").read_text())
    assert told["detected"] is True
    assert told["what"][0]["kind"] == "cubic_stiffness"
    assert told["what"][0]["where"] == "m1-ground"
    assert set(told["fit"]) == {"before", "after", "noise_floor"}
    assert told["statement"] in result.output
    assert (out / "diagnosis.png").stat().st_size > 10_000
    assert "cubic_stiffness" in (out / "report.html").read_text()


def test_a_study_without_force_is_refused(tmp_path):
    study = written(tmp_path, recordings("nothing")[:2])
    text = study.read_text()
    study.write_text(text[: text.index("recordings:")])
    result = CliRunner().invoke(app, ["diagnose", str(study), "--out", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert "no recordings of kind transient" in result.output
    assert not (tmp_path / "out").exists()
