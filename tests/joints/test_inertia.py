"""Inertia as a joint: a mass in another place of the equations."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

import iwanjax as ij
from iwanjax.joints import AbstractStepped, Inertia, ParameterInfo

M, K = np.diag([1.0, 2.0]), np.array([[300.0, -100.0], [-100.0, 100.0]])
ROW = np.array([-1.0, 1.0])


class Flywheel(AbstractStepped):
    """A law of one's own that is inertial: a flywheel behind a rack."""

    parameters = (ParameterInfo("J", "mass*length^2", "inertia", 0.0),)
    inertial = True
    J: Array = eqx.field(converter=jnp.asarray)

    def follow(self, motion, memory):
        return self.J / 0.5**2 * motion.a, memory


def joined(**joints):
    spring = ij.CubicSpring(k3=1e4)
    return ij.JointedStructure(
        ij.LinearStructure(M, 0.01 * M, K), {"s": (np.array([1.0, 0.0]), spring)} | joints
    )


def test_an_inerter_is_its_matrix():
    """Smith (2002), Eq. (1): F = b (v2' - v1'), so M + b r r^T; modes, QSMA and motion know it."""
    b = 0.7
    spring = {"s": (np.array([1.0, 0.0]), ij.CubicSpring(k3=1e4))}
    expected = ij.JointedStructure(
        ij.LinearStructure(M + b * np.outer(ROW, ROW), 0.01 * M, K), spring
    )
    seen = joined(b=(ROW, Inertia(b)))
    assert seen.labels == ("s",)
    np.testing.assert_allclose(seen.modes().omega, expected.modes().omega, rtol=1e-12)
    assert np.all(seen.modes().omega < joined().modes().omega)
    alpha = np.geomspace(1e-3, 0.3, 5)
    np.testing.assert_allclose(
        ij.qsma(seen, mode=0, alpha=alpha).curves.frequency,
        ij.qsma(expected, mode=0, alpha=alpha).curves.frequency,
        rtol=1e-12,
    )
    start = {"displacement": [0.1, -0.2], "velocity": [1.0, 0.5]}
    motion = [ij.simulate(js, np.zeros((300, 2)), 5e-3, **start) for js in (seen, expected)]
    np.testing.assert_allclose(motion[0].displacement, motion[1].displacement, atol=1e-12)


def test_so_is_an_inertial_law_of_one_s_own():
    np.testing.assert_allclose(
        joined(b=(ROW, Flywheel(0.175))).structure.M, M + 0.7 * np.outer(ROW, ROW), rtol=1e-12
    )


def test_what_a_mass_matrix_cannot_take_is_refused():
    with pytest.raises(ij.InputError, match=r"'b' is a batch of \(2,\) inertias; expected one"):
        joined(b=(ROW, Inertia(jnp.array([0.5, 3.0]))))
    with pytest.raises(ij.InputError, match=r"'b' is an inertia, part of the mass matrix"):
        joined(b=(ROW, Inertia(0.7))).with_joints({"b": Inertia(0.8)})


def test_its_force_is_that_of_the_acceleration_of_a_history():
    """By a numerical route of its own: the second derivative of a smooth history."""
    dt = 1e-3
    t = dt * np.arange(800)
    d = 1e-3 * t**3 * np.sin(20.0 * t)
    force = ij.hysteresis(Inertia(2.5), d, dt=dt)
    # Rates of a history are those of the middle of each step.
    a = np.gradient(np.gradient(d, dt), dt)
    np.testing.assert_allclose(force[5:-2], 2.5 * a[5:-2], atol=0.03 * np.max(np.abs(2.5 * a)))


def test_over_a_cycle_it_loses_and_carries_nothing():
    joint, d = Inertia(jnp.array([0.5, 3.0])), np.array([0.1, 2.0])
    for found in (joint.dissipation(d, omega=3.0), joint.secant(d), joint.harmonic_stiffness(d)):
        np.testing.assert_array_equal(found, 0.0)
    with pytest.raises(ij.InputError, match=r"m = -1 \(mass\)"):
        Inertia(-1.0)
