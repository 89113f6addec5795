"""Modes one at a time by first harmonics: eigenvalues, one mass, continued harmonic balance."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

import iwanjax as ij
from iwanjax.quasistatic.single_harmonic import OfJoint, backbones

M = np.diag([2.0, 1.5, 1.0])
K = np.array([[9.0, -4.0, 0.0], [-4.0, 7.5, -3.5], [0.0, -3.5, 3.5]])
ROW, OTHER = np.array([-1.0, 1.0, 0.0]), np.array([0.0, -1.0, 1.0])
IWAN = ij.Iwan4(F_S=1.0, K_T=2.0, chi=-0.4, beta=1.5)


def chain():
    return ij.JointedStructure(ij.LinearStructure(M, None, K), {"J1": (ROW, IWAN)})


def cycles(structure, elements, q, further=(), modes=(0, 1, 2)):
    basis = structure.basis
    rows = jnp.concatenate([basis.P, *(row[None] @ basis.Phi for row in further)])
    held = jnp.concatenate([basis.stiffness, jnp.zeros(len(further))])
    return backbones(
        basis,
        rows,
        held,
        elements,
        jnp.asarray(modes),
        jnp.broadcast_to(jnp.asarray(q), (len(modes), len(q))),
        jnp.zeros(len(modes)),
    )


def springs(k, other):
    """Cycles with springs at both places: another set than the one that the modes are of."""
    elements = [OfJoint(ij.LinearSpring(k)), OfJoint(ij.LinearSpring(other))]
    return cycles(chain(), elements, [0.1, 10.0], further=(OTHER,))


@pytest.mark.parametrize("k", [0.0, 0.3, 2.0, 6.0])
def test_springs_give_eigenvalues(k):
    """Whatever the springs are, and whether they stand beside or for the stuck joint."""
    found = springs(1.3, k)
    whole = K + 1.3 * np.outer(ROW, ROW) + k * np.outer(OTHER, OTHER)
    known = np.sqrt(scipy.linalg.eigh(whole, M, eigvals_only=True)) / (2.0 * np.pi)
    np.testing.assert_allclose(found.frequency, np.tile(known[:, None], 2), rtol=1e-9)
    np.testing.assert_allclose(found.damping, 0.0, atol=1e-12)


def test_one_mass_is_the_modal_oscillator():
    structure = ij.JointedStructure(
        ij.LinearStructure([[1.0]], [[0.02]], [[8.0]]), {"J": ([1.0], IWAN)}
    )
    q = np.geomspace(2e-3, 20.0, 9) * float(IWAN.phi_max)
    found = backbones(
        structure.basis,
        structure.basis.P,
        structure.basis.stiffness,
        [OfJoint(IWAN)],
        jnp.asarray([0]),
        jnp.asarray(q)[None],
        jnp.asarray([0.02]),
    )
    omega = np.sqrt(10.0)
    same = ij.ModalOscillator(omega / (2.0 * np.pi), 0.01 / omega, IWAN)
    f, zeta = same.ringdown_frequency_and_damping(q)
    np.testing.assert_allclose(found.frequency[0], f, rtol=1e-12)
    # The oscillator takes its slope from a difference.
    np.testing.assert_allclose(found.damping[0], zeta, rtol=1e-5)


@pytest.mark.parametrize("mode", [0, 2])
def test_frequencies_are_those_of_continued_harmonic_balance(mode):
    """Sliders, several harmonics and dynamics of their own; statics would be off ten times more."""
    structure = chain()
    size = float(IWAN.phi_max / abs(structure.basis.P[0, mode]))
    q = np.array([0.05, 0.3, 0.9, 2.0]) * size
    known = np.asarray(ij.nonlinear_modes(structure, mode, q).frequency)
    found = np.asarray(cycles(structure, [OfJoint(IWAN)], q, modes=(mode,)).frequency[0])
    fall = float(np.sqrt(structure.basis.omega2[mode])) / (2.0 * np.pi) - known
    assert np.all(np.abs(found - known) < 0.02 * fall)


def test_gradients_are_those_of_differences():
    q, structure = np.array([0.1, 0.5, 1.5]) * float(IWAN.phi_max), chain()

    def told(theta):
        joint = ij.Iwan4(F_S=theta[0], K_T=theta[1], chi=theta[2], beta=theta[3])
        found = cycles(structure, [OfJoint(joint)], q)
        return jnp.stack([found.frequency, found.damping])

    theta = jnp.asarray([1.0, 2.0, -0.4, 1.5])
    # One kernel for both.
    both = jax.jit(lambda theta: (told(theta), jax.jacfwd(told)(theta)))
    J = both(theta)[1]
    for i in range(theta.size):
        step = 1e-5 * jnp.eye(theta.size)[i]
        difference = (both(theta + step)[0] - both(theta - step)[0]) / 2e-5
        np.testing.assert_allclose(J[..., i], difference, rtol=1e-4, atol=1e-8)


def test_what_has_no_cycle_is_nan():
    elements = [OfJoint(IWAN), OfJoint(ij.CubicSpring(-1e4))]
    found = cycles(chain(), elements, [0.1], further=(OTHER,), modes=(0,))
    assert np.isnan(found.frequency[0, 0])


def test_a_mode_that_becomes_another_is_nan():
    found = np.asarray(springs(float(IWAN.K_T), 20.0).frequency)
    assert np.all(np.isfinite(found[0]))
    assert np.all(np.isnan(found[1]))
