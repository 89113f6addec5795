"""A modal test of a beam that SciPy has integrated: twelve noisy sensors, four hammer points."""

import numpy as np
import pytest
from hammered_beam import POINTS, RATE, SENSORS, ZETA, beam, hits

import iwanjax as ij

BAND = (8.0, 700.0)


@pytest.fixture(scope="module")
def recordings():
    return [
        ij.as_recording(
            response,
            force,
            sampling_rate=RATE,
            sensors=SENSORS,
            inputs=f"hammer {point + 1}",
            quantity="acceleration",
            name=f"hit {i}",
        )
        for i, (point, response, force) in enumerate(hits(np.random.default_rng(0)))
    ]


@pytest.fixture(scope="module")
def test(recordings):
    places = {f"hammer {point + 1}": SENSORS[point] for point in POINTS}
    return ij.modal_test(recordings, BAND, driving_points=places)


def test_modes_are_those_of_the_beam(test):
    omega, Phi = beam()
    f = omega / (2.0 * np.pi)
    n = int(np.sum((f > BAND[0]) & (f < BAND[1])))
    assert test.frequency.size == n == 4
    np.testing.assert_allclose(test.frequency, f[:n], rtol=5e-4)
    np.testing.assert_allclose(test.damping, ZETA[:n], rtol=0.05)
    assurance = np.asarray(ij.modal_assurance(test.shapes, Phi[:, :n]))
    assert np.all(np.diag(assurance) > 0.99)
    # Mass-normalised by the driving points, with no scale to spare.
    scale = np.abs(np.sum(test.shapes * Phi[:, :n], axis=0) / np.sum(Phi[:, :n] ** 2, axis=0))
    np.testing.assert_allclose(scale, 1.0, rtol=0.02)


def test_the_exponential_window_is_taken_off_the_damping(test):
    # It adds as much to the decay rate as three quarters of the first mode has.
    assert test.responses.window > 0.7 * ZETA[0] * beam()[0][0]


def test_its_structure_answers_as_the_beam_does(test):
    model = test.model()
    M, C, K = (np.asarray(getattr(model.structure, name)) for name in "MCK")
    sensors, inputs = (np.stack(list(each.values())) for each in (model.sensors, model.inputs))
    omega, Phi = beam()
    omega, Phi = omega[: len(ZETA)], Phi[:, : len(ZETA)]
    off, whole = [], []
    # Lines of the measurement, so that resonances weigh as they do there.
    for w in 2.0 * np.pi * test.responses.frequency[::3]:
        shown = -(w**2) * sensors @ np.linalg.solve(K - w**2 * M + 1j * w * C, inputs.T)
        known = -(w**2) * (Phi / (omega**2 - w**2 + 2j * ZETA * omega * w)) @ Phi[list(POINTS)].T
        off.append(shown - known)
        whole.append(known)
    # As exact as the sensors, whose noise is 1 %.
    assert np.linalg.norm(off) < 0.01 * np.linalg.norm(whole)
    # Rows: each sensor against the ground, and each two against each other.
    rows = model.rows
    np.testing.assert_array_equal(rows["a3-a2"], rows["a3-ground"] - rows["a2-ground"])
    assert len(rows) == len(SENSORS) + len(SENSORS) * (len(SENSORS) - 1) // 2


def test_it_is_saved_and_shown(test, tmp_path):
    again = type(test).load(test.save(tmp_path / "test.npz"))
    np.testing.assert_array_equal(again.shapes, test.shapes)
    assert again.summary() == test.summary()
    assert "mass-normalised" in test.summary()
    assert len(test.plot().axes) == 3
    assert test.to_dict()["frequency"].shape == test.frequency.shape
