"""The same three masses out of every kind of file, and hand-written samples."""

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from exchange_samples import DOFS, C, K, M, calculix, check, coordinates, put, upper
from matlab73 import put_sparse

from iwanjax.structures.exchange import NodeMap, read_matrices, read_node_map

NODES = np.array([1, 2, 4])
SHARED = {"M": M, "K": K, "C": C, "nodes": NODES}


@pytest.mark.parametrize("dofs", [["ux", "ux", "ux"], [1, 1, 1], ["UX", "T1", "1"]])
@pytest.mark.parametrize("suffix", [".npz", ".mat", ".h5"])
def test_containers(tmp_path, suffix, dofs):
    path = tmp_path / f"job{suffix}"
    arrays = {**SHARED, "dofs": np.array(dofs)}
    if suffix == ".npz":
        np.savez(path, **arrays)
    elif suffix == ".mat":
        cell = np.array(dofs, dtype=object)
        scipy.io.savemat(path, {**arrays, "dofs": cell if isinstance(dofs[0], str) else dofs})
    else:
        with h5py.File(path, "w") as file:
            for name, value in arrays.items():
                file[name] = value.tolist() if value.dtype.kind == "U" else value
    check(read_matrices(path), damping=True)


def test_sparse_matrices_of_matlab_and_scipy(tmp_path):
    scipy.io.savemat(tmp_path / "old.mat", {"M": sp.csc_array(M), "K": sp.csc_array(K)})
    with h5py.File(tmp_path / "new.mat", "w", userblock_size=512) as file:
        put_sparse(file, "M", sp.csc_array(M))
        put_sparse(file, "K", sp.csc_array(K))
    for name in ("old.mat", "new.mat"):
        check(read_matrices(tmp_path / name), dofs=None)
    sp.save_npz(tmp_path / "K.npz", sp.csr_array(K))
    sp.save_npz(tmp_path / "M.npz", sp.csr_array(M))
    check(read_matrices(tmp_path / "K.npz", tmp_path / "M.npz"), dofs=None)


def test_a_sparse_matrix_that_would_not_fit_stays_sparse(tmp_path):
    n = 20_000  # 3.2 GB with its zeros
    big = sp.diags_array(
        [np.full(n - 1, -1.0), np.full(n, 2.0), np.full(n - 1, -1.0)], offsets=[-1, 0, 1]
    )
    scipy.io.savemat(tmp_path / "old.mat", {"K": sp.csc_array(big), "M": sp.csc_array(abs(big))})
    with h5py.File(tmp_path / "new.mat", "w", userblock_size=512) as file:
        put_sparse(file, "K", sp.csc_array(big))
        put_sparse(file, "M", sp.csc_array(abs(big)))
    for name in ("old.mat", "new.mat"):
        found = read_matrices(tmp_path / name)
        assert abs(found.K - big).max() == 0
        assert abs(found.M - abs(big)).max() == 0


def test_joint_rows_called_b_are_no_damping(tmp_path):
    np.savez(tmp_path / "job.npz", M=M, K=K, B=np.ones((1, 3)))
    assert read_matrices(tmp_path / "job.npz").C is None


def test_a_reduced_basis_sees_nodes_through_its_recovery(tmp_path):
    T = np.array([[1.0, 0.0, 0.0], [0.5, 2.0, 0.0], [0.0, 1.0, 3.0], [0.0, 0.0, 1.0]])
    np.savez(tmp_path / "r.npz", M=M, K=K, T=T, nodes=[7, 7, 8, 9], dofs=["ux", "ry", "ux", "ux"])
    found = read_matrices(tmp_path / "r.npz")
    np.testing.assert_array_equal(found.row((7, "ry")), T[1])
    np.testing.assert_array_equal(found.row((8, "ux"), (7, "ux")), T[2] - T[0])


@pytest.mark.parametrize("symmetry", ["symmetric", "general"])
@pytest.mark.parametrize("kind", [sp.coo_array, np.asarray])
def test_matrix_market(tmp_path, kind, symmetry):
    for name, matrix in (("K", K), ("M", M), ("C", C)):
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", kind(matrix), symmetry=symmetry)
    files = [tmp_path / f"{name}.mtx" for name in "KMC"]
    check(read_matrices(*files, nodes=NodeMap(NODES, ["ux"] * 3)), damping=True)


def test_matrix_market_by_hand(tmp_path):
    mass = "%%MatrixMarket matrix array real general\n% columns first\n2 2\n1.5\n0.25\n0.25\n2\n"
    stiffness = "%%MatrixMarket matrix coordinate integer symmetric\n2 2 3\n1 1 5\n2 1 -4\n2 2 4\n"
    table = "node,dof\n12,ux\n12,rotz\n"
    found = read_matrices(
        put(tmp_path / "K.mtx", stiffness),
        put(tmp_path / "M.mtx", mass),
        nodes=put(tmp_path / "map.csv", table),
    )
    np.testing.assert_array_equal(found.K.toarray(), [[5, -4], [-4, 4]])
    np.testing.assert_array_equal(found.M, [[1.5, 0.25], [0.25, 2]])
    assert found.nodes.labels() == [(12, "ux"), (12, "rz")]


def test_calculix(tmp_path):
    found = read_matrices(calculix(tmp_path))
    check(found)
    assert "K holds its upper triangle only" in found.notes[0]
    assert len(found.notes) == 1  # a diagonal mass lacks nothing


def test_a_node_number_that_ends_in_zero_in_a_dof_file(tmp_path):
    # As a decimal number 10.1 and 10.10 would be the same, and node 20 would be node 2.
    found = read_node_map(put(tmp_path / "job.dof", "10.1\n20.3\n1000000.2\n"))
    assert found.labels() == [(10, "ux"), (20, "uz"), (1000000, "uy")]


# ANSYS writes one number a line and, unless told otherwise, a right-hand side.
ANSYS = """\
Stiffness matrix of three masses                                        THREE
            17             4             5             5             3
RSA                        3             3             5             0
(1I14)          (1I14)          (1D25.15)           (1D25.15)
F                          1             0
             1
             3
             5
             6
             1
             2
             2
             3
             3
    0.500000000000000D+03
   -0.300000000000000D+03
    0.700000000000000D+03
   -0.400000000000000D+03
    0.400000000000000D+03
    0.000000000000000D+00
    0.000000000000000D+00
    0.100000000000000D+01
"""
# Fields that touch, of a format with a scale factor.
PACKED = """\
Mass matrix                                                             THREE
             3             1             1             1
RUA                        3             3             3             0
(16I5)          (16I5)          (1P,3E12.4)
    1    2    3    4
    1    2    3
  2.0000E+00  3.0000E+00  4.0000E+00
"""
MAPPING = "    Matrix Eqn      Node      Dof\n             1         1       UX\n"
MAPPING += "             2         2       UX\n             3         4       UX\n"


def test_harwell_boeing_by_hand(tmp_path):
    put(tmp_path / "K.mapping", MAPPING)
    found = read_matrices(put(tmp_path / "K.matrix", ANSYS), put(tmp_path / "M.hb", PACKED))
    check(found)
    assert "K holds its lower triangle only" in found.notes[0]


def test_fields_that_touch(tmp_path):
    touching = PACKED.replace("3E12.4", "3E10.4").replace(
        "  2.0000E+00  3.0000E+00  4.0000E+00", "2.0000E+003.0000E+004.0000E+00"
    )
    files = put(tmp_path / "K.hb", ANSYS), put(tmp_path / "M.hb", touching)
    check(read_matrices(*files), dofs=None)


def test_rows_of_two_files_in_different_order(tmp_path):
    put(tmp_path / "K.mapping", MAPPING)
    order = [2, 0, 1]
    put(tmp_path / "M.mapping", "Matrix Eqn Node Dof\n1 4 UX\n2 1 UX\n3 2 UX\n")
    consistent = M + 0.5 * (np.eye(3, k=1) + np.eye(3, k=-1))
    moved = consistent[np.ix_(order, order)]
    scipy.io.hb_write(tmp_path / "M.rua", sp.csc_array(np.tril(moved)))
    (tmp_path / "M.rua").rename(tmp_path / "M.hb")
    found = read_matrices(put(tmp_path / "K.hb", ANSYS), tmp_path / "M.hb")
    assert found.nodes.labels() == DOFS
    np.testing.assert_allclose(found.M.toarray(), consistent)
    np.testing.assert_allclose(found.K.toarray(), K)


def test_random_matrices_survive_every_text_format(tmp_path):
    rng = np.random.default_rng(5)
    n = 30
    A = sp.random_array((n, n), density=0.1, rng=rng).toarray() - 0.5 * np.eye(n)
    stiffness, mass = A @ A.T, np.diag(rng.uniform(1, 2, n))
    dofs = "".join(f"{i}.{i % 3 + 1}\n" for i in range(1, n + 1))
    calculix(tmp_path, K=stiffness, M=mass, dof=dofs)
    scipy.io.hb_write(tmp_path / "K.hb", sp.csc_array(stiffness))
    scipy.io.hb_write(tmp_path / "M.hb", sp.csc_array(mass))
    put(tmp_path / "j_STIF1.mtx", coordinates(stiffness))
    put(tmp_path / "j_MASS1.mtx", coordinates(mass, keep=upper))
    for found in (
        read_matrices(tmp_path / "job.sti"),
        read_matrices(tmp_path / "K.hb", tmp_path / "M.hb"),
        read_matrices(tmp_path / "j_STIF1.mtx"),
    ):
        largest = np.abs(stiffness).max()
        np.testing.assert_allclose(found.K.toarray(), stiffness, atol=1e-13 * largest)
        np.testing.assert_allclose(found.M.toarray(), mass, rtol=1e-12)
