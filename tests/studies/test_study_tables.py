"""Arrays and tables become recordings; pandas and xarray by what they have, and if installed."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import iwanjax as ij
from iwanjax.errors import InputError

RATE = 512.0
T = np.arange(600) / RATE
X = np.stack([np.sin(40.0 * T), np.cos(70.0 * T)], axis=1)
F = np.exp(-30.0 * T)


class Frame:
    """What a pandas DataFrame has."""

    def __init__(self, values, columns, index):
        self._values, self.columns, self.index = values, columns, index

    def to_numpy(self):
        return self._values


def check(found, names=("a1", "a2")):
    assert isinstance(found, ij.Recording)
    assert [channel.name for channel in found.channels] == list(names)
    assert_allclose(found.response, X)
    assert_allclose(found.sampling_rate, RATE)


@pytest.mark.parametrize("array", [np.asarray, jnp.asarray, np.ndarray.tolist])
def test_arrays_and_lists(array):
    found = ij.as_recording(array(X), sampling_rate=RATE, sensors=["a1", "a2"], unit="m/s^2")
    check(found)
    assert {channel.quantity for channel in found.channels} == {"acceleration"}
    assert found.force is None
    check(ij.as_recording(array(X), sampling_rate=RATE), ("s1", "s2"))


def test_one_column_and_a_force():
    found = ij.as_recording(X[:, 0], F, sampling_rate=RATE, sensors="tip", inputs="hammer")
    assert found.response.shape == (600, 1)
    assert [channel.name for channel in found.inputs] == ["hammer"]
    assert found.inputs[0].quantity == "force"
    assert_allclose(found.force[:, 0], F)


def test_a_frame_brings_names_and_times():
    frame = Frame(X, np.array(["a1", "a2"], object), T)
    check(ij.as_recording(frame))
    # Seconds that begin anywhere, dates, differences of time.
    check(ij.as_recording(Frame(X, ["a1", "a2"], T + 17.0)))
    since = (T * 1e9).round().astype("timedelta64[ns]")
    check(ij.as_recording(Frame(X, ["a1", "a2"], since)))
    check(ij.as_recording(Frame(X, ["a1", "a2"], np.datetime64("2026-01-01") + since)))


def test_columns_are_taken_by_name():
    table = Frame(np.column_stack([F, X]), ["f", "a1", "a2"], T)
    found = ij.as_recording(table, table, sensors=["a1", "a2"], inputs="f")
    check(found)
    assert_allclose(found.force[:, 0], F)
    swapped = ij.as_recording(table, sensors=["a2", "a1"])
    assert_allclose(swapped.response, X[:, ::-1])


def test_a_count_of_rows_is_no_time():
    frame = Frame(X, ["a1", "a2"], np.arange(len(T)))
    with pytest.raises(InputError, match="hit: response brings no times; give sampling_rate"):
        ij.as_recording(frame, name="hit")
    check(ij.as_recording(frame, sampling_rate=RATE))


def test_a_data_array_brings_what_it_has():
    names = ["a1", "a2"]
    check(ij.as_recording(SimpleNamespace(values=X, dims=("t", "s"), coords=coords(t=T, s=names))))
    bare = SimpleNamespace(values=X, dims=("t", "s"), coords=coords(t=T))
    check(ij.as_recording(bare, sensors=names))
    single = SimpleNamespace(values=X[:, 0], dims=("t",), coords=coords(t=T))
    assert ij.as_recording(single, sensors="tip").channels[0].name == "tip"


def coords(**values):
    return {dim: SimpleNamespace(values=np.asarray(each)) for dim, each in values.items()}


def test_pandas_itself():
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    frame = pandas.DataFrame(X, columns=["a1", "a2"], index=T)
    check(ij.as_recording(frame))
    found = ij.as_recording(frame["a2"])
    assert_allclose(found.response[:, 0], X[:, 1])
    check(ij.as_recording(pandas.DataFrame(X, columns=["a1", "a2"]), sampling_rate=RATE))
    dated = frame.set_index(pandas.to_datetime(T, unit="s"))
    check(ij.as_recording(dated))


def test_xarray_itself():
    xarray = pytest.importorskip("xarray", reason="xarray is not installed")
    dims, coordinates = ("time", "channel"), {"time": T, "channel": ["a1", "a2"]}
    array = xarray.DataArray(X, dims=dims, coords=coordinates)
    check(ij.as_recording(array))
    bare = xarray.DataArray(X, dims=dims)
    check(ij.as_recording(bare, sampling_rate=RATE, sensors=["a1", "a2"]))


TABLE = Frame(X, ["a1", "a2"], T)
BAD = {
    "no rate": (lambda: ij.as_recording(X), "brings no times; give sampling_rate"),
    "rate in words": (lambda: ij.as_recording(X, sampling_rate="2 kHz"), "'2 kHz'; expected pos"),
    "a mapping": (
        lambda: ij.as_recording({"a1": X[:, 0]}, sampling_rate=RATE),
        r"response, a dict, has shape \(\)",
    ),
    "negative rate": (lambda: ij.as_recording(X, sampling_rate=-1.0), "positive Hz"),
    "names for one": (
        lambda: ij.as_recording(X, sampling_rate=RATE, sensors="a1"),
        r"sensors names 1 column\(s\), a1; expected 2",
    ),
    "no such column": (lambda: ij.as_recording(TABLE, sensors="a3"), "no column 'a3'.*a1, a2"),
    "inputs without force": (
        lambda: ij.as_recording(TABLE, inputs="f"),
        "inputs are named but there is no force",
    ),
    "three axes": (
        lambda: ij.as_recording(np.zeros((9, 9, 9)), sampling_rate=1.0),
        r"a ndarray, has shape \(9, 9, 9\); expected \(N,\)",
    ),
    "times in words": (
        lambda: ij.as_recording(Frame(X, ["a1", "a2"], np.array(["now"] * len(T)))),
        "the times are of type <U3",
    ),
    "force of another length": (
        lambda: ij.as_recording(TABLE, F[:9], inputs="f"),
        r"recording: force has shape \(9, 1\)",
    ),
    "unknown quantity": (lambda: ij.as_recording(TABLE, quantity="speed"), "'speed' is unknown"),
}


@pytest.mark.parametrize(("make", "said"), BAD.values(), ids=BAD)
def test_what_cannot_be_used_is_named(make, said):
    with pytest.raises(InputError, match=said):
        make()
