"""Mains hum in the recordings of a modal test, as strong as the response itself."""

import numpy as np
import pytest

import iwanjax as ij

RATE, N = 1024, 8192
T = np.arange(N) / RATE
MODES = ((80.0, 5e-3), (180.0, 4.4e-4))


def velocity():
    """Of a hit whose driving point is the sensor: the sum of the modes' impulse responses."""
    force = np.asarray(ij.half_sine(T - 0.01, 100.0, np.pi / 4e-3))
    response = np.zeros(N)
    for frequency, zeta in MODES:
        omega, share = 2.0 * np.pi * frequency, np.sqrt(1.0 - zeta**2)
        cosine, sine = np.cos(share * omega * T), np.sin(share * omega * T)
        response += np.exp(-zeta * omega * T) * (cosine - zeta / share * sine)
    response[0] *= 0.5  # of a jump, the integral has half
    return force, np.convolve(force, response)[:N] / RATE


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_hum_is_no_mode_and_ends_no_test(noise):
    force, v = velocity()
    random = np.random.default_rng(0)
    hits = [
        ij.as_recording(
            v + v.std() * (np.cos(2 * np.pi * 50 * T + i) + noise * random.standard_normal(N)),
            force,
            sampling_rate=RATE,
            sensors="tip",
            inputs="hammer",
            quantity="velocity",
            name=f"hit {i}",
        )
        for i in range(3)
    ]
    test = ij.modal_test(hits, band=(20, 300), driving_points={"hammer": "tip"})
    found = np.asarray(test.frequency), np.asarray(test.damping)
    for value, true, close in zip(found, zip(*MODES, strict=True), (1e-5, 0.005), strict=True):
        assert np.allclose(value, true, rtol=close)
