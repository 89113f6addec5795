"""Free decays as laboratories record them: driven first, in a narrow band, two modes near 1:2."""

import numpy as np
import pytest

from iwanjax.signals import ringdown

RATE = 2048.0
NOISE = np.random.default_rng(5)


def phase(frequency, time):
    return 2.0 * np.pi * frequency * time


@pytest.mark.parametrize("lasts", [2.0, 12.0])
def test_where_the_shaker_lets_go_is_where_the_decay_begins(lasts):
    t = np.arange(int((lasts + 6.0) * RATE)) / RATE
    # A driven vibration at resonance, which wanders a little; then it decays with 0.5 %.
    size = np.where(t < lasts, 1.0 + 0.02 * np.sin(t), 1.0) * np.exp(
        -0.005 * phase(40.0, np.maximum(t - lasts, 0.0))
    )
    x = size * np.sin(phase(40.0, t)) + 1e-4 * NOISE.standard_normal(t.size)
    found = ringdown(x, RATE, (30.0, 50.0), "velocity")
    assert found.signal_time[0] == pytest.approx(lasts, abs=0.3)
    (told,) = (each for each in found.remarks if "drives" in each)
    assert told.startswith("until ")
    off = (np.asarray(found.curves.damping) - 0.005) / np.asarray(found.curves.damping_std)
    assert np.all(np.abs(off) < 4.0)
    assert float(found.curves.amplitude[0]) > 0.5


def test_a_decay_that_nothing_drives_begins_where_it_did():
    t = np.arange(8192) / RATE
    # Macroslip: damping falls with amplitude, and the logarithm of the envelope is concave.
    size = 1.0 / np.cosh(1.5 * t)
    found = ringdown(size * np.sin(phase(120.0, t)), RATE, (90.0, 150.0), "velocity", end=2.5)
    assert not any("drives" in each for each in found.remarks)
    assert found.signal_time[0] < 0.05


def test_a_narrow_band_says_what_a_wider_one_shows():
    t = np.arange(8192) / RATE
    x = np.exp(-0.003 * phase(120.0, t)) * np.sin(phase(120.0, t))
    x = np.concatenate([np.zeros(200), x]) + 1e-4 * NOISE.standard_normal(t.size + 200)
    (told,) = ringdown(x, RATE, (112.0, 128.0), "velocity").remarks
    assert "takes 0." in told
    assert "% of the amplitude on; (104, 136) Hz gives " in told
    assert ringdown(x, RATE, (80.0, 160.0), "velocity").remarks == ()


def test_the_second_harmonic_of_a_mode_at_half_the_frequency_is_taken_off():
    t = np.arange(int(3.0 * RATE)) / RATE
    lower = 0.8 * np.exp(-0.002 * phase(122.0, t)) * np.exp(1j * phase(122.0, t))
    upper = np.exp(-0.0025 * phase(243.0, t)) * np.exp(1j * phase(243.0, t))
    x = np.real(lower + upper + 0.15 * np.exp(2.0j) * lower**2)
    x = x + 1e-4 * NOISE.standard_normal(t.size)
    found = ringdown(x, RATE, (200.0, 300.0), "velocity")
    assert "harmonic of a mode near half the frequency, 0.15" in found.remarks[0]
    curves = found.curves
    clear = np.asarray(curves.amplitude) > 0.02
    assert np.count_nonzero(clear) >= 10
    np.testing.assert_allclose(np.asarray(curves.frequency)[clear], 243.0, atol=0.1)
    np.testing.assert_allclose(np.asarray(curves.damping)[clear], 0.0025, rtol=0.06)
    # The lower mode has no mode at half its own frequency.
    assert not any("harmonic" in each for each in ringdown(x, RATE, (90.0, 160.0)).remarks)


def test_both_modes_of_the_double_beam(reference_data):
    """Refused in every band before: 122 Hz and, near twice that, 244 Hz."""
    from iwanjax.signals import read_recordings

    hits = read_recordings(reference_data / "double_beam" / "data.mat", quantity="velocity")
    for hit in hits:
        x = hit.response[:, 0]
        first, second = (
            ringdown(x, hit.sampling_rate, band, "velocity").curves
            for band in ((90.0, 180.0), (180.0, 320.0))
        )
        assert np.all(np.abs(np.asarray(first.frequency) - 122.0) < 1.5)
        assert np.all(np.abs(np.asarray(second.frequency) - 243.5) < 1.5)
        loud = np.asarray(second.amplitude) > 0.1
        assert np.all(np.abs(np.asarray(second.damping)[loud] - 3e-3) < 1.5e-3)
        assert second.amplitude.size >= 10
