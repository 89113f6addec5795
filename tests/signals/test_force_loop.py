"""Loops of a joint on its own: files, and what is refused."""

import json
import math

import numpy as np
import pytest

import iwanjax as ij
from iwanjax.errors import InputError
from iwanjax.signals import read_loop

D = 1e-4 * np.sin(np.linspace(0.0, 4.0 * np.pi, 201))
FORCE = 6e4 * D


def write(path, d, force):
    arrays = {"displacement": d, "force": force}
    if path.suffix == ".json":
        path.write_text(json.dumps({name: list(each) for name, each in arrays.items()}))
    elif path.suffix == ".csv":
        np.savetxt(
            path, np.column_stack([d, force]), delimiter=",", header=",".join(arrays), comments=""
        )
    else:
        np.savez(path, **arrays)
    return path


@pytest.mark.parametrize("suffix", [".json", ".csv", ".npz"])
def test_a_loop_comes_back_from_its_file(tmp_path, suffix):
    found = read_loop(write(tmp_path / f"J1{suffix}", D, FORCE))
    np.testing.assert_allclose(found.d, D, rtol=1e-15)
    np.testing.assert_allclose(found.force, FORCE, rtol=1e-15)
    assert found.name == f"J1{suffix}"


def test_noise_is_told_from_the_loop():
    noise = 0.01 * np.random.default_rng(0).standard_normal(D.size)
    assert ij.ForceLoop(D, FORCE + noise).noise == pytest.approx(0.01, rel=0.3)


def test_where_it_begins():
    """At rest; or, cut from a steady loop, on the branch that it goes on along."""
    quarter = 25
    down, up = (ij.ForceLoop(D[i:], FORCE[i:]) for i in (quarter, 3 * quarter))
    assert ij.ForceLoop(D, FORCE).may_begin_at_rest
    assert not ij.ForceLoop(D, FORCE).before(True).any()
    assert not down.may_begin_at_rest
    assert np.sign(down.before(True)).tolist() == [-1.0, 1.0]
    assert np.sign(up.before(True)).tolist() == [1.0, -1.0]
    assert np.sign(ij.ForceLoop(D, FORCE).before(False)).tolist() == [1.0, -1.0]


@pytest.mark.parametrize(
    ("d", "force", "told"),
    [
        (D, np.where(np.arange(D.size) == 7, math.nan, FORCE), "force holds NaN .* at value 7"),
        (D[:5], FORCE[:5], r"displacement has shape \(5,\); expected \(N,\) with at least 8"),
        (D, 0.0 * FORCE, "force is 0 throughout"),
        (D, FORCE[:-1], "displacement has 201 values and force 200"),
        (D[:, None] * [1.0, 2.0], FORCE, r"displacement has shape \(201, 2\)"),
    ],
)
def test_what_is_no_loop_is_refused(d, force, told):
    with pytest.raises(InputError, match=told):
        ij.ForceLoop(d, force)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('{"displacement": [0, 1], "forse": [0, 1]}', "force is missing; .*did you mean 'forse'"),
        ('{"displacement": [0, 1', "no JSON .*cut short"),
        ("[1, 2]", "holds no object"),
        ('{"displacement": ["a"], "force": [1]}', "displacement holds no real numbers"),
    ],
)
def test_a_file_that_is_wrong_is_named(tmp_path, text, told):
    path = tmp_path / "J1.json"
    path.write_text(text)
    with pytest.raises(InputError, match=f"J1.json: .*{told}"):
        read_loop(path)
