"""Cycles of a five-parameter element after a larger one, against quadrature and differences."""

import equinox as eqx
import numpy as np
import pytest
import scipy.integrate
from oracles import Distribution

import iwanjax as ij

# Amplitude over the largest so far, and that over phi_max.
SHARE = np.array([0.05, 0.4, 0.61, 0.74, 0.93, 1.0])
REACHED = np.array([1e-2, 0.7, 1.0 - 1e-9, 1.6])
THETAS = (0.2, 0.5, 0.8, 1.0)


def element(chi, beta, theta):
    return ij.Iwan5(F_S=2.0, K_T=3e4, chi=chi, beta=beta, theta=theta)


@eqx.filter_jit
def harmonic(joint, d, d_max):
    return joint.harmonic_stiffness(d, d_max)


def slider(phi, d, theta, slips):
    """First harmonic over d of one unit slider: sticks after a turn for (1 + theta) phi."""
    if not slips:
        return 1.0
    t = np.arccos(1.0 - min((1.0 + theta) * phi / d, 2.0))

    def force(x):
        return -theta * phi + d * (1.0 - np.cos(x)) if x < t else theta * phi

    parts = ((0.0, t), (t, np.pi))
    return -sum(
        2.0 / (np.pi * d) * scipy.integrate.quad(lambda x: force(x) * np.cos(x), a, b)[0]
        for a, b in parts
    )


@pytest.mark.parametrize("theta", [0.2, 0.8])
@pytest.mark.parametrize(("share", "reached"), [(0.4, 0.7), (0.93, 0.7), (0.3, 1.6), (0.8, 1.6)])
def test_first_harmonic_is_the_sum_of_the_sliders_own(theta, share, reached):
    joint = element(-0.45, 0.7, theta)
    R, S, chi, phi_max = (float(getattr(joint, k)) for k in ("R", "S", "chi", "phi_max"))
    d_max = reached * phi_max
    d = share * d_max

    def own(phi):
        return slider(phi, d, theta, phi <= d_max and (1.0 + theta) * phi <= 2.0 * d)

    expected = Distribution(R, S, chi, phi_max, theta).integral(own, d_max, 2.0 * d / (1.0 + theta))
    found = float(harmonic(joint, d, d_max))
    assert found == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("theta", THETAS)
@pytest.mark.parametrize("beta", [0.0, 0.7])
@pytest.mark.parametrize("chi", [-0.95, -0.5, 0.3])
def test_tips_follow_the_secants_force(chi, beta, theta):
    joint = element(chi, beta, theta)
    d_max = float(joint.phi_max) * REACHED[:, None]
    d = SHARE[:-1] * d_max
    step = 1e-6 * d
    ahead, behind = ((d + x) * np.asarray(joint.secant(d + x, d_max)) for x in (step, -step))
    found = np.asarray(joint.tip_stiffness(d, d_max))
    np.testing.assert_allclose(found, (ahead - behind) / (2.0 * step), atol=1e-5 * 3e4)


@pytest.mark.parametrize("chi", [-0.95, -0.5, 0.3])
def test_with_one_friction_all_is_masings(chi):
    joint = element(chi, 0.7, 1.0)
    same = ij.Iwan4(F_S=2.0, K_T=3e4, chi=chi, beta=0.7)
    d = float(same.phi_max) * np.array([0.0, 1e-3, 0.4, 0.95, 1.1, 4.0])
    after, plain = joint.after(5.0 * d), same.after(5.0 * d)
    assert plain is same
    for name in ("harmonic_stiffness", "tip_stiffness", "dissipation"):
        found, expected = (np.asarray(getattr(each, name)(d)) for each in (after, plain))
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=2e-7 * np.max(expected))
