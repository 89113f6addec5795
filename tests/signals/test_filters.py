import numpy as np
import pytest
import scipy.signal
from numpy.testing import assert_allclose

import iwanjax as ij
from iwanjax.signals.filters import (
    analytic_signal,
    band_pass,
    band_pass_gain,
    check_band,
    modal_filter,
    settling_time,
)

RATE = 2000.0
BAND = (90.0, 110.0)
CENTRE = np.sqrt(BAND[0] * BAND[1])


def times(seconds=4.0):
    return np.arange(int(seconds * RATE)) / RATE


def inside(t, order=3):
    """Where the ends of the record are long forgotten."""
    settled = 2.0 * settling_time(BAND, order)
    return (t > settled) & (t < t[-1] - settled)


@pytest.mark.parametrize("order", [1, 2, 3, 6])
def test_half_passes_at_the_corners_and_all_at_the_centre(order):
    gain = band_pass_gain(np.array([0.0, BAND[0], CENTRE, BAND[1], 1e6]), BAND, order)
    assert_allclose(gain, [0.0, 0.5, 1.0, 0.5, 0.0], rtol=1e-13, atol=1e-8)


@pytest.mark.parametrize("order", [1, 3, 4])
def test_the_gain_is_that_of_an_analog_butterworth_run_twice(order):
    corners = 2.0 * np.pi * np.array(BAND)
    zpk = scipy.signal.butter(order, corners, "bandpass", analog=True, output="zpk")
    f = np.linspace(60.0, 160.0, 101)
    _, response = scipy.signal.freqs_zpk(*zpk, 2.0 * np.pi * f)
    assert_allclose(band_pass_gain(f, BAND, order), np.abs(response) ** 2, rtol=1e-9)


@pytest.mark.parametrize("frequency", [BAND[0], 95.0, CENTRE, 108.0, 130.0])
def test_a_sine_keeps_its_phase_and_loses_what_the_gain_says(frequency):
    t = times()
    passed = band_pass(np.cos(2.0 * np.pi * frequency * t + 0.7), RATE, BAND)
    gain = band_pass_gain(np.array(frequency), BAND, 3)
    expected = gain * np.cos(2.0 * np.pi * frequency * t + 0.7)
    assert_allclose(passed[inside(t)], expected[inside(t)], rtol=0, atol=1e-5)


def test_the_analytic_signal_holds_envelope_and_phase():
    t = times()
    z = analytic_signal(3.0 * np.cos(2.0 * np.pi * CENTRE * t + 0.7), RATE, BAND)
    expected = 3.0 * np.exp(1j * (2.0 * np.pi * CENTRE * t + 0.7))
    assert_allclose(z[inside(t)], expected[inside(t)], rtol=0, atol=3e-5)


def test_what_happens_at_the_end_does_not_reach_the_beginning():
    t = times()
    hit = np.where(t > t[-1] - 0.5 * settling_time(BAND, 3), 1.0, 0.0)
    assert np.max(np.abs(analytic_signal(hit, RATE, BAND)[t < 2.0])) < 1e-6


@pytest.mark.parametrize(
    ("band", "order"),
    [
        (BAND, 2),
        (BAND, 3),
        (BAND, 6),
        ((60.0, 140.0), 3),
    ],
)
def test_a_tone_that_sets_in_has_settled_after_the_settling_time(band, order):
    t = times() - 2.0
    tone = np.where(t >= 0.0, np.sin(2.0 * np.pi * np.sqrt(band[0] * band[1]) * t), 0.0)
    envelope = np.abs(analytic_signal(tone, RATE, band, order))
    settled = settling_time(band, order)
    ends = (t > -1.0) & (t < 1.0)
    off = np.abs(envelope - (t >= 0.0))
    assert np.max(off[ends & (np.abs(t) > settled)]) < 1e-4
    # Nor is it much longer than it need be.
    assert np.max(off[ends & (np.abs(t) > 0.5 * settled)]) > 1e-4


def test_a_narrower_band_settles_more_slowly_in_proportion():
    assert settling_time((95.0, 105.0), 3) == pytest.approx(2.0 * settling_time(BAND, 3), rel=0.05)


def test_modes_are_told_apart_by_more_sensors_than_modes():
    rng = np.random.default_rng(0)
    q, shapes = rng.standard_normal((50, 3)), rng.standard_normal((5, 3))
    assert_allclose(modal_filter(q @ shapes.T, shapes), q, rtol=1e-12, atol=1e-12)


def test_with_a_sensor_at_every_coordinate_it_is_the_thesis_filter():
    rng = np.random.default_rng(1)
    root = rng.standard_normal((4, 4))
    M = root @ root.T + 4.0 * np.eye(4)
    Phi = np.linalg.solve(np.linalg.cholesky(M).T, np.linalg.qr(rng.standard_normal((4, 4)))[0])
    u = rng.standard_normal((20, 4))
    assert_allclose(modal_filter(u, Phi), u @ M @ Phi, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(
    ("responses", "shapes", "message"),
    [
        (np.ones((9, 1)), np.ones((1, 2)), r"1 sensor\(s\) tell only 1 of 2 modes"),
        (np.ones((9, 3)), np.ones((3, 2)), r"3 sensor\(s\) tell only 1 of 2 modes"),
        (np.ones((9, 3)), np.ones((2, 2)), r"\(9, 3\) and shapes \(2, 2\) do not match"),
        (np.ones(9), np.ones((1, 1)), r"expected \(N, sensors\)"),
    ],
)
def test_sensors_that_cannot_tell_modes_apart_are_refused(responses, shapes, message):
    with pytest.raises(ij.InputError, match=message):
        modal_filter(responses, shapes)


@pytest.mark.parametrize(
    ("band", "rate", "message"),
    [
        ((110.0, 90.0), RATE, "expected 0 < low < high"),
        ((90.0, 90.0), RATE, "expected 0 < low < high"),
        ((0.0, 90.0), RATE, "expected 0 < low < high"),
        ((np.nan, 90.0), RATE, "expected 0 < low < high"),
        ((90.0, 1000.0), RATE, "Nyquist frequency 1000 Hz"),
        ((90.0, np.inf), RATE, "Nyquist"),
        ((90.0, 100.0, 110.0), RATE, "two frequencies"),
        (100.0, RATE, "two frequencies"),
        ("ab", RATE, "two frequencies"),
        (None, RATE, "two frequencies"),
        (BAND, 0.0, "sampling_rate"),
        (BAND, np.nan, "sampling_rate"),
    ],
)
def test_a_bad_band_is_refused(band, rate, message):
    for use in (lambda: check_band(band, rate), lambda: band_pass(np.ones(500), rate, band)):
        with pytest.raises(ij.InputError, match=message) as caught:
            use()
        assert "\n" not in str(caught.value)


def test_a_band_of_whole_numbers_and_arrays_is_taken():
    assert check_band(np.array([90, 110]), 2000) == (90.0, 110.0)


def test_a_band_that_the_recording_does_not_resolve_is_refused_before_memory_is_asked_for():
    """Of two modes all but at one frequency: its filter would ring for days."""
    for filtered in (analytic_signal, band_pass, ij.ringdown_curves):
        with pytest.raises(
            ij.InputError, match=r"narrower than the 0.25 Hz that a recording of 4 s"
        ):
            filtered(np.sin(np.arange(8000)), RATE, (100.0, 100.0 + 1e-5))
    assert analytic_signal(np.ones(8000), RATE, (100.0, 101.0)).shape == (8000,)
