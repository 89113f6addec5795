"""Errata of the thesis, each by a number: the printed form fails, the corrected one holds."""

import itertools

import numpy as np
import pytest
from oracles import Distribution, bank, drive_sliders

import iwanjax as ij

pytestmark = pytest.mark.reference

VALUES = {"chi": -0.6, "phi_max": 6e-4, "R": 7e5, "S": 9e3}
# Modal Iwan model of mode 2 of the three masses, Table 2.3.
MODAL = {"F_S": 2.877, "K_T": 7.843e-2, "chi": -0.5150, "beta": 5.614}
K_INF = 1.399


def test_2_8_denominator_has_chi_plus_two():
    joint = ij.Iwan4(**MODAL)
    chi, beta, q = MODAL["chi"], MODAL["beta"], 9.18
    share = (q / float(joint.phi_max)) ** (chi + 1) / (beta + 1)
    printed = np.sqrt(K_INF + MODAL["K_T"] * (1 - share / (chi + 1)))
    right = np.sqrt(K_INF + float(joint.secant(q)))
    truth = 2 * np.pi * _frequency_of_mode_2(q)
    assert abs(right / truth - 1) < 5e-4
    assert abs(printed / truth - 1) > 2e-3


def _frequency_of_mode_2(q: float) -> float:
    solution = ij.qsma(ij.three_mass(), 1, np.geomspace(1e-1, 1e2, 60))
    return float(np.interp(q, solution.q, solution.curves.frequency))


def test_2_8_and_2_9_macroslip_is_continuous():
    joint, oracle = ij.Iwan4.from_distribution(**VALUES), Distribution(**VALUES)
    phi = 6e-4
    below, above = phi * (1 - 1e-9), phi * (1 + 1e-9)
    # Printed: K = 0 and D = 4 F_S q at once.
    assert float(joint.secant(above)) == pytest.approx(float(joint.secant(below)), rel=1e-8)
    assert float(joint.dissipation(above)) == pytest.approx(
        float(joint.dissipation(below)), rel=1e-7
    )
    F_S = float(joint.F_S)
    for u in (6e-4, 8e-4, 2e-3):
        assert float(joint.secant(u)) == pytest.approx(F_S / u, rel=1e-12)
        assert float(joint.dissipation(u)) == pytest.approx(oracle.dissipation(u, u), rel=1e-9)
        assert abs(4 * F_S * u / oracle.dissipation(u, u) - 1) > 0.1
    # And asymptotically the printed form is right.
    assert float(joint.dissipation(1.0)) == pytest.approx(4 * F_S, rel=1e-3)


@pytest.mark.parametrize("zeta", [0.001, 0.05])
def test_2_21_decay_needs_a_minus_sign(zeta):
    omega = 100.0
    t = np.linspace(0.0, 1.0, 2001)
    gamma = np.polyfit(t, np.log(np.exp(-zeta * omega * t)), 1)[0]
    omega_d = omega * np.sqrt(1 - zeta**2)
    printed = gamma / np.sqrt(omega_d**2 + gamma**2)
    assert -printed == pytest.approx(zeta, rel=1e-9)
    assert printed < 0


def test_3_4_eigenproblem_subtracts_inertia():
    system = ij.three_mass()
    omega, Phi = system.modes()
    low = system.linearised("low")
    for w, phi in zip(omega, Phi.T, strict=True):
        assert np.linalg.norm((low.K - w**2 * low.M) @ phi) < 1e-12
        assert np.linalg.norm((low.K + w**2 * low.M) @ phi) > 1.0


def test_3_16_shared_displacements_give_negative_dissipation():
    # 23 uniform points before 50 logarithmic ones, as the thesis advises.
    system = ij.three_mass()
    alpha = np.concatenate([np.linspace(0.0, 1e-1, 25)[1:-1], np.geomspace(1e-1, 1e2, 50)])
    solution = ij.qsma(system, 1, alpha)
    q, truth = np.asarray(solution.q), np.asarray(solution.dissipation)

    def printed(load, displacement):
        """(3.14) to (3.16): both half loops against one displacement vector."""
        forward, reverse = 2 * load - load[-1], load[-1] - 2 * load[::-1]
        return np.trapezoid(forward - reverse, 2 * displacement - displacement[-1])

    for j in (40, 60, 73):
        assert printed(alpha[:j], q[:j]) < 0 < truth[j - 1]
    # On a uniform grid of displacements it is right.
    uniform = np.linspace(0.0, q[-1], 4001)
    load = np.interp(uniform, np.append(0.0, q), np.append(0.0, alpha))
    assert printed(load, uniform) == pytest.approx(truth[-1], rel=1e-2)
    work = ij.qsma(system, 1, alpha, dissipation="work").dissipation
    np.testing.assert_allclose(work, truth, rtol=1e-3)


def test_3_22_slip_takes_the_sign_of_the_stretch():
    joint = ij.Iwan4.from_distribution(**VALUES)
    assert float(joint.backbone(-1e-2)) == pytest.approx(-float(joint.F_S), rel=1e-12)


def test_4_27_fraction_counts_travel_from_the_lower_tip():
    theta, u_max, phi_max, u = 0.3, 5.5e-4, 6e-4, -1e-4
    # At u the sliders up to (u + u_max)/(1 + theta) have slipped again.
    right = (u + u_max) / ((1 + theta) * phi_max)
    printed = (u - u_max) / ((1 + theta) * phi_max)
    assert 0 < right < 1
    assert printed < 0
    oracle = Distribution(**VALUES, theta=theta)
    joint = ij.Iwan5.from_distribution(**VALUES, theta=theta)
    assert float(joint.loading(u, u_max)) == pytest.approx(oracle.loading(u, u_max), rel=1e-9)


def test_4_33_bracket_has_no_exponent():
    theta, u_max, chi, R = 0.3, 5.5e-4, VALUES["chi"], VALUES["R"]
    joint = ij.Iwan5.from_distribution(**VALUES, theta=theta)
    oracle = Distribution(**VALUES, theta=theta)
    u = np.linspace(-u_max, 0.99 * theta * u_max, 12)

    def forward(bracket: float) -> np.ndarray:
        scale = R / ((chi + 2) * (chi + 1))
        start = scale * (chi + 2 - theta * (chi + 1)) * u_max ** (chi + 2)
        travel = ((u + u_max) / (1 + theta)) ** (chi + 2)
        return float(joint.K_T) * u + start - scale * bracket * travel

    expected = [oracle.loading(x, u_max) for x in u]
    bracket = (1 - theta) * chi + 2
    np.testing.assert_allclose(forward(bracket), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(joint.loading(u, u_max), expected, rtol=1e-9, atol=1e-9)
    assert np.max(np.abs(forward(bracket ** (chi + 2)) - expected)) > 0.1


def test_4_37_the_joint_stiffens_the_oscillator():
    joint = ij.Iwan4.from_distribution(**(VALUES | {"S": 9e4}))
    K = float(joint.secant(1e-4))
    assert np.sqrt(5e5 + K) == pytest.approx(805.365, rel=1e-5)
    assert abs(np.sqrt(5e5 - K) / 805.365 - 1) > 0.1


def test_section_4_5_has_ten_times_the_dirac_strength():
    printed = ij.Iwan4.from_distribution(**VALUES)
    assert np.sqrt(5e5 + float(printed.secant(1e-4))) == pytest.approx(753.4, abs=0.05)
    right = ij.Iwan4.from_distribution(**(VALUES | {"S": 9e4}))
    assert np.sqrt(5e5 + float(right.secant(1e-4))) == pytest.approx(805.4, abs=0.05)


def test_table_g_1_exponents():
    joint = ij.Iwan5.from_distribution(**VALUES, theta=0.3)
    assert float(joint.dissipation(3.5e-4)) == pytest.approx(3.240e-3, rel=1e-3)
    assert float(joint.dissipation(5e-4)) == pytest.approx(7.626e-3, rel=1e-3)


@pytest.mark.parametrize("theta", [0.2, 0.5])
def test_five_parameter_macroslip(theta):
    joint = ij.Iwan5.from_distribution(**VALUES, theta=theta)
    oracle = Distribution(**VALUES, theta=theta)
    phi, F_S = 6e-4, float(joint.F_S)
    drop = float(joint.backbone(phi * (1 - 1e-12)) - joint.backbone(phi * (1 + 1e-12)))
    assert drop == pytest.approx((1 - theta) * VALUES["S"] * phi, rel=1e-6)
    assert float(joint.backbone(2 * phi)) == pytest.approx(theta * F_S, rel=1e-12)
    for u in (0.51 * (1 + theta) * phi, phi, 3 * phi):
        assert float(joint.secant(u, 4 * phi)) == pytest.approx(theta * F_S / u, rel=1e-12)
        assert float(joint.dissipation(u, 4 * phi)) == pytest.approx(
            oracle.dissipation(u, 4 * phi), rel=1e-9
        )


def test_4_17_sliders_need_signed_flags():
    phi, k, theta = np.array([1.0, 2.0]), np.ones(2), 0.5
    history = np.array([1.8, 1.6, 2.1])
    assert drive_sliders(phi, k, theta, history)[-1] == pytest.approx(1.8)
    assert _counted_sliders(phi, k, theta, history)[-1] != pytest.approx(1.8)


@pytest.mark.parametrize(("theta", "force"), [(0.5, 12.0295), (0.3, 11.4297)])
def test_4_17_in_the_continuous_limit(theta, force):
    turns = [0.0, 2e-4, 1.8e-4, 2.6e-4]
    history = np.concatenate([np.linspace(a, b, 400)[1:] for a, b in itertools.pairwise(turns)])
    sliders = bank(Distribution(**VALUES, theta=theta), 20_000)
    assert drive_sliders(*sliders, theta, history)[-1] == pytest.approx(force, rel=2e-5)
    assert abs(_counted_sliders(*sliders, theta, history)[-1] / force - 1) > 1e-3


def _counted_sliders(phi, k, theta, history) -> np.ndarray:
    """(4.15) to (4.19) as printed: the first n sliders are taken to slip."""
    x, n, force = np.zeros_like(phi), 0, []
    for u in history:
        threshold = np.where(np.arange(len(phi)) < n, theta * phi, phi)
        n = int(np.sum(np.abs(u - x) >= threshold))
        slips = np.arange(len(phi)) < n
        x = np.where(slips, u - theta * phi * np.sign(u - x), x)
        force.append(np.sum(k * (u - x)))
    return np.array(force)
