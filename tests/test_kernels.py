import contextlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwanjax.kernels import Kept


@pytest.fixture
def folder(tmp_path):
    """An empty place for kernels, in which the compiler's own cache keeps none of these."""
    with replaced("jax_compilation_cache_dir", str(tmp_path)), replaced(LEAST, 60.0):
        yield tmp_path


LEAST = "jax_persistent_cache_min_compile_time_secs"


@contextlib.contextmanager
def replaced(name, value):
    """Another value of one of JAX's settings."""
    before = jax.config.values[name]
    jax.config.update(name, value)
    try:
        yield
    finally:
        jax.config.update(name, before)


def traced(name=lambda *arguments: "a"):
    """A function that is kept, and the list that it leaves a mark in whenever it is traced."""
    marks = []

    def function(x, scale):
        marks.append(x.shape)
        return jnp.sin(x) * scale, x.sum()

    return Kept(function, name), marks


X = jnp.linspace(0.0, 1.0, 5)


def kernels(folder):
    return sorted(folder.glob("*.kernel"))


def test_another_process_need_not_trace_it(folder):
    first, marks = traced()
    expected = first(X, 2.0)
    again, none = traced()
    found = again(X, 2.0)
    assert (len(marks), none) == (1, [])
    np.testing.assert_array_equal(found[0], np.sin(X) * 2.0)
    np.testing.assert_array_equal(found[1], expected[1])
    assert len(kernels(folder)) == 1


def test_whatever_is_compiled_in_tells_kernels_apart(folder):
    kept, marks = traced()
    np.testing.assert_allclose(kept(X, 2.0)[0], np.sin(X) * 2.0)
    np.testing.assert_allclose(kept(X, 3.0)[0], np.sin(X) * 3.0)
    np.testing.assert_allclose(kept(X[:3], 3.0)[0], np.sin(X[:3]) * 3.0)
    kept(X, 3.0)
    other, more = traced(lambda *arguments: "b")
    other(X, 3.0)
    assert (len(marks), len(more), len(kernels(folder))) == (3, 1, 4)


def test_arrays_are_none_of_it(folder):
    kept, marks = traced()
    for scale in (2.0, 3.0):
        for array in (jnp.asarray, np.asarray):
            np.testing.assert_allclose(kept(array(X), jnp.asarray(scale))[0], np.sin(X) * scale)
    assert len(marks) == 1


@pytest.mark.parametrize("broken", [b"", b"no pickle", None])
def test_what_cannot_be_loaded_is_made_again(folder, broken):
    traced()[0](X, 2.0)
    (place,) = kernels(folder)
    place.write_bytes(place.read_bytes()[:-100] if broken is None else broken)
    again, marks = traced()
    np.testing.assert_allclose(again(X, 2.0)[0], np.sin(X) * 2.0)
    assert len(marks) == 1
    after, none = traced()
    after(X, 2.0)
    assert none == []


def test_without_a_name_nothing_is_kept(folder):
    kept, marks = traced(lambda *arguments: None)
    kept(X, 2.0)
    assert (len(marks), kernels(folder)) == (1, [])


def test_an_empty_name_is_no_place(folder, monkeypatch):
    """As ``JAX_COMPILATION_CACHE_DIR=`` leaves it: nothing is kept where the command was called."""
    monkeypatch.chdir(folder)
    with replaced("jax_compilation_cache_dir", ""):
        traced()[0](X, 2.0)
    assert not kernels(folder)


def test_without_a_place_for_it_a_kernel_is_made_all_the_same(folder):
    for place in (str(folder / "missing"), None):
        with replaced("jax_compilation_cache_dir", place):
            np.testing.assert_allclose(traced()[0](X, 2.0)[0], np.sin(X) * 2.0)


def test_what_came_from_the_compilers_own_cache_is_made_again_or_runs(folder):
    """A kernel that JAX has loaded itself loses its functions when it is kept a second time."""
    with replaced(LEAST, 0.0):
        traced()[0](X, 2.0)
        for _ in range(2):
            for place in kernels(folder):
                place.unlink()
            jax.clear_caches()
            for _ in range(2):
                np.testing.assert_allclose(traced()[0](X, 2.0)[0], np.sin(X) * 2.0)
