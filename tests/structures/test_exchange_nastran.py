"""Nastran matrices, by pyyeti and by bytes written after the OUTPUT2 layout."""

import sys

import numpy as np
import pytest
import scipy.sparse as sp
from exchange_samples import DOFS, C, K, M, check, op2

from iwanjax.errors import InputError
from iwanjax.structures.exchange import NodeMap, read_matrices

NODES = NodeMap.of(DOFS)


@pytest.fixture(scope="module")
def op4():
    return pytest.importorskip("pyyeti.nastran.op4", reason="pyyeti reads Nastran files")


@pytest.fixture(scope="module", autouse=True)
def _pyyeti(op4):
    """All of these tests need it."""


@pytest.mark.parametrize("layout", ["dense", "bigmat", "nonbigmat"])
@pytest.mark.parametrize("binary", [True, False])
def test_op4(tmp_path, op4, binary, layout):
    path = tmp_path / "job.op4"
    op4.write(str(path), {"KAA": K, "MAA": M, "BAA": C}, binary=binary, sparse=layout)
    found = read_matrices(path, nodes=NODES)
    check(found, damping=True)
    assert sp.issparse(found.K) == (layout != "dense")


# Columns, rows, form, type, name and format; then column, first row, numbers and the numbers;
# after the last column one more with a 1.
OP4_TEXT = """\
       2       2       6       2KGG     1P,3E23.16
       1       1       2
 5.0000000000000000E+00-4.0000000000000000E+00
       2       1       2
-4.0000000000000000E+00 4.0000000000000000E+00
       3       1       1
 1.0000000000000000E+00
       2       2       6       2MGG     1P,3E23.16
       1       1       1
 1.5000000000000000E+00
       2       2       1
 2.5000000000000000E+00
       3       1       1
 1.0000000000000000E+00
"""


def test_op4_by_hand(tmp_path):
    (tmp_path / "job.op4").write_text(OP4_TEXT)
    found = read_matrices(tmp_path / "job.op4")
    np.testing.assert_array_equal(found.K, [[5, -4], [-4, 4]])
    np.testing.assert_array_equal(found.M, np.diag([1.5, 2.5]))


def test_one_matrix_a_file_and_names(tmp_path, op4):
    op4.write(str(tmp_path / "K.op4"), {"KXX": K, "PHG": np.ones((3, 2))})
    op4.write(str(tmp_path / "M.op4"), {"mass": M})
    check(read_matrices(tmp_path / "K.op4", tmp_path / "M.op4"), dofs=None)
    both = {"KGG": 2 * K, "MGG": 2 * M, "KAA": K, "MAA": M}
    op4.write(str(tmp_path / "both.op4"), both)
    with pytest.raises(InputError, match="KGG with MGG, KAA with MAA; say which"):
        read_matrices(tmp_path / "both.op4")
    check(read_matrices(tmp_path / "both.op4", names={"K": "KAA", "M": "maa"}), dofs=None)
    with pytest.raises(InputError, match=r"no matrix 'KAX' .*did you mean 'KAA'"):
        read_matrices(tmp_path / "both.op4", names={"K": "KAX", "M": "MAA"})


@pytest.mark.parametrize("binary", [True, False])
def test_op4_cut_short(tmp_path, op4, binary):
    path = tmp_path / "job.op4"
    op4.write(str(path), {"KAA": K, "MAA": M}, binary=binary)
    content = path.read_bytes()
    for kept in (0.0, 0.1, 0.45, 0.55, 0.8):
        path.write_bytes(content[: int(kept * len(content))])
        with pytest.raises(InputError) as caught:
            read_matrices(path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)
        assert "cut short" in str(caught.value) or "mass is missing" in str(caught.value)


def test_op2(tmp_path):
    path = tmp_path / "job.op2"
    path.write_bytes(op2({"KAA": K, "MAA": M, "BAA": C}))
    check(read_matrices(path, nodes=NODES), damping=True)


@pytest.mark.parametrize("kept", [0.0, 0.002, 0.2, 0.6, 0.9])
def test_op2_cut_short(tmp_path, kept):
    path = tmp_path / "job.op2"
    content = op2({"KAA": K, "MAA": M})
    path.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(InputError, match=r"job\.op2.*(cut short|missing)"):
        read_matrices(path)


def test_without_pyyeti_the_extra_is_named(tmp_path, monkeypatch):
    (tmp_path / "job.op4").write_text(OP4_TEXT)
    monkeypatch.setitem(sys.modules, "pyyeti.nastran", None)
    with pytest.raises(InputError, match=r"pip install iwanjax\[nastran\]"):
        read_matrices(tmp_path / "job.op4")
