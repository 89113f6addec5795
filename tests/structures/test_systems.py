"""Builders: their damping."""

import numpy as np
import pytest

import iwanjax as ij

JOINT = ij.Iwan4(F_S=10.0, K_T=4.0, chi=-0.5, beta=5.0)


@pytest.mark.parametrize("joint", [None, JOINT], ids=["own", "another"])
def test_every_mode_of_the_chain_has_the_ratio(joint):
    """Thesis (2.25), about the modes with the joint stuck."""
    system = ij.three_mass(joint=joint, zeta=1e-3)
    omega, Phi = system.modes()
    modal = Phi.T @ system.structure.C @ Phi
    np.testing.assert_allclose(modal, np.diag(2e-3 * omega), rtol=1e-10, atol=1e-15)


def test_the_oscillator_has_the_ratio():
    system = ij.oscillator(mass=2.0, stiffness=14.0, joint=JOINT, zeta=0.1)
    # omega = 3, c = 2 zeta m omega.
    np.testing.assert_allclose(system.structure.C, [[1.2]], rtol=1e-12)


def test_without_a_ratio_there_is_no_damping():
    assert not np.any(ij.three_mass().structure.C)
    assert not np.any(ij.oscillator(stiffness=1.0, joint=JOINT).structure.C)


@pytest.mark.parametrize(
    "build", [ij.three_mass, lambda zeta: ij.oscillator(stiffness=1.0, joint=JOINT, zeta=zeta)]
)
def test_a_negative_ratio_is_refused(build):
    with pytest.raises(ij.InputError, match=r"zeta = -0\.001 is negative; expected"):
        build(zeta=-1e-3)
