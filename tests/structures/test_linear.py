"""Linear structures: modes, rigid bodies, damping, and what they refuse."""

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

import iwanjax as ij
from iwanjax.structures import null_space_transform


def chain(n: int, *, ground: bool) -> tuple[np.ndarray, np.ndarray]:
    """Unit masses in a row on unit springs, the first one grounded or free."""
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[-1, -1] = 1.0
    K[0, 0] = 2.0 if ground else 1.0
    return np.eye(n), K


def test_modes_of_a_chain_are_sines():
    n = 12
    M, K = chain(n, ground=True)
    omega, Phi = ij.LinearStructure(M, None, K).modes()
    r = np.arange(1, n + 1)
    expected = 2 * np.sin((2 * r - 1) * np.pi / (2 * (2 * n + 1)))
    np.testing.assert_allclose(omega, expected, rtol=1e-12)
    np.testing.assert_allclose(Phi.T @ M @ Phi, np.eye(n), atol=1e-12)
    largest = np.take_along_axis(np.asarray(Phi), np.argmax(np.abs(Phi), axis=0)[None], 0)
    assert np.all(largest > 0)


def test_free_chain_has_one_rigid_body_mode_and_elastic_cosines():
    n = 9
    structure = ij.LinearStructure(*_with_none(chain(n, ground=False)))
    rigid = np.asarray(structure.rigid_body_modes())
    np.testing.assert_allclose(np.abs(rigid), 1 / np.sqrt(n) * np.ones((n, 1)), atol=1e-10)
    omega, Phi = structure.modes()
    np.testing.assert_allclose(omega, 2 * np.sin(np.arange(1, n) * np.pi / (2 * n)), rtol=1e-12)
    np.testing.assert_allclose(np.asarray(Phi).T @ rigid, 0.0, atol=1e-12)


def test_a_plane_free_frame_has_three_rigid_body_modes():
    # Three unit masses at the corners of a triangle, joined by springs: u = (x, y) each.
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.3, 0.8]])
    K = np.zeros((6, 6))
    for i, j in ((0, 1), (1, 2), (2, 0)):
        e = (corners[j] - corners[i]) / np.linalg.norm(corners[j] - corners[i])
        row = np.zeros(6)
        row[2 * i : 2 * i + 2], row[2 * j : 2 * j + 2] = -e, e
        K += 1e6 * np.outer(row, row)
    structure = ij.LinearStructure(np.eye(6), None, K)
    assert structure.rigid_body_modes().shape == (6, 3)
    assert structure.modes().omega.shape == (3,)


def test_null_space_transform_removes_momentum():
    M, K = chain(7, ground=False)
    rigid = np.ones((7, 1)) / np.sqrt(7)
    L = null_space_transform(M, rigid)
    assert L.shape == (7, 6)
    np.testing.assert_allclose(rigid.T @ M @ L, 0.0, atol=1e-14)
    reduced = np.sqrt(scipy.linalg.eigh(L.T @ K @ L, L.T @ M @ L, eigvals_only=True))
    np.testing.assert_allclose(ij.LinearStructure(M, None, K).modes().omega, reduced, rtol=1e-12)


def test_damping_matrix_gives_the_ratios_back():
    structure = ij.three_mass().linearised("low")
    omega, Phi = structure.modes()
    ratios = np.array([1e-4, 5e-3, 2e-2])
    modal = Phi.T @ structure.damping_matrix(ratios) @ Phi
    np.testing.assert_allclose(modal, np.diag(2 * ratios * np.asarray(omega)), atol=1e-15)
    np.testing.assert_allclose(
        structure.damping_matrix(1e-4), structure.damping_matrix([1e-4] * 3), rtol=1e-15
    )
    first = Phi.T @ structure.damping_matrix([1e-4]) @ Phi
    assert float(jnp.abs(first[1:, 1:]).max()) < 1e-15


def _with_none(pair):
    return pair[0], None, pair[1]


EYE = np.eye(3)
K3 = np.diag([1.0, 2.0, 3.0])


def _broken(matrix: np.ndarray, index: tuple[int, int], value: float) -> np.ndarray:
    out = matrix.copy()
    out[index] = value
    return out


BAD_MATRICES = {
    "not square": ((np.ones((3, 2)), None, K3), r"M has shape \(3, 2\); expected a square"),
    "vector": ((np.ones(3), None, K3), r"M has shape \(3,\)"),
    "empty": ((np.zeros((0, 0)), None, K3), r"M has shape \(0, 0\)"),
    "ragged": (([[1.0], [1.0, 2.0]], None, K3), "M: .*rectangular"),
    "words": (([["a"]], None, [[1.0]]), "M is of type .*expected real numbers"),
    "complex": ((EYE, None, K3 * (1 + 0.01j)), "K is complex"),
    "NaN": ((EYE, None, _broken(K3, (1, 1), np.nan)), r"K holds 1 NaN.*index \(1, 1\)"),
    "infinite": ((_broken(EYE, (2, 2), np.inf), None, K3), "M holds 1 NaN or infinite"),
    "asymmetric mass": ((_broken(EYE, (0, 1), 0.5), None, K3), r"M is not symmetric: M\[0, 1\]"),
    "asymmetric stiffness": ((EYE, None, _broken(K3, (0, 2), 1.0)), "K is not symmetric.*triangle"),
    "asymmetric damping": ((EYE, _broken(EYE, (0, 2), 1.0), K3), "C is not symmetric"),
    "stiffness of another size": (
        (EYE, None, np.eye(4)),
        r"K has shape \(4, 4\); expected \(3, 3\)",
    ),
    "damping of another size": ((EYE, np.eye(2), K3), r"C has shape \(2, 2\)"),
    "massless coordinate": ((np.diag([1.0, 0.0, 1.0]), None, K3), "M is not positive def.*DOF 1"),
    "negative mass": ((np.diag([1.0, 1.0, -1.0]), None, K3), "M is not positive definite.*DOF 2"),
}


@pytest.mark.parametrize("case", BAD_MATRICES)
def test_bad_matrices_get_one_clear_line(case):
    matrices, message = BAD_MATRICES[case]
    with pytest.raises(ij.InputError, match=message) as caught:
        ij.LinearStructure(*matrices)
    assert "\n" not in str(caught.value)


def test_a_sparse_matrix_is_refused_by_name():
    scipy_sparse = pytest.importorskip("scipy.sparse")
    with pytest.raises(ij.InputError, match="K is a sparse matrix"):
        ij.LinearStructure(EYE, None, scipy_sparse.eye(3))


def test_an_unstable_structure_is_refused():
    with pytest.raises(ij.InputError, match="K is not positive semidefinite: smallest"):
        ij.LinearStructure(EYE, None, np.diag([1.0, -1.0, 2.0])).modes()


@pytest.mark.parametrize(
    ("zeta", "message"),
    [(-0.1, "negative"), ([0.1] * 4, "up to 3"), ([[0.1]], "shape"), ("x", "real numbers")],
)
def test_bad_damping_ratios(zeta, message):
    with pytest.raises(ij.InputError, match=message):
        ij.LinearStructure(EYE, None, K3).damping_matrix(zeta)
