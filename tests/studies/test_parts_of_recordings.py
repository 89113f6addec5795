"""``from`` and ``to`` cut responses and forces alike, on the recording's own time axis."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import iwanjax as ij
from iwanjax.studies import diagnoses

RATE = 100.0
ONE = ij.oscillator(stiffness=30.0**2, joint=ij.Jenkins(F_S=1.0, K_T=700.0))
ROW = {"m": np.ones(1)}
X = np.random.default_rng(0).standard_normal((400, 2))


@dataclass(frozen=True)
class Said:
    """A verdict as far as a study adds to it."""

    warnings: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()


def recorded(time, response=X[:, 0], force=X[:, 1]):
    begun = ij.as_recording(
        response, force, sampling_rate=RATE, sensors="m", inputs=None if force is None else "f"
    )
    return replace(begun, time=time)


def study(*recordings):
    return ij.Study(ONE, recordings, rows=ROW, sensors=ROW, inputs={"f": np.ones(1)})


def handed_over(monkeypatch, *recordings):
    """What a study's recordings become before they are diagnosed."""
    taken = []

    def said(*given, **_):
        taken.append(given)
        return Said()

    monkeypatch.setattr(diagnoses, "diagnose_histories", said)
    study(*recordings).diagnose()
    return taken[0][1]


@pytest.mark.parametrize("begin", [0.0, -1.0, 7.0])
def test_response_and_force_are_cut_alike(monkeypatch, begin):
    whole = recorded(begin + np.arange(400) / RATE)
    part = ij.Measurement(whole, start=begin + 0.5, end=begin + 2.0)
    (given,) = handed_over(monkeypatch, part)
    assert_array_equal(given.response[:, 0], X[50:201, 0])
    assert_array_equal(given.force[:, 0], X[50:201, 1])


def test_without_either_the_recording_is_whole(monkeypatch):
    whole = recorded(np.arange(400) / RATE)
    from_one, to_one = handed_over(
        monkeypatch, ij.Measurement(whole, start=1.0), ij.Measurement(whole, end=1.0)
    )
    assert_array_equal(from_one.response[:, 0], X[100:, 0])
    assert_array_equal(to_one.response[:, 0], X[:101, 0])
    assert len(handed_over(monkeypatch, whole)[0].response) == 400


def test_a_decay_begins_where_it_is_said_to(monkeypatch):
    t = 3.0 + np.arange(400) / RATE
    x = np.exp(-0.5 * (t - 3.0)) * np.cos(40.0 * (t - 3.0))
    decay = recorded(t, x, None)
    given, found = handed_over(monkeypatch, ij.Measurement(decay, start=4.0), decay)
    assert given.force is None
    assert_array_equal(given.response[:, 0], x[100:])
    assert_array_equal(found.response[:, 0], x[8:])


@pytest.mark.parametrize(
    ("span", "words"),
    [
        ({"start": -0.5}, ["recordings[0].start: got -0.5 s", "lasts from 0 to 3.99 s"]),
        ({"start": 4.5}, ["recordings[0].start: got 4.5 s"]),
        ({"end": 4.5}, ["recordings[0].end: got 4.5 s"]),
        ({"start": 1.0, "end": 1.0}, ["recordings[0].end: got 1;", "more than start = 1"]),
        ({"end": 0.05}, ["recordings[0].end: leaves 6 sample(s)", "at least 16"]),
        ({"start": 3.75}, ["recordings[0].start: leaves 25 samples", "needs 36"]),
    ],
)
def test_a_part_that_is_not_there_is_refused(span, words):
    whole = recorded(np.arange(400) / RATE)
    with pytest.raises(ij.InputError) as refused:
        study(ij.Measurement(whole, **span)).diagnose()
    for word in words:
        assert word in str(refused.value)


def test_the_state_in_which_it_begins_is_passed_on(monkeypatch):
    whole = recorded(np.arange(400) / RATE)
    given = [ij.Measurement(whole, initial=said) for said in ("rest", "unknown", "periodic")]
    found = handed_over(monkeypatch, *given, whole)
    assert [each.initial for each in found] == ["rest", "unknown", "periodic", None]
