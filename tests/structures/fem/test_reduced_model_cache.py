"""The cache of reduced models: believed only when whole and of the same options."""

import dataclasses
import json

import numpy as np
import pytest

from iwanjax.errors import InputError

pytest.importorskip("skfem", reason="scikit-fem (extra fem) is not installed")

from iwanjax.structures.fem import cache
from iwanjax.structures.fem.bricks import Material
from iwanjax.structures.fem.cache import cached
from iwanjax.structures.reduced_model import ReducedModel, SurfaceShape


def model(seed: int) -> ReducedModel:
    rng = np.random.default_rng(seed)
    return ReducedModel(
        M=np.eye(3) * (1 + rng.random()),
        K=np.diag(rng.random(3)),
        coordinates=("J1A.x", "J1B.x"),
        rows={"J1.x": np.array([-1.0, 1.0, 0.0])},
        sensors={},
        inputs={"s": rng.normal(size=3)},
        shape=SurfaceShape(
            rng.normal(size=(4, 3)), np.array([[0, 1, 2, 3]]), np.array([-1]),
            rng.normal(size=(4, 3, 3)),
        ),
        fixed_frequency=rng.random(1),
        effective_mass=rng.random((1, 6)),
        residual_flexibility={"s": 0.25},
    )  # fmt: skip


class Builder:
    """Counts how often it is asked; no two models alike."""

    def __init__(self):
        self.calls = 0

    def __call__(self):
        self.calls += 1
        return model(self.calls)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("IWANJAX_CACHE", str(tmp_path))
    return tmp_path / "fem"


def test_what_was_built_comes_back_whole(folder):
    build = Builder()
    first = cached("beam", {"size": 10.0}, build)
    again = cached("beam", {"size": 10.0}, build)
    assert build.calls == 1
    assert [path.suffix for path in folder.iterdir()] == [".npz"]
    for field in dataclasses.fields(ReducedModel):
        a, b = getattr(first, field.name), getattr(again, field.name)
        a, b = (vars(x) if isinstance(x, SurfaceShape) else x for x in (a, b))
        if isinstance(a, dict):
            assert list(a) == list(b)
            assert all(np.array_equal(a[key], b[key]) for key in a)
        else:
            assert np.array_equal(a, b)


def test_everything_the_result_depends_on_is_in_the_key(folder, monkeypatch):
    build = Builder()
    steel = Material(E=2.0, nu=0.3, rho=1.0)
    options = [
        {"size": 10.0},
        {"size": 10.000000001},
        {"size": 10.0, "material": steel},
        {"size": 10.0, "material": dataclasses.replace(steel, nu=0.31)},
    ]
    for entry in options:
        cached("beam", entry, build)
    cached("strip", options[0], build)
    monkeypatch.setattr(cache, "VERSION", cache.VERSION + 1)
    cached("beam", options[0], build)
    monkeypatch.setattr(cache.skfem(), "__version__", "another")
    cached("beam", options[0], build)
    assert build.calls == len(options) + 3


@pytest.mark.parametrize("damage", ["cut", "flipped", "emptied", "text", "another key"])
def test_a_damaged_file_is_rebuilt(folder, damage):
    build = Builder()
    cached("beam", {"size": 10.0}, build)
    (path,) = folder.iterdir()
    data = bytearray(path.read_bytes())
    if damage == "cut":
        path.write_bytes(data[: len(data) // 2])
    elif damage == "flipped":
        place = data.index(np.array(model(1).inputs["s"]).tobytes())
        data[place] ^= 1
        path.write_bytes(data)
    elif damage == "another key":
        with np.load(path) as file:
            arrays = dict(file)
        arrays["key"] = np.array(json.dumps({"name": "beam"}))
        np.savez(path, **arrays)
    else:
        path.write_bytes({"emptied": b"", "text": b"not a zip file"}[damage])
    assert np.array_equal(cached("beam", {"size": 10.0}, build).M, model(2).M)
    assert np.array_equal(cached("beam", {"size": 10.0}, build).M, model(2).M)
    assert build.calls == 2


def test_without_a_place_to_write_every_call_builds(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("IWANJAX_CACHE", str(tmp_path / "file"))
    build = Builder()
    cached("beam", {"size": 10.0}, build)
    cached("beam", {"size": 10.0}, build)
    assert build.calls == 2


@pytest.mark.parametrize("value", [np.nan, object(), lambda: 1])
def test_options_that_have_no_text_are_refused(folder, value):
    with pytest.raises(InputError, match="options of beam"):
        cached("beam", {"size": value}, Builder())
