"""Nonlinear modes by phase resonance against closed forms and quasi-static analysis."""

from functools import cache

import numpy as np
import pytest

import iwanjax as ij
from iwanjax.dynamics import nonlinear_modes

ODD = (1, 3, 5, 7)
# Of the joint that the three masses come with: F_S = 10, K_T = 1, chi = -0.5, beta = 5.
PHI_MAX = 10.0 * 6.0 / (5.0 + 1.0 / 3.0)


def test_oscillator_follows_the_first_harmonic_closed_form():
    joint = ij.Iwan4(F_S=1.0, K_T=1.0, chi=-0.5, beta=0.5)
    system = ij.oscillator(stiffness=9.0, joint=joint, zeta=0.002)
    q = np.geomspace(1e-2, 10.0, 10) * float(joint.phi_max)
    curves = nonlinear_modes(system, 0, q, harmonics=ODD)
    closed = ij.ModalOscillator(np.sqrt(10.0) / (2 * np.pi), 0.002, joint)
    frequency, damping = closed.frequency_and_damping(q)
    np.testing.assert_array_equal(curves.amplitude, q)
    # Higher harmonics of the motion and 200 sliders; measured 1e-5 and 1e-3 at most, both in
    # macroslip, where the force is nearest to a square wave.
    np.testing.assert_allclose(curves.frequency, frequency, rtol=2e-5)
    np.testing.assert_allclose(curves.damping, damping, rtol=2e-3)


# Levels close together, as many in all of these for the same reason.
CLOSE = np.geomspace(1e-3, 1e3, 61)


def softened(joint):
    return ij.oscillator(stiffness=3.0, joint=joint, zeta=0.01)


JOINTS = {
    "slider": ij.Jenkins(F_S=1.0, K_T=1.0),
    "Iwan": ij.Iwan4(F_S=1.0, K_T=1.0, chi=-0.5, beta=1.0),
    "stiff slider": ij.Jenkins(F_S=1.0, K_T=100.0),
}


@cache
def followed_closely(name):
    return nonlinear_modes(softened(JOINTS[name]), 0, CLOSE, harmonics=ODD)


@pytest.mark.parametrize(
    "levels",
    # As many in all, for one kernel.
    [
        [0.5, 2.0, 0.5, 2.0],
        [0.5, 1e3, 0.5, 1e3],
        [1e3, 2.0, 0.5, 1e3],
        [2.0, 2.0, 2.0, 2.0],
        [1e-3, 1e3, 1e-2, 1e2],
    ],
)
@pytest.mark.parametrize("name", [pytest.param("slider", marks=pytest.mark.long), "Iwan"])
def test_a_level_may_be_any_multiple_of_the_last(name, levels):
    # The frequency used to run away, 8.5e15 Hz at the second level, and count as balanced.
    joint, levels = JOINTS[name], np.asarray(levels)
    curves = nonlinear_modes(softened(joint), 0, levels, harmonics=ODD)
    closed = ij.ModalOscillator(2.0 / (2 * np.pi), 0.01, joint)
    frequency, damping = closed.frequency_and_damping(levels)
    # The third harmonic of the motion, measured.
    np.testing.assert_allclose(curves.frequency, frequency, rtol=1e-3)
    np.testing.assert_allclose(curves.damping, damping, rtol=1e-2)
    close = followed_closely(name)
    place = np.searchsorted(close.amplitude, levels * (1.0 - 1e-9))
    here = np.isclose(close.amplitude[place], levels)
    np.testing.assert_allclose(curves.frequency[here], close.frequency[place][here], rtol=1e-9)


def test_a_frequency_is_one_that_the_structure_can_have_or_nan():
    # Between 0.1 and 0.2 the slider, a hundred times as stiff as the structure, damps the mode
    # more than critically; the motion is no mode's there, nor found.
    curves = followed_closely("stiff slider")
    omega = 2.0 * np.pi * np.asarray(curves.frequency)
    found = np.isfinite(omega)
    assert np.mean(found) > 0.9
    # Next to those levels the third harmonic takes 0.1 % off the lower bound.
    assert np.min(omega[found]) > 0.998 * np.sqrt(3.0)
    assert np.max(omega[found]) < np.sqrt(103.0) * (1.0 + 1e-9)
    assert np.all(curves.damping[found] > 0.0)


@pytest.mark.reference
def test_three_masses_part_from_quasi_static_analysis_in_macroslip():
    system = ij.three_mass()
    static = ij.qsma(system, 1, np.geomspace(0.1, 1e3, 12), 0.0, frequency="first_harmonic")
    q = np.asarray(static.q)
    curves = nonlinear_modes(system, 1, q, harmonics=ODD)
    frequency = np.abs(curves.frequency / static.curves.frequency - 1.0)
    damping = np.abs(curves.damping / static.curves.damping - 1.0)
    slips = np.abs(np.asarray(static.deflection)[:, 0]) > PHI_MAX
    assert 2 < np.sum(slips) < 8
    # As the joint softens its inertia load shifts the shape: 1e-5 and 0.7 % before macroslip.
    assert np.max(frequency[~slips]) < 2e-5
    assert np.max(damping[~slips]) < 1e-2
    # Beyond, a tenth of a per cent and four per cent.
    assert 1e-4 < np.max(frequency[slips]) < 1e-3
    assert 1e-2 < np.max(damping[slips]) < 5e-2


def test_bad_arguments():
    with pytest.raises(ij.InputError, match="mode = 3; expected 0 to 2"):
        nonlinear_modes(ij.three_mass(), 3, 1.0)
    with pytest.raises(ij.InputError, match="mode = 1; expected 0 to 0"):
        nonlinear_modes(ij.three_mass(), 1, 1.0, modes=1)
    with pytest.raises(ij.InputError, match="levels holds 0"):
        nonlinear_modes(ij.three_mass(), 1, [0.0, 1.0])
