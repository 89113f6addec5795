"""Modes without structure, recordings, and what is said of parameters, in study files."""

import re
from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_config import check_refused, matrices, replaced

from iwanjax.config import ModalMode, read_study
from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.estimation import LogNormal, Uniform
from iwanjax.joints import Iwan4, Iwan5, Jenkins
from iwanjax.updating import modal_parameters, structural_parameters

ROOT = Path(__file__).resolve().parents[1]

MODAL = """\
name: beam
model:
  modal:
    - {name: mode1, band: [90, 150], joint: {type: iwan4, parameters: {chi: -0.4}}}
    - {name: mode2, band: [3e2, 4e2], joint: {type: iwan5}}
recordings:
  - {file: hits.mat, variable: xData, kind: free_decay, index: [0, 2], mode: mode1,
     response: {channel: tip, quantity: velocity, unit: m/s}, from: 0.1, to: 2}
  - file: control.csv
    kind: response_control
    levels: [1, 2, 3.5]
    use: hold_out
    mode: mode1
  - {file: curves.csv, kind: curves, mode: mode2, response: {quantity: velocity}}
  - {file: loop.json, kind: loop, joint: J1}
bounds:
  mode1.F_S: [1, 10]
  mode2.chi: [-1, 1]
priors:
  mode1.beta: {type: log_normal, median: 1, sigma: 0.5}
values: {mode2.chi: 0.2}
fixed: {mode1.zeta_0: 1e-3}
ringdown: {precision: 0.05, order: 4}
fit: {starts: 8, reference: shift}
posterior: {effective: 50, walkers: 20, most_steps: 100, seed: 5}
noise: {tip: 1e-3}
hypotheses: [cubic_stiffness, gap_contact]
budget: 3600
seed: 7
"""
STRUCTURE = """\
name: chain
model:
  file: model.npz
  joints:
    - {name: J1, type: iwan4, parameters: {F_S: 10, K_T: 1, chi: -0.5, beta: 5}}
    - {name: J2, row: J1, type: iwan4, parameters: {F_S: 5, K_T: 1, chi: -0.5, beta: 5}}
    - {name: J3, row: J1, type: jenkins, parameters: {F_S: 5, K_T: 1}}
recordings:
  - file: rec1.npz
    sampling_rate: 2048
    response: {array: response, sensors: [a1, a2], quantity: acceleration}
    force: {array: force, inputs: [m1]}
  - {file: curves.csv, kind: curves, mode: 2}
  - {file: loop.json, kind: loop, joint: J1, use: hold_out}
modes: [0, 2]
bands: {2: [0.1, 0.2]}
bounds: {ends.F_S: [1, 20]}
fixed: {J3.F_S: 4}
fit: {groups: {ends: [J1, J2]}}
"""
FILES = ("hits.mat", "control.csv", "curves.csv", "loop.json", "rec1.npz")
Q = np.geomspace(1e-5, 1e-4, 5)


@pytest.fixture
def study_file(tmp_path):
    np.savez(tmp_path / "model.npz", **matrices())
    for name in FILES:
        (tmp_path / name).touch()

    def write(text):
        path = tmp_path / "study.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture(scope="module")
def defaults():
    f, zeta = 118.0 - 2e4 * Q, 1e-3 + 10.0 * Q
    curves = ModalCurves(Q, f, zeta, frequency_std=0.01 * f, damping_std=0.1 * zeta)
    return modal_parameters(Iwan4, curves)


def test_modes_without_structure(study_file):
    study = read_study(study_file(MODAL))
    assert study.model is None
    assert study.structure is None
    assert study.modal == (
        ModalMode("mode1", (90.0, 150.0), Iwan4, {"chi": -0.4}),
        ModalMode("mode2", (300.0, 400.0), Iwan5, {}),
    )
    assert study.modes is None
    assert study.bands == {}


def test_recordings_of_modes(study_file, tmp_path):
    study = read_study(study_file(MODAL))
    hits, control, curves, loop = study.recordings
    assert hits.path == tmp_path / "hits.mat"
    assert (hits.kind, hits.use, hits.name, hits.variable) == (
        "free_decay",
        "fit",
        "hits.mat",
        "xData",
    )
    assert hits.index == (0, 2)
    assert hits.modes == ("mode1",)
    assert hits.response.channels == ("tip",)
    assert (hits.response.quantity, hits.response.unit) == ("velocity", "m/s")
    assert (hits.start, hits.end) == (0.1, 2.0)
    assert hits.place == f"{study.path}:7: recordings[0]"
    assert (control.kind, control.use, control.levels) == (
        "response_control",
        "hold_out",
        (1.0, 2.0, 3.5),
    )
    assert curves.modes == ("mode2",)
    assert curves.response.quantity == "velocity"
    assert (loop.joint, loop.modes, loop.levels) == ("J1", (), None)
    frozen: Any = hits
    with pytest.raises(FrozenInstanceError):
        frozen.use = "hold_out"


def test_settings(study_file):
    study = read_study(study_file(MODAL))
    assert study.ringdown.model_dump() == {
        "precision": 0.05,
        "order": 4,
        "estimator": "lines",
    }
    assert study.fit.model_dump() == {
        "starts": 8,
        "seed": 7,
        "reference": "shift",
        "groups": {},
        "coupled": False,
        "most_probable": False,
        "model_error": None,
        "method": "optimistix",
    }
    assert study.fit.error is None
    text = MODAL.replace("fit: {", "fit: {method: jaxopt, ")
    assert read_study(study_file(text)).fit.method == "jaxopt"
    text = MODAL.replace("fit: {", "fit: {model_error: {frequency: 1e-4, damping: 0.02}, ")
    assert read_study(study_file(text)).fit.error == (1e-4, 0.02)
    assert study.posterior.model_dump() == {
        "effective": 50,
        "walkers": 20,
        "most_steps": 100,
        "seed": 5,
    }
    assert study.noise == {"tip": 1e-3}
    assert study.hypotheses == ("cubic_stiffness", "gap_contact")
    assert (study.budget, study.seed) == (3600.0, 7)


def test_settings_that_are_not_given(study_file):
    study = read_study(study_file(MODAL[: MODAL.index("bounds:")]))
    assert study.ringdown.model_dump() == {
        "precision": 0.02,
        "order": 3,
        "estimator": "lines",
    }
    assert study.fit.model_dump() == {
        "starts": 64,
        "seed": 0,
        "reference": None,
        "groups": {},
        "coupled": False,
        "most_probable": False,
        "model_error": None,
        "method": "optimistix",
    }
    assert study.posterior.model_dump() == {
        "effective": 1000,
        "walkers": 48,
        "most_steps": 20_000,
        "seed": 0,
    }
    assert (study.noise, study.hypotheses, study.budget, study.seed) == ({}, (), 1800.0, 0)
    assert list(study.changes) == ["mode1.chi"]


def test_what_is_said_of_parameters(study_file, defaults):
    found = read_study(study_file(MODAL)).parameters("mode1", defaults)
    assert list(found) == list(defaults)
    assert found["f_0"] is defaults["f_0"]
    F_S, chi, beta, zeta_0 = (found[name] for name in ("F_S", "chi", "beta", "zeta_0"))
    assert (F_S.lower, F_S.upper, F_S.transform) == (1.0, 10.0, "logit")
    assert F_S.prior is defaults["F_S"].prior
    assert 1.0 <= F_S.value <= 10.0
    assert (chi.value, chi.fixed, chi.lower, chi.upper) == (-0.4, False, -1.0, 0.0)
    assert isinstance(beta.prior, LogNormal)
    assert (float(beta.prior.median), float(beta.prior.sigma)) == (1.0, 0.5)
    assert beta.value == defaults["beta"].value
    assert (zeta_0.value, zeta_0.fixed) == (1e-3, True)
    other = read_study(study_file(MODAL)).parameters("mode2", defaults)["chi"]
    assert (other.value, other.lower, other.upper, other.transform) == (0.2, -1.0, 1.0, "logit")
    assert isinstance(other.prior, Uniform)
    assert (float(other.prior.low), float(other.prior.high)) == (-1.0, 1.0)


def test_a_prior_goes_before_the_one_that_bounds_imply(study_file, defaults):
    text = MODAL.replace(
        "  mode1.beta:", "  mode2.chi: {type: normal, mean: 0, std: 0.1}\n  mode1.beta:"
    )
    prior: Any = read_study(study_file(text)).parameters("mode2", defaults)["chi"].prior
    assert float(prior.std) == pytest.approx(0.1)


def test_a_default_outside_the_study_s_bounds_moves_to_their_middle(study_file, defaults):
    text = MODAL.replace("mode2.chi: [-1, 1]", "mode2.chi: [-0.3, -0.1]").replace(
        ": 0.2}", ": -0.2}"
    )
    study = read_study(study_file(text.replace("values: {mode2.chi: -0.2}\n", "")))
    assert study.parameters("mode2", defaults)["chi"].value == pytest.approx(-0.2)


def test_a_value_that_the_data_refuse_is_told_with_its_line(study_file, defaults):
    study = read_study(study_file(MODAL.replace("mode1.zeta_0: 1e-3", "mode1.zeta_0: 0.9")))
    with pytest.raises(InputError) as caught:
        study.parameters("mode1", defaults)
    assert str(caught.value).startswith(f"{study.path}:22: fixed.mode1.zeta_0: ")
    assert "0.9 lies outside its bounds" in str(caught.value)


def test_parameters_of_what_is_not_in_the_study(study_file, defaults):
    study = read_study(study_file(MODAL))
    for mode in ("mode3", None):
        with pytest.raises(InputError, match="no mode"):
            study.parameters(mode, defaults)
    with pytest.raises(InputError, match="no mode"):
        read_study(study_file(STRUCTURE)).parameters("mode1", defaults)


def test_recordings_of_a_structure(study_file):
    study = read_study(study_file(STRUCTURE))
    hammer, curves, loop = study.recordings
    assert (hammer.kind, hammer.use, hammer.sampling_rate) == ("transient", "fit", 2048.0)
    assert (hammer.response.array, hammer.response.sensors) == ("response", ("a1", "a2"))
    assert (hammer.force.array, hammer.force.inputs) == ("force", ("m1",))
    assert hammer.modes == (0, 2)
    assert curves.modes == (2,)
    assert loop.joint == "J1"
    assert study.modal == ()
    assert study.modes == (0, 2)
    assert study.bands == {2: (0.1, 0.2)}


def test_parameters_of_a_structure(study_file):
    study = read_study(study_file(STRUCTURE))
    known = structural_parameters(study.structure, study.fit.groups)
    found = study.parameters(None, known)
    assert list(found) == list(known)
    assert (found["ends.F_S"].lower, found["ends.F_S"].upper) == (1.0, 20.0)
    assert found["ends.F_S"].value == 10.0
    assert (found["J3.F_S"].value, found["J3.F_S"].fixed) == (4.0, True)
    assert found["ends.chi"] is known["ends.chi"]


def test_damping_of_a_structures_modes_beside_its_joints(study_file):
    text = STRUCTURE.replace("fixed: {", "fixed: {mode2.zeta_0: 3e-4, ")
    assert text != STRUCTURE
    study = read_study(study_file(text))
    q = [1.0, 2.0, 3.0]
    curve = ModalCurves(q, [0.1] * 3, [1e-3] * 3, frequency_std=[1e-3] * 3, damping_std=[1e-4] * 3)
    known = structural_parameters(study.structure, study.fit.groups, [curve], [2])
    found = study.parameters(None, known)["mode2.zeta_0"]
    assert (found.value, found.fixed) == (3e-4, True)
    # Mode 1 is none of the study's, and the nearest name is told.
    with pytest.raises(InputError, match=r"fixed.mode1.zeta_0: unknown parameter.*mode2.zeta_0"):
        read_study(study_file(text.replace("mode2.zeta_0", "mode1.zeta_0")))


def test_what_can_be_left_out_where_it_is_clear(study_file):
    text = MODAL.replace("    - {name: mode2, band: [3e2, 4e2], joint: {type: iwan5}}\n", "")
    text = re.sub(r", mode: mode\d|    mode: mode1\n", "", text[: text.index("bounds:")])
    study = read_study(study_file(text))
    assert [entry.modes for entry in study.recordings] == [("mode1",)] * 3 + [()]
    text = "name: a\nmodel: {builder: three_mass}\nmodes: [1]\nrecordings:\n"
    text += "  - {file: curves.csv, kind: curves}\n  - {file: loop.json, kind: loop}\n"
    text += "  - {file: rec1.npz, response: {sensors: any, channels: acc_1}}\n"
    study = read_study(study_file(text))
    assert study.recordings[0].modes == (1,)
    assert study.recordings[1].joint == "J1"
    assert study.recordings[2].response.sensors == ("any",)


def test_a_mode_s_joint_may_be_any(study_file):
    text = "name: a\nmodel: {modal: [{name: m, band: [1, 2], joint: {type: jenkins}}]}"
    study = read_study(study_file(text + "\nvalues: {m.F_S: 3}"))
    assert study.modal[0].kind is Jenkins
    assert study.changes["m.F_S"].value == 3.0


def test_the_example_of_the_format(study_file):
    """Kinds and keys as the format's description has them."""
    text = """\
name: beam
model:
  modal:
    - {name: mode1, band: [90, 160], joint: {type: iwan4}}
recordings:
  - {file: hits.mat, variable: xData, kind: free_decay, use: fit,
     response: {channel: tip, quantity: velocity}}
  - {file: control.csv, kind: response_control, levels: [1, 2, 3, 5, 7], use: fit, mode: mode1}
  - {file: control.csv, kind: response_control, levels: [4, 6, 8], use: hold_out, mode: mode1}
  - {file: curves.csv, kind: curves, use: fit, mode: mode1}
  - {file: loop.json, kind: loop, use: fit, joint: J1}
"""
    kinds = [entry.kind for entry in read_study(study_file(text)).recordings]
    assert kinds == ["free_decay", "response_control", "response_control", "curves", "loop"]


@pytest.mark.parametrize("name", ["cubic_spring", "nothing_missing"])
def test_recordings_of_the_shared_examples(reference_data, name):
    path = reference_data.parent / "examples" / name / "study.yaml"
    if not path.is_file():
        pytest.skip(f"no shared example {name}")
    study = read_study(path)
    assert [entry.use for entry in study.recordings] == ["fit"] * 3 + ["hold_out"] * 2
    for entry in study.recordings:
        assert entry.kind == "transient"
        assert set(entry.response.sensors) <= set(study.model.sensors)
        assert set(entry.force.inputs) <= set(study.model.inputs)


def test_the_shipped_config():
    study = read_study(ROOT / "configs" / "modal_ringdown.yaml")
    assert [mode.kind for mode in study.modal] == [Iwan4]
    assert [entry.path.name for entry in study.recordings] == [f"hit{i}.npz" for i in range(1, 5)]
    assert [entry.use for entry in study.recordings] == ["fit"] * 3 + ["hold_out"]
    assert {entry.response.quantity for entry in study.recordings} == {"velocity"}


def test_the_keys_in_the_shipped_config_s_comments_work(tmp_path):
    """What the template offers may be used as it stands there, and defaults are defaults."""
    text = (ROOT / "configs" / "modal_ringdown.yaml").read_text(encoding="utf-8")
    used = re.sub(r"^( *)#(?=\S)", r"\1", text, flags=re.MULTILINE)
    assert used.count("\n") == text.count("\n")
    (tmp_path / "modal_ringdown").mkdir()
    for i in range(1, 5):
        (tmp_path / "modal_ringdown" / f"hit{i}.npz").touch()
    found = []
    for content in (text, used):
        (tmp_path / "study.yaml").write_text(content, encoding="utf-8")
        found.append(read_study(tmp_path / "study.yaml"))
    plain, full = found
    assert (full.ringdown, full.fit, full.posterior) == (plain.ringdown, plain.fit, plain.posterior)
    assert full.modal[0].values
    assert full.recordings[0].sampling_rate == 2048.0
    parameters = {"mode1.chi", "mode1.beta", "mode1.zeta_0", "mode1.F_S", "mode1.K_T"}
    assert set(full.changes) == parameters


BAD_MODEL = {
    # what: (text to replace, its replacement, line, words of the message)
    "file and modal": (
        "modal:",
        "file: model.npz\n  modal:",
        2,
        ["model: got both file and modal"],
    ),
    "modal empty": (
        MODAL[MODAL.index("\n    - {name: mode1") : MODAL.index("\nrec")],
        " []",
        3,
        ["model.modal", "at least one"],
    ),
    "modal a word": (
        MODAL[MODAL.index("\n    - {name: mode1") : MODAL.index("\nrec")],
        " mode1",
        3,
        ["list"],
    ),
    "options beside modal": (
        "modal:",
        "options: {mass: 1}\n  modal:",
        3,
        ["model.options", "builder"],
    ),
    "joints beside modal": (
        "modal:",
        "joints: [{name: J1, type: jenkins, parameters: {F_S: 1, K_T: 1}}]\n  modal:",
        3,
        ["model.joints", "joint:"],
    ),
    "unknown modal key": ("band: [90", "bnd: [90", 4, ["model.modal[0].bnd", "'band'"]),
    "missing band": (", band: [90, 150]", "", 4, ["modal[0]", "'band' is missing", "[90, 150]"]),
    "missing joint": (", joint: {type: iwan5}", "", 5, ["modal[1]", "'joint' is missing"]),
    "name twice": ("name: mode2", "name: mode1", 5, ["modal[1].name", "'mode1' again"]),
    "band falls": ("[90, 150]", "[150, 90]", 4, ["modal[0].band[1]", "got 90", "more than"]),
    "band negative": ("[90, 150]", "[-1, 90]", 4, ["modal[0].band[0]", "got -1", "positive"]),
    "band of three": ("[90, 150]", "[90, 1, 2]", 4, ["modal[0].band", "got 3", "two"]),
    "band a number": ("[90, 150]", "120", 4, ["modal[0].band", "'120'", "a list"]),
    "band not numbers": ("[90, 150]", "[90, x]", 4, ["modal[0].band[1]", "'x'", "number"]),
    "unknown type": ("iwan4", "iwan6", 4, ["modal[0].joint.type", "'iwan6'", "did you mean"]),
    "joint a word": ("{type: iwan5}", "iwan5", 5, ["modal[1].joint", "'iwan5'", "mapping"]),
    "unknown start": ("chi: -0.4", "Chi: -0.4", 4, ["parameters.Chi", "did you mean 'chi'"]),
    "start of a distribution": ("chi: -0.4", "phi_max: 1", 4, ["parameters.phi_max", "F_S, K_T"]),
    "start out of range": ("chi: -0.4", "chi: -2", 4, ["parameters.chi", "(-1, inf)"]),
    "start out of bounds": (
        "chi: -0.4",
        "chi: 0.4",
        4,
        ["parameters.chi", "[-1, 0]", "bounds: {mode1.chi"],
    ),
    "start not a number": ("chi: -0.4", "chi: low", 4, ["parameters.chi", "'low'"]),
    "qsma": ("seed: 7", "qsma: {alpha: [1]}", 29, ["qsma: needs a structure"]),
    "modes": ("seed: 7", "modes: [0]", 29, ["modes: needs a structure"]),
    "bands": ("seed: 7", "bands: {0: [1, 2]}", 29, ["bands: needs a structure"]),
    "groups": ("starts: 8", "groups: {a: [J1]}", 24, ["fit.groups: needs a structure"]),
}
BAD_RECORDINGS = {
    "unknown key": (
        "variable:",
        "varable:",
        7,
        ["recordings[0].varable", "did you mean 'variable'"],
    ),
    "missing file key": ("file: control.csv\n    kind", "kind", 9, ["recordings[1]", "file: rec1"]),
    "file not there": (
        "hits.mat",
        "hit.mat",
        7,
        ["[0].file", "not exist", "did you mean 'hits.mat'"],
    ),
    "file in no folder": ("hits.mat", "a/hits.mat", 7, ["[0].file", "a/hits.mat does not exist"]),
    "file a folder": ("hits.mat", ".", 7, ["[0].file", "is a folder"]),
    "file nothing": ("file: curves.csv", "file:", 14, ["[2].file", "got nothing", "text"]),
    "kind misspelt": (
        "free_decay",
        "free_decey",
        7,
        ["[0].kind", "'free_decey'", "mean 'free_decay'"],
    ),
    "use misspelt": ("hold_out", "holdout", 12, ["[1].use", "'holdout'", "mean 'hold_out'"]),
    "rate zero": (
        "variable: xData",
        "sampling_rate: 0",
        7,
        ["[0].sampling_rate", "greater than 0"],
    ),
    "rate with unit": ("variable: xData", "sampling_rate: 2 kHz", 7, ["'2 kHz'", "without unit"]),
    "index negative": ("[0, 2]", "-1", 7, ["[0].index", "'-1'"]),
    "index twice": ("[0, 2]", "[2, 2]", 7, ["[0].index[1]", "got 2 again"]),
    "index empty": ("[0, 2]", "[]", 7, ["[0].index", "at least one"]),
    "response a word": ("{quantity: velocity}", "tip", 14, ["[2].response", "'tip'", "mapping"]),
    "response key": ("channel:", "chanel:", 8, ["[0].response.chanel", "did you mean 'channel'"]),
    "quantity misspelt": ("velocity", "velocty", 8, ["response.quantity", "mean 'velocity'"]),
    "quantity missing": (
        "{channel: tip, quantity: velocity,",
        "{array: a,",
        8,
        ["[0].response", "'quantity' is missing"],
    ),
    "both channels": (
        "channel: tip",
        "channel: tip, channels: [a]",
        8,
        ["response.channels", "both"],
    ),
    "channels twice": ("channel: tip", "channels: [a, a]", 8, ["response.channels[1]", "a again"]),
    "uneven sensors": (
        "channel: tip",
        "channel: a, sensors: [a, b]",
        8,
        ["sensors", "got 2 for 1"],
    ),
    "to first": ("from: 0.1, to: 2", "from: 2, to: 1", 8, ["[0].to", "more than from = 2"]),
    "to at from": ("from: 0.1, to: 2", "from: 2, to: 2", 8, ["[0].to", "more than from = 2"]),
    "initial misspelt": ("from: 0.1", "initial: ret", 8, ["[0].initial", "'ret'", "'rest'"]),
    "initial of a decay": ("from: 0.1", "initial: rest", 8, ["[0].initial", "free decay"]),
    "initial of curves": ("mode: mode2", "initial: rest", 14, ["[2].initial", "kind curves"]),
    "from with unit": ("from: 0.1", "from: 0.1 s", 8, ["[0].from", "'0.1 s'"]),
    "from of curves": ("mode: mode2", "from: 1", 14, ["[2].from", "kind curves"]),
    "start": ("from: 0.1", "start: 0.1", 8, ["[0].start: unknown key"]),
    "force of a decay": (
        "variable: xData",
        "force: {array: f}",
        7,
        ["[0].force", "kind free_decay"],
    ),
    "levels of a decay": ("variable: xData", "levels: [1]", 7, ["[0].levels", "kind free_decay"]),
    "variable of curves": ("mode: mode2", "variable: x", 14, ["[2].variable", "kind curves"]),
    "modes of curves": ("mode: mode2", "modes: [mode2]", 14, ["[2].modes", "kind curves"]),
    "joint of curves": ("mode: mode2", "joint: J1", 14, ["[2].joint", "kind curves"]),
    "channel of curves": (
        "{quantity: velocity}",
        "{channel: a}",
        14,
        ["[2].response.channel", "curves"],
    ),
    "sensors of curves": (
        "{quantity: velocity}",
        "{sensors: [a, b]}",
        14,
        ["response.sensors", "expected one"],
    ),
    "inputs of a loop": (
        "kind: loop, joint: J1",
        "kind: loop, joint: J1, force: {inputs: [m1]}",
        15,
        ["[3].force.inputs", "kind loop", "array, unit"],
    ),
    "mode of a loop": ("joint: J1", "mode: mode1", 15, ["[3].mode", "kind loop"]),
    "mode missing": (", mode: mode2", "", 14, ["[2]: 'mode' is missing", "mode1, mode2"]),
    "mode unknown": (
        "mode: mode2",
        "mode: mode3",
        14,
        ["[2].mode", "'mode3'", "did you mean 'mode"],
    ),
    "mode and modes": ("mode: mode1,", "mode: mode1, modes: [mode2],", 7, ["[0].modes", "both"]),
    "modes twice": ("mode: mode1,", "modes: [mode2, mode2],", 7, ["[0].modes[1]", "again"]),
    "modes unknown": ("mode: mode1,", "modes: [mode2, mod],", 7, ["[0].modes[1]", "'mod'"]),
    "level not a number": ("[1, 2, 3.5]", "[1, low]", 11, ["[1].levels[1]", "'low'"]),
    "level twice": ("[1, 2, 3.5]", "[1, 2, 1.0]", 11, ["[1].levels[2]", "got 1 again"]),
    "level negative": ("[1, 2, 3.5]", "[-1]", 11, ["[1].levels[0]", "'-1'"]),
    "an entry a word": (
        "{file: loop.json, kind: loop, joint: J1}",
        "loop.json",
        15,
        ["[3]", "mapping"],
    ),
}
BAD_PARAMETERS = {
    "bounds unknown": ("mode2.chi: [", "mode2.ch: [", 18, ["bounds.mode2.ch", "mean 'mode2.chi'"]),
    "bounds without mode": ("mode2.chi: [", "chi: [", 18, ["bounds.chi", "unknown parameter"]),
    "bounds fall": ("[-1, 1]", "[1, -1]", 18, ["bounds.mode2.chi[1]", "got -1"]),
    "bounds equal": ("[-1, 1]", "[1, 1]", 18, ["bounds.mode2.chi[1]", "more than"]),
    "bounds one": ("[-1, 1]", "[1]", 18, ["bounds.mode2.chi", "got 1 number", "two"]),
    "bounds infinite": ("[-1, 1]", "[-1, inf]", 18, ["bounds.mode2.chi[1]", "finite"]),
    "bounds beyond the class": ("[-1, 1]", "[-1.5, 1]", 18, ["mode2.chi[0]", "(-1, inf)"]),
    "bounds not numbers": ("[-1, 1]", "[-1, x]", 18, ["bounds.mode2.chi[1]", "'x'"]),
    "bounds a list": (
        MODAL[MODAL.index("\n  mode1.F_S") : MODAL.index("\npriors")],
        " [1]",
        16,
        ["mapping"],
    ),
    "prior unknown": ("mode1.beta", "mode1.bet", 20, ["priors.mode1.bet", "mean 'mode1.beta'"]),
    "prior type": ("log_normal", "log_norml", 20, ["mode1.beta.type", "mean 'log_normal'"]),
    "prior without type": (
        "type: log_normal, ",
        "",
        20,
        ["priors.mode1.beta", "'type'", "uniform"],
    ),
    "prior a word": (
        "{type: log_normal, median: 1, sigma: 0.5}",
        "normal",
        20,
        ["mode1.beta", "mapping"],
    ),
    "prior field missing": (", sigma: 0.5", "", 20, ["priors.mode1.beta", "'sigma' is missing"]),
    "prior field extra": ("sigma:", "mean: 1, sigma:", 20, ["beta.mean", "unknown key", "median"]),
    "prior not a number": ("sigma: 0.5", "sigma: wide", 20, ["mode1.beta.sigma", "'wide'"]),
    "prior impossible": ("sigma: 0.5", "sigma: -1", 20, ["priors.mode1.beta", "sigma", "positive"]),
    "value unknown": (
        "{mode2.chi: 0.2}",
        "{mode3.chi: 1}",
        21,
        ["values.mode3.chi", "did you mean"],
    ),
    "value out of bounds": ("chi: 0.2", "chi: 1.2", 21, ["values.mode2.chi", "1.2", "[-1, 1]"]),
    "value out of range": ("chi: 0.2", "chi: -1", 21, ["values.mode2.chi", "(-1, inf)"]),
    "value out of default bounds": (
        "  mode2.chi: [-1, 1]\n",
        "",
        20,
        ["values.mode2.chi", "bounds: {mode2.chi"],
    ),
    "value a list": ("chi: 0.2", "chi: [0, 1]", 21, ["values.mode2.chi", "a list of 2", "number"]),
    "fixed unknown": (
        "mode1.zeta_0",
        "mode1.zeta",
        22,
        ["fixed.mode1.zeta", "mean 'mode1.zeta_0'"],
    ),
    "fixed out of range": ("1e-3}\nring", "-1}\nring", 22, ["fixed.mode1.zeta_0", "[0, 1)"]),
    "fixed and value": (
        "{mode1.zeta_0",
        "{mode2.chi: 0.1, mode1.zeta_0",
        21,
        ["values.mode2.chi", "fixed as well"],
    ),
    "fixed and start": (
        "{mode1.zeta_0",
        "{mode1.chi: -0.1, mode1.zeta_0",
        22,
        ["fixed.mode1.chi", "-0.4 already"],
    ),
}
BAD_SETTINGS = {
    "ringdown key": ("order: 4", "ordr: 4", 23, ["ringdown.ordr", "'order'"]),
    "precision": ("precision: 0.05", "precision: 2", 23, ["ringdown.precision", "less than 1"]),
    "order": ("order: 4", "order: 2.5", 23, ["ringdown.order", "'2.5'", "whole"]),
    "fit key": ("starts:", "start:", 24, ["fit.start", "'starts'"]),
    "starts": ("starts: 8", "starts: 0", 24, ["fit.starts", "'0'"]),
    "reference": ("reference: shift", "reference: shft", 24, ["fit.reference", "mean 'shift'"]),
    "posterior key": ("walkers:", "walker:", 25, ["posterior.walker", "'walkers'"]),
    "walkers odd": ("walkers: 20", "walkers: 21", 25, ["posterior.walkers", "even"]),
    "noise": ("tip: 1e-3", "tip: 0", 26, ["noise.tip", "greater than 0"]),
    "hypotheses a word": ("[cubic_stiffness, gap_contact]", "all", 27, ["hypotheses", "a list"]),
    "hypotheses twice": ("gap_contact", "cubic_stiffness", 27, ["hypotheses[1]", "again"]),
    "budget": ("3600", "1 h", 28, ["budget", "'1 h'", "without unit"]),
    "seed": ("seed: 7", "seed: -7", 29, ["seed", "'-7'"]),
    "top key": ("seed: 7", "sed: 7", 29, ["sed: unknown key", "'seed'"]),
}
BAD_STRUCTURE = {
    "sensor unknown": ("[a1, a2]", "[a1, A2]", 11, ["response.sensors[1]", "'A2'", "mean 'a2'"]),
    "input unknown": ("[m1]", "[M1]", 12, ["[0].force.inputs[0]", "'M1'", "mean 'm1'"]),
    "force key": ("inputs:", "input:", 12, ["[0].force.input", "'inputs'"]),
    "quantity missing": (", quantity: acceleration", "", 11, ["[0].response", "'quantity'"]),
    "mode a word": ("mode: 2", "mode: mode1", 13, ["[1].mode", "mode1", "0 to 2"]),
    "mode too high": ("mode: 2", "mode: 3", 13, ["[1].mode", "got 3", "0 to 2"]),
    "mode left out before": ("mode: 2", "mode: 1", 13, ["[1].mode", "[0, 2]"]),
    "mode missing": (", mode: 2", "", 13, ["[1]: 'mode' is missing", "0, 2"]),
    "joint unknown": ("joint: J1", "joint: j1", 14, ["[2].joint", "'j1'", "mean 'J1'"]),
    "joint missing": (" joint: J1,", "", 14, ["[2]: 'joint' is missing", "J1, J2, J3"]),
    "modes too high": ("modes: [0, 2]", "modes: [0, 2, 5]", 15, ["modes[2]", "got 5"]),
    "modes twice": ("modes: [0, 2]", "modes: [0, 2, 2]", 15, ["modes[2]", "again"]),
    "band of no mode": ("{2: [0.1", "{x: [0.1", 16, ["bands.x", "got x", "0 to 2"]),
    "band of another mode": ("{2: [0.1", "{1: [0.1", 16, ["bands.1", "[0, 2]"]),
    "band falls": ("[0.1, 0.2]", "[0.2, 0.1]", 16, ["bands.2[1]", "more than"]),
    "joint in a group": ("ends.F_S", "J1.F_S", 17, ["bounds.J1.F_S", "expected ends.F_S"]),
    "model's value outside": ("[1, 20]", "[1, 9]", 17, ["bounds.ends.F_S", "model's 10"]),
    "group of no joint": (
        "[J1, J2]",
        "[J1, j2]",
        19,
        ["fit.groups.ends[1]", "'j2'", "did you mean"],
    ),
    "group of two types": ("[J1, J2]", "[J1, J3]", 19, ["groups.ends[1]", "Jenkins", "one type"]),
    "group twice": ("[J1, J2]", "[J1, J1]", 19, ["groups.ends[1]", "already"]),
    "group named as a joint": ("ends: [J1, J2]", "J3: [J1, J2]", 19, ["groups.J3", "rename"]),
    "group empty": ("[J1, J2]", "[]", 19, ["fit.groups.ends", "at least one"]),
    "noise": ("fit:", "noise: {a3: 1}\nfit:", 19, ["noise.a3", "no sensor or input 'a3'"]),
}


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        pytest.param(*case, id=f"{group}: {what}")
        for group, cases in (
            ("model", BAD_MODEL),
            ("recordings", BAD_RECORDINGS),
            ("parameters", BAD_PARAMETERS),
            ("settings", BAD_SETTINGS),
        )
        for what, case in cases.items()
    ],
)
def test_a_fault_in_a_study_of_modes(study_file, old, new, line, words):
    check_refused(study_file(replaced(MODAL, old, new)), line, words)


@pytest.mark.parametrize(("old", "new", "line", "words"), BAD_STRUCTURE.values(), ids=BAD_STRUCTURE)
def test_a_fault_in_a_study_of_a_structure(study_file, old, new, line, words):
    check_refused(study_file(replaced(STRUCTURE, old, new)), line, words)
