"""First harmonic of the steady loop: the closed form, its edges and its derivatives."""

import equinox as eqx
import jax
import numpy as np
import pytest
import scipy.integrate
from oracles import Distribution, bank, drive_sliders

import iwanjax as ij

CHI = (-0.95, -0.5, 0.3, 1.0)
# Amplitudes over phi_max, some just beside macroslip.
S = (1e-3, 0.1, 0.7, 1 - 1e-6, 1.0, 1 + 1e-12, 1 + 1e-8, 1 + 1e-4, 1.05, 2.0, 30.0, 1e3)
F_S, K_T, BETA = 2.0, 3.0e4, 0.7


def joint(chi, beta=BETA):
    return ij.Iwan4(F_S=F_S, K_T=K_T, chi=chi, beta=beta)


@eqx.filter_jit
def stiffness(element, d):
    """Compiled whole: quicker than operation by operation for each shape."""
    return element.harmonic_stiffness(d)


def distribution(element):
    R, S, chi, phi_max = (float(getattr(element, k)) for k in ("R", "S", "chi", "phi_max"))
    return Distribution(R, S, chi, phi_max)


def slider(threshold, amplitude):
    """First harmonic of one slider of unit stiffness: sticks after each turn for an angle."""
    if amplitude <= threshold:
        return 1.0
    sticks = np.arccos(1.0 - 2.0 * threshold / amplitude)
    return (sticks - 0.5 * np.sin(2.0 * sticks)) / np.pi


@pytest.mark.parametrize("ratio", [0.01, 0.3, 0.99])
def test_the_oracles_slider_is_the_integral_over_its_branch(ratio):
    def force(t):
        return max(np.cos(t) - 1.0 + ratio, -ratio) * np.cos(t)

    turn = np.arccos(1.0 - 2.0 * ratio)
    expected = sum(
        scipy.integrate.quad(force, a, b, epsabs=1e-13)[0] for a, b in ((0, turn), (turn, np.pi))
    )
    assert slider(ratio, 1.0) == pytest.approx(2.0 / np.pi * expected, abs=1e-12)


@pytest.mark.parametrize("beta", [0.0, BETA])
@pytest.mark.parametrize("chi", CHI)
def test_closed_form_against_adaptive_quadrature_over_the_sliders(chi, beta):
    element = joint(chi, beta)
    sliders = distribution(element)
    d = np.array(S) * sliders.phi_max
    expected = [sliders.integral(lambda phi, a=a: slider(phi, a), a) for a in d]
    np.testing.assert_allclose(stiffness(element, d), expected, rtol=0, atol=1e-7 * K_T)


@pytest.mark.parametrize("chi", CHI)
def test_it_falls_from_the_tangent_at_rest_to_what_sliding_friction_leaves(chi):
    element = joint(chi)
    assert float(stiffness(element, 0.0)) == pytest.approx(K_T, rel=1e-15)
    # What is left at a tiny amplitude is the power law itself.
    assert float(stiffness(element, 1e-300)) == pytest.approx(K_T, abs=K_T * 1e-280 ** (chi + 1))
    d = float(element.phi_max) * np.geomspace(1e-3, 1e3, 400)
    k = np.asarray(stiffness(element, d))
    assert np.all(np.diff(k) < 0)
    np.testing.assert_array_equal(stiffness(element, -d), k)
    # Far beyond phi_max each slider has 16/(3 pi) (phi/A)^(3/2), to the order of phi/A.
    sliders = distribution(element)
    far = sliders.integral(lambda phi: 16.0 / (3.0 * np.pi) * (phi / d[-1]) ** 1.5)
    assert k[-1] == pytest.approx(far, rel=1e-3)


@pytest.mark.parametrize("chi", CHI)
def test_the_quadrature_that_every_joint_has_agrees_in_microslip(chi):
    """64 midpoints on a branch that begins like t^(2 chi + 4): an error of that order."""
    element = joint(chi)
    d = float(element.phi_max) * np.array([1e-3, 0.1, 0.5, 0.99])
    plain = eqx.filter_jit(ij.AbstractJoint.harmonic_stiffness)(element, d)
    order = 64.0 ** -min(2.0 * chi + 5.0, 6.0)
    np.testing.assert_allclose(plain, stiffness(element, d), rtol=0, atol=K_T * order)


@pytest.mark.parametrize("s", [0.2, 0.95, 1.3, 4.0])
@pytest.mark.parametrize("chi", [-0.5, 0.3])
def test_discrete_sliders_driven_round_their_cycle(chi, s):
    element = joint(chi)
    phi, k = bank(distribution(element), 1500)
    t = np.linspace(0.0, np.pi, 1201)
    amplitude = s * float(element.phi_max)
    force = drive_sliders(phi, k, 1.0, amplitude * np.cos(t))
    found = 2.0 / np.pi * np.trapezoid(force * np.cos(t), t) / amplitude
    assert float(stiffness(element, amplitude)) == pytest.approx(found, rel=1e-3)


@jax.jit
def value(point):
    """At (F_S, K_T, chi, beta, d), so that one compilation serves all points."""
    return ij.Iwan4(F_S=point[0], K_T=point[1], chi=point[2], beta=point[3]).harmonic_stiffness(
        point[4]
    )


gradient = jax.jit(jax.grad(value))


@pytest.mark.parametrize("away", [-0.9, -0.1, -1e-5, 1e-5, 1e-3, 0.5, 10.0])
@pytest.mark.parametrize("chi", [*CHI, -0.9999])
def test_gradient_is_that_of_central_differences(chi, away):
    point = np.array([F_S, K_T, chi, BETA, (1.0 + away) * float(joint(chi).phi_max)])
    found = np.asarray(gradient(point))
    # An angle's arc sine just above phi_max magnifies that of its argument.
    round_off = 1e-15 * K_T / np.sqrt(min(1.0, abs(away)))
    for i, x in enumerate(point):
        # Small beside the way to macroslip, where the second derivative is infinite.
        h = 1e-2 * min(abs(away), 0.1) * max(abs(x), 0.1 if i in (2, 3) else 0.0)
        h = min(h, 0.1 * (1.0 + chi)) if i == 2 else h
        step = h * np.eye(5)[i]
        ahead, behind = float(value(point + step)), float(value(point - step))
        # Truncation goes with (h / away)^2 / 24; round-off counts tenfold.
        assert found[i] == pytest.approx((ahead - behind) / (2 * h), rel=1e-5, abs=round_off / h)


@pytest.mark.parametrize("s", [0.0, 1e-300, 1e-9, 1.0, 1 + 1e-15, 1 + 1e-9, 1 + 2e-9, 1e6])
@pytest.mark.parametrize("chi", [-1 + 1e-6, -0.5, 0.0, 1.0])
def test_gradient_is_finite_everywhere(chi, s):
    point = np.array([F_S, K_T, chi, BETA, s * float(joint(chi).phi_max)])
    assert np.all(np.isfinite(gradient(point)))


def test_parameters_may_be_a_batch():
    batch = ij.Iwan4(F_S=[[1.0], [2.0]], K_T=K_T, chi=[[-0.5], [0.2]], beta=BETA)
    d = np.array([1e-5, 1e-4, 1e-3])
    found = np.asarray(stiffness(batch, d))
    for row, F, chi in zip(found, (1.0, 2.0), (-0.5, 0.2), strict=True):
        single = ij.Iwan4(F_S=F, K_T=K_T, chi=chi, beta=BETA)
        np.testing.assert_allclose(row, stiffness(single, d), rtol=1e-13)
