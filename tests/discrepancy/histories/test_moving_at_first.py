"""Recordings that begin in the middle of a motion, under a force that goes on."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.integrate
from linear_pair import RATE, C, M, model, state_matrix, stiffness_with_joint

import iwanjax as ij
from iwanjax.discrepancy import StudyRecording
from iwanjax.discrepancy.histories.diagnose import diagnose_histories

N, CUT, K3 = 800, 317, 3e9
AXES = {"m1": np.eye(2)[0], "m2": np.eye(2)[1]}


def recorded(cubic: float, seed: int) -> StudyRecording:
    """A multisine up to 150 Hz at the first mass and a spring k3 d^3 at the second; by DOP853."""
    random = np.random.default_rng(seed)
    lines = np.arange(2.0, 150.0, 0.7)
    phase = random.uniform(0.0, 2.0 * np.pi, len(lines))
    A = state_matrix(M, C, stiffness_with_joint())

    def force(t: np.ndarray) -> np.ndarray:
        return 2.0 * np.cos(2.0 * np.pi * np.outer(t, lines) + phase).sum(axis=1)

    t = np.arange(CUT + N) / RATE

    # Exact between: the force is a sum of cosines, evaluated where the solver asks.
    def rate(s: float, z: np.ndarray) -> np.ndarray:
        acting = np.array([float(force(np.array([s]))[0]), -cubic * z[1] ** 3])
        return A @ z + np.concatenate([np.zeros(2), np.linalg.solve(M, acting)])

    z = scipy.integrate.solve_ivp(
        rate, (0.0, t[-1]), np.zeros(4), "DOP853", t, rtol=1e-9, atol=1e-13, max_step=2e-3
    ).y
    y = np.array([rate(s, each)[2:] for s, each in zip(t, z.T, strict=True)])
    y = y + 2e-3 * np.std(y, axis=0) * random.standard_normal(y.shape)
    forces = np.stack([force(t), np.zeros(len(t))], axis=1)
    return StudyRecording(f"cut {seed}", y[CUT:], forces[CUT:])


@pytest.fixture(scope="module")
def cubic() -> list[StudyRecording]:
    uses = ("fit", "fit", "hold_out")
    return [replace(recorded(K3, i), use=use) for i, use in enumerate(uses)]


def diagnosed(recordings: list[StudyRecording]) -> ij.Diagnosis:
    return diagnose_histories(
        model(joint=False),
        recordings,
        RATE,
        rows=AXES,
        sensors=AXES,
        inputs=AXES,
        hypotheses=("stiffness_error", "viscous_damping", "cubic_stiffness", "sensor_gain"),
    )


@pytest.fixture(scope="module")
def found(cubic: list[StudyRecording]) -> ij.Diagnosis:
    return diagnosed(cubic)


def test_the_state_is_estimated_with_everything_else(found):
    """Found in the middle of a motion, to the noise in the recording that was not seen."""
    assert found.verdict.name == "something_missing"
    first = found.what[0]
    assert first.label == "cubic_stiffness@m2"
    (k3,) = first.parameters
    assert abs(k3.value - K3) < max(4.0 * k3.std, 0.01 * K3)
    assert found.after.hold_out < 1.5 * found.noise_floor.hold_out


@pytest.mark.long
def test_taken_for_rest_it_predicts_less(cubic, found):
    rest = diagnosed([replace(each, initial="rest") for each in cubic])
    assert rest.after.hold_out > 5.0 * found.after.hold_out
