"""Inertia as a joint: a mass in another place of the equations."""

import jax.numpy as jnp
import numpy as np
import pytest

import iwanjax as ij
from iwanjax.joints import Inertia

M, K, DT = 2.0, 800.0, 2e-3


def structure(m: float, joint: float) -> ij.JointedStructure:
    one = np.ones((1, 1))
    linear = ij.LinearStructure(m * one, 3.0 * one, K * one)
    return ij.JointedStructure(linear, {"J1": (np.ones(1), Inertia(joint))})


def pulse(dt: float, samples: int) -> np.ndarray:
    t = dt * np.arange(samples)
    return np.where(t < 0.1, np.sin(np.pi * t / 0.1) ** 2, 0.0)[:, None]


@pytest.mark.parametrize("start", ["struck", "released", "moving"])
def test_a_mass_of_the_joint_is_one_of_the_structure(start):
    """The limit: of two ways to place the same mass; errors fall with the step's square."""
    given = {
        "struck": {},
        "released": {"displacement": [1e-3]},
        "moving": {"velocity": [2e-2]},
    }[start]
    errors = []
    for dt in (DT, DT / 2, DT / 4):
        samples = round(0.5 / dt)
        force = pulse(dt, samples) * (start == "struck")
        options = {"accuracy": None, "keep": ["displacement"], **given}
        seen, whole = (
            np.ravel(ij.simulate(s, force, dt, **options).displacement)
            for s in (structure(M, 0.6), structure(M + 0.6, 0.0))
        )
        errors.append(np.max(np.abs(seen - whole)) / np.max(np.abs(whole)))
    assert errors[-1] < 2e-3
    # A motion that begins with an acceleration loses the first half step of it.
    assert errors[1] / errors[2] > (3.5 if start == "struck" else 1.8)


def test_its_force_is_that_of_the_acceleration_of_a_history():
    """By a numerical route of its own: the second derivative of a smooth history."""
    dt = 1e-3
    t = dt * np.arange(800)
    d = 1e-3 * t**3 * np.sin(20.0 * t)
    force = ij.hysteresis(Inertia(2.5), d, dt=dt)
    # Rates of a history are those of the middle of each step.
    a = np.gradient(np.gradient(d, dt), dt)
    np.testing.assert_allclose(force[5:-2], 2.5 * a[5:-2], atol=0.03 * np.max(np.abs(2.5 * a)))


def test_an_inerter_is_its_matrix():
    """Smith (2002), Eq. (1): F = b (v2' - v1'), here by the frequencies of two masses."""
    M, K, b = np.diag([1.0, 2.0]), np.array([[300.0, -100.0], [-100.0, 100.0]]), 0.7
    row = np.array([-1.0, 1.0])
    by_matrix = ij.LinearStructure(M + b * np.outer(row, row), 0.0 * M, K).modes()
    joined = ij.JointedStructure(ij.LinearStructure(M, 0.0 * M, K), {"b": (row, Inertia(b))})
    dt, n = 2e-3, 400
    q = np.asarray(by_matrix.Phi)[:, 1]
    found = ij.simulate(
        joined, np.zeros((n, 2)), dt, displacement=1e-3 * q, accuracy=None, keep=["displacement"]
    )
    wave = np.cos(float(by_matrix.omega[1]) * dt * np.arange(n))
    seen = np.asarray(found.displacement) @ q / (1e-3 * q @ q)
    np.testing.assert_allclose(seen, wave, atol=0.05)


def test_over_a_cycle_it_loses_and_carries_nothing():
    joint, d = Inertia(jnp.array([0.5, 3.0])), np.array([0.1, 2.0])
    for found in (joint.dissipation(d, omega=3.0), joint.secant(d), joint.harmonic_stiffness(d)):
        np.testing.assert_array_equal(found, 0.0)
    with pytest.raises(ij.InputError, match=r"m = -1 \(mass\)"):
        Inertia(-1.0)
