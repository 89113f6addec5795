"""Recordings of several rates become those that a recorder would have made at one."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose, assert_array_equal

from iwanjax.identification.initial_state import initial_state
from iwanjax.identification.recordings import StudyRecording, cleaned
from iwanjax.identification.resampling import at_one_rate, at_rate, working_rate

RATE, FINE, SECONDS = 1024.0, 40.0 * 1024.0, 1.0
OMEGA, ZETA, WIDTH = 2.0 * math.pi * 60.0, 0.01, 4e-3
UNKNOWN = np.full(1, np.nan)
RNG = np.random.default_rng(3)


def measured(rate, at=0.1, use="fit", seconds=SECONDS, **options):
    """Acceleration of an oscillator after a bell, whose spectrum ends far below any rate here.

    The state goes from one fine step to the next by the matrix exponential (Van Loan 1978).
    """
    dt, count = 1.0 / FINE, round(FINE * seconds)
    force = np.exp(-0.5 * ((np.arange(count) * dt - at) / WIDTH) ** 2)
    whole = np.zeros((4, 4))
    whole[0, 1], whole[1] = 1.0, [-(OMEGA**2), -2.0 * ZETA * OMEGA, 1.0, 0.0]
    whole[2, 3] = 1.0
    E = scipy.linalg.expm(whole * dt)
    step, held, ramp = E[:2, :2], E[:2, 2], E[:2, 3] / dt
    z, states = np.zeros(2), np.zeros((count, 2))
    for i in range(count - 1):
        z = step @ z + held * force[i] + ramp * (force[i + 1] - force[i])
        states[i + 1] = z
    a = force - OMEGA**2 * states[:, 0] - 2.0 * ZETA * OMEGA * states[:, 1]
    kept = np.round(np.arange(0, round(rate * seconds)) * FINE / rate).astype(int)
    return StudyRecording(f"{rate:g} Hz", a[kept, None], force[kept, None], use, **options)


@pytest.mark.parametrize("rate", [4.0 * RATE, 2.5 * RATE, RATE / 2.0])
def test_what_was_measured_at_another_rate_is_as_if_measured_at_this_one(rate):
    found, native = at_rate(measured(rate), rate, RATE, UNKNOWN), measured(RATE)
    count = len(found.response)
    assert len(native.response) - 2 * 24 * max(1, RATE / rate) <= count <= len(native.response)
    assert found.initial == "rest"
    size = np.max(np.abs(native.response))
    assert_allclose(found.response, native.response[:count], atol=2e-4 * size)
    assert_allclose(found.force, native.force[:count], atol=2e-4)


def test_where_a_force_acts_at_once_rest_is_put_before_it():
    """A filter reaches back; what it finds before the first sample belongs to the recording."""
    early = 4.0 * WIDTH
    given, native = measured(4 * RATE, early), measured(RATE, early)
    found = at_rate(given, 4 * RATE, RATE, UNKNOWN)
    assert found.initial == "rest"
    before = len(found.response) + 24 - len(native.response)
    assert 15 <= before <= 24
    size = np.max(np.abs(native.response))
    assert_allclose(found.response[before:], native.response[:-24], atol=1e-3 * size)
    assert np.max(np.abs(found.response[:before])) < 1e-3 * size
    assert initial_state(replace(found, initial=None)) == "rest"


def test_a_recording_that_moves_at_first_loses_what_the_filter_cannot_know():
    whole = measured(4 * RATE)
    cut = StudyRecording("cut", whole.response[600:], whole.force[600:])
    found = at_rate(cut, 4 * RATE, RATE, UNKNOWN)
    assert found.initial == "unknown"
    assert_allclose(
        found.response[:, 0],
        measured(RATE).response[150 + 24 :][: len(found.response), 0],
        atol=2e-4 * np.max(np.abs(whole.response)),
    )


def test_the_noise_of_a_hit_that_is_cut_off_is_no_force():
    """It was taken for a shaker's, and drove the model."""
    whole = measured(4 * RATE)
    noisy = whole.force[400:] + 1e-3 * RNG.standard_normal((len(whole.force) - 400, 1))
    found = at_rate(StudyRecording("cut", whole.response[400:], noisy), 4 * RATE, RATE, UNKNOWN)
    assert found.initial == "unknown"
    assert_array_equal(found.force[50:], 0.0)
    assert not cleaned(found.force).endless


def test_a_decay_has_no_force_afterwards_either():
    whole = measured(4 * RATE)
    found = at_rate(StudyRecording("d", whole.response[800:], None), 4 * RATE, RATE, UNKNOWN)
    assert found.force is None
    assert len(found.response) == (len(whole.response) - 800) // 4 - 2 * 24


def test_a_period_stays_one():
    t = np.arange(2048) / 2048.0
    x = np.cos(2.0 * np.pi * 8.0 * t) + np.sin(2.0 * np.pi * 40.0 * t)
    given = StudyRecording("p", x[:, None], x[:, None], initial="periodic")
    found = at_rate(given, 2048.0, RATE, UNKNOWN)
    assert_allclose(found.response, given.response[::2], atol=1e-3)
    assert_allclose(found.force, given.force[::2], atol=1e-3)


@pytest.mark.parametrize("new", [RATE / 4.0, 2.0 * RATE])
def test_noise_keeps_its_density(new):
    """Per frequency, whatever passes the filter of it; the study's own figure as well."""
    x = RNG.standard_normal((40_000, 2))
    x[:, 1] = np.nan
    shaken = StudyRecording("n", x, RNG.standard_normal((40_000, 1)), initial="unknown")
    found = at_rate(shaken, RATE, new, np.full(2, np.nan))
    assert_allclose(found.noise.deviation[0], math.sqrt(new / RATE), rtol=0.1)
    stated = at_rate(shaken, RATE, new, np.array([3.0, 3.0]))
    assert_allclose(stated.noise.deviation[0], 3.0 * math.sqrt(new / RATE))
    assert np.all(np.isnan(found.response[:, 1]))
    power = np.abs(np.fft.rfft(found.response[:, 0])) ** 2 / len(found.response)
    low = round(0.3 * min(RATE, new) / new * len(found.response))
    assert_allclose(np.mean(power[1:low]), new / RATE, rtol=0.05)


def test_coloured_noise_is_that_of_the_band_that_is_compared():
    """Noise of 1/f beside a ringing mode: most of it is in the lowest quarter of the band."""
    count, new = 8_000, RATE / 4.0
    rng, f = np.random.default_rng(5), np.fft.rfftfreq(count, 1.0 / RATE)
    shaped = np.fft.rfft(rng.standard_normal(count)) / np.sqrt(np.maximum(f, f[1]))
    noise = np.fft.irfft(np.where(f > 0.0, shaped, 0.0), count)
    t = np.arange(count) / RATE
    ring = np.exp(-0.01 * OMEGA / 4.0 * t) * np.cos(OMEGA / 4.0 * t)
    given = StudyRecording("n", (noise / noise.std() + 400.0 * ring)[:, None], None)
    found = at_rate(given, RATE, new, UNKNOWN)
    # By frequency, as white noise that has as much of it below 0.4 of the new rate.
    whole = np.abs(np.fft.rfft(noise / noise.std())) ** 2 / count
    own = math.sqrt(np.mean(whole[(f > 0.0) & (f < 0.4 * new)]) * new / RATE)
    assert 0.6 * own < found.noise.deviation[0] < 1.5 * own
    assert found.noise.upper[0] > 0.8 * own


def test_the_lowest_rate_that_shows_all_is_taken():
    fast, slow = 4 * RATE, RATE
    both = [measured(fast), measured(slow, use="hold_out")]
    found, rate, told = at_one_rate(both, [fast, slow], UNKNOWN)
    assert rate == slow
    assert found[1] is both[1]
    (line,) = told
    assert "4096 Hz" in line
    assert "1024 Hz" in line


def test_a_rate_that_would_hide_motion_is_not_taken():
    """The recordings to fit say what has to be seen; those held out are interpolated."""
    fast, slow = measured(4 * RATE), measured(RATE, use="hold_out")
    t = np.arange(len(fast.response)) / (4 * RATE)
    ringing = 0.1 * np.max(np.abs(fast.response)) * np.sin(2 * np.pi * 700 * t)[:, None]
    both = [replace(fast, response=fast.response + ringing), slow]
    found, rate, told = at_one_rate(both, [4 * RATE, RATE], UNKNOWN)
    assert rate == 4 * RATE
    assert found[0] is both[0]
    assert "above 512 Hz" in told[0]


def test_a_clipped_recording_keeps_its_rate():
    fast, slow = measured(4 * RATE), measured(RATE, use="hold_out")
    limit = 0.5 * np.max(np.abs(fast.response))
    cut = replace(fast, response=np.clip(fast.response, -limit, limit))
    assert working_rate([fast, slow], [4 * RATE, RATE]) == RATE
    assert working_rate([cut, slow], [4 * RATE, RATE]) == 4 * RATE


def test_what_a_limit_cut_off_a_force_is_known_at_a_lower_rate():
    """A filtered limit shows nothing any more: the peaks go through the same filter."""
    whole = measured(4 * RATE)
    t = np.arange(len(whole.force)) / (4 * RATE)
    force = 2.0 * np.sin(2 * np.pi * (20.0 + 30.0 * t) * t)[:, None]
    limit = 1.2
    cut = replace(whole, force=np.clip(force, -limit, limit))
    expected, found = (
        at_rate(each, 4 * RATE, RATE, UNKNOWN) for each in (replace(whole, force=force), cut)
    )
    assert expected.force is not None
    assert found.force is not None
    missing = np.linalg.norm(expected.force - found.force)
    assert missing > 0.2 * np.linalg.norm(expected.force)
    back = found.force + found.cut_off(found.force)
    assert np.linalg.norm(back - expected.force) < 0.15 * missing
    assert not np.any(expected.cut_off(expected.force))


def test_recordings_of_one_rate_stay_as_they_are():
    """Rates that are told by rounded times are one; what is short is left as it was measured."""
    both = [measured(4 * RATE), measured(4 * RATE, 0.2)]
    found, rate, told = at_one_rate(both, [4 * RATE, 4 * RATE * (1 + 1e-9)], UNKNOWN)
    assert rate == 4 * RATE
    assert found[0] is both[0]
    assert found[1] is both[1]
    assert not told


def test_plenty_of_samples_are_brought_to_the_band_that_matters():
    long = measured(8 * RATE, seconds=3.0)
    rate = working_rate([long], [8 * RATE])
    assert rate < 2 * RATE
    assert (8 * RATE / rate).is_integer()
    assert 0.35 * rate > 60.0
    found = at_rate(long, 8 * RATE, rate, UNKNOWN)
    assert_array_equal(found.response.shape, found.force.shape)
