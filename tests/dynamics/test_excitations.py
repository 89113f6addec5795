"""Force histories against the thesis's formulas, and rows against what they drive."""

import jax
import numpy as np
import pytest

import iwanjax as ij
from iwanjax.dynamics import (
    base_input,
    half_sine,
    modal_input,
    point_input,
    ramp,
    sine,
    sweep,
)

T = np.arange(0, 1000) * 1e-3
SYSTEM = ij.three_mass()


def test_half_sine_of_4_43():
    t = np.arange(-5, 40) * 2.5e-4
    found = half_sine(t, 100.0, 200 * np.pi)
    expected = np.where((t >= 0) & (t < 1 / 200), 100 * np.sin(200 * np.pi * t), 0)
    np.testing.assert_allclose(found, expected, rtol=1e-15)
    assert float(found[15]) == pytest.approx(100.0, rel=1e-15)
    # The end itself does not belong to the blow.
    assert float(half_sine([0.5], 1.0, 2 * np.pi)[0]) == 0.0


def test_levels_on_a_leading_axis():
    levels = np.array([1.0, 3.0])
    found = half_sine(T, levels[:, None], 9.0)
    np.testing.assert_allclose(found, levels[:, None] * half_sine(T, 1.0, 9.0), rtol=1e-15)
    assert sine(T, ramp(T, levels[:, None], 0.0, 0.5), 9.0).shape == (2, 1000)


@pytest.mark.parametrize(("start", "end"), [(2e-4, 5.5e-4), (5.5e-4, 2e-4)])
def test_ring_up_and_ring_down_of_4_23_and_4_24(start, end):
    t = np.linspace(0.0, 3.0, 301)
    found = sine(t, ramp(t, start, end, 2.0), 2 * np.pi, np.pi / 2)
    growing = (start + (end - start) * t / 2) * np.cos(2 * np.pi * t)
    expected = np.where(t < 2, growing, end * np.cos(2 * np.pi * t))
    np.testing.assert_allclose(found, expected, atol=1e-18)


def test_forcing_of_4_42():
    omega, high, low, duration = 805.4, 6.0, 0.6663, 0.7
    found = sine(T, ramp(T, high, low, duration), omega)
    falling = (high - (high - low) * T / duration) * np.sin(omega * T)
    expected = np.where(duration > T, falling, low * np.sin(omega * T))
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("band", [(5.0, 60.0), (60.0, 5.0)])
@pytest.mark.parametrize("kind", ["linear", "log"])
def test_frequency_of_a_sweep(kind, band):
    t = 3.0 + np.linspace(0.0, 2.0, 200_001)
    # The zeros tell the phase: k half cycles at the k-th.
    found = np.asarray(sweep(t, 2.0, band, kind))
    assert found[0] == 0.0
    assert np.max(np.abs(found)) == pytest.approx(2.0, rel=1e-4)
    zeros = np.flatnonzero(np.diff(np.sign(found[1:]))) + 1
    at = t[zeros] - found[zeros] * (t[1] - t[0]) / (found[zeros + 1] - found[zeros]) - 3.0
    f_0, f_1 = band
    if kind == "linear":
        cycles = f_0 * at + (f_1 - f_0) * at**2 / 4
    else:
        cycles = 2 * f_0 / np.log(f_1 / f_0) * ((f_1 / f_0) ** (at / 2) - 1)
    np.testing.assert_allclose(2 * cycles, np.arange(1, len(at) + 1), atol=1e-5)


def test_a_modal_force_drives_one_mode_alone():
    for limit in ("low", "high"):
        Phi = SYSTEM.modes(limit).Phi
        row = modal_input(SYSTEM, 1, limit)
        np.testing.assert_allclose(Phi.T @ row, [0.0, 1.0, 0.0], atol=1e-14)


def test_a_point_is_one_coordinate():
    np.testing.assert_array_equal(point_input(SYSTEM, 1), [0.0, 1.0, 0.0])


def test_a_base_at_constant_acceleration_deflects_the_structure_statically():
    row = base_input(SYSTEM, np.ones(3))
    np.testing.assert_allclose(row, -10 * np.ones(3))
    # Masses left behind compress their springs: K u = -M r a.
    K = SYSTEM.linearised("low").K
    np.testing.assert_allclose(np.linalg.solve(K, row), -10 / 9 * np.array([3, 5, 5.9]), rtol=1e-12)


def test_derivatives():
    def last(amplitude, omega):
        return half_sine(T, amplitude, omega)[100]

    found = jax.grad(last, (0, 1))(2.0, 9.0)
    expected = np.sin(0.9), 0.1 * 2.0 * np.cos(0.9)
    np.testing.assert_allclose(found, expected, rtol=1e-14)


BAD = {
    "NaN": (lambda: half_sine([0.0, np.nan], 1.0, 1.0), "t holds 1 NaN"),
    "text": (lambda: sine(T, "big", 1.0), "amplitude is of type"),
    "no frequency": (lambda: half_sine(T, 1.0, 0.0), r"omega = 0\.0; expected a positive number"),
    "no duration": (lambda: ramp(T, 1.0, 0.0, -1.0), r"duration = -1\.0; expected a positive"),
    "descending": (lambda: sweep(T[::-1], 1.0, (1.0, 2.0)), "expected .* ascending instants"),
    "instant": (lambda: sweep(0.0, 1.0, (1.0, 2.0)), r"t of shape \(\); expected \(N,\)"),
    "one frequency": (lambda: sweep(T, 1.0, (1.0, 1.0)), "two different positive frequencies"),
    "from zero": (lambda: sweep(T, 1.0, (0.0, 1.0)), "two different positive frequencies"),
    "three": (lambda: sweep(T, 1.0, (1.0, 2.0, 3.0)), "two different positive frequencies"),
    "kind": (lambda: sweep(T, 1.0, (1.0, 2.0), "chirp"), "kind = 'chirp'; expected 'linear'"),
    "mode": (lambda: modal_input(SYSTEM, 3), "mode = 3; expected a whole number from 0 to 2"),
    "coordinate": (lambda: point_input(SYSTEM, -1), "coordinate = -1; expected a whole number"),
    "direction": (lambda: base_input(SYSTEM, [1.0]), r"direction has shape \(1,\); expected"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_gets_one_clear_line(case):
    call, message = BAD[case]
    with pytest.raises(ij.InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)
