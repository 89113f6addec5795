"""One mode as an oscillator: against static modal analysis, the thesis and a free decay."""

from functools import cache

import jax
import numpy as np
import pytest
from modal_ringdown import make_hits

import iwanjax as ij
from iwanjax.errors import InputError
from iwanjax.quasistatic import ModalOscillator
from iwanjax.signals.hilbert import ringdown_curves

F_0, ZETA_0 = 118.0, 4e-4
TRUTH = make_hits.TRUTH
JOINT = ij.Iwan4(F_S=TRUTH.F_S, K_T=TRUTH.K_T, chi=TRUTH.chi, beta=TRUTH.beta)
MODE = ModalOscillator(F_0, ZETA_0, JOINT)
PHI_MAX = TRUTH.phi_max
S = np.array([1e-3, 0.05, 0.3, 0.9, 1.0, 1.2, 3.0])


@pytest.mark.parametrize("joint", [JOINT, ij.Jenkins(F_S=1.8, K_T=2.75e4)], ids=["iwan4", "slider"])
@pytest.mark.parametrize("frequency", ["first_harmonic", "secant"])
def test_the_oscillator_is_the_structure_of_one_mass(joint, frequency):
    """Statics gives amplitudes for loads; at these amplitudes both must say the same."""
    mode = ModalOscillator(F_0, 0.0, joint)
    system = ij.oscillator(stiffness=float(mode.K_inf), joint=joint)
    alpha = float(mode.omega_0) ** 2 * PHI_MAX * np.array([0.1, 0.5, 0.9, 1.1, 2.0])
    solution = ij.qsma(system, 0, alpha, frequency=frequency)
    f, zeta = mode.frequency_and_damping(solution.q, frequency)
    np.testing.assert_allclose(f, solution.curves.frequency, rtol=1e-9)
    # There the loss is always held against the secant's energy, here against the frequency's.
    secant = np.sqrt(alpha / np.asarray(solution.q)) / (2.0 * np.pi)
    expected = np.asarray(solution.curves.damping) * (secant / np.asarray(f)) ** 2
    np.testing.assert_allclose(zeta, expected, rtol=1e-8, atol=1e-14)
    # A dashpot's damping ratio is that at low amplitude, less whatever the frequency loses.
    damped = ModalOscillator(F_0, ZETA_0, joint).frequency_and_damping(solution.q, frequency)
    np.testing.assert_allclose(damped[0], f, rtol=1e-15)
    np.testing.assert_allclose(damped[1] - zeta, ZETA_0 * F_0 / np.asarray(f), rtol=1e-9)


def test_microslip_is_the_thesis_with_its_denominators_put_right():
    """(2.12) and (2.13) with (2.8) and (2.9), their (chi + 1) read as (chi + 2)."""
    F_S, K_T, chi, beta = TRUTH.F_S, TRUTH.K_T, TRUTH.chi, TRUTH.beta
    q = PHI_MAX * np.array([1e-4, 1e-2, 0.3, 0.99])
    phi_max = F_S * (1 + beta) / (K_T * (beta + (chi + 1) / (chi + 2)))
    r = q / phi_max
    omega_0 = 2 * np.pi * F_0
    K_inf = omega_0**2 - K_T
    omega = np.sqrt(K_inf + K_T * (1 - r ** (chi + 1) / ((chi + 2) * (1 + beta))))
    D = 4 * K_T * (chi + 1) * q**2 * r ** (chi + 1) / ((1 + beta) * (chi + 2) * (chi + 3))
    zeta = (D / (2 * np.pi * q**2) + ZETA_0 * omega_0 * omega) / omega**2
    found = MODE.frequency_and_damping(q, "secant")
    np.testing.assert_allclose(found[0], omega / (2 * np.pi), rtol=1e-12)
    np.testing.assert_allclose(found[1], zeta, rtol=1e-11)
    assert float(MODE.omega_0) == pytest.approx(omega_0)
    assert float(MODE.K_inf) == pytest.approx(K_inf)


def test_limits_at_small_and_large_amplitude():
    f, zeta = MODE.frequency_and_damping(PHI_MAX * np.array([1e-20, 1e8]))
    assert float(f[0]) == pytest.approx(F_0, rel=1e-12)
    assert float(zeta[0]) == pytest.approx(ZETA_0, rel=1e-6)
    omega_inf = np.sqrt(float(MODE.K_inf))
    assert float(f[1]) == pytest.approx(omega_inf / (2 * np.pi), rel=1e-9)
    assert float(zeta[1]) == pytest.approx(ZETA_0 * float(MODE.omega_0) / omega_inf, rel=1e-6)


def test_curves_carry_the_same_numbers():
    curves = MODE.curves(PHI_MAX * S, frequency="secant", unit="m", name="first")
    f, zeta = MODE.frequency_and_damping(PHI_MAX * S, "secant")
    np.testing.assert_array_equal(curves.frequency, f)
    np.testing.assert_array_equal(curves.damping, zeta)
    assert (curves.quantity, curves.unit, curves.name) == ("displacement", "m", "first")


def test_ringdown_is_the_plain_damping_at_small_amplitude():
    """They differ by a tenth or so of d ln omega / d ln q, which vanishes with the amplitude."""
    s = np.array([1e-8, 1e-6, 1e-4, 1e-2, 0.3])
    f, zeta = MODE.frequency_and_damping(PHI_MAX * s)
    f_decay, decay = MODE.ringdown_frequency_and_damping(PHI_MAX * s)
    np.testing.assert_array_equal(f_decay, f)
    apart = np.abs(np.asarray(decay / zeta) - 1.0)
    # The derivative goes with the drop of omega^2, K_T / ((chi + 2)(1 + beta)) s^(chi + 1).
    n = TRUTH.chi + 1.0
    drop = TRUTH.K_T / float(MODE.omega_0) ** 2 * s**n / ((n + 1.0) * (1.0 + TRUTH.beta))
    assert np.all(apart > 0)
    assert np.all(apart < 0.2 * 0.5 * n * drop)


def test_a_dashpot_alone_rings_down_as_it_is():
    mode = ModalOscillator(50.0, 3e-3, ij.LinearSpring(k=1e3))
    f, zeta = mode.ringdown_frequency_and_damping(np.array([1e-6, 1.0, 1e6]))
    np.testing.assert_allclose(f, 50.0, rtol=1e-14)
    np.testing.assert_allclose(zeta, 3e-3, rtol=1e-14)


@cache
def decay():
    """Free decay of discrete sliders from 2.5 phi_max, and what the package finds in it."""
    rate = make_hits.SAMPLING_RATE
    start = np.array([2.5]) * TRUTH.omega_0 * PHI_MAX
    motion = make_hits.ring_down(TRUTH, start, rate, round(3.0 * rate), make_hits.STEPS_PER_SAMPLE)
    x = np.concatenate([np.zeros(round(0.02 * rate)), motion.velocity[:, 0]])
    # A filter needs some noise to tell a decay from; 120 dB down it moves nothing.
    x += 1e-6 * x.max() * np.random.default_rng(3).standard_normal(x.size)
    return ringdown_curves(x, rate, (90.0, 150.0), quantity="velocity").as_quantity("displacement")


def test_discrete_sliders_ring_down_as_the_oscillator_says():
    curves = decay()
    s = np.asarray(curves.amplitude) / PHI_MAX
    f, zeta = MODE.ringdown_frequency_and_damping(curves.amplitude)
    off_f = np.asarray(curves.frequency) / np.asarray(f) - 1.0
    off = np.asarray(curves.damping) / np.asarray(zeta) - 1.0
    below = s < 0.8
    assert np.sum(below) > 10
    assert s.min() < 0.1
    assert np.max(np.abs(off[below])) < 1e-3
    assert np.max(np.abs(off_f[below])) < 1e-5
    # The plain (2.13) is further from the decay than the oscillator's own decay is.
    plain = np.asarray(curves.damping) / np.asarray(MODE.frequency_and_damping(curves.amplitude)[1])
    assert np.max(np.abs(off[below])) < np.max(np.abs(plain[below] - 1.0))
    # About phi_max an interval of the ring-down spans the kink.
    assert np.max(np.abs(off)) < 0.03


def test_derivatives_of_the_decay_are_central_differences():
    def both(x):
        joint = ij.Iwan4(F_S=x[2], K_T=x[3], chi=x[4], beta=x[5])
        mode = ModalOscillator(x[0], x[1], joint)
        return jax.numpy.stack(mode.ringdown_frequency_and_damping(PHI_MAX * S[[1, 3, 5]]))

    x = np.array([F_0, ZETA_0, TRUTH.F_S, TRUTH.K_T, TRUTH.chi, TRUTH.beta])
    value, slopes = jax.jit(both), np.asarray(jax.jit(jax.jacfwd(both))(x))
    for i in range(6):
        h = 1e-5 * abs(x[i])
        step = h * np.eye(6)[i]
        expected = np.asarray(value(x + step) - value(x - step)) / (2 * h)
        np.testing.assert_allclose(slopes[..., i] * x[i], expected * x[i], rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize(
    ("f_0", "zeta_0", "joint", "told"),
    [
        (F_0, -1e-6, JOINT, "zeta_0 = -1e-06 is negative"),
        (0.0, 0.0, JOINT, "f_0 = 0"),
        (-5.0, 0.0, JOINT, "f_0 = -5"),
        (26.0, 0.0, JOINT, "exceeds"),
        (F_0, 0.0, "iwan4", "expected a joint element, got str"),
        (F_0, 0.0, {"F_S": 1.0}, "expected a joint element, got dict"),
        ("fast", 0.0, JOINT, "f_0"),
    ],
)
def test_what_is_no_oscillator_is_refused(f_0, zeta_0, joint, told):
    with pytest.raises(InputError, match=told):
        ModalOscillator(f_0, zeta_0, joint)


@pytest.mark.parametrize("amplitude", [[0.0, 1e-5], [-1e-5], ["small"]])
def test_amplitudes_must_be_positive(amplitude):
    with pytest.raises(InputError, match="amplitude"):
        MODE.curves(amplitude)


def test_an_unknown_frequency_is_refused():
    with pytest.raises(InputError, match="expected one of first_harmonic, secant"):
        MODE.frequency_and_damping(1e-5, "tangent")
