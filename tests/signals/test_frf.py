"""Frequency response functions against an oscillator's own; noise where each estimator fails."""

from typing import Any

import numpy as np
import pytest
import scipy.signal

import iwanjax as ij
from iwanjax.signals.frf import frequency_responses

RATE, OMEGA, ZETA = 256.0, 2.0 * np.pi * 12.0, 0.02


def exact(s):
    """Velocity per force of a unit mass."""
    return s / (s**2 + 2.0 * ZETA * OMEGA * s + OMEGA**2)


def response_to(force, fine=16):
    """Velocity of the unit mass to a band-limited force, from rest."""
    dense = scipy.signal.resample(force, len(force) * fine)
    system = ([1.0, 0.0], [1.0, 2.0 * ZETA * OMEGA, OMEGA**2])
    discrete: Any = scipy.signal.cont2discrete(system, 1.0 / (RATE * fine), method="foh")
    b, a = discrete[:2]
    return np.asarray(scipy.signal.lfilter(b.ravel(), a, dense))[::fine]


def multisine(random, count=1024):
    spectrum = np.zeros(count // 2 + 1, complex)
    lines = slice(8, 200)
    spectrum[lines] = np.exp(2j * np.pi * random.random(192))
    return np.fft.irfft(spectrum, count) * count / 20.0


def recorded(response, force, **said):
    known = {"sampling_rate": RATE, "sensors": "x", "inputs": "F", "quantity": "velocity"}
    return ij.as_recording(response, force, **(known | said))


def test_periods_are_found_and_the_start_left_out():
    force = np.tile(multisine(np.random.default_rng(0)), 8)
    found = frequency_responses(recorded(response_to(force), force), (5.0, 40.0))
    assert found.excitation == "periodic"
    assert len(found.frequency) == 141  # lines a quarter of a Hz apart, as 4 s have
    assert found.averages < 8
    np.testing.assert_allclose(found.frf[:, 0, 0], exact(found.s), rtol=5e-3)
    assert np.all(found.coherence > 0.999)


def test_an_exponential_window_shifts_s_and_nothing_else():
    # A hit whose response is far from over at the end of the record.
    t = np.arange(512) / RATE
    force = np.exp(-0.5 * ((t - 0.1) / 0.012) ** 2)
    response = response_to(np.pad(force, (0, 1536)))[:512]
    assert np.abs(response[-50:]).max() > 0.02 * np.abs(response).max()
    found = frequency_responses(recorded(response, force), (5.0, 20.0), window=8.0)
    assert found.excitation == "transient"
    np.testing.assert_allclose(np.real(found.s), 8.0)
    np.testing.assert_allclose(found.frf[:, 0, 0], exact(found.s), rtol=1e-3)


def test_each_estimator_stands_its_noise():
    random = np.random.default_rng(1)
    clean = np.tile(multisine(random), 200)
    moved = response_to(clean)
    at = {}
    for where, of_force, of_response in (("response", 0.0, 1.0), ("force", 1.0, 0.0)):
        force = clean + of_force * np.std(clean) * random.standard_normal(clean.shape)
        response = moved + of_response * np.std(moved) * random.standard_normal(clean.shape)
        for estimator in ("H1", "H2", "Hv"):
            found = frequency_responses(
                recorded(response, force), (8.0, 20.0), estimator=estimator, period=4.0
            )
            gain = np.abs(found.frf[:, 0, 0]) / np.abs(exact(found.s))
            at[where, estimator] = float(np.median(gain))
    assert at["response", "H1"] == pytest.approx(1.0, abs=0.01)
    assert at["force", "H2"] == pytest.approx(1.0, abs=0.01)
    # The other way round each is biased, as its formula says, and Hv lies between.
    assert at["response", "H2"] > 1.02
    assert at["force", "H1"] < 0.98
    for where in ("response", "force"):
        assert at[where, "Hv"] == pytest.approx(
            np.sqrt(at[where, "H1"] * at[where, "H2"]), rel=0.01
        )


def test_the_scatter_is_that_of_repeats():
    random = np.random.default_rng(2)
    clean = np.tile(multisine(random), 9)
    moved, off = response_to(clean), []
    for _ in range(40):
        noisy = moved + 0.1 * np.std(moved) * random.standard_normal(moved.shape)
        found = frequency_responses(recorded(noisy, clean), (8.0, 20.0), period=4.0)
        off.append((found.frf - exact(found.s)[:, None, None]) / found.frf_std)
    # Of the complex value, by the mean square of some thousand of them.
    assert np.mean(np.abs(off) ** 2) == pytest.approx(1.0, rel=0.25)


def test_two_inputs_at_once_need_two_records():
    random = np.random.default_rng(3)
    force = np.stack([np.tile(multisine(random), 4) for _ in range(2)], axis=1)
    both = recorded(response_to(force[:, 0]), force, inputs=["F", "G"])
    with pytest.raises(ij.InputError, match="do not tell the inputs F, G apart"):
        frequency_responses(both, (8.0, 20.0))
    other = np.stack([np.tile(multisine(random), 4) for _ in range(2)], axis=1)
    second = recorded(response_to(other[:, 0]), other, inputs=["F", "G"], name="second")
    found = frequency_responses([both, second], (8.0, 20.0))
    np.testing.assert_allclose(found.frf[:, 0, 0], exact(found.s), rtol=0.01)
    assert np.max(np.abs(found.frf[:, 0, 1])) < 0.01 * np.max(np.abs(found.frf[:, 0, 0]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"quantity": ""}, "measures something unknown"),
        ({"band": (30.0, 30.5)}, "has 3 lines"),
        ({"estimator": "H3"}, "expected H1, H2 or Hv"),
        ({"period": 1e3}, "period = 1000 s is 256000 samples"),
    ],
)
def test_what_cannot_be_is_said(change, message):
    force = np.tile(multisine(np.random.default_rng(4)), 4)
    said = {"quantity": "velocity", "band": (8.0, 20.0)} | change
    recording = recorded(force, force, quantity=said.pop("quantity"))
    with pytest.raises(ij.InputError, match=message):
        frequency_responses(recording, **said)
