"""What matrices say about supports, mass and units, and the models they become."""

import itertools

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

import iwanjax as ij
from iwanjax.errors import InputError
from iwanjax.structures.exchange import (
    ImportedMatrices,
    NodeMap,
    check_matrices,
    read_matrices,
    to_model,
)
from iwanjax.structures.exchange.spectrum import definiteness, lowest_eigenvalues


def chain(n, *, ground, m=0.5, k=2e8, kind=np.asarray):
    """Masses in a row along x, the first one grounded or free."""
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[-1, -1] = 1.0
    K[0, 0] = 2.0 if ground else 1.0
    nodes = NodeMap(range(1, n + 1), ["ux"] * n)
    return ImportedMatrices(M=kind(m * np.eye(n)), K=kind(k * K), nodes=nodes)


def lattice(shape, *, m=0.01, k=1e6, left_out=()):
    """Point masses on a grid in space, springs to all neighbours within a cell's diagonal."""
    points = np.array(list(itertools.product(*map(range, shape))), dtype=float)
    rows = []
    for i, j in itertools.combinations(range(len(points)), 2):
        arm = points[j] - points[i]
        if np.max(np.abs(arm)) <= 1 and i not in left_out and j not in left_out:
            row = np.zeros(3 * len(points))
            row[3 * i : 3 * i + 3], row[3 * j : 3 * j + 3] = -arm, arm
            rows.append(row / np.linalg.norm(arm))
    B = sp.csr_array(np.array(rows))
    nodes = NodeMap(np.repeat(np.arange(1, len(points) + 1), 3), ["ux", "uy", "uz"] * len(points))
    M = sp.csr_array(m * sp.eye_array(3 * len(points)))
    return ImportedMatrices(M=M, K=sp.csr_array(k * (B.T @ B)), nodes=nodes)


def without(matrices, rows):
    """The structure with some DOFs held."""
    kept = np.setdiff1d(np.arange(matrices.size), rows)
    labels = matrices.nodes.labels()
    return ImportedMatrices(
        M=matrices.M[kept][:, kept],
        K=matrices.K[kept][:, kept],
        nodes=NodeMap.of([labels[i] for i in kept]),
    )


@pytest.mark.parametrize("ground", [True, False])
@pytest.mark.parametrize(("n", "kind"), [(12, np.asarray), (12, sp.csr_array), (900, sp.csr_array)])
def test_frequencies_of_a_chain(n, kind, ground):
    report = check_matrices(chain(n, ground=ground, kind=kind), modes=4)
    r = np.arange(1, 5)
    angle = (2 * r - 1) * np.pi / (2 * (2 * n + 1)) if ground else r * np.pi / (2 * n)
    expected = np.sqrt(2e8 / 0.5) * 2 * np.sin(angle) / (2 * np.pi)
    np.testing.assert_allclose(report.frequency, expected, rtol=1e-6)
    assert report.rigid_bodies == (0 if ground else 1)
    assert report.total_mass == pytest.approx({"ux": 0.5 * n})
    assert not report.warnings
    text = "supported" if ground else "1 rigid-body mode(s): the structure is free"
    assert text in str(report)


# 81 DOFs are solved dense, 540 sparse.
@pytest.mark.parametrize("shape", [(3, 3, 3), (4, 5, 9)])
def test_a_free_body_in_space_has_six_rigid_body_modes(shape):
    body = lattice(shape)
    report = check_matrices(body, modes=5)
    values = scipy.linalg.eigh(body.K.toarray(), body.M.toarray(), eigvals_only=True)
    np.testing.assert_allclose(report.frequency, np.sqrt(values[6:11]) / (2 * np.pi), rtol=1e-6)
    assert report.rigid_bodies == 6
    assert "6 rigid-body mode(s): the structure is free." in report.sentences
    assert not report.warnings


@pytest.mark.parametrize("shape", [(3, 3, 3), (4, 5, 9)])
def test_supports_and_mechanisms_are_told(shape):
    body = lattice(shape)
    clamped = check_matrices(without(body, range(9)))  # three nodes on a line still turn about it
    assert clamped.rigid_bodies == 1
    assert "1 rigid-body mode(s) where a free structure has 6" in clamped.warnings[-1]
    assert "partly supported" in clamped.warnings[-1]
    off_the_line = 3 * shape[1] * shape[2]
    held = check_matrices(without(body, [*range(9), off_the_line + 1]))
    assert held.rigid_bodies == 0
    # A mass on one spring alone: two of its directions have no stiffness but mass.
    K = sp.block_diag([body.K, np.diag([1e6, 0.0, 0.0])], format="csr")
    M = sp.block_diag([body.M, 0.01 * np.eye(3)], format="csr")
    labels = [*body.nodes.labels(), (9999, "ux"), (9999, "uy"), (9999, "uz")]
    loose = check_matrices(ImportedMatrices(M=M, K=K, nodes=NodeMap.of(labels)))
    assert loose.rigid_bodies == 8
    assert "2 mechanism(s)" in loose.warnings[-1]


def test_masses_that_nothing_holds():
    report = check_matrices(ImportedMatrices(M=np.diag([1.0, 2.0]), K=np.zeros((2, 2))))
    assert report.rigid_bodies == 2
    assert report.frequency.shape == (0,)


def test_matrices_of_few_digits_still_show_six_rigid_body_modes():
    body = lattice((4, 5, 9))
    K = body.K.copy()
    K.data = np.array([float(f"{value:.7e}") for value in K.data])
    report = check_matrices(ImportedMatrices(M=body.M, K=K, nodes=body.nodes))
    assert report.rigid_bodies == 6
    exact = check_matrices(body).frequency
    np.testing.assert_allclose(report.frequency, exact, rtol=1e-4)


def test_a_soft_suspension_is_no_free_body():
    body = lattice((3, 3, 3))
    soft = 30.0 * sp.eye_array(body.size)
    report = check_matrices(ImportedMatrices(M=body.M, K=body.K + soft, nodes=body.nodes))
    assert report.rigid_bodies == 0
    assert np.sqrt(30.0 / 0.01) / (2 * np.pi) == pytest.approx(report.frequency[0], rel=1e-6)
    assert "soft suspension" in report.warnings[0]


@pytest.mark.parametrize("penalty", [1e4, 1e7, 1e9])
def test_a_penalty_spring_makes_nothing_rigid(penalty):
    K = 1e4 * np.array([[2.0, -1.0, 0.0], [-1.0, 1.0 + penalty, -penalty], [0, -penalty, penalty]])
    report = check_matrices(ImportedMatrices(M=np.eye(3), K=K))
    assert report.rigid_bodies == 0
    # The penalty makes one mass of 2 and 3.
    rigid = scipy.linalg.eigh([[2e4, -1e4], [-1e4, 1e4]], np.diag([1.0, 2.0]), eigvals_only=True)
    expected = np.sqrt(rigid) / (2 * np.pi)
    np.testing.assert_allclose(report.frequency[:2], expected, rtol=max(1e-6, 1 / penalty))


def test_dofs_without_mass_are_named_and_do_not_disturb():
    whole = chain(6, ground=True)
    M = np.array(whole.M)
    M[2, 2] = 0.0
    report = check_matrices(ImportedMatrices(M=M, K=whole.K, nodes=whole.nodes))
    assert report.massless == ("node 3 ux",)
    assert "1 of 6 DOFs have no mass: node 3 ux" in report.warnings[0]
    kept = [0, 1, 3, 4, 5]
    column = whole.K[kept, 2]
    condensed = whole.K[np.ix_(kept, kept)] - np.outer(column, column) / whole.K[2, 2]
    values = scipy.linalg.eigh(condensed, M[np.ix_(kept, kept)], eigvals_only=True)
    np.testing.assert_allclose(report.frequency, np.sqrt(values) / (2 * np.pi), rtol=1e-6)
    with pytest.raises(InputError, match="1 DOFs have no mass: node 3 ux; condense"):
        to_model(ImportedMatrices(M=M, K=whole.K, nodes=whole.nodes))


def test_rows_of_nothing_are_passed_over():
    whole = chain(6, ground=True)
    M, K = np.zeros((8, 8)), np.zeros((8, 8))
    M[:6, :6], K[:6, :6] = whole.M, whole.K
    nodes = NodeMap(range(1, 9), ["ux"] * 8)
    report = check_matrices(ImportedMatrices(M=M, K=K, nodes=nodes))
    np.testing.assert_allclose(report.frequency, check_matrices(whole).frequency, rtol=1e-12)
    assert "neither mass nor stiffness" in report.warnings[1]
    assert "node 7 ux, node 8 ux" in report.warnings[1]


@pytest.mark.parametrize("n", [6, 500])
def test_indefinite_matrices_are_told(n):
    whole = chain(n, ground=True, kind=sp.csr_array)
    K = sp.csr_array(whole.K - sp.diags_array(np.r_[np.zeros(n - 2), 2e8, 2e8]))
    report = check_matrices(ImportedMatrices(M=whole.M, K=K))
    negative = int(np.sum(np.linalg.eigvalsh(K.toarray()) < 0))
    assert negative > 0
    assert f"{negative} eigenvalue(s) of (K, M) are negative" in report.warnings[-1]
    assert report.rigid_bodies is None
    for M, words in (
        (whole.M + 0.4 * (sp.eye_array(n, k=1) + sp.eye_array(n, k=-1)), "negative mass"),
        (whole.M - sp.diags_array(np.r_[np.zeros(n - 1), 1.0]), f"at row {n - 1}"),
    ):
        (warning,) = check_matrices(ImportedMatrices(M=M, K=whole.K)).warnings
        assert "M is not positive definite" in warning
        assert words in warning
    nothing = check_matrices(ImportedMatrices(M=0 * whole.M, K=whole.K))
    assert "density" in nothing.warnings[-1]


def test_a_mass_of_lower_rank_is_told():
    whole = chain(3, ground=True)
    M = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    report = check_matrices(ImportedMatrices(M=M, K=whole.K))
    assert "M is singular beyond DOFs without mass" in report.warnings[0]
    inverse = scipy.linalg.eigh(M, whole.K, eigvals_only=True)[1:][::-1]
    np.testing.assert_allclose(report.frequency, 1 / np.sqrt(inverse) / (2 * np.pi), rtol=1e-9)


def test_a_beam_that_bends_in_a_plane_has_two_rigid_body_modes():
    # Euler-Bernoulli element of length 1, E I = 1e3 and consistent mass of 0.42.
    K = 1e3 * np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4.0]])
    M = 1e-3 * np.array(
        [[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]
    )
    nodes = NodeMap([1, 1, 2, 2], ["uy", "rz"] * 2)
    report = check_matrices(ImportedMatrices(M=M, K=K, nodes=nodes))
    assert report.rigid_bodies == 2
    assert report.total_mass == pytest.approx({"uy": 0.42})
    assert not report.warnings
    # The element's own free-free eigenvalues are 720 and 8400 E I / (m L^3).
    expected = np.sqrt(np.array([720.0, 8400.0]) * 1e3 / 0.42) / (2 * np.pi)
    np.testing.assert_allclose(report.frequency, expected, rtol=1e-9)


@pytest.mark.parametrize("n", [6, 500])
def test_definiteness(n):
    A = sp.csr_array(sp.eye_array(n) - 0.4 * sp.eye_array(n, k=1) - 0.4 * sp.eye_array(n, k=-1))
    assert definiteness(A) == "definite"
    ones = sp.block_diag([sp.eye_array(n - 2), np.ones((2, 2))], format="csr")
    assert definiteness(ones) == "singular"
    assert definiteness(A - 0.9 * sp.eye_array(n)) == "indefinite"
    # Units of translations and rotations may lie far apart.
    scale = sp.diags_array(np.where(np.arange(n) % 2, 1e-9, 1.0))
    assert definiteness(scale @ A @ scale) == "definite"


def test_a_motion_without_mass_and_stiffness_has_no_frequency():
    K = np.array([[1.0, 0, 0], [0, 1, -1], [0, -1, 1]])
    with pytest.raises(InputError, match="neither mass nor stiffness"):
        lowest_eigenvalues(K, np.diag([1.0, 0.0, 0.0]), 1)


MIX_UPS = {
    "N/mm with kg": (1e-3, 1.0, "K in N/mm with M in kg"),
    "N/m with tonne": (1.0, 1e-3, "K in N/m with M in tonne"),
    "N/mm with g": (1e-3, 1e3, "K in N/mm with M in g"),
    "kg/m^3 with mm": (1e-3, 1e9, "density in kg/m^3 with lengths in mm"),
    "lbf/in with lb": (1 / 175.126835, 1 / 0.45359237, "K in lbf/in with M in lb"),
}


@pytest.mark.parametrize(("k", "m", "words"), MIX_UPS.values(), ids=MIX_UPS)
def test_mixed_units_are_recognised_by_the_frequency_that_was_expected(k, m, words):
    # In SI, 2 kg on 8e5 N/m: 100.66 Hz; k and m are the sizes of N/m and kg in the other units.
    true = np.sqrt(8e5 / 2.0) / (2 * np.pi)
    mixed = ImportedMatrices(M=[[2.0 * m]], K=[[8e5 * k]])
    report = check_matrices(mixed, expected=1.1 * true)
    (warning,) = report.warnings
    assert words in warning
    assert f"{true:.4g} Hz" in warning
    assert words in str(check_matrices(mixed))  # said even where nothing is expected


def test_units_that_go_together_give_no_warning():
    for m, k in ((2.0, 8e5), (2e-3, 8e2)):
        report = check_matrices(ImportedMatrices(M=[[m]], K=[[k]]), expected=100.0)
        assert not report.warnings
    odd = check_matrices(ImportedMatrices(M=[[2.0]], K=[[8e5]]), expected=1300.0)
    assert "none of the usual mix-ups" in odd.warnings[0]
    slow = check_matrices(ImportedMatrices(M=[[2.0]], K=[[8.0]]))
    assert "0.3183 Hz, is unusual" in slow.warnings[0]


def test_total_mass_is_read_in_kg_or_tonnes():
    assert "3 kg in N, m, kg, s (the likelier" in str(check_matrices(chain(6, ground=True)))
    light = chain(6, ground=True, m=5e-4, k=2e5)
    assert "3 kg in N, mm, tonne, s (the likelier" in str(check_matrices(light))
    uneven = without(lattice((3, 3, 3)), [0, 3])
    assert "not the same in all directions: ux 0.25, uy 0.27" in check_matrices(uneven).warnings[0]


def test_wrong_arguments():
    whole = chain(3, ground=True)
    for wrong in ({"modes": 0}, {"expected": 0.0}, {"expected": np.nan}):
        with pytest.raises(InputError, match="expected positive"):
            check_matrices(whole, **wrong)


def test_the_three_masses_from_files_have_their_published_frequencies(tmp_path):
    # Thesis Sec. 2.3.1: m = 10, k = 9; omega_0 = 0.424470, 1.215684, 1.744115 with the joint.
    K = 9.0 * np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    np.savez(tmp_path / "m.npz", M=10 * np.eye(3), K=K, nodes=[1, 2, 3], dofs=["ux"] * 3)
    model = to_model(
        read_matrices(tmp_path / "m.npz"),
        rows={"J1": ((3, "ux"), (2, "ux"))},
        sensors={"tip": (3, "ux")},
        inputs={"push": [0.0, 1.0, 0.0]},
    )
    np.testing.assert_array_equal(model.rows["J1"], [0, -1, 1])
    np.testing.assert_array_equal(model.sensors["tip"], [0, 0, 1])
    np.testing.assert_array_equal(model.inputs["push"], [0, 1, 0])
    joint = ij.Iwan4(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0)
    omega, _ = ij.JointedStructure(model.structure, {"J1": (model.rows["J1"], joint)}).modes()
    np.testing.assert_allclose(omega, [0.424470, 1.215684, 1.744115], rtol=1e-6)


def test_a_reduced_model_of_an_independent_computation(reference_data):
    found = read_matrices(reference_data / "reference" / "brb_reduced.npz")
    assert found.C is None
    reference = np.load(reference_data / "reference" / "brb_reduced.npz")
    B, omega = reference["B"], reference["w"]
    # The stiffness of the joints that the file's frequencies were computed with.
    Phi = reference["Phi"]
    stuck = found.M @ Phi @ np.diag(omega**2) @ Phi.T @ found.M
    report = check_matrices(ImportedMatrices(M=found.M, K=stuck), modes=4, expected=170.0)
    np.testing.assert_allclose(report.frequency, omega[:4] / (2 * np.pi), rtol=1e-6)
    assert report.rigid_bodies == 0
    assert not report.warnings
    model = to_model(found, rows={f"J{i}": row for i, row in enumerate(B, 1)})
    assert len(model.rows) == len(B)


def test_places_that_are_not_there_and_matrices_too_large():
    whole = chain(3, ground=True)
    with pytest.raises(InputError, match="'J1': node 7 is not among"):
        to_model(whole, rows={"J1": ((1, "ux"), (7, "ux"))})
    with pytest.raises(InputError, match=r"row 'J1' has shape \(2,\); expected \(3,\)"):
        to_model(whole, rows={"J1": [1.0, 0.0]})
    large = sp.csr_array(sp.eye_array(3000))
    with pytest.raises(InputError, match=r"3000 rows.*reduce them first"):
        to_model(ImportedMatrices(M=large, K=large))
