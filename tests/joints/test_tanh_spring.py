"""A softening spring: limits, the work of its force, the published pendulum-like series."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

import iwanjax as ij
from iwanjax.joints import TanhSpring

K, WIDTH = 5.0, 0.3
D = np.linspace(-2.0, 2.0, 41)


def test_its_limits_are_a_spring_and_a_constant_force():
    np.testing.assert_allclose(TanhSpring(K, 1e6).backbone(D), K * D, rtol=1e-11)
    hard = TanhSpring(K / 1e-6, 1e-6)
    np.testing.assert_allclose(hard.backbone(D), K * np.sign(D), atol=1e-9)
    spring = ij.LinearSpring(K)
    along = np.sin(np.arange(50.0))
    np.testing.assert_allclose(
        ij.hysteresis(TanhSpring(K, 1e6), along), ij.hysteresis(spring, along), rtol=1e-11
    )


def test_it_solves_its_differential_equation():
    """By another route: F' = k (1 - (F/(k width))^2), integrated."""
    found = solve_ivp(
        lambda d, F: K * (1.0 - (F / (K * WIDTH)) ** 2),
        (0.0, 2.0),
        [0.0],
        t_eval=D[D >= 0],
        rtol=1e-11,
        atol=1e-13,
    )
    np.testing.assert_allclose(TanhSpring(K, WIDTH).backbone(D[D >= 0]), found.y[0], atol=1e-9)


def test_its_first_harmonic_and_energy():
    """Softening of a Duffing oscillator (Nayfeh & Mook 1979, Eq. 4.1): k (1 - d^2/(4 width^2))."""
    joint, d = TanhSpring(K, WIDTH), 0.02 * WIDTH
    series = K * (1.0 - 0.25 * (d / WIDTH) ** 2)
    assert float(joint.harmonic_stiffness(d)) == pytest.approx(series, rel=1e-7)
    element = joint.discrete()
    stored = float(element.energy(jnp.asarray(0.5), element.init()))
    assert stored == pytest.approx(quad(lambda x: float(joint.backbone(x)), 0.0, 0.5)[0], rel=1e-9)
    closed = K * WIDTH**2 * np.log(np.cosh(0.5 / WIDTH))
    assert stored == pytest.approx(closed, rel=1e-9)


def test_gradients_are_finite_everywhere():
    for values in ((K, WIDTH), (1e-3, 1e-6)):
        slopes = jax.jacobian(lambda x: TanhSpring(*x).secant(D))(jnp.array(values))
        assert np.all(np.isfinite(slopes))
