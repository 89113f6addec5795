"""Files, node maps and matrices that cannot be used, each told in one line."""

import numpy as np
import pytest
import scipy.sparse as sp
from exchange_samples import C, K, M, calculix, coordinates, put, upper
from test_exchange_formats import ANSYS, MAPPING

from iwanjax.errors import InputError
from iwanjax.structures.exchange import ImportedMatrices, NodeMap, read_matrices, read_node_map


def refused(words, call, *args, **kwargs):
    with pytest.raises(InputError) as caught:
        call(*args, **kwargs)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message, message


def test_files_that_are_not_there_or_of_no_known_kind(tmp_path):
    path = tmp_path / "job.sti"
    refused([str(path), "does not exist", ".op4", ".npz"], read_matrices, path)
    refused(["is a folder"], read_matrices, tmp_path)
    text = put(tmp_path / "job.inp", "1 1 5.\n")
    refused([str(text), "'.inp' is unknown", ".mtx", ".mat"], read_matrices, text)
    refused(["no node map's", ".dof"], read_node_map, text)
    refused(["does not exist"], read_node_map, tmp_path / "job.dof")
    calculix(tmp_path)
    refused(["nowhere.mas", "does not exist"], read_matrices, path, tmp_path / "nowhere.mas")
    refused(["job.sti", "holds K", "which is the mass"], read_matrices, path, path)
    (tmp_path / "job.mas").unlink()
    refused(["job.sti", "mass is missing", "mass="], read_matrices, path)


BAD_LINES = {
    "text": ("2 2 x7\n", ["line 3", "'x7' is not a number"]),
    "NaN": ("2 2 nan\n", ["line 3", "NaN"]),
    "cut": ("2 2\n", ["line 3 holds 2 numbers", "expected 3"]),
    "index 0": ("0 2 1.0\n", ["line 3", "row is 0", "from 1"]),
    "beyond": ("4 4 1.0\n", ["row 4", "job.dof has 3 rows"]),
    "doubled": ("6 6 1.0\n", ["row 6", "cyclic symmetry"]),
    "twice": ("3 3 1.0\n", ["entry (3, 3) stands 2 times"]),
}


@pytest.mark.parametrize(("line", "words"), BAD_LINES.values(), ids=BAD_LINES)
def test_bad_lines_of_calculix(tmp_path, line, words):
    path = calculix(tmp_path)
    lines = coordinates(K, keep=upper).splitlines(keepends=True)
    put(path, "".join([*lines[:2], line, *lines[2:]]))
    refused([str(path), *words], read_matrices, path)


def test_a_text_file_cut_short_in_its_last_line_or_after_one(tmp_path):
    path = calculix(tmp_path)
    text = path.read_text()
    put(path, text[:-3])  # a smaller exponent would go unnoticed
    refused([str(path), "line 5, the last, does not end", "cut short"], read_matrices, path)
    put(path, "".join(text.splitlines(keepends=True)[:-1]))
    refused([str(path), "row 3 has no diagonal entry", "cut short"], read_matrices, path)


def test_binary_content_under_a_text_extension(tmp_path):
    path = calculix(tmp_path)
    path.write_bytes(b"\xff\xfe\x00\x01")
    refused([str(path), "no text file"], read_matrices, path)
    put(path, "")
    refused([str(path), "is empty"], read_matrices, path)


BAD_MAPS = {
    "text": ("1.1\nx.1\n4.1\n", ["job.dof", "line 2", "'x.1'"]),
    "no direction": ("1.1\n2\n4.1\n", ["job.dof", "line 2", "node.direction"]),
    "twice": ("1.1\n2.1\n1.1\n", ["job.dof", "node 1 ux", "rows 1 and 3"]),
    "short": ("1.1\n2.1\n", ["row 3", "has 2 rows"]),
    "long": ("1.1\n2.1\n3.1\n4.1\n", ["row 3", "has 4 rows"]),
}


@pytest.mark.parametrize(("dof", "words"), BAD_MAPS.values(), ids=BAD_MAPS)
def test_bad_dof_files(tmp_path, dof, words):
    refused(words, read_matrices, calculix(tmp_path, dof=dof))


BAD_MAPPINGS = {
    "cut": (MAPPING[:-10] + "\n", ["line 4", "equation, node, DOF"]),
    "short": (MAPPING[:-34], ["2 rows", "expected 3"]),
    "missing": (MAPPING.replace("  2   ", "  4   ", 1), ["equation 2 is missing"]),
    "twice": (MAPPING.replace("  2   ", "  1   ", 1), ["line 3", "equation 1 stands there twice"]),
    "empty": ("Matrix Eqn Node Dof\n", ["all equations are missing"]),
}


@pytest.mark.parametrize(("mapping", "words"), BAD_MAPPINGS.values(), ids=BAD_MAPPINGS)
def test_bad_mapping_files(tmp_path, mapping, words):
    put(tmp_path / "K.mapping", mapping)
    path = put(tmp_path / "K.hb", ANSYS)
    refused(["K.", *words], read_matrices, path, path)


def test_bad_tables_of_nodes(tmp_path):
    refused(["line 2", "'7 ux uy'"], read_node_map, put(tmp_path / "a.csv", "1,ux\n7 ux uy\n"))
    refused(["a.csv", "is empty"], read_node_map, put(tmp_path / "a.csv", " \n"))


BAD_HEADERS = {
    "cut header": (ANSYS[:300], ["does not end", "cut short"]),
    "cut pointers": (ANSYS[: ANSYS.index("F   ")] + f"F\n{1:14}\n", ["1 column pointers of 4"]),
    "cut values": (ANSYS[: ANSYS.index("-0.4")], ["3 values of 5", "cut short"]),
    "two lines": ("a\nb\n", ["fewer lines than the four"]),
    "no counts": (ANSYS.replace("17", "xx"), ["lines 2 and 3", "ASCII"]),
    "complex": (ANSYS.replace("RSA", "CSA"), ["type CSA", "RSA or RUA"]),
    "elements": (ANSYS.replace("RSA", "RSE"), ["type RSE", "assembled"]),
    "format": (ANSYS.replace("(1I14)", "(1A14)"), ["(1A14)", "unknown"]),
    "pointers": (ANSYS.replace(f"{6:14}", f"{9:14}"), ["1 to 9", "1 to 6"]),
    "index": (ANSYS.replace(f"{3:14}\n    0.5", f"{7:14}\n    0.5"), ["index is 7", "1 to 3"]),
    "text": (ANSYS.replace("0.7000000", "0.700x000"), ["values", "line 15"]),
    "NaN": (ANSYS.replace("0.700000000000000D+03", "NaN"), ["values", "NaN"]),
}


@pytest.mark.parametrize(("text", "words"), BAD_HEADERS.values(), ids=BAD_HEADERS)
def test_bad_harwell_boeing_files(tmp_path, text, words):
    path = put(tmp_path / "K.hb", text)
    refused([str(path), *words], read_matrices, path, path)


def test_bad_matrix_market_files(tmp_path):
    good = put(tmp_path / "M.mtx", "%%MatrixMarket matrix coordinate real general\n1 1 1\n1 1 2.\n")
    head = "%%MatrixMarket matrix coordinate {} general\n2 2 2\n1 1 5.\n"
    for text, words in (
        (head.format("real"), ["holds 1 entries", "says 2", "cut short"]),
        (head.format("real") + "3 2 1.\n", ["row or column 3", "up to 2"]),
        (head.format("real") + "2 2 x\n", ["line 4", "'x'"]),
        (head.format("real") + "1 1 5.\n", ["entry (1, 1) stands 2 times"]),
        (head.format("real") + "2 2 5", ["line 4", "does not end"]),
        (head.format("complex") + "2 2 1. 0.\n", ["complex entries"]),
        (head.format("pattern") + "2 2\n", ["pattern entries"]),
        (head.replace("general", "hermitian").format("real"), ["is hermitian"]),
        (head.replace("coordinate", "heap").format("real"), ["line 1", "coordinate or array"]),
        (head.replace("2 2 2", "2 3 2").format("real"), ["2 by 3", "square"]),
        (head.format("real") + "2 2 5.\n", ["M has shape (1, 1)", "(2, 2) like K"]),
    ):
        path = put(tmp_path / "K.mtx", text)
        refused([str(path), *words], read_matrices, path, good)


BAD_ARRAYS = {
    "size": ({"M": np.eye(2)}, ["M has shape (2, 2)", "(3, 3) like K"]),
    "not square": ({"K": np.ones((3, 2))}, ["K has shape (3, 2)", "square"]),
    "complex": ({"K": K * (1 + 0.01j)}, ["K is complex"]),
    "text": ({"K": K.astype(str)}, ["K is of type", "real numbers"]),
    "NaN": ({"M": np.diag([1.0, np.nan, 1.0])}, ["M holds 1 NaN", "(1, 1)"]),
    "asymmetric": ({"K": K + np.eye(3, k=2)}, ["K is not symmetric", "node 1 ux", "node 4 ux"]),
    "no K": ({"K": np.ones(3)}, ["a K and an M that belong together is missing", "holds M"]),
    "map length": ({"nodes": [1, 2]}, ["2 node numbers but 3 DOF names"]),
    "map size": ({"nodes": [1, 2], "dofs": [1, 1]}, ["node map has 2 rows", "expected 3 like K"]),
    "map twice": ({"nodes": [1, 2, 1]}, ["node 1 ux stands in rows 1 and 3"]),
    "map fraction": ({"nodes": [1, 2, 2.5]}, ["whole number"]),
    "half a map": ({"dofs": np.array({"a": 1})}, ["nodes and dofs"]),
    "T": ({"T": np.ones((3, 2))}, ["T has shape (3, 2)", "(p, 3)"]),
    "map of T": ({"T": np.ones((4, 3))}, ["node map has 3 rows", "expected 4 like T"]),
}


@pytest.mark.parametrize(("change", "words"), BAD_ARRAYS.values(), ids=BAD_ARRAYS)
def test_bad_arrays(tmp_path, change, words):
    path = tmp_path / "job.npz"
    np.savez(path, **{"M": M, "K": K, "nodes": [1, 2, 4], "dofs": ["ux"] * 3, **change})
    refused([str(path), *words], read_matrices, path)


def test_wrong_options(tmp_path):
    path = tmp_path / "job.npz"
    np.savez(path, M=M, K=K)
    refused(["names", "'D'", "K, M, C, T"], read_matrices, path, names={"D": "K"})
    refused(["node map has 1 rows"], read_matrices, path, nodes=NodeMap([1], ["ux"]))
    np.savez(path, K=K)
    refused(["mass is missing", "holds K", "mass="], read_matrices, path)


@pytest.mark.parametrize("kind", [np.asarray, sp.csr_array, sp.coo_array])
def test_a_triangle_is_completed_and_said(kind):
    found = ImportedMatrices(M=kind(M), K=kind(np.triu(K)), C=kind(np.tril(C)))
    for name, matrix in (("M", M), ("K", K), ("C", C)):
        value = getattr(found, name)
        np.testing.assert_array_equal(value.toarray() if sp.issparse(value) else value, matrix)
    assert [note.split(";")[0] for note in found.notes] == [
        "K holds its upper triangle only",
        "C holds its lower triangle only",
    ]


def test_small_differences_are_round_off_of_the_export():
    off = K.copy()
    off[0, 1] *= 1 + 1e-8
    found = ImportedMatrices(M=M, K=off)
    np.testing.assert_array_equal(found.K, found.K.T)
    off[0, 1] = K[0, 1] * (1 + 1e-6)
    refused(["K is not symmetric", "row 0", "row 1"], ImportedMatrices, M=M, K=off)


def test_nodes_that_are_not_there():
    nodes = NodeMap([10, 10, 10, 250, 999], ["ux", "uy", "rz", "ux", "temp"])
    assert nodes.index(10, 6) == nodes.index(10, "ROTZ") == 2
    assert nodes.index(999, "TEMP") == 4
    np.testing.assert_array_equal(nodes.row((250, "ux"), (10, "ux")), [-1, 0, 0, 1, 0])
    refused(
        ["node 12", "3 nodes (10 to 999)", "nearest numbers are 10, 250"], nodes.index, 12, "ux"
    )
    refused(["node 10 has no 'rx'", "it has ux, uy, rz"], nodes.index, 10, "rx")
    refused(["relative to itself"], nodes.row, (10, "ux"), (10, 1))
    refused(["no node map", "nodes="], ImportedMatrices(M=M, K=K).row, (1, "ux"))
