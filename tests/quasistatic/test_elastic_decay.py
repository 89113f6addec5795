"""What a free decay shows beside an elastic force: SciPy integrates, the closed form predicts."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

import iwanjax as ij
from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.identification.steady.cycle import beside
from iwanjax.quasistatic import ModalOscillator
from iwanjax.quasistatic.modal import about
from iwanjax.quasistatic.single_harmonic import OfJoint, backbones

F_0, ZETA_0, Q, RATE, SECONDS = 28.0, 1.3e-3, 1e-3, 1024.0, 8.0
OMEGA2 = (2.0 * np.pi * F_0) ** 2
# Both raise the frequency at Q by one per cent.
CUBIC, STOP, CLEARANCE = 0.027 * OMEGA2 / Q**2, 0.1 * OMEGA2, 0.5 * Q
SPRINGS = {
    "cubic_stiffness": (ij.CubicSpring(CUBIC), CUBIC, 1.0),
    "gap_contact": (ij.Gap(STOP, CLEARANCE), STOP, CLEARANCE),
}


def decay(force):
    """Curves of the acceleration, which is that of the mass itself."""

    def motion(_, y):
        return [y[1], -OMEGA2 * y[0] - 2.0 * ZETA_0 * np.sqrt(OMEGA2) * y[1] - force(y[0])]

    time = np.arange(int(SECONDS * RATE)) / RATE
    x = solve_ivp(
        motion, (0.0, time[-1]), [Q, 0.0], "DOP853", time, rtol=1e-9, atol=1e-13, max_step=2e-3
    ).y
    acceleration = np.array([motion(0.0, y)[1] for y in x.T])
    found = ij.ringdown_curves(acceleration, RATE, (20.0, 38.0), quantity="acceleration")
    return found.as_quantity("displacement")


# Its slope at the tip, where its secant belongs, would be 3.5 and 8 % of damping off.
@pytest.mark.parametrize("name", SPRINGS)
def test_an_elastic_force_counts_at_the_tip_with_its_secant(name):
    spring, size, shape = SPRINGS[name]
    force = {
        "cubic_stiffness": lambda x: CUBIC * x**3,
        "gap_contact": lambda x: STOP * np.sign(x) * max(abs(x) - CLEARANCE, 0.0),
    }[name]
    curves = decay(force)
    q = np.asarray(curves.amplitude)
    assert q.max() > 0.8 * Q
    assert q.min() < 0.3 * Q
    unit = beside(CATALOGUE[name][0], shape, np.asarray(about(q)), np.sqrt(OMEGA2))
    force_beside = type(unit)(*(size * np.asarray(each) for each in unit))
    bare = ModalOscillator(F_0, ZETA_0, ij.CubicSpring(0.0))
    for f, zeta in (
        ModalOscillator(F_0, ZETA_0, spring).ringdown_frequency_and_damping(q),
        bare.ringdown_frequency_and_damping(q, force_beside),
    ):
        np.testing.assert_allclose(f, curves.frequency, rtol=5e-5)
        np.testing.assert_allclose(zeta, curves.damping, rtol=0.01)


def test_in_a_structure_as_well():
    """A hardening spring between two masses of a chain, in its second mode."""
    M, C = np.diag([1.0, 1.5]), 0.5 * np.eye(2)
    K, row = np.array([[9e4, -5e4], [-5e4, 1.2e5]]), np.array([1.0, -1.0])
    squared, shapes = eigh(K, M)
    phi, stroke, mode = shapes[:, 1], row @ shapes[:, 1], 1
    size = 1e-3
    k3 = 0.027 * squared[mode] / (stroke**4 * size**2)

    def motion(_, y):
        u, v = y[:2], y[2:]
        return np.concatenate([v, -(C @ v + K @ u + k3 * (row @ u) ** 3 * row) / np.diag(M)])

    time = np.arange(int(5.0 * RATE)) / RATE
    start = np.concatenate([size * phi, np.zeros(2)])
    y = solve_ivp(
        motion, (0.0, time[-1]), start, "DOP853", time, rtol=1e-9, atol=1e-13, max_step=1e-3
    ).y
    modal = phi @ M @ np.array([motion(0.0, each)[2:] for each in y.T]).T
    f_0 = np.sqrt(squared[mode]) / (2.0 * np.pi)
    curves = ij.ringdown_curves(modal, RATE, (0.8 * f_0, 1.2 * f_0), quantity="acceleration")
    curves = curves.as_quantity("displacement")
    q = np.asarray(curves.amplitude)
    assert q.max() > 0.8 * size
    spring = ij.CubicSpring(k3)
    basis = ij.JointedStructure(ij.LinearStructure(M, C, K), {"S": (row, spring)}).basis
    viscous = jnp.asarray([phi @ C @ phi])
    found = backbones(
        basis, basis.P, basis.stiffness, [OfJoint(spring)], jnp.asarray([mode]), q[None], viscous
    )
    np.testing.assert_allclose(found.frequency[0], curves.frequency, rtol=5e-5)
    np.testing.assert_allclose(found.damping[0], curves.damping, rtol=0.01)
