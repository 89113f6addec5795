import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iwanjax.errors import InputError
from iwanjax.signals import Channel, Recording
from iwanjax.signals.clipping import clipped_samples

N = 64
TIME = 0.5 + np.arange(N) / 128.0
RESPONSE = np.column_stack([np.sin(0.3 * np.arange(N)), np.cos(0.2 * np.arange(N))])
FORCE = np.exp(-0.5 * (np.arange(N) - 8.0) ** 2)[:, None]
CHANNELS = (Channel("tip", "acceleration", "m/s^2", "+x"), Channel("base"))
INPUTS = (Channel("hammer", "force", "N"),)
ARGUMENTS = {
    "time": TIME,
    "response": RESPONSE,
    "channels": CHANNELS,
    "force": FORCE,
    "inputs": INPUTS,
    "name": "hits.mat[3]",
}


def changed(array, index, value):
    array = np.array(array)
    array[index] = value
    return array


def test_what_a_recording_knows():
    recording = Recording(**ARGUMENTS)
    assert recording.size == N
    assert recording.sampling_rate == pytest.approx(128.0)
    assert recording.duration == pytest.approx(0.5)
    np.testing.assert_array_equal(recording.channel("base"), RESPONSE[:, 1])
    np.testing.assert_array_equal(recording.channel("hammer"), FORCE[:, 0])
    assert recording.clipped == {}


def test_arrays_are_copies_in_double_precision_and_read_only():
    counts = (1000 * RESPONSE).astype(np.int16)
    recording = Recording(TIME.astype(np.float32), counts, CHANNELS)
    assert {recording.time.dtype, recording.response.dtype} == {np.dtype(np.float64)}
    counts[:] = 0
    assert np.ptp(recording.response) > 1000
    with pytest.raises(ValueError, match="read-only"):
        recording.response[0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        recording.__setattr__("name", "other")


def test_one_channel_may_be_a_vector():
    assert Recording(TIME, RESPONSE[:, 0], CHANNELS[:1]).response.shape == (N, 1)


def test_a_force_may_be_zero():
    two = np.column_stack([FORCE, np.zeros(N)])
    recording = Recording(TIME, RESPONSE, CHANNELS, two, (*INPUTS, Channel("other")))
    assert not recording.channel("other").any()


@pytest.mark.parametrize("digits", [6, 7])
def test_a_little_rounding_of_time_is_no_fault(digits):
    time = np.round(np.arange(N) / 5120.0, digits)
    assert Recording(time, RESPONSE, CHANNELS).sampling_rate == pytest.approx(5120.0, rel=1e-3)


BAD = {
    "few samples": (
        {"time": TIME[:15], "response": RESPONSE[:15], "force": FORCE[:15]},
        ["time has 15 samples", "16"],
    ),
    "time of two axes": ({"time": RESPONSE}, ["time has shape (64, 2)", "(N,)"]),
    "NaN in time": ({"time": changed(TIME, 3, np.nan)}, ["time holds 1 NaN", "index 3"]),
    "time back": ({"time": changed(TIME, 9, 0.5)}, ["not increase at index 9", "sampling_rate"]),
    "time twice": ({"time": changed(TIME, 9, TIME[8])}, ["not increase at index 9"]),
    "jitter": (
        {"time": changed(TIME, 9, TIME[9] + 0.2 / 128.0)},
        ["not uniform: sample 9", "0.2 steps", "128 Hz", "resample"],
    ),
    "gap": ({"time": TIME + (np.arange(N) > 30) / 128.0}, ["not uniform", "resample"]),
    "other length": ({"response": RESPONSE[1:]}, ["response has shape (63, 2)", "(64, 2)"]),
    "other force": ({"force": FORCE[1:]}, ["force has shape (63, 1)", "(64, 1)"]),
    "too few channels": ({"channels": CHANNELS[:1]}, ["(64, 2)", "(64, 1)", "1 channels"]),
    "no channels": ({"response": np.zeros((N, 0)), "channels": ()}, ["no channels"]),
    "no inputs": ({"inputs": ()}, ["force has shape (64, 1)", "(64, 0)"]),
    "no force": ({"force": None}, ["1 inputs are named", "no force"]),
    "NaN": (
        {"response": changed(RESPONSE, (slice(5, 8), 1), np.nan)},
        ["'base' holds 3 NaN", "index 5", "t = 0.539062 s"],
    ),
    "infinite": ({"force": changed(FORCE, 2, np.inf)}, ["'hammer' holds 1 NaN", "index 2"]),
    "dead sensor": (
        {"response": changed(RESPONSE, (slice(None), 0), 1.5)},
        ["'tip' is 1.5 throughout", "connected"],
    ),
    "zero response": ({"response": RESPONSE * [0.0, 1.0]}, ["'tip' is 0 throughout"]),
    "constant force": ({"force": np.full((N, 1), 2.0)}, ["'hammer' is 2 throughout"]),
    "same name": ({"channels": (CHANNELS[0], Channel("tip"))}, ["'tip' names two channels"]),
    "name of a force": ({"inputs": (Channel("tip"),)}, ["'tip' names two channels"]),
    "complex": ({"response": RESPONSE * 1j}, ["response is of type complex128", "real"]),
    "text": ({"time": ["a"] * N}, ["time is of type", "real"]),
    "ragged": ({"response": [[1.0], [1.0, 2.0]]}, ["response", "rectangular"]),
}


@pytest.mark.parametrize(("change", "words"), BAD.values(), ids=BAD)
def test_a_fault_names_the_recording_and_the_channel(change, words):
    check_refused(lambda: Recording(**{**ARGUMENTS, **change}), ["hits.mat[3]: ", *words])


def test_an_unknown_channel():
    recording = Recording(**ARGUMENTS)
    check_refused(
        lambda: recording.channel("Tip"),
        ["hits.mat[3]", "'Tip'", "tip, base, hammer", "did you mean 'tip'?"],
    )


def test_a_faulty_channel():
    check_refused(lambda: Channel(""), ["no name"])
    check_refused(lambda: Channel("a", "accelaration"), ["'a'", "did you mean 'acceleration'?"])


def check_refused(call, words):
    with pytest.raises(InputError) as caught:
        call()
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


def sine(step, amplitude=1.0, phase=0.3, samples=2000):
    return amplitude * np.cos(step * np.arange(samples) + phase)


@pytest.mark.parametrize("step", [2.0 * np.pi / 3.0, np.pi / 2.0, 1.0, 0.1, 1e-3])
def test_a_clean_sine_is_not_clipped(step):
    assert clipped_samples(sine(step, phase=0.0)) == 0
    assert clipped_samples(sine(step)) == 0


@given(
    step=st.floats(1e-3, 2.5),
    amplitude=st.floats(2.0, 3e4),
    phase=st.floats(0.0, 6.3),
    ratio=st.floats(0.0, 0.1),
)
def test_a_sine_in_counts_is_not_clipped(step, amplitude, phase, ratio):
    # Slow and in coarse counts, its crests are runs of up to thousands of equal samples.
    counts = np.round(sine(step, amplitude, phase) * np.exp(-ratio * step * np.arange(2000)))
    assert clipped_samples(0.00314 * counts) == 0


@given(
    step=st.floats(0.01, 0.2),
    level=st.floats(0.5, 0.9),
    amplitude=st.sampled_from([200.0, 1e4, None]),
)
def test_a_saturated_sine_is_clipped(step, level, amplitude):
    x = sine(step, amplitude or 1.0)
    x = x if amplitude is None else np.round(x)
    limit = level * np.max(x) if amplitude is None else np.round(level * amplitude)
    resting = np.sum(np.abs(x) >= limit)
    assert 0.7 * resting <= clipped_samples(np.clip(x, -limit, limit)) <= resting


def test_one_side_and_one_overload_are_enough():
    x = sine(0.05) * np.exp(-2e-3 * np.arange(2000))
    top = np.minimum(x, 0.8)
    assert clipped_samples(top) == clipped_samples(-top) == np.sum(top == 0.8) > 5
    noisy = x + 1e-3 * np.random.default_rng(0).standard_normal(2000)
    assert clipped_samples(noisy) == 0
    assert clipped_samples(np.minimum(noisy, 0.8)) > 5


def test_a_hammer_between_its_rests_is_not_clipped():
    force = np.zeros(500)
    force[100:112] = 300.0 * np.sin(np.pi * np.arange(12) / 11.0)
    assert clipped_samples(force) == clipped_samples(force - 0.5) == 0
    assert clipped_samples(np.minimum(force, 250.0)) == 4


def test_clipping_of_what_is_no_vibration():
    assert clipped_samples(np.zeros(100)) == 0
    assert clipped_samples([]) == 0
    assert clipped_samples([np.nan] * 20) == 0
    assert clipped_samples([1.0, 2.0]) == 0


def test_missing_samples_do_not_hide_clipping():
    x = np.clip(sine(0.1), -0.8, 0.8)
    whole = clipped_samples(x)
    assert 0 < clipped_samples(changed(x, 1000, np.nan)) <= whole


def test_a_recording_names_its_clipped_channels():
    response = np.clip(RESPONSE, -2.0, [2.0, 0.6])
    assert list(Recording(TIME, response, CHANNELS).clipped) == ["base"]
