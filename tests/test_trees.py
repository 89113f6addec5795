"""Files of saved objects: whole or not at all, read without executing anything."""

import json
import stat
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest

from iwanjax.errors import InputError
from iwanjax.files import trees
from iwanjax.files.trees import read_tree, write_tree


@dataclass(frozen=True)
class Pair:
    first: object
    second: object = None


class Point(NamedTuple):
    x: float
    y: np.ndarray


@pytest.mark.parametrize(
    "value",
    [
        None,
        True,
        -3,
        0.1 + 0.2,
        float("inf"),
        "häufig \n ±",
        2.0 - 1.0j,
        np.float32(0.1),
        np.float64(0.1),
        np.int8(-3),
        np.bool_(True),
        (1, (2, [3, None])),
        {"a": 1, 2: "b", (3, 4): 5.0},
        Point,
        Pair(Point(1.0, None), ()),
    ],
)
def test_values_come_back_with_their_types(value, tmp_path):
    found = read_tree(write_tree(tmp_path / "a.npz", Pair(value)))
    assert found == Pair(value)
    assert type(found.first) is type(value)


@pytest.mark.parametrize("dtype", ["f4", "f8", "c16", "i1", "u8", "?", "U3"])
def test_arrays_come_back_with_their_shapes_and_types(dtype, tmp_path):
    array = np.arange(6).reshape(1, 2, 3).astype(dtype)
    found = read_tree(write_tree(tmp_path / "a.npz", Point(1.0, array)))
    assert found.y.dtype == array.dtype
    np.testing.assert_array_equal(found.y, array)


def test_nan_is_nan(tmp_path):
    assert np.isnan(read_tree(write_tree(tmp_path / "a.npz", Pair(float("nan")))).first)


# --- writing ------------------------------------------------------------------------------


def test_a_write_that_fails_leaves_what_stood_there(tmp_path, monkeypatch):
    path = write_tree(tmp_path / "a.npz", Pair(1))

    def half(file, **arrays):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", half)
    with pytest.raises(InputError, match=r"a\.npz: cannot be written \(No space left on device\)"):
        write_tree(path, Pair(2))
    assert read_tree(path) == Pair(1)
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_is_readable_by_whom_others_of_its_writer_are(tmp_path):
    (tmp_path / "plain").touch()
    path = write_tree(tmp_path / "a.npz", Pair(1))
    modes = [stat.S_IMODE(each.stat().st_mode) for each in (path, tmp_path / "plain")]
    assert modes[0] == modes[1]


@pytest.mark.parametrize("name", ["a", "a.mat", "a.npz.gz"])
def test_another_ending_is_refused(name, tmp_path):
    with pytest.raises(InputError, match=r"saved as \.npz"):
        write_tree(tmp_path / name, Pair(1))


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match="expected a folder that exists"):
        write_tree(tmp_path / "none" / "a.npz", Pair(1))


def test_what_cannot_be_saved_is_named_with_its_place(tmp_path):
    @dataclass
    class Local:
        x: int

    for value, message in (
        (Pair((0, open)), r"Pair\.first\.1 is a builtin_function_or_method"),
        (Pair(np.array([object()])), r"Pair\.first: an array of Python objects"),
        (Pair(Local(1)), r"Pair\.first: .*Local cannot be found by its name"),
    ):
        with pytest.raises(InputError, match=message):
            write_tree(tmp_path / "a.npz", value)


# --- reading ------------------------------------------------------------------------------


def stored(path, tree, **arrays):
    """A file with this tree in it, right or not."""
    text = json.dumps({"version": "0.0.9", "tree": tree})
    np.savez(path, iwanjax=np.array(text), **arrays)
    return path


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.npz"):
        read_tree(tmp_path / "none.npz")


def test_a_file_of_another_origin_is_named(tmp_path):
    np.savez(tmp_path / "a.npz", time=np.arange(3))
    with pytest.raises(InputError, match="is no result that iwanjax saved"):
        read_tree(tmp_path / "a.npz")


@pytest.mark.parametrize("keep", [0, 10, 0.5, 0.95])
def test_a_file_that_is_cut_short_is_named(keep, tmp_path):
    path = write_tree(tmp_path / "a.npz", Pair(np.arange(1000.0)))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(keep if keep > 1 else keep * len(whole))])
    with pytest.raises(InputError, match="cannot be read"):
        read_tree(path)


def test_a_bit_that_fell_over_is_found(tmp_path):
    path = write_tree(tmp_path / "a.npz", Pair(np.arange(1000.0)))
    whole = bytearray(path.read_bytes())
    whole[len(whole) // 2] ^= 1
    path.write_bytes(whole)
    with pytest.raises(InputError, match="cannot be read"):
        read_tree(path)


@pytest.mark.parametrize(
    ("tree", "message"),
    [
        ({"object": [["iwanjax.curves", "Nothing"], {}]}, r"iwanjax\.curves\.Nothing is not known"),
        ({"object": [["some.thing", "A"], {}]}, r"import some\.thing first \(saved by .* 0\.0\.9"),
        ({"object": [["iwanjax.errors", "InputError"], {}]}, "has other fields here"),
        (
            {"object": [["subprocess", "Popen"], {"args": "ls"}]},
            "Popen has other fields here: args",
        ),
        ({"object": [["test_trees", "Pair"], {"first": 1, "third": 2}]}, "second, third"),
        ({"type": ["os", "system"]}, r"os\.system is not known"),
        ({"numpy": "b"}, "damaged"),
        ({"strange": 1}, "damaged"),
        ({"tuple": 3}, "damaged"),
    ],
)
def test_a_tree_that_does_not_fit_is_refused(tree, message, tmp_path):
    with pytest.raises(InputError, match=message):
        read_tree(stored(tmp_path / "a.npz", tree))


def test_reading_calls_no_constructor_and_unpickles_nothing(tmp_path, monkeypatch):
    calls = []
    path = write_tree(tmp_path / "a.npz", Pair(1))
    monkeypatch.setattr(Pair, "__init__", lambda self, *_: calls.append(self))
    assert read_tree(path).first == 1
    assert not calls
    np.savez(tmp_path / "b.npz", iwanjax=np.array([calls.append], dtype=object))
    with pytest.raises(InputError, match="cannot be read"):
        read_tree(tmp_path / "b.npz")


def test_single_precision_is_said(tmp_path, monkeypatch):
    import jax.numpy as jnp

    path = write_tree(tmp_path / "a.npz", Pair(jnp.arange(3.0)))
    said = []
    monkeypatch.setattr(trees, "warn_single_precision", lambda: said.append(1))
    read_tree(path)
    assert said
