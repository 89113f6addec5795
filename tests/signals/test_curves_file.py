import h5py
import numpy as np
import pytest
import scipy.io

from iwanjax.errors import InputError
from iwanjax.signals import read_curves

CURVES = {
    "amplitude": np.array([1e-6, 1e-5, 1e-4, 1e-3]),
    "frequency": np.array([80.5, 80.4, 80.1, 79.2]),
    "damping": np.array([1e-3, 1.2e-3, 2e-3, 4e-3]),
}
DEVIATIONS = {f"{name}_std": 0.01 * value for name, value in CURVES.items()}
HZ = {"frequency": "frequency_hz", "frequency_std": "frequency_hz_std"}


def write(path, arrays):
    if path.suffix == ".npz":
        np.savez(path, **arrays)
    elif path.suffix == ".mat":
        scipy.io.savemat(path, arrays)
    elif path.suffix == ".csv":
        lines = [",".join(arrays)]
        lines += [",".join(map(repr, row)) for row in np.column_stack([*arrays.values()]).tolist()]
        path.write_text("\n".join(lines))
    else:
        with h5py.File(path, "w") as file:
            for name, value in arrays.items():
                file[name] = value
    return path


@pytest.mark.parametrize("hertz", [False, True])
@pytest.mark.parametrize("suffix", [".csv", ".npz", ".mat", ".h5"])
def test_curves_come_back(tmp_path, suffix, hertz):
    arrays = {**CURVES, **DEVIATIONS, "level": np.arange(4.0)}
    named = {HZ.get(name, name) if hertz else name: value for name, value in arrays.items()}
    curves = read_curves(
        write(tmp_path / f"curves{suffix}", named), quantity="velocity", unit="m/s", name="mode1"
    )
    for name in (*CURVES, *DEVIATIONS):
        np.testing.assert_array_equal(getattr(curves, name), arrays[name])
    assert (curves.quantity, curves.unit, curves.name) == ("velocity", "m/s", "mode1")


def test_deviations_may_be_missing(tmp_path):
    curves = read_curves(write(tmp_path / "curves.csv", CURVES))
    assert curves.frequency_std is None
    assert curves.quantity == "modal displacement"


def changed(name, index, value):
    array = np.array({**CURVES, **DEVIATIONS}[name])
    array[index] = value
    return {name: array}


BAD = {
    "NaN": (changed("damping", 2, np.nan), ["damping holds 1 NaN", "point 2"]),
    "infinite": (changed("damping_std", 0, np.inf), ["damping_std holds 1 NaN", "point 0"]),
    "zero amplitude": (changed("amplitude", 1, 0.0), ["amplitude is 0 at point 1", "positive"]),
    "negative": (changed("frequency", 3, -1.0), ["frequency is -1 at point 3"]),
    "percent": ({"damping": 100 * CURVES["damping"] + 1}, ["damping is 1.4", "percent", "100"]),
    "negative deviation": (changed("frequency_std", 0, -0.1), ["frequency_std", "negative"]),
    "few points": ({n: v[:2] for n, v in CURVES.items()}, ["amplitude has 2 points", "3"]),
    "twice": ({"frequency_hz": CURVES["frequency"]}, ["frequency_hz and frequency", "leave out"]),
    "misspelt": ({"damping_sd": CURVES["damping"]}, ["damping_sd", "did you mean 'damping_std'?"]),
}


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".mat", ".h5"])
@pytest.mark.parametrize(("change", "words"), BAD.values(), ids=BAD)
def test_a_bad_column_is_named(tmp_path, suffix, change, words):
    path = write(tmp_path / f"curves{suffix}", {**CURVES, **change})
    check_refused(path, [f"{path}: ", *words])


@pytest.mark.parametrize("name", CURVES)
def test_a_missing_column_is_named(tmp_path, name):
    less = {key: value for key, value in CURVES.items() if key != name}
    path = write(tmp_path / "curves.csv", {**less, name[:-1]: CURVES[name]})
    check_refused(path, [f"{path}: ", f"{name} is missing", f"did you mean '{name[:-1]}'?"])


def test_arrays_that_are_no_columns(tmp_path):
    path = write(tmp_path / "curves.npz", {**CURVES, "damping": np.ones((2, 2))})
    check_refused(path, ["damping has shape (2, 2)", "(levels,)"])
    path = write(tmp_path / "text.npz", {**CURVES, "damping": np.array(["a"] * 4)})
    check_refused(path, ["damping holds no real numbers"])
    path = write(tmp_path / "length.npz", {**CURVES, "damping": CURVES["damping"][:3]})
    check_refused(path, ["damping has shape (3,)", "(4,)"])
    path = write(tmp_path / "o.npz", {**CURVES, "damping": np.array([None] * 4, dtype=object)})
    check_refused(path, ["damping holds pickled"])


def test_files_that_are_none(tmp_path):
    check_refused(tmp_path / "curves.csv", ["does not exist"])
    path = tmp_path / "curves.csv"
    path.write_text("amplitude,frequency_hz,damping\n1,2,x\n")
    check_refused(path, [f"{path}:2: ", "'damping' holds 'x'"])


def check_refused(path, words):
    with pytest.raises(InputError) as caught:
        read_curves(path)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message
