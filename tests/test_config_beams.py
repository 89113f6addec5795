"""Study files about the thesis's two finite element beams."""

import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from iwanjax.cli import app
from iwanjax.config import read_study
from iwanjax.errors import InputError

pytest.importorskip("skfem", reason="scikit-fem (extra fem) is not installed")

from iwanjax.structures.fem.brake_reuss import (
    brake_reuss_beam,
    brake_reuss_joints,
    brake_reuss_springs,
)
from iwanjax.structures.fem.sumali import sumali_beam, sumali_joints, sumali_springs

CONFIGS = Path(__file__).resolve().parents[1] / "configs"
# A mesh that is built in a second, once for all tests.
COARSE = """\
name: beam
model:
  builder: brake_reuss_beam
  options:
    size: 40
    modes: 3
    springs: {J1.y: 1e5}
    zeta: 1e-3
  joints:
    - {name: left, row: J1.x, type: jenkins, parameters: {F_S: 2, K_T: 3e5}}
"""
BARE = "name: beam\nmodel:\n  builder: brake_reuss_beam\n  options: {size: 40, modes: 3}\n"


@pytest.fixture
def study_file(tmp_path):
    def write(text):
        path = tmp_path / "study.yaml"
        path.write_text(text)
        return path

    return write


@cache
def shipped(name: str) -> Any:
    return read_study(CONFIGS / f"{name}_beam.yaml")


def ratios(structure):
    """Damping ratio of each mode, and the largest damping between two."""
    omega, Phi = structure.modes()
    C = np.asarray(Phi.T @ structure.structure.C @ Phi)
    coupled = np.abs(C - np.diag(np.diag(C))).max() / np.abs(C).max()
    return np.diag(C) / (2 * np.asarray(omega)), coupled


def test_options_reach_the_beam(study_file):
    study = read_study(study_file(COARSE))
    beam = brake_reuss_beam(size=40.0, modes=3)
    assert study.structure.labels == ("left",)
    assert_allclose(study.structure.rows, [beam.rows["J1.x"]])
    assert_allclose(study.model.structure.K, beam.model({"J1.y": 1e5}).structure.K)
    assert list(study.model.rows) == list(beam.rows)
    assert list(study.model.sensors) == list(beam.sensors)
    assert list(study.model.inputs) == ["s"]
    zeta, coupled = ratios(study.structure)
    assert_allclose(zeta, 1e-3, rtol=1e-6)
    assert coupled < 1e-9


def test_without_a_list_it_has_the_thesis_s_springs_and_joints(study_file):
    study = read_study(study_file(BARE))
    joints = brake_reuss_joints()
    assert study.structure.labels == tuple(joints)
    assert_allclose(study.structure.basis.stiffness, [joint.K_T for joint in joints.values()])
    expected = brake_reuss_beam(size=40.0, modes=3).model(brake_reuss_springs("y")).structure
    assert_allclose(study.model.structure.K, expected.K)
    assert not np.any(study.structure.structure.C)


def test_forces_act_on_inputs_rows_and_coordinates(study_file):
    case = "{{name: c{i}, dt: 1e-4, samples: 3, excitation: {{type: sine, input: {at}, "
    case += "amplitude: 1, frequency: 9}}, sensors: [a3, J1A.z]}}"
    places = ("s", "J2.y", "J1B.rz", "u63")
    cases = ", ".join(case.format(i=i, at=at) for i, at in enumerate(places))
    study = read_study(study_file(f"{BARE}simulate: [{cases}]\n"))
    model, n = study.model, 63
    # Twelve motions a joint, and B's rz is the last of the first twelve; u63 is a fixed mode.
    expected = [model.inputs["s"], model.rows["J2.y"], np.eye(n)[11], np.eye(n)[62]]
    for found, row in zip(study.simulate, expected, strict=True):
        assert_allclose(found.inputs, [row])
        assert_allclose(found.sensors["J1A.z"], np.eye(n)[2])


def test_damping_by_mode_goes_on_with_the_last(study_file):
    text = COARSE.replace("zeta: 1e-3", "zeta: [1e-3, 5e-3, 2e-3]")
    zeta, coupled = ratios(read_study(study_file(text)).structure)
    assert_allclose(zeta[:4], [1e-3, 5e-3, 2e-3, 2e-3], rtol=1e-6)
    assert_allclose(zeta[3:], 2e-3, rtol=1e-6)
    assert coupled < 1e-9


SINE = "excitation: {type: sine, input: t, amplitude: 1, frequency: 9}"
BAD = {
    "builder": ("brake_reuss_beam", "brake_reus_beam", 3, ["did you mean 'brake_reuss_beam'"]),
    "option": ("modes: 3", "mode: 3", 6, ["model.options.mode: unknown key", "'modes'"]),
    "size": ("size: 40", "size: -40", 5, ["options.size", "'-40'", "greater than 0"]),
    "size too fine": ("size: 40", "size: 1", 5, ["options.size", "choose a larger element size"]),
    "modes": ("modes: 3", "modes: 0", 6, ["options.modes", "'0'"]),
    "modes too many": ("modes: 3", "modes: 99999", 6, ["options.modes", "from 1 to"]),
    "spring on no row": ("J1.y: 1e5", "J6.y: 1e5", 7, ["springs.J6.y", "no row 'J6.y'", "J1.x"]),
    "spring below 0": ("J1.y: 1e5", "J1.y: -1", 7, ["springs.J1.y", "'-1'"]),
    "spring with unit": ("J1.y: 1e5", "J1.y: 5 N", 7, ["springs.J1.y", "'5 N'", "without unit"]),
    "zeta": ("zeta: 1e-3", "zeta: [1e-3, -1]", 8, ["options.zeta[1]", "'-1'"]),
    "too many zeta": ("zeta: 1e-3", f"zeta: [{'0.1,' * 99}]", 2, ["model", "zeta", "elastic"]),
    "joint on no row": ("row: J1.x", "row: J1", 10, ["joints[0].row", "no row 'J1'", "J1.x"]),
    "input": (
        "{F_S: 2, K_T: 3e5}}\n",
        f"{{F_S: 2, K_T: 3e5}}}}\nsimulate: {{name: a, dt: 1, samples: 3, {SINE}}}\n",
        11,
        ["simulate.excitation.input", "no input 't'"],
    ),
    "sensor": (
        "{F_S: 2, K_T: 3e5}}\n",
        "{F_S: 2, K_T: 3e5}}\nnoise: {a13: 1}\n",
        11,
        ["noise.a13", "no sensor or input 'a13'", "lateral"],
    ),
}


@pytest.mark.parametrize(("old", "new", "line", "words"), BAD.values(), ids=BAD)
def test_a_fault_has_one_line(study_file, old, new, line, words):
    assert COARSE.count(old) == 1
    path = study_file(COARSE.replace(old, new))
    with pytest.raises(InputError) as caught:
        read_study(path)
    message = str(caught.value)
    assert message.startswith(f"{path}:{line}: ")
    assert "\n" not in message
    for word in words:
        assert word in message


def test_a_missing_library_is_told_in_one_line(study_file, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "skfem", None)
    path = study_file(BARE)
    result = CliRunner().invoke(app, ["qsma", str(path), "--out", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert result.stderr.startswith(f"{path}:3: model.builder: ")
    assert "pip install 'iwanjax[fem]'" in result.stderr
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_the_shipped_brake_reuss_beam_is_the_thesis_s():
    study = shipped("brake_reuss")
    for label, joint in brake_reuss_joints().items():
        own = study.structure.joints[label.removesuffix(".x")]
        for name in ("F_S", "K_T", "chi", "beta"):
            assert_allclose(getattr(own, name), getattr(joint, name), rtol=1e-5)
    ends = np.log10(study.qsma.levels[:, [0, -1]])
    assert_allclose(ends, [[1.25, 3.30], [1.15, 3.85], [1.10, 3.40]], atol=1e-4)
    expected = brake_reuss_beam().model(brake_reuss_springs("y")).structure
    assert_allclose(study.model.structure.K, expected.K)


@pytest.mark.long
def test_the_shipped_modes_are_the_first_bending_modes_by_shape():
    """In the plane of x and y nothing moves along z, and bending modes come in their order."""
    study = shipped("brake_reuss")
    omega, Phi = map(np.asarray, study.structure.modes())
    bar = np.stack([study.model.sensors[f"a{i}"] for i in range(1, 13)]) @ Phi[:, :12]
    lateral = np.abs(study.model.sensors["lateral"] @ Phi[:, :12])
    bending = np.flatnonzero(lateral < 1e-3 * np.abs(bar).max(axis=0))[:4]
    assert study.qsma.modes == tuple(bending[:3])
    assert_allclose(omega[bending] / (2 * np.pi), [175.06, 589.99, 1196.0, 1651.6], rtol=0.015)
    # First to fourth bending have two to five nodes.
    assert [np.sum(np.diff(np.sign(bar[:, r])) != 0) for r in bending] == [2, 3, 4, 5]
    (case,) = study.simulate
    assert case.settings.excitation.mode == bending[0]
    zeta, _ = ratios(study.structure)
    assert_allclose(zeta[bending], [5.37e-4, 2.99e-4, 4.46e-4, 4.70e-4], rtol=1e-6)
    assert_allclose(np.delete(zeta, bending), 4.5e-4, rtol=1e-6)
    assert_allclose(study.qsma.damping, zeta[bending[:3]], rtol=1e-6)


def test_the_shipped_sumali_beam_is_the_thesis_s():
    study = shipped("sumali")
    for label, joint in sumali_joints().items():
        own = study.structure.joints[label.removesuffix(".x")]
        for name in ("F_S", "K_T", "chi", "beta"):
            assert_allclose(getattr(own, name), getattr(joint, name))
    assert study.qsma.modes == (0, 1, 2)
    low = study.structure.modes().omega[:3]
    assert_allclose(low, [759.3, 1345, 3185], rtol=5e-3)
    first, second = study.simulate
    assert_allclose(first.settings.excitation.circular, low[2], rtol=1e-4)
    assert_allclose(first.inputs, [study.model.inputs["left"]])
    # The outer bolt moves in z with both strips.
    (row,) = np.asarray(second.inputs)
    assert list(np.flatnonzero(row)) == [study.model.coordinates.index("J1A.z")]
    expected = sumali_beam().model(sumali_springs()).structure
    assert_allclose(study.model.structure.K, expected.K)
