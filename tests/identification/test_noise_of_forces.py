"""Noise of measured forces: what shows it, and what of it reaches the sensors."""

from dataclasses import replace

import numpy as np
import pytest

from iwanjax.identification.recordings import StudyRecording, force_noise_of
from iwanjax.identification.resampling import at_rate
from iwanjax.signals.force_noise import InputNoise

COUNT, S = 4000, 0.003
NOT_GIVEN = np.full(2, np.nan)


def noise_of(force: np.ndarray, given: np.ndarray = NOT_GIVEN, **state) -> InputNoise:
    """Of a force of noise S at the first of two inputs, the other silent."""
    random = np.random.default_rng(0)
    both = np.stack([force + S * random.standard_normal(len(force)), np.zeros(len(force))], axis=1)
    found = force_noise_of(StudyRecording("rec", both, both, **state), given)
    assert found is not None
    assert (found.deviation[1], found.source[1]) == (0.0, "")
    return found


def band(lowest: float, highest: float, count: int = COUNT) -> np.ndarray:
    """A random force between two shares of the sampling rate, of deviation 1."""
    random = np.random.default_rng(1)
    spectrum = np.fft.rfft(random.standard_normal(count))
    f = np.fft.rfftfreq(count)
    wave = np.fft.irfft(np.where((f > lowest) & (f < highest), spectrum, 0.0))
    return wave / np.std(wave)


def test_beside_a_pulse():
    force = np.zeros(COUNT)
    force[200:220] = np.hanning(20)
    found = noise_of(force)
    assert found.source[0] == "beside its pulses"
    assert found.deviation[0] == pytest.approx(S, rel=0.1)


def test_of_a_shaker_in_the_bands_that_it_does_not_excite():
    found = noise_of(band(0.02, 0.2), initial="unknown")
    assert found.source[0] == "in quiet bands"
    assert found.deviation[0] == pytest.approx(S, rel=0.15)


def test_of_a_sweep_all_over_its_band():
    t = np.arange(COUNT)
    found = noise_of(np.sin(2.0 * np.pi * (0.01 * t + 0.17 * t**2 / COUNT)), initial="unknown")
    assert found.source[0] == "in quiet bands"
    assert found.deviation[0] == pytest.approx(S, rel=0.15)


def test_of_periods_by_what_changes():
    found = noise_of(np.tile(band(0.0, 0.5, COUNT // 4), 4), initial="periodic")
    assert found.source[0] == "between periods"
    assert found.deviation[0] == pytest.approx(S, rel=0.1)


def test_random_noise_up_to_the_end_of_the_band_hides_it():
    force = band(0.0, 0.5)
    found = noise_of(force, initial="unknown")
    assert found.source[0] == "not known"
    assert np.isnan(found.deviation[0])
    found = noise_of(force, np.array([0.3, np.nan]), initial="unknown")
    assert (found.deviation[0], found.source[0]) == (0.3, "as given")
    recording = StudyRecording("rec", force[:, None], force[:, None], "fit", "unknown")
    one = InputNoise(found.deviation[:1], found.source[:1])
    lower = at_rate(replace(recording, force_noise=one), 1000.0, 250.0, np.full(1, np.nan))
    assert lower.force_noise is not None
    # Of the same density.
    assert lower.force_noise.deviation[0] == pytest.approx(0.15)
    assert force_noise_of(StudyRecording("decay", force[:, None], None), NOT_GIVEN) is None
