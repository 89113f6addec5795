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


def write(path, d, force, **further):
    arrays = {"displacement": d, "force": force, **further}
    if path.suffix == ".json":
        path.write_text(json.dumps({name: list(each) for name, each in arrays.items()}))
    elif path.suffix == ".csv":
        np.savetxt(
            path,
            np.column_stack(list(arrays.values())),
            delimiter=",",
            header=",".join(arrays),
            comments="",
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


# --- further channels ----------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".json", ".csv", ".npz"])
def test_channels_that_are_named_come_with_the_loop(tmp_path, suffix):
    """Others stay where they are: a second load cell would explain any force."""
    u = np.linspace(20.0, 40.0, D.size)
    found = read_loop(
        write(tmp_path / f"J1{suffix}", D, FORCE, temperature_c=u, load_2=FORCE),
        channels=["temperature_c"],
    )
    assert list(found.channels) == ["temperature_c"]
    np.testing.assert_allclose(found.channels["temperature_c"], u, rtol=1e-15)


def test_a_channel_may_be_one_number(tmp_path):
    for file in ("J1.json", "J1.npz"):
        held = {"displacement": D, "force": FORCE, "bolt_kn": 12.5}
        if file.endswith("json"):
            lists = {name: np.asarray(x).tolist() for name, x in held.items()}
            (tmp_path / file).write_text(json.dumps(lists))
        else:
            np.savez(tmp_path / file, **held)
        found = read_loop(tmp_path / file, channels=["bolt_kn"])
        assert found.channels["bolt_kn"].tolist() == [12.5] * D.size


@pytest.mark.parametrize(
    ("u", "told"),
    [
        (FORCE[:-1], r"channel u has shape \(200,\); expected one value, or 201 .* another rate"),
        (np.where(np.arange(D.size) == 7, math.nan, 1.0), "channel u holds NaN .* at value 7"),
        (["warm"], "channel u holds no real numbers"),
    ],
)
def test_a_channel_that_is_wrong_is_refused(u, told):
    with pytest.raises(InputError, match=told):
        ij.ForceLoop(D, FORCE, channels={"u": u})


def test_what_follows_a_channel_is_no_scatter():
    """Eight cycles of which each is stronger by a channel, and a little by chance."""
    random = np.random.default_rng(2)
    t = np.arange(3200) / 400.0
    d, load = np.sin(2.0 * np.pi * t), np.floor(t + 0.25)
    chance = 0.02 * random.standard_normal(load.size)[load.astype(int)]
    force = (1.0 + 0.1 * load + chance) * d
    assert ij.ForceLoop(d, force).scatter > 0.1
    known = ij.ForceLoop(d, force, channels={"load": load, "humidity": 0.4})
    assert known.scatter < 0.02


def test_how_long_its_cycles_take():
    """Half a cycle is between two turning points, noise or not."""
    d = np.sin(np.linspace(0.0, 8.5 * np.pi, 851)) + 1e-3 * np.cos(np.arange(851.0))
    loop = ij.ForceLoop(d, d, dt=0.1)
    assert loop.duration == pytest.approx(85.0)
    assert loop.period == pytest.approx(20.0, rel=0.06)
    assert math.isnan(ij.ForceLoop(d, d).period)
