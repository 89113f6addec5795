"""Constant offsets of channels: what is one, what is motion, and what nothing can tell."""

import numpy as np
import pytest
import scipy.signal
from numpy.testing import assert_allclose, assert_array_equal

from iwanjax.identification.offsets import without_offsets
from iwanjax.identification.recordings import StudyRecording

RATE, N, NOISE = 1000.0, 4000, 1e-3
T = np.arange(N) / RATE


def oscillator(force, quantity, quadratic=0.0):
    """One that answers a force (N,): a linear filter, and what a quadratic spring adds slowly."""
    omega, zeta = 2 * np.pi * 40.0, 0.01
    x = scipy.signal.lsim(([1.0], [1.0, 2 * zeta * omega, omega**2]), force, T)[1]
    x = x - quadratic * x**2
    return {"displacement": x, "acceleration": np.gradient(np.gradient(x, T), T)}[quantity]


def force(kind, seed=0):
    random = np.random.default_rng(seed)
    if kind == "sine":
        return np.sin(2 * np.pi * 45.0 * T)
    if kind == "hammer":
        return 50.0 * np.exp(-0.5 * ((T - 0.1) / 2e-3) ** 2)
    waves = np.asarray(
        scipy.signal.sosfilt(
            scipy.signal.butter(4, [5.0, 200.0], "band", fs=RATE, output="sos"),
            random.standard_normal(N),
        )
    )
    return waves * (T > 0.3) if kind == "late" else waves


def recording(kind, quantity, offset=0.0, of_force=0.0, seed=0, **options):
    random = np.random.default_rng(100 + seed)
    f = force(kind, seed)
    x = oscillator(f, quantity, **options)
    x = x + np.std(x) * (offset + NOISE * random.standard_normal(N))
    f = f + np.max(f) * of_force + 1e-3 * np.max(f) * random.standard_normal(N)
    return StudyRecording("rec", x[:, None], f[:, None])


def taken(each, quantity, name="f", rigid=False):
    (found,), told = without_offsets([each], ["a"], [name], quantity, rigid)
    return found, told


@pytest.mark.parametrize("kind", ["hammer", "random", "late"])
@pytest.mark.parametrize("seed", range(4))
def test_what_has_no_offset_stays_as_it_is(kind, seed):
    for quantity in ("acceleration", "displacement"):
        each = recording(kind, quantity, seed=seed)
        found, told = taken(each, quantity)
        assert found.response is each.response
        assert found.force is each.force
        assert not told


@pytest.mark.parametrize("offset", [0.0, 0.01])
def test_motion_of_a_slow_mode_is_told_from_an_offset(offset):
    """A suspension's mode of three periods hides the offset of what hangs on it."""
    slow = 0.75
    motion = np.exp(-0.1 * T) * np.sin(2 * np.pi * slow * T + 1.0)
    noise = NOISE * np.random.default_rng(4).standard_normal(N)
    each = StudyRecording("rec", (motion + offset + noise)[:, None], None)
    (alone,), told = without_offsets([each], ["a"], [], "acceleration", False)
    assert alone.response is each.response
    modes = np.array([slow, 1.02 * slow, 40.0]) / RATE
    (found,), told = without_offsets([each], ["a"], [], "acceleration", False, modes)
    if offset:
        assert "a +0.0" in told[0]
        assert_allclose(found.response, each.response - offset, atol=0.2 * offset)
    else:
        assert found.response is each.response
        assert not told


@pytest.mark.parametrize("kind", ["hammer", "random"])
def test_the_mean_of_an_acceleration_is_an_offset(kind):
    clean, each = (recording(kind, "acceleration", offset=off) for off in (0.0, 0.01))
    found, told = taken(each, "acceleration")
    assert_allclose(found.response, clean.response, atol=3e-4 * np.std(clean.response))
    assert "a +" in told[0]
    assert "(mean)" in told[0]
    # Of what may drift away a mean is motion; before a force it is an offset all the same.
    free, _ = taken(each, "acceleration", rigid=True)
    if kind == "hammer":
        assert_allclose(free.response, clean.response, atol=1e-3 * np.std(clean.response))
    else:
        assert free.response is each.response


def test_a_displacement_has_an_offset_where_it_rests():
    clean, each = (recording("late", "displacement", offset=off) for off in (0.0, 0.05))
    found, told = taken(each, "displacement")
    assert_allclose(found.response, clean.response, atol=5e-4 * np.std(clean.response))
    assert "before the force" in told[0]


def test_the_mean_of_a_displacement_may_be_physics():
    """A quadratic spring moves the mean: it stays, and is told."""
    each = recording("sine", "displacement", quadratic=400.0)
    found, told = taken(each, "displacement")
    assert found.response is each.response
    assert "one-sided" in told[0]


@pytest.mark.parametrize("kind", ["hammer", "late"])
def test_a_force_has_an_offset_where_it_rests(kind):
    clean, each = (recording(kind, "acceleration", of_force=off) for off in (0.0, 0.01))
    found, told = taken(each, "acceleration")
    assert_allclose(found.force, clean.force, atol=1e-4 * np.max(clean.force))
    assert "f +" in told[0]
    assert "where it rests" in told[0]


def test_a_force_that_never_rests_keeps_its_mean_but_the_ground_does_not():
    clean, each = (recording("random", "acceleration", of_force=off) for off in (0.0, 0.1))
    found, told = taken(each, "acceleration")
    assert_array_equal(found.force, each.force)
    assert not told
    shaken, told = taken(each, "acceleration", name="base")
    assert_allclose(shaken.force, clean.force, atol=2e-2 * np.std(clean.force))
    assert "base +" in told[0]


def test_an_offset_that_another_recording_shows_at_rest_is_taken_off_a_force_without_rest():
    resting, driven = (
        recording(kind, "acceleration", of_force=0.1, seed=seed)
        for kind, seed in (("late", 1), ("random", 2))
    )
    scale = np.max(resting.force) / np.max(driven.force)
    driven = StudyRecording("driven", scale * driven.response, scale * driven.force)
    (_, found), told = without_offsets([resting, driven], ["a"], ["f"], "acceleration", False)
    assert driven.force is not None
    assert found.force is not None
    assert_allclose(
        np.mean(driven.force - found.force), 0.1 / 1.1 * np.max(resting.force), rtol=0.02
    )
    assert "as in other recordings" in told[1]
