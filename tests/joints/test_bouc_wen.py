"""Bouc-Wen: limits, its rate equation integrated by SciPy, published closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import hyp2f1

import iwanjax as ij
from iwanjax.joints import BoucWen
from iwanjax.types import compiled_for_one_call

F_S, K_T = 3.0, 20.0
SLIP = F_S / K_T
EXPONENTS = (1.0, 1.3, 2.0, 3.7)
TURNS = SLIP * np.array([0.5, 3.0, -2.0, -1.0, -4.0, 6.0, 5.5, 5.9, -0.2, 0.1])


def test_its_limits_are_a_spring_and_dry_friction():
    np.testing.assert_allclose(ij.hysteresis(BoucWen(1e9, K_T, 1.5), TURNS), K_T * TURNS, rtol=1e-6)
    sudden = ij.hysteresis(BoucWen(F_S, K_T, 400.0), TURNS)
    np.testing.assert_allclose(sudden, ij.hysteresis(ij.Jenkins(F_S, K_T), TURNS), atol=0.01 * F_S)


@pytest.mark.parametrize("n", EXPONENTS)
def test_a_history_is_that_of_its_rate_equation(n):
    """Wen (1976) with A = 1, beta = gamma; steps far longer than an integrator's are exact."""
    z, last, found = 0.0, 0.0, []
    for d in TURNS:
        way = np.sign(d - last)

        def rate(_, z, way=way):
            return way * (1.0 - 0.5 * np.abs(z / SLIP) ** n * (1.0 + np.sign(way * z)))

        z = solve_ivp(rate, (0.0, abs(d - last)), [z], rtol=1e-10, atol=1e-13).y[0, -1]
        found.append(K_T * z)
        last = d
    np.testing.assert_allclose(ij.hysteresis(BoucWen(F_S, K_T, n), TURNS), found, atol=1e-7 * F_S)


@pytest.mark.parametrize("n", EXPONENTS)
def test_the_virgin_curve_is_the_published_one(n):
    """Charalampakis & Koumousis (2008): d = z 2F1(1, 1/n; 1 + 1/n; (z/s)^n)."""
    joint, w = BoucWen(F_S, K_T, n), np.array([1e-8, 1e-3, 0.2, 0.7, 0.99, 0.999999])
    d = SLIP * w * hyp2f1(1.0, 1.0 / n, 1.0 + 1.0 / n, w**n)
    np.testing.assert_allclose(joint.backbone(d), F_S * w, rtol=1e-10)
    closed = {1.0: F_S * -np.expm1(-d / SLIP), 2.0: F_S * np.tanh(d / SLIP)}
    if n in closed:
        np.testing.assert_allclose(joint.backbone(-d), -closed[n], rtol=1e-11)


@pytest.mark.parametrize("n", EXPONENTS)
def test_a_steady_cycle_loses_the_published_energy(n):
    """The same, half a cycle: s F_S w^2/2 (2F1(1, 2/n; 1 + 2/n; w^n) - 1) with the tip's w."""
    joint, d = BoucWen(F_S, K_T, n), SLIP * np.array([0.05, 0.4, 1.0, 3.0])
    w = np.asarray(joint.secant(d)) * d / F_S
    # Twice the amplitude is what is unloaded and the virgin curve to the tip.
    np.testing.assert_allclose(
        2.0 * d / SLIP, w * (1.0 + hyp2f1(1.0, 1.0 / n, 1.0 + 1.0 / n, w**n)), rtol=1e-9
    )
    lost = w**2 * F_S * SLIP * (hyp2f1(1.0, 2.0 / n, 1.0 + 2.0 / n, w**n) - 1.0)
    np.testing.assert_allclose(joint.dissipation(d), lost, rtol=1e-6)
    # After many cycles a history runs along this loop.
    history = SLIP * np.tile([1.0, -1.0], 60)
    tips = np.asarray(ij.hysteresis(joint, history))[-2:]
    np.testing.assert_allclose(tips, [F_S * w[2], -F_S * w[2]], rtol=1e-6)


def test_gradients_are_finite_where_nothing_moves_and_where_it_is_spent():
    history = jnp.asarray(SLIP * np.array([0.0, 0.0, 1.0, 80.0, 80.0, -80.0]))

    @jax.jit
    def force(x):
        return ij.hysteresis(BoucWen(*x), history)

    values = jnp.array([F_S, K_T, 1.5])
    slopes = compiled_for_one_call(jax.jacobian(force))(values)
    assert np.all(np.isfinite(slopes))
    h = 1e-6
    for i in range(3):
        step = h * values[i] * jnp.eye(3)[i]
        ahead, behind = force(values + step), force(values - step)
        np.testing.assert_allclose(
            slopes[:, i], (ahead - behind) / (2.0 * h * values[i]), atol=1e-6
        )


@pytest.mark.parametrize("n", [1.0, 2.0, 5.0])
@pytest.mark.parametrize("reach", [0.3, 1.0, 2.5])
def test_the_tip_stiffness_is_that_of_a_slow_decay(n, reach):
    """Work of the last of many branches that come closer, against a steady cycle's as long."""
    joint, slip, shrunk = BoucWen(F_S=2.0, K_T=4.0, n=n), 0.5, 5e-6
    # As many as it takes to forget the first where next to nothing yields.
    ends = slip * reach + shrunk * (np.arange(4000, -1, -1) + 0.5)
    turns = np.concatenate([[0.0], ends * (-1.0) ** np.arange(ends.size)])
    # The last branch closely.
    d = np.concatenate([turns[:-1], np.linspace(turns[-2], turns[-1], 40_001)[1:]])
    force = np.asarray(ij.hysteresis(joint, d))[-40_001:]
    path = d[-40_001:]
    work = float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(path)))
    amplitude = 0.5 * abs(float(path[-1] - path[0]))
    steady = 0.5 * float(joint.dissipation(amplitude))
    expected = (steady - work) / (amplitude * shrunk)
    assert float(joint.tip_stiffness(amplitude)) == pytest.approx(expected, rel=1e-2, abs=1e-3)
    assert float(joint.tip_stiffness(0.0)) == 4.0
