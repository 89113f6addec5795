import h5py
import numpy as np
import pytest
import scipy.io
from matlab73 import write_matlab73
from numpy.testing import assert_allclose

from iwanjax.errors import InputError
from iwanjax.structures.model_file import read_model

ARRAYS = {
    "M": np.diag([1.0, 2.0]),
    "C": 0.01 * np.eye(2),
    "K": np.array([[3.0, -1.0], [-1.0, 1.0]]),
    "row_labels": np.array(["J1", "m1-ground"]),
    "rows": np.array([[-1.0, 1.0], [1.0, 0.0]]),
    "sensor_labels": np.array(["tip"]),
    "sensor_rows": np.array([[0.0, 1.0]]),
    "input_labels": np.array(["m1", "m2"]),
    "input_rows": np.eye(2),
}
CELL = np.array([["J1"], ["m1-ground"]], dtype=object)


def write(path, arrays):
    if path.suffix == ".npz":
        np.savez(path, **arrays)
    elif path.suffix == ".mat":
        scipy.io.savemat(path, arrays)
    else:
        with h5py.File(path, "w") as file:
            for name, value in arrays.items():
                file[name] = value.tolist() if value.dtype.kind == "U" else value
    return path


@pytest.mark.parametrize("name", ["model.npz", "model.mat", "model.h5", "model.HDF5", "model.NPZ"])
def test_every_format_gives_the_same_model(tmp_path, name):
    path = tmp_path / name
    write(path.with_suffix(path.suffix.lower()), ARRAYS).rename(path)
    model = read_model(path)
    for matrix in "MCK":
        assert_allclose(getattr(model.structure, matrix), ARRAYS[matrix])
    assert list(model.rows) == ["J1", "m1-ground"]
    assert list(model.sensors) == ["tip"]
    assert list(model.inputs) == ["m1", "m2"]
    assert_allclose(model.rows["m1-ground"], [1.0, 0.0])


@pytest.mark.parametrize("labels", [CELL, CELL.T])
def test_labels_in_a_matlab_cell(tmp_path, labels):
    model = read_model(write(tmp_path / "model.mat", {**ARRAYS, "row_labels": labels}))
    assert list(model.rows) == ["J1", "m1-ground"]


@pytest.mark.parametrize("suffix", [".npz", ".mat", ".h5"])
def test_a_model_without_sensors(tmp_path, suffix):
    nothing = {"sensor_labels": np.array([]), "sensor_rows": np.zeros((0, 2))}
    assert read_model(write(tmp_path / f"model{suffix}", {**ARRAYS, **nothing})).sensors == {}


BAD_ARRAYS = {
    "asymmetric": ({"K": np.array([[3.0, -1.0], [0.0, 1.0]])}, ["K is not symmetric"]),
    "not square": ({"M": np.ones((2, 3))}, ["M has shape (2, 3)", "square"]),
    "another size": ({"C": np.eye(3)}, ["C has shape (3, 3)", "(2, 2)"]),
    "massless": ({"M": np.diag([1.0, 0.0])}, ["M is not positive definite", "DOF 1"]),
    "NaN": ({"rows": np.array([[np.nan, 1.0], [1.0, 0.0]])}, ["rows", "NaN", "(0, 0)"]),
    "complex": ({"K": ARRAYS["K"] * (1 + 0.1j)}, ["K is complex", "real"]),
    "text for numbers": ({"M": np.array(["a", "b"])}, ["M", "real numbers"]),
    "too few rows": ({"rows": np.ones((1, 2))}, ["rows has shape (1, 2)", "(2, 2)", "row_labels"]),
    "rows too short": ({"input_rows": np.ones((2, 1))}, ["input_rows", "(2, 1)", "(2, 2)"]),
    "label twice": ({"row_labels": np.array(["J1", "J1"])}, ["row_labels", "'J1' 2 times"]),
    "numbers for labels": ({"sensor_labels": np.array([1.0])}, ["sensor_labels", "1.0", "text"]),
}


@pytest.mark.parametrize("suffix", [".npz", ".mat", ".h5"])
@pytest.mark.parametrize(("change", "words"), BAD_ARRAYS.values(), ids=BAD_ARRAYS)
def test_a_bad_array_is_named(tmp_path, change, words, suffix):
    path = write(tmp_path / f"model{suffix}", {**ARRAYS, **change})
    check_refused(path, words)


@pytest.mark.parametrize("suffix", [".npz", ".mat", ".h5"])
def test_a_missing_array_is_named(tmp_path, suffix):
    less = {name: value for name, value in ARRAYS.items() if name != "row_labels"}
    check_refused(write(tmp_path / f"model{suffix}", less), ["'row_labels' is missing", "holds C"])


@pytest.mark.parametrize("kept", [0.0, 0.3, 0.9])
@pytest.mark.parametrize("suffix", [".npz", ".mat", ".h5"])
def test_a_file_cut_short(tmp_path, suffix, kept):
    path = write(tmp_path / f"model{suffix}", ARRAYS)
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    check_refused(path, ["cut short"] if suffix != ".mat" else [])


def test_a_damaged_member(tmp_path):
    path = write(tmp_path / "model.npz", ARRAYS)
    content = path.read_bytes()
    start = content.index(ARRAYS["K"].tobytes())
    path.write_bytes(content[:start] + bytes(8) + content[start + 8 :])
    check_refused(path, ["K cannot be read", "damaged"])


def test_python_objects_are_never_loaded(tmp_path):
    path = write(tmp_path / "model.npz", {**ARRAYS, "row_labels": CELL})
    check_refused(path, ["row_labels", "pickled", "dtype=str"])


@pytest.mark.parametrize("labels", [ARRAYS["row_labels"], CELL, CELL.T])
def test_matlab_7_3(tmp_path, labels):
    nothing = {"sensor_labels": np.empty((0, 0), dtype=object), "sensor_rows": np.zeros((0, 2))}
    skewed = {"rows": np.array([[1.0, -2.0], [3.0, 4.0]])}
    arrays = {**ARRAYS, **nothing, **skewed, "row_labels": labels}
    model = read_model(write_matlab73(tmp_path / "model.mat", arrays))
    assert_allclose(model.structure.K, ARRAYS["K"])
    assert list(model.rows) == ["J1", "m1-ground"]
    assert_allclose(model.rows["J1"], [1.0, -2.0])
    assert model.sensors == {}


def test_a_group_is_no_array(tmp_path):
    path = write(tmp_path / "model.h5", {n: v for n, v in ARRAYS.items() if n != "K"})
    with h5py.File(path, "a") as file:
        file.create_group("K")
    check_refused(path, ["K is a group", "dataset"])


def test_matlab_7_3_cut_short(tmp_path):
    path = tmp_path / "model.mat"
    path.write_bytes(write_matlab73(path, ARRAYS).read_bytes()[:-100])
    check_refused(path, ["cut short"])


def test_an_unknown_extension(tmp_path):
    path = tmp_path / "model.op4"
    path.write_text("")
    check_refused(path, ["'.op4'", ".npz"])


def test_no_such_file(tmp_path):
    check_refused(tmp_path / "model.npz", ["does not exist"])
    check_refused(tmp_path, ["is a folder"])


def check_refused(path, words):
    with pytest.raises(InputError) as caught:
        read_model(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    for word in words:
        assert word in message
