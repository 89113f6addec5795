from typing import Any

import h5py
import hypothesis.extra.numpy as hnp
import hypothesis.strategies as st
import numpy as np
import pytest
import scipy.io
import scipy.sparse
from hypothesis import given, settings
from matlab73 import put_sparse, write_matlab73

from iwanjax.errors import InputError
from iwanjax.files import Unreadable, existing_file, nearest, read_arrays

ROWS = {".npz": (3,), ".h5": (3,), ".mat": (1, 3)}
MATRIX = np.arange(6.0).reshape(2, 3)


def cell(*rows):
    found = np.empty((len(rows), len(rows[0])), dtype=object)
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            found[i, j] = entry
    return found


STRUCT = {"time": np.array([[0.0, 1.0]]), "acc": MATRIX, "units": "s, m/s^2", "a": {"b": MATRIX}}
HITS = [{"time": np.array([[float(i)]]), "acc": MATRIX + i} for i in range(3)]
MATLAB = {
    "matrix": MATRIX,
    "counts": np.array([[1, -2]], dtype=np.int16),
    "flags": np.array([[True, False]]),
    "complex": MATRIX * (1 + 2j),
    "empty": np.zeros((0, 0)),
    "tall": np.zeros((0, 2)),
    "text": "tip",
    "nothing": "",
    "texts": np.array(["J1", "m1-ground"]),
    "s": STRUCT,
    "c": cell([MATRIX, np.zeros((0, 0))], ["label", STRUCT], [np.ones((1, 1)), cell([MATRIX])]),
    "hits": cell(HITS),
}


def read(path, names=None) -> dict[str, Any]:
    return read_arrays(path, names)


def write(path, arrays):
    if path.suffix == ".npz":
        np.savez(path, **arrays)
    elif path.suffix == ".mat":
        scipy.io.savemat(path, arrays, do_compression=True)
    else:
        with h5py.File(path, "w") as file:
            for name, value in arrays.items():
                file[name] = value.tolist() if value.dtype.kind == "U" else value
    return path


def as_saved(value):
    """What savemat takes for an array of structs: a structured array."""
    if isinstance(value, np.ndarray) and value.dtype == object:
        if not all(isinstance(entry, dict) for entry in value.flat):
            return value
        found = np.empty(value.shape, dtype=[(name, object) for name in value.flat[0]])
        for i, entry in enumerate(value.flat):
            found.flat[i] = tuple(entry.values())
        return found
    return value


def check_same(found, expected):
    if isinstance(expected, dict):
        assert list(found) == list(expected)
        for name, value in expected.items():
            check_same(found[name], value)
    elif isinstance(expected, str):
        assert found.tolist() == ([expected] if expected else [])
        assert found.dtype.kind == "U"
    elif expected.dtype == object:
        assert found.dtype == object
        assert found.shape == expected.shape
        for one, other in zip(found.flat, expected.flat, strict=True):
            check_same(one, other)
    elif expected.dtype.kind == "U":
        assert [text.rstrip() for text in found] == expected.tolist()
    else:
        assert found.shape == expected.shape
        np.testing.assert_array_equal(found, expected)


def test_matlab_of_both_kinds_gives_the_same(tmp_path):
    old = tmp_path / "old.mat"
    scipy.io.savemat(old, {name: as_saved(value) for name, value in MATLAB.items()})
    new = write_matlab73(tmp_path / "new.mat", MATLAB)
    for path in (old, new):
        found = read(path)
        assert sorted(found) == sorted(MATLAB)
        check_same({name: found[name] for name in MATLAB}, MATLAB)


def test_matlab_4(tmp_path):
    path = tmp_path / "old.mat"
    scipy.io.savemat(path, {"x": MATRIX, "label": "tip"}, format="4")
    check_same(read(path), {"x": MATRIX, "label": "tip"})


@pytest.mark.parametrize("matrix", [scipy.sparse.diags_array([1.0, 0.0, 3.0]), np.zeros((2, 4))])
def test_sparse_matrices_come_out_dense(tmp_path, matrix):
    sparse = scipy.sparse.csc_array(matrix)
    scipy.io.savemat(tmp_path / "old.mat", {"K": sparse})
    with h5py.File(write_matlab73(tmp_path / "new.mat", {}), "a") as file:
        put_sparse(file, "K", sparse)
    for name in ("old.mat", "new.mat"):
        np.testing.assert_array_equal(read(tmp_path / name)["K"], sparse.toarray())


def test_a_sparse_matrix_too_large(tmp_path):
    huge = scipy.sparse.csc_array((100_000, 100_000))
    scipy.io.savemat(tmp_path / "old.mat", {"K": huge})
    with h5py.File(write_matlab73(tmp_path / "new.mat", {}), "a") as file:
        put_sparse(file, "K", huge)
    for name in ("old.mat", "new.mat"):
        check_refused(tmp_path / name, ["K is a sparse matrix", "(100000, 100000)"], ["K"])


@settings(max_examples=25)
@given(
    array=hnp.arrays(
        st.sampled_from([np.float64, np.float32, np.int16, np.uint8]),
        hnp.array_shapes(min_dims=2, max_dims=3, min_side=0, max_side=4),
    )
)
def test_numbers_come_back(tmp_path_factory, array):
    folder = tmp_path_factory.mktemp("files")
    paths = [write(folder / f"x{suffix}", {"x": array}) for suffix in ROWS]
    for path in (*paths, write_matlab73(folder / "new.mat", {"x": array})):
        found = read(path, ["x"])["x"]
        np.testing.assert_array_equal(found, array)
        assert found.dtype == array.dtype or not array.size


@pytest.mark.parametrize(("suffix", "shape"), ROWS.items())
def test_vectors_and_text_in_each_format(tmp_path, suffix, shape):
    arrays = {"x": np.arange(3.0), "labels": np.array(["a1", "tip"])}
    found = read(write(tmp_path / f"x{suffix}", arrays))
    assert found["x"].shape == shape
    assert [str(text).rstrip() for text in found["labels"]] == ["a1", "tip"]


@pytest.mark.parametrize("suffix", ROWS)
def test_only_what_is_named(tmp_path, suffix):
    path = write(tmp_path / f"x{suffix}", {"x": MATRIX, "y": MATRIX, "z": MATRIX})
    assert list(read(path, ["z", "x"])) == ["z", "x"]
    check_refused(path, ["'zz' is missing", "expected x, zz", "x, y, z", "'z'?"], ["x", "zz"])


def test_groups_tables_and_scalars_of_hdf5(tmp_path):
    path = tmp_path / "x.h5"
    table = np.array([(0.0, 1.0), (0.5, 2.0)], dtype=[("time", float), ("acc", float)])
    with h5py.File(path, "w") as file:
        file["run/hit/acc"] = MATRIX
        file["table"] = table
        file["scalar"] = 3.0
        file["name"] = "tip"
        file["fixed"] = np.array([b"a", b"bc"])
        file["nothing"] = h5py.Empty("f")
    found = read(path)
    np.testing.assert_array_equal(found["run"]["hit"]["acc"], MATRIX)
    np.testing.assert_array_equal(found["table"]["acc"], [1.0, 2.0])
    assert found["scalar"] == 3.0
    assert found["name"] == "tip"
    assert found["fixed"].tolist() == ["a", "bc"]
    assert found["nothing"].size == 0


def test_hdf5_under_the_name_of_matlab(tmp_path):
    path = write(tmp_path / "x.h5", {"x": MATRIX}).rename(tmp_path / "x.mat")
    np.testing.assert_array_equal(read(path)["x"], MATRIX)


def test_what_cannot_be_read_stands_beside_what_can(tmp_path):
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        group = file.create_group("group")
        group["itself"] = group
        group["nowhere"] = h5py.SoftLink("/missing")
        group["x"] = MATRIX
        file["type"] = np.dtype(float)
        file.create_dataset("reference", data=group.ref, dtype=h5py.ref_dtype)
    found = read(path)
    assert "holds itself" in found["group"]["itself"].reason
    assert "cannot be read" in found["group"]["nowhere"].reason
    np.testing.assert_array_equal(found["group"]["x"], MATRIX)
    assert isinstance(found["reference"], Unreadable)
    check_refused(path, ["type is no array"], ["type"])


@pytest.mark.parametrize("kind", ["function_handle", "string"])
def test_matlab_objects_are_told(tmp_path, kind):
    path = write_matlab73(tmp_path / "x.mat", {"x": MATRIX, "f": MATRIX})
    with h5py.File(path, "a") as file:
        file["f"].attrs["MATLAB_class"] = np.bytes_(kind)
        file.create_group("g").attrs["MATLAB_class"] = np.bytes_("function_handle")
    found = read(path)
    assert isinstance(found["g"], Unreadable)
    np.testing.assert_array_equal(found["x"], MATRIX)
    check_refused(path, ["f is a MATLAB function or object", "plain arrays"], ["f"])


def test_python_objects_are_never_loaded(tmp_path):
    path = write(tmp_path / "x.npz", {"x": MATRIX, "o": cell(["a"])})
    assert isinstance(read(path)["o"], Unreadable)
    check_refused(path, ["o holds pickled", "never loaded"], ["o"])


def test_bytes_and_other_types_of_numpy(tmp_path):
    arrays = {"b": np.array([b"a1"]), "dates": np.array(["2024-01-01"], dtype="M8[D]")}
    found = read(write(tmp_path / "x.npz", arrays))
    assert found["b"].tolist() == ["a1"]
    assert "datetime64" in found["dates"].reason


@pytest.mark.parametrize("kept", [0.0, 0.3, 0.6, 0.9])
@pytest.mark.parametrize("name", ["x.npz", "x.h5", "old.mat", "new.mat"])
def test_a_file_cut_short(tmp_path, name, kept):
    path = tmp_path / name
    noise = {"x": np.random.default_rng(0).normal(size=(50, 50))}
    (write_matlab73 if name == "new.mat" else write)(path, noise)
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    check_refused(path, ["cut short"])


@pytest.mark.parametrize("name", ["x.npz", "x.h5", "old.mat", "new.mat"])
def test_another_kind_of_file(tmp_path, name):
    path = tmp_path / name
    path.write_text("time,acc\n" + "0.0,1.0\n" * 500)
    check_refused(path, ["again"])


def test_a_damaged_member(tmp_path):
    path = write(tmp_path / "x.npz", {"x": MATRIX, "y": np.ones(3)})
    content = path.read_bytes()
    start = content.index(MATRIX.tobytes()) + 8
    path.write_bytes(content[:start] + bytes(8) + content[start + 8 :])
    found = read(path)
    assert "damaged" in found["x"].reason
    np.testing.assert_array_equal(found["y"], np.ones(3))
    check_refused(path, ["x cannot be read", "damaged"], ["x"])


def test_no_such_file(tmp_path):
    check_refused(tmp_path / "x.npz", ["does not exist", ".npz, .mat, .h5 or .hdf5"])
    check_refused(tmp_path, ["is a folder"])
    path = tmp_path / "x.xlsx"
    path.write_text("")
    check_refused(path, ["'.xlsx'", ".npz, .mat, .h5 or .hdf5"])
    with pytest.raises(InputError, match=r"\.csv, \.npz, \.mat"):
        existing_file(path, [".csv"])


def test_the_nearest_name():
    assert nearest("xdata", ["time", "xData"]) == "; did you mean 'xData'?"
    assert nearest("quite different", ["time"]) == ""


def check_refused(path, words, names=None):
    with pytest.raises(InputError) as caught:
        read(path, names)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    for word in words:
        assert word in message
