"""Study files about, and a look into, matrices that other programs wrote."""

import exchange_samples as chain
import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from iwanjax.cli import app
from iwanjax.config import read_study
from iwanjax.errors import InputError

STUDY = """\
name: chain
model:
  matrices:
    stiffness: job.sti
    mass: job.mas
    nodes: job.dof
    rows:
      J1: [4 ux, 2 ux]
      ground: 1 ux
    sensors: {mean: [0.5, 0.5, 0]}
    inputs: {hit: 4 UX}
  joints:
    - {name: bolt, row: J1, type: iwan4, parameters: {F_S: 10, K_T: 50, chi: -0.5, beta: 5}}
simulate:
  name: sine
  dt: 1e-3
  samples: 9
  sensors: [mean, 4 ux]
  excitation: {type: sine, input: 2 ux, amplitude: 1, frequency: 2}
"""
FILES = STUDY[STUDY.index("    stiffness") : STUDY.index("    rows")]


@pytest.fixture
def study_file(tmp_path):
    chain.calculix(tmp_path)

    def write(text):
        path = tmp_path / "study.yaml"
        path.write_text(text)
        return path

    return write


def test_matrices_become_a_structure(study_file):
    study = read_study(study_file(STUDY))
    assert_allclose(study.model.structure.M, chain.M)
    assert_allclose(study.model.structure.K, chain.K)
    assert not np.any(study.model.structure.C)
    rows = {name: list(row) for name, row in study.model.rows.items()}
    assert rows == {"J1": [0, -1, 1], "ground": [1, 0, 0]}
    assert_allclose(study.model.sensors["mean"], [0.5, 0.5, 0])
    assert_allclose(study.model.inputs["hit"], [0, 0, 1])
    # A spring of the joint's K_T between nodes 2 and 4.
    K = chain.K + 50.0 * np.array([[0, 0, 0], [0, 1, -1], [0, -1, 1]])
    expected = np.sqrt(scipy.linalg.eigh(K, chain.M, eigvals_only=True))
    assert_allclose(np.asarray(study.structure.modes().omega), np.sort(expected))


def test_degrees_of_freedom_are_names(study_file):
    (case,) = read_study(study_file(STUDY)).simulate
    assert_allclose(case.inputs, [[0, 1, 0]])
    assert {name: list(row) for name, row in case.sensors.items()} == {
        "mean": [0.5, 0.5, 0],
        "4 ux": [0, 0, 1],
    }


@pytest.mark.parametrize("files", ["stiffness: job.sti", "stiffness: all.npz"])
def test_one_file_may_do(study_file, tmp_path, files):
    nodes, dofs = zip(*chain.DOFS, strict=True)
    np.savez(tmp_path / "all.npz", K=chain.K, M=chain.M, C=chain.C, nodes=nodes, dofs=dofs)
    study = read_study(study_file(STUDY.replace(FILES, f"    {files}\n")))
    assert_allclose(study.model.structure.K, chain.K)
    assert_allclose(study.model.structure.C, chain.C if "all" in files else 0 * chain.C)


def test_names_say_which_matrix_is_which(study_file, tmp_path):
    np.savez(tmp_path / "all.npz", stiff=chain.K, heavy=chain.M)
    files = "    stiffness: all.npz\n    names: {K: stiff, M: heavy}\n    nodes: job.dof\n"
    study = read_study(study_file(STUDY.replace(FILES, files)))
    assert_allclose(study.model.structure.M, chain.M)


@pytest.mark.parametrize("joints", ["", "  joints: []\n"])
def test_matrices_without_joints_are_a_linear_structure(study_file, tmp_path, joints):
    section = STUDY[STUDY.index("  joints") : STUDY.index("simulate")]
    path = study_file(STUDY.replace(section, joints))
    study = read_study(path)
    assert study.structure.labels == ()
    expected = np.sort(scipy.linalg.eigh(chain.K, chain.M, eigvals_only=True))
    assert_allclose(np.asarray(study.structure.modes().omega) ** 2, expected)
    result = CliRunner().invoke(app, ["simulate", str(path), "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    with np.load(tmp_path / "out" / "simulate.npz") as arrays:
        assert arrays["sine_acceleration"].shape == (9, 2)


BAD = {
    "no stiffness": ("    stiffness: job.sti\n", "", 3, ["model.matrices", "stiffness: job.sti"]),
    "unknown key": ("mass:", "masse:", 5, ["matrices.masse: unknown key", "'mass'"]),
    "no such file": ("job.sti", "jobb.sti", 4, ["matrices.stiffness", "jobb.sti: does not exist"]),
    "no such mass": ("job.mas", "a.mas", 5, ["matrices.mass", "a.mas: does not exist"]),
    "no such map": ("job.dof", "a.dof", 6, ["matrices.nodes", "a.dof"]),
    "unknown kind": ("job.sti", "study.yaml", 4, ["matrices.stiffness", ".sti"]),
    "unknown letter": (
        "    rows:\n",
        "    names: {Q: a}\n    rows:\n",
        7,
        ["matrices.names.Q: unknown key", "K, M, C, T"],
    ),
    "no node": ("1 ux", "3 ux", 9, ["rows.ground", "node 3", "nearest numbers are 1, 2, 4"]),
    "no motion": ("1 ux", "1 uy", 9, ["rows.ground", "no 'uy'", "it has ux"]),
    "no place": ("1 ux", "first", 9, ["rows.ground", "for instance 12 ux"]),
    "three": ("[4 ux, 2 ux]", "[4 ux, 2 ux, 1 ux]", 8, ["rows.J1", "[12 ux, 40 ux]"]),
    "itself": ("[4 ux, 2 ux]", "[4 ux, 4 ux]", 8, ["rows.J1", "relative to itself"]),
    "mixed": ("[4 ux, 2 ux]", "[4 ux, 2]", 8, ["rows.J1", "[12 ux, 40 ux]"]),
    "too short": ("[0.5, 0.5, 0]", "[0.5, 0.5]", 10, ["sensors.mean", "2 number(s); expected 3"]),
    "not a number": ("[0.5, 0.5, 0]", "[0.5, x, 0]", 10, ["sensors.mean", "'x'"]),
    "empty": ("[0.5, 0.5, 0]", "[]", 10, ["sensors.mean", "0 number(s)"]),
    "input": ("4 UX", "9 UX", 11, ["inputs.hit", "node 9"]),
    "ground": ("hit: ", "base: ", 11, ["inputs.base", "-M r"]),
    "two sources": ("  matrices:\n", "  file: a.npz\n  matrices:\n", 2, ["file and matrices"]),
    "coordinate": ("input: 2 ux", "input: 2 uy", 19, ["excitation.input", "'2 uy'", "'2 ux'"]),
}


@pytest.mark.parametrize(("old", "new", "line", "words"), BAD.values(), ids=BAD)
def test_a_fault_has_one_line(study_file, old, new, line, words):
    assert STUDY.count(old) == 1
    path = study_file(STUDY.replace(old, new))
    with pytest.raises(InputError) as caught:
        read_study(path)
    message = str(caught.value)
    assert message.startswith(f"{path}:{line}: ")
    assert "\n" not in message
    for word in words:
        assert word in message


def test_massless_nodes_and_large_matrices_are_refused(study_file, tmp_path):
    bare = f"{STUDY[: STUDY.index('    stiffness')]}    stiffness: all.npz\n"
    path = study_file(bare + STUDY[STUDY.index("  joints") :])
    for M, words in (
        (np.diag([2.0, 3.0, 0.0]), "1 DOFs have no mass: row 2"),
        (np.eye(2001), "reduce them first"),
    ):
        np.savez(tmp_path / "all.npz", K=np.eye(len(M)), M=M)
        with pytest.raises(InputError, match=f"study.yaml:3: model.matrices: .*{words}"):
            read_study(path)


def inspected(path):
    return CliRunner().invoke(app, ["inspect", str(path)])


def test_inspect_reports_on_matrices(tmp_path):
    result = inspected(chain.calculix(tmp_path))
    assert (result.exit_code, result.stderr) == (0, "")
    omega = np.sqrt(scipy.linalg.eigh(chain.K, chain.M, eigvals_only=True)[0])
    first = f"The first elastic frequency is {omega / (2 * np.pi):.4g} Hz"
    for words in ("job.sti", "total mass is 9", "the structure is supported", first):
        assert words in result.stdout
    np.savez(tmp_path / "all.npz", K=chain.K, M=chain.M)
    result = inspected(tmp_path / "all.npz")
    for words in ("K     3 x 3 float64", first):
        assert words in result.stdout
    assert "fault" not in result.stdout


def test_inspect_tells_what_is_wrong_with_matrices(tmp_path):
    skew = chain.K + np.triu(np.ones((3, 3)), 1)
    np.savez(tmp_path / "all.npz", K=skew, M=chain.M)
    result = inspected(tmp_path / "all.npz")
    assert result.exit_code == 0
    assert "fault: K is not symmetric" in result.stdout
    result = inspected(chain.put(tmp_path / "cut.sti", "1 1"))
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr.startswith(f"{tmp_path / 'cut.sti'}: ")
    assert result.stderr.count("\n") == 1
