"""Joints against adaptive quadrature, discrete sliders and the thesis's tables."""

import jax.numpy as jnp
import numpy as np
import pytest
from oracles import Distribution, bank, drive_sliders

import iwanjax as ij

pytestmark = pytest.mark.reference

SECTION_4_2_4 = {"chi": -0.6, "phi_max": 6e-4, "R": 7e5, "S": 9e3}
AMPLITUDES = [1e-7, 1e-5, 2e-4, 3.5e-4, 5.5e-4, 5.9999e-4, 6.0000001e-4, 6.5e-4, 9e-4, 3e-3]


def test_parameters_of_section_4_2_4():
    joint = ij.Iwan4.from_distribution(**SECTION_4_2_4)
    assert float(joint.K_T) == pytest.approx(99011.614, rel=1e-8)
    assert float(joint.F_S) == pytest.approx(20.830562, rel=1e-7)


@pytest.mark.parametrize("chi", [-0.6, -0.95, -0.05, 0.4])
def test_four_parameters_against_quadrature(chi):
    values = SECTION_4_2_4 | {"chi": chi, "R": 7e5 * 6e-4 ** (-0.6 - chi)}
    joint, oracle = ij.Iwan4.from_distribution(**values), Distribution(**values)
    u = np.array(AMPLITUDES)
    np.testing.assert_allclose(joint.backbone(u), [oracle.virgin(x) for x in u], rtol=1e-9)
    np.testing.assert_allclose(joint.secant(u), [oracle.secant(x, x) for x in u], rtol=1e-9)
    np.testing.assert_allclose(
        joint.dissipation(u), [oracle.dissipation(x, x) for x in u], rtol=1e-9
    )
    for x in u:
        d = np.linspace(-x, x, 9)
        expected = [oracle.loading(y, x) for y in d]
        np.testing.assert_allclose(joint.loading(d, x), expected, rtol=1e-9, atol=1e-9 * x * 1e5)


@pytest.mark.parametrize("theta", [1.0, 0.7, 0.3, 0.05])
@pytest.mark.parametrize("chi", [-0.6, -0.1])
def test_five_parameters_against_quadrature(theta, chi):
    values = SECTION_4_2_4 | {"chi": chi, "R": 7e5 * 6e-4 ** (-0.6 - chi), "theta": theta}
    joint, oracle = ij.Iwan5.from_distribution(**values), Distribution(**values)
    u = np.array(AMPLITUDES)
    np.testing.assert_allclose(joint.backbone(u), [oracle.virgin(x) for x in u], rtol=1e-9)
    for d_max in (None, 3e-4, 5.8e-4, 6.0000001e-4, 2e-3):
        largest = u if d_max is None else np.maximum(u, d_max)
        np.testing.assert_allclose(
            joint.secant(u, d_max),
            [oracle.secant(x, y) for x, y in zip(u, largest, strict=True)],
            rtol=1e-9,
        )
        np.testing.assert_allclose(
            joint.dissipation(u, d_max),
            [oracle.dissipation(x, y) for x, y in zip(u, largest, strict=True)],
            rtol=1e-9,
        )
    for x in u:
        d = np.linspace(-0.99 * x, x, 9)
        expected = [oracle.loading(y, x) for y in d]
        np.testing.assert_allclose(joint.loading(d, x), expected, rtol=1e-9, atol=1e-9 * x * 1e5)


@pytest.mark.parametrize("theta", [1.0, 0.3])
@pytest.mark.parametrize("amplitude", [2e-4, 3.5e-4, 5e-4, 8e-4])
def test_steady_cycle_against_ten_thousand_sliders(theta, amplitude):
    distribution = Distribution(**SECTION_4_2_4, theta=theta)
    joint = ij.Iwan5.from_distribution(**SECTION_4_2_4, theta=theta)
    t = np.arange(0.0, 1.2505, 0.001)
    u = amplitude * np.sin(2 * np.pi * t)
    force = drive_sliders(*bank(distribution, 10_000), theta, u)
    K = (force[1250] - force[750]) / (u[1250] - u[750])
    E = np.trapezoid(force[250:1251], u[250:1251])
    assert float(joint.secant(amplitude)) == pytest.approx(K, rel=1e-4)
    assert float(joint.dissipation(amplitude)) == pytest.approx(E, rel=1e-3)


def test_ring_down_against_ten_thousand_sliders():
    distribution = Distribution(**SECTION_4_2_4, theta=0.3)
    joint = ij.Iwan5.from_distribution(**SECTION_4_2_4, theta=0.3)
    t = np.arange(0.0, 5.0005, 0.001)
    envelope = np.interp(t, [0.0, 3.0, 5.0], [5.5e-4, 2e-4, 2e-4])
    up = np.linspace(0.0, 5.5e-4, 200)
    u = np.concatenate([up, (envelope * np.cos(2 * np.pi * t))[1:]])
    force = drive_sliders(*bank(distribution, 10_000), 0.3, u)[-1001:]
    last = u[-1001:]
    K = (force[0] - force[500]) / (last[0] - last[500])
    assert float(joint.secant(2e-4, 5.5e-4)) == pytest.approx(K, rel=1e-4)
    assert float(joint.dissipation(2e-4, 5.5e-4)) == pytest.approx(
        np.trapezoid(force, last), rel=1e-3
    )


def test_table_4_1():
    joint = ij.Iwan5.from_distribution(**SECTION_4_2_4, theta=0.3)
    assert float(joint.secant(2e-4)) == pytest.approx(4.5980e4, rel=1e-4)
    assert float(joint.dissipation(2e-4)) == pytest.approx(8.4574e-4, rel=1e-4)
    assert float(joint.secant(2e-4, d_max=5.5e-4)) == pytest.approx(3.9188e4, rel=1e-4)
    assert float(joint.dissipation(2e-4, d_max=5.5e-4)) == pytest.approx(1.5953e-3, rel=1e-4)


def test_table_g_1():
    joint = ij.Iwan5.from_distribution(**SECTION_4_2_4, theta=0.3)
    found = joint.dissipation(np.array([2e-4, 3.5e-4, 5e-4]))
    np.testing.assert_allclose(found, [8.4574e-4, 3.2399e-3, 7.6259e-3], rtol=1e-4)


@pytest.mark.parametrize(("theta", "R_bar"), [(0.2, 1087700), (0.5, 890080), (1.0, 700000)])
def test_equivalent_strength_in_ring_down(theta, R_bar):
    joint = ij.Iwan5.from_distribution(**SECTION_4_2_4, theta=theta)
    assert float(joint.R_bar) == pytest.approx(R_bar, rel=5e-5)
    # (4.48), (4.49): below (1 + theta)/2 of the largest amplitude it is a four-parameter joint.
    u = np.linspace(1e-6, 0.99 * 0.5 * (1 + theta) * 5.5e-4, 20)
    R, chi = float(joint.R_bar), -0.6
    np.testing.assert_allclose(
        joint.secant(u, 5.5e-4), joint.K_T - R * u**0.4 / ((chi + 2) * (chi + 1)), rtol=1e-12
    )
    np.testing.assert_allclose(
        joint.dissipation(u, 5.5e-4), 4 * R * u**2.4 / ((chi + 3) * (chi + 2)), rtol=1e-12
    )


@pytest.mark.parametrize(
    ("theta", "omega", "force"), [(1.0, 805.365, 0.66630), (0.5, 801.457, 0.62465)]
)
def test_oscillator_of_section_4_5(theta, omega, force):
    # S = 9e4, not the printed 9e3.
    joint = ij.Iwan5.from_distribution(**(SECTION_4_2_4 | {"S": 9e4}), theta=theta)
    system = ij.oscillator(stiffness=5e5, joint=joint)
    alpha = (5e5 + float(joint.secant(1e-4))) * 1e-4
    solution = ij.qsma(system, 0, [alpha])
    assert float(solution.q[0]) == pytest.approx(1e-4, rel=1e-9)
    assert float(2 * jnp.pi * solution.curves.frequency[0]) == pytest.approx(omega, rel=1e-5)
    assert float(solution.dissipation[0] / (np.pi * 1e-4)) == pytest.approx(force, rel=1e-5)
