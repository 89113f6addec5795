from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
from numpy.testing import assert_allclose

from iwanjax.config import read_study
from iwanjax.errors import InputError
from iwanjax.joints import Iwan4, Iwan5, LinearSpring
from iwanjax.quasistatic import qsma
from iwanjax.structures import three_mass

ROOT = Path(__file__).resolve().parents[1]
LEVELS = np.geomspace(1e-3, 1e2, 9)

BUILDER = """\
name: chain
model:
  builder: three_mass
  options: {mass: 10, stiffness: 9}
  joints:
    - name: J1
      type: iwan4
      parameters: {F_S: 10, K_T: 1, chi: -0.5, beta: 5}
qsma:
  modes: [0, 2]
  alpha: {from: 1e-3, to: 1e2, count: 9}
  zeta0: 1e-4
"""
FILE = """\
name: chain
model:
  file: model.npz
  joints:
    - {name: bolt, row: J1, type: iwan4, parameters: {F_S: 10, K_T: 1, chi: -0.5, beta: 5}}
"""
IWAN4 = "parameters: {F_S: 10, K_T: 1, chi: -0.5, beta: 5}"


def matrices():
    chain = three_mass()
    return {
        **{name: np.asarray(getattr(chain.structure, name)) for name in "MCK"},
        "row_labels": np.array(["J1"]),
        "rows": np.asarray(chain.rows),
        "sensor_labels": np.array(["a1", "a2"]),
        "sensor_rows": np.eye(3)[:2],
        "input_labels": np.array(["m1"]),
        "input_rows": np.eye(3)[:1],
    }


@pytest.fixture
def study_file(tmp_path):
    np.savez(tmp_path / "model.npz", **matrices())

    def write(text):
        path = tmp_path / "study.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def joint_of(study) -> Any:
    return study.structure.joints["J1"]


def curves(study):
    return qsma(study.structure, [0, 2], LEVELS, 1e-4).curves


def test_a_builder_gives_the_library_s_own_structure(study_file):
    study = read_study(study_file(BUILDER))
    expected = qsma(three_mass(), [0, 2], LEVELS, 1e-4).curves
    found = curves(study)
    assert study.name == "chain"
    assert_allclose(found.frequency, expected.frequency, rtol=1e-12)
    assert_allclose(found.damping, expected.damping, rtol=1e-12)
    assert list(study.model.rows) == ["J1"]


def test_every_model_format_gives_the_same_curves(study_file, tmp_path):
    scipy.io.savemat(tmp_path / "model.mat", matrices())
    with h5py.File(tmp_path / "model.h5", "w") as file:
        for name, value in matrices().items():
            file[name] = value.tolist() if value.dtype.kind == "U" else value
    expected = qsma(three_mass(), [0, 2], LEVELS, 1e-4).curves
    for name in ("model.npz", "model.mat", "model.h5"):
        study = read_study(study_file(FILE.replace("model.npz", name)))
        assert study.structure.labels == ("bolt",)
        assert list(study.model.sensors) == ["a1", "a2"]
        assert_allclose(curves(study).frequency, expected.frequency, rtol=1e-12)
        assert_allclose(curves(study).damping, expected.damping, rtol=1e-12)


def test_numbers_that_yaml_takes_for_text(study_file):
    study = read_study(study_file(BUILDER.replace("F_S: 10", "F_S: 1e5")))
    assert float(joint_of(study).F_S) == 1e5


def test_names_that_yaml_takes_for_something_else(study_file):
    assert read_study(study_file(BUILDER.replace("chain", "2024-01-01"))).name == "2024-01-01"
    assert read_study(study_file(BUILDER.replace("chain", "no"))).name == "no"


def test_the_slider_distribution_is_another_way_to_give_a_joint(study_file):
    joint = Iwan4(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0)
    given = f"R: {joint.R}, S: {joint.S}, chi: -0.5, phi_max: {joint.phi_max}"
    text = BUILDER.replace(IWAN4, f"parameters: {{{given}}}")
    found = joint_of(read_study(study_file(text)))
    assert_allclose([found.F_S, found.K_T, found.beta], [10.0, 1.0, 5.0], rtol=1e-12)
    text = text.replace("type: iwan4", "type: iwan5").replace("{R:", "{theta: 0.8, R:")
    found = joint_of(read_study(study_file(text)))
    assert isinstance(found, Iwan5)
    assert_allclose(found.theta, 0.8)


def test_a_builder_s_joint_can_change_its_kind_and_name(study_file):
    text = BUILDER.replace("name: J1", "name: bolt\n      row: J1").replace(
        f"iwan4\n      {IWAN4}", "jenkins\n      parameters: {F_S: 2, K_T: 3}"
    )
    study = read_study(study_file(text))
    assert study.structure.labels == ("bolt",)
    # The modes start from the new joint's stiffness.
    assert_allclose(study.structure.basis.stiffness, [3.0])


def test_a_builder_keeps_its_own_joint(study_file):
    study = read_study(study_file("name: a\nmodel: {builder: three_mass}"))
    assert_allclose(joint_of(study).F_S, 10.0)
    assert study.qsma is None
    assert study.recordings == ()


def test_two_joints_may_share_a_row(study_file):
    second = "\n    - {name: J2, row: J1, type: linear_spring, parameters: {k: 2}}\nqsma:"
    study = read_study(study_file(BUILDER.replace("\nqsma:", second)))
    assert study.structure.labels == ("J1", "J2")
    assert_allclose(study.structure.basis.stiffness, [1.0, 2.0])


def test_the_shape_of_loading(study_file):
    for text, shape in ((BUILDER, "linear"), (BUILDER + "  shape: updated\n", "updated")):
        settings = read_study(study_file(text)).qsma
        assert settings is not None
        assert settings.shape == shape


def test_the_oscillator_takes_its_joint_from_the_list(study_file):
    text = BUILDER[: BUILDER.index("qsma:")].replace("three_mass", "oscillator")
    study = read_study(study_file(text.replace("mass: 10, stiffness: 9", "stiffness: 4")))
    assert_allclose(study.structure.modes().omega, [np.sqrt(5.0)])


@pytest.mark.parametrize(
    ("alpha", "expected"),
    [
        ("[1, 1e1, 100]", [[1, 10, 100]] * 2),
        ("{from: 1, to: 100, count: 3}", [[1, 10, 100]] * 2),
        ("[[1, 2], [3, 4]]", [[1, 2], [3, 4]]),
        ("[{from: 1, to: 100, count: 3}, [3, 4, 5]]", [[1, 10, 100], [3, 4, 5]]),
    ],
)
def test_load_levels(study_file, alpha, expected):
    settings = read_study(
        study_file(BUILDER.replace("{from: 1e-3, to: 1e2, count: 9}", alpha))
    ).qsma
    assert settings is not None
    assert_allclose(settings.levels, expected, rtol=1e-12)


@pytest.mark.parametrize(("zeta0", "expected"), [("1e-4", [1e-4] * 2), ("[0, 1e-3]", [0, 1e-3])])
def test_background_damping(study_file, zeta0, expected):
    settings = read_study(study_file(BUILDER.replace("zeta0: 1e-4", f"zeta0: {zeta0}"))).qsma
    assert settings is not None
    assert settings.damping is not None
    assert_allclose(settings.damping, expected)


def test_no_background_damping_means_the_structure_s(study_file):
    settings = read_study(study_file(BUILDER.replace("  zeta0: 1e-4\n", ""))).qsma
    assert settings is not None
    assert settings.damping is None


def test_the_shipped_config():
    study = read_study(ROOT / "configs" / "three_mass.yaml")
    settings = study.qsma
    assert settings is not None
    solution = qsma(study.structure, list(settings.modes), settings.levels, settings.damping)
    phi_max = float(joint_of(study).phi_max)
    assert np.all(solution.converged)
    assert_allclose(solution.q[:, 0], 1e-2, rtol=2e-3)
    deflection = np.abs(np.asarray(solution.deflection))
    assert np.all(deflection[:, 0] < 1e-2 * phi_max)
    assert np.all(deflection[:, -1] > 3.0 * phi_max)


def test_the_shipped_impact():
    study = read_study(ROOT / "configs" / "three_mass.yaml")
    case: Any
    (case,) = study.simulate
    assert (case.settings.method, case.settings.steps) == ("newmark", 100_000)
    omega, Phi = study.structure.modes()
    assert_allclose(case.settings.excitation.circular, omega[2], rtol=1e-8)
    assert_allclose(case.inputs, [[0, 1, 0]])
    modal = Phi.T @ study.structure.structure.C @ Phi
    assert_allclose(modal, np.diag(2e-4 * omega), rtol=1e-9, atol=1e-15)


def test_the_shipped_sines_are_at_the_resonance_of_their_element():
    """Thesis (4.38) and (4.41) at y0 = 1e-4."""
    cases: dict[str, Any] = {
        case.name: case
        for case in read_study(ROOT / "configs" / "oscillator_five_parameter.yaml").simulate
    }
    for theta, label in ((1.0, "1"), (0.5, "05")):
        up, down = cases[f"ring_up_theta_{label}"], cases[f"ring_down_theta_{label}"]
        joint = up.structure.joints["J1"]
        assert_allclose(joint.theta, theta)
        assert_allclose([joint.R, joint.S, joint.phi_max], [7e5, 9e4, 6e-4], rtol=1e-12)
        omega = np.sqrt(5e5 + float(joint.secant(1e-4)))
        force = float(joint.dissipation(1e-4)) / (np.pi * 1e-4)
        for case in (up, down):
            assert_allclose(case.settings.excitation.circular, omega, rtol=1e-6)
        assert_allclose(up.settings.excitation.amplitude, force, rtol=1e-5)
        ramp = down.settings.excitation.amplitude
        assert_allclose([ramp.start, ramp.to, ramp.duration], [6.0, force, 2.0], rtol=1e-5)
    assert_allclose(cases["impact_theta_02"].structure.joints["J1"].theta, 0.2)
    blow = cases["impact_theta_02"].settings.excitation
    assert_allclose([blow.p, blow.circular], [100.0, 200.0 * np.pi])


def test_the_shipped_drives():
    cases: Any = read_study(ROOT / "configs" / "ring_up_ring_down.yaml").simulate
    assert [case.joint for case in cases] == ["J1"] * 4
    assert [float(case.structure.joints["J1"].theta) for case in cases] == [1.0, 1.0, 0.3, 0.3]
    # All printed digits.
    assert_allclose(cases[0].structure.joints["J1"].K_T, 99011.614, rtol=0, atol=5e-4)
    assert_allclose(cases[0].structure.joints["J1"].F_S, 20.830562, rtol=0, atol=5e-7)


@pytest.mark.parametrize(
    ("joints", "stiffness"),
    [
        ("[{name: J1, type: jenkins, parameters: {F_S: 2, K_T: 3}}]", 3.0),
        (
            "[{name: J1, type: jenkins, parameters: {F_S: 2, K_T: 3}}, "
            "{name: J2, row: J1, type: linear_spring, parameters: {k: 2}}]",
            5.0,
        ),
    ],
)
def test_a_builder_s_damping_is_of_the_modes_with_the_study_s_joints(study_file, joints, stiffness):
    text = f"{{builder: three_mass, options: {{zeta: 1e-2}}, joints: {joints}}}"
    study = read_study(study_file(f"name: a\nmodel: {text}\n"))
    expected = three_mass(joint=LinearSpring(k=stiffness), zeta=1e-2).structure.C
    assert_allclose(study.structure.structure.C, expected, rtol=1e-10, atol=1e-14)
    assert_allclose(study.model.structure.C, expected, rtol=1e-10, atol=1e-14)


def test_a_case_or_a_list_of_cases(study_file):
    case = "{name: a, dt: 0.1, samples: 5, drive: {amplitude: 1}}"
    for text in (case, f"[{case}]"):
        found: Any
        (found,) = read_study(study_file(BUILDER + f"simulate: {text}\n")).simulate
        assert (found.name, found.joint, found.settings.steps) == ("a", "J1", 4)
        assert found.settings.drive.frequency == 1.0
    assert read_study(study_file(BUILDER)).simulate == ()


def test_a_joint_must_be_named_among_several(study_file):
    second = "\n    - {name: J2, row: J1, type: linear_spring, parameters: {k: 2}}\nqsma:"
    case = "simulate: {name: a, dt: 0.1, samples: 5, drive: {amplitude: 1}}\n"
    path = study_file(BUILDER.replace("\nqsma:", second) + case)
    check_refused(path, 14, ["simulate.drive", "'joint' is missing", "J1, J2"])


@pytest.mark.parametrize("name", ["cubic_spring", "nothing_missing"])
def test_the_shared_examples(name):
    path = ROOT.parent / "shared" / "examples" / name / "study.yaml"
    if not path.is_file():
        pytest.skip(f"no shared example {name}")
    study = read_study(path)
    assert len(study.recordings) == 5
    low = study.structure.modes().omega
    solution = qsma(study.structure, 0, float(low[0]) ** 2 * np.geomspace(1e-6, 1e-4, 5))
    assert np.all(solution.converged)


BAD = {
    # what: (text to replace, its replacement, line, words of the message)
    "unknown top key": ("qsma:", "qsmaa:", 9, ["qsmaa: unknown key", "'qsma'"]),
    "later section": (
        "qsma:",
        "discrepancy: 3\nqsma:",
        9,
        ["discrepancy: unknown key", "recordings"],
    ),
    "unknown model key": ("builder:", "bulder:", 3, ["model.bulder", "'builder'"]),
    "unknown joint key": ("type:", "typ:", 7, ["model.joints[0].typ", "'type'"]),
    "unknown qsma key": ("zeta0:", "zeta:", 12, ["qsma.zeta", "'zeta0'"]),
    "unknown range key": ("to: 1e2", "too: 1e2", 11, ["qsma.alpha.too", "'to'"]),
    "missing name": ("name: chain\n", "", 1, ["'name' is missing", "name: my_study"]),
    "missing alpha": ("  alpha: {from: 1e-3, to: 1e2, count: 9}\n", "", 9, ["'alpha' is missing"]),
    "missing type": ("      type: iwan4\n", "", 6, ["model.joints[0]", "'type' is missing"]),
    "empty name": ("name: chain", "name:", 1, ["name: got nothing", "text"]),
    "unknown builder": ("three_mass", "three_masses", 3, ["'three_masses'", "'three_mass'"]),
    "unknown option": ("mass: 10,", "mas: 10,", 4, ["model.options.mas", "'mass'"]),
    "option not a number": ("mass: 10", "mass: heavy", 4, ["model.options.mass", "'heavy'"]),
    "option out of range": ("mass: 10", "mass: -1", 4, ["model.options.mass", "-1", "positive"]),
    "missing option": (
        "three_mass\n  options: {mass: 10, stiffness: 9}",
        "oscillator\n  options: {mass: 10}",
        4,
        ["model.options", "'stiffness' is missing"],
    ),
    "missing joint": (
        BUILDER[BUILDER.index("three_mass") : BUILDER.index("qsma:")],
        "oscillator\n  options: {stiffness: 9}\n",
        3,
        ["model.builder", "oscillator needs its joint", "joints:"],
    ),
    "too many joints": (
        BUILDER[BUILDER.index("three_mass") : BUILDER.index("qsma:")],
        "oscillator\n  options: {stiffness: 9}\n  joints:\n"
        + "".join(f"    - {{name: J{i}, row: J1, type: iwan4, {IWAN4}}}\n" for i in (1, 2)),
        3,
        ["model.builder", "oscillator needs its joint, got 2"],
    ),
    "file and builder": ("builder:", "file: a.npz\n  builder:", 2, ["model", "both"]),
    "neither": ("builder: three_mass\n  options: {mass: 10, stiffness: 9}", "", 2, ["neither"]),
    "unknown type": ("iwan4", "iwan6", 7, ["joints[0].type", "'iwan6'", "did you mean 'iwan"]),
    "unknown parameter": ("K_T: 1", "K_t: 1", 8, ["parameters.K_t", "iwan4", "'K_T'"]),
    "missing parameter": (", beta: 5", "", 8, ["parameters: beta", "Dirac", "missing"]),
    "two sets": ("K_T: 1", "phi_max: 1", 8, ["parameters.phi_max", "mixes", "R, S, chi, phi_max"]),
    "out of bounds": ("chi: -0.5", "chi: -2", 8, ["parameters.chi", "-2", "(-1, inf)"]),
    "with unit": ("F_S: 10", "F_S: 10 N", 8, ["parameters.F_S", "'10 N'", "without unit"]),
    "decimal comma": ("chi: -0.5", "chi: '-0,5'", 8, ["'-0,5'", "number"]),
    "not finite": ("F_S: 10", "F_S: nan", 8, ["'nan'", "finite"]),
    "truth value": ("F_S: 10", "F_S: yes", 8, ["'yes'", "number"]),
    "parameters a list": (IWAN4, "parameters: [10, 1]", 8, ["a list of 2", "mapping"]),
    "unknown label": ("name: J1", "name: J2", 6, ["joints[0].name", "'J2'", "J1"]),
    "mode too high": ("[0, 2]", "[0, 3]", 10, ["qsma.modes[1]", "got 3", "0 to 2"]),
    "negative mode": ("[0, 2]", "[-1]", 10, ["qsma.modes[0]", "'-1'", "0"]),
    "mode not whole": ("[0, 2]", "[0.5]", 10, ["qsma.modes[0]", "'0.5'", "whole"]),
    "mode twice": ("[0, 2]", "[2, 2]", 10, ["qsma.modes", "twice"]),
    "modes not a list": ("[0, 2]", "0", 10, ["qsma.modes", "'0'", "list"]),
    "no modes": ("[0, 2]", "[]", 10, ["qsma.modes", "at least one"]),
    "range upside down": ("to: 1e2", "to: 1e-4", 11, ["qsma.alpha.to", "0.0001", "0.001"]),
    "range from zero": ("from: 1e-3", "from: 0", 11, ["qsma.alpha.from", "'0'", "greater than 0"]),
    "falling levels": ("{from: 1e-3, to: 1e2, count: 9}", "[1, 3, 2]", 11, ["alpha[2]", "3"]),
    "negative level": ("{from: 1e-3, to: 1e2, count: 9}", "[-1, 3]", 11, ["alpha[0]", "positive"]),
    "levels for too many": ("{from: 1e-3, to: 1e2, count: 9}", "[[1], [2], [3]]", 11, ["3 sets"]),
    "uneven levels": ("{from: 1e-3, to: 1e2, count: 9}", "[[1], [2, 3]]", 11, ["1 and 2 levels"]),
    "levels a word": (
        "{from: 1e-3, to: 1e2, count: 9}",
        "many",
        11,
        ["qsma.alpha", "'many'", "{from"],
    ),
    "negative damping": ("zeta0: 1e-4", "zeta0: -1", 12, ["qsma.zeta0", "'-1'"]),
    "damping for too many": ("zeta0: 1e-4", "zeta0: [0, 0, 0]", 12, ["qsma.zeta0", "3 numbers"]),
    "unknown frequency": ("zeta0: 1e-4", "frequency: tangent", 12, ["'tangent'", "'secant'"]),
    "unknown shape": ("zeta0: 1e-4", "shape: curved", 12, ["qsma.shape", "'curved'", "'updated'"]),
    "infinite level": ("{from: 1e-3, to: 1e2, count: 9}", "[1, inf]", 11, ["alpha[1]", "finite"]),
    "level not a number": (
        "{from: 1e-3, to: 1e2, count: 9}",
        "[[1, 2], [3, x]]",
        11,
        ["qsma.alpha[1][1]", "'x'"],
    ),
    "recordings a word": ("qsma:", "recordings: rec1.npz\nqsma:", 9, ["recordings", "a list"]),
    "key twice": ("zeta0: 1e-4", "modes: [1]", 12, ["modes", "twice"]),
    "key not text": ("zeta0: 1e-4", "[1]: 2", 12, ["a list of 1 for a key"]),
    "broken YAML": ("modes: [0, 2]", "modes: [0, 2", 11, ["not valid YAML"]),
    "tab": ("  zeta0", "\tzeta0", 12, ["not valid YAML"]),
    "a list": (BUILDER, "- name: a", 1, ["a list of 1", "mapping"]),
    "empty": (BUILDER, "# nothing yet\n", 1, ["empty"]),
}
BAD_WITH_FILE = {
    "missing model": ("model.npz", "modell.npz", 3, ["model.file", "modell.npz", "not exist"]),
    "not a model": ("model.npz", "study.yaml", 3, ["model.file", "'.yaml'", ".npz"]),
    "unknown row": ("row: J1", "row: j1", 5, ["joints[0].row", "'j1'", "did you mean 'J1'"]),
    "options": ("file:", "options: {mass: 1}\n  file:", 3, ["model.options", "builder"]),
    "name twice": (
        "    - {",
        f"    - {{name: bolt, row: J1, type: iwan4, {IWAN4}}}\n    - {{",
        6,
        ["model.joints[1].name", "'bolt' again"],
    ),
}


@pytest.mark.parametrize(("old", "new", "line", "words"), BAD.values(), ids=BAD)
def test_a_fault_has_one_line(study_file, old, new, line, words):
    check_refused(study_file(replaced(BUILDER, old, new)), line, words)


@pytest.mark.parametrize(("old", "new", "line", "words"), BAD_WITH_FILE.values(), ids=BAD_WITH_FILE)
def test_a_fault_with_a_model_file_has_one_line(study_file, old, new, line, words):
    check_refused(study_file(replaced(FILE, old, new)), line, words)


def test_a_faulty_model_file_is_told_with_the_study_s_line(study_file, tmp_path):
    np.savez(tmp_path / "model.npz", **{**matrices(), "K": np.eye(2)})
    check_refused(study_file(FILE), 3, ["model.file", "model.npz: K has shape (2, 2)"])


def test_unstable_structures_are_told_with_the_study_s_line(study_file, tmp_path):
    np.savez(tmp_path / "model.npz", **{**matrices(), "K": -np.eye(3)})
    check_refused(study_file(FILE), 2, ["model", "not positive semidefinite"])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"name: \xff\xfe", ["UTF-8"]),
        (b"name: \x00", ["not valid YAML"]),
        (b"a: &x [*x]", ["nested too deeply"]),
        (b"[" * 9999, ["nested too deeply"]),
    ],
)
def test_files_that_are_no_study(tmp_path, content, words):
    path = tmp_path / "study.yaml"
    path.write_bytes(content)
    check_refused(path, None, words)


def test_a_study_that_is_not_there(tmp_path):
    check_refused(tmp_path / "study.yaml", None, ["No such file", "YAML"])
    check_refused(tmp_path, None, ["YAML"])


def replaced(text, old, new):
    assert old in text
    return text.replace(old, new, 1)


def check_refused(path, line, words):
    with pytest.raises(InputError) as caught:
        read_study(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: " if line is None else f"{path}:{line}: ")
    assert "\n" not in message
    for word in words:
        assert word in message
