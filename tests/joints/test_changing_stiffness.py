"""A stiffness that changes with time: limits, a closed form by SciPy, what it feeds."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import iwanjax as ij
from iwanjax.joints import ChangingStiffness

K, TAU = 40.0, 0.7
RATE = K / TAU


def test_it_is_a_spring_in_the_end_and_nothing_at_first():
    d = np.array([0.1, -0.2, 0.3])
    late = ij.hysteresis(ChangingStiffness(K / 1e-6, 1e-6), d, dt=1.0)
    np.testing.assert_allclose(late, K * d, rtol=1e-12)
    early = ij.hysteresis(ChangingStiffness(K, 1e9), d, dt=1.0)
    # In proportion to time.
    np.testing.assert_allclose(early, K * np.arange(1, 4) * d, rtol=1e-6)
    # Quasi-static analysis is of the beginning.
    assert float(ChangingStiffness(RATE, TAU).secant(0.3)) == 0.0
    assert float(ChangingStiffness(RATE, TAU).dissipation(0.3, omega=2.0)) == 0.0


@pytest.mark.parametrize("k", [K, -0.5 * K])
def test_a_mass_on_it_moves_as_its_equation_says(k):
    """m u'' + (k_0 + k (1 - exp(-t/tau))) u = 0 from rest after a push, by SciPy."""
    m, k_0, dt, N = 1.0, 100.0, 2e-3, 1500
    t = dt * np.arange(N)
    push = np.where(t < 0.05, 20.0 * np.sin(np.pi * t / 0.05) ** 2, 0.0)
    structure = ij.JointedStructure(
        ij.LinearStructure([[m]], [[0.0]], [[k_0]]), {"J": ([1.0], ChangingStiffness(k / TAU, TAU))}
    )
    found = ij.simulate(structure, push[:, None], dt, sensors=[[1.0]])

    def rate(t, state):
        pull = (k_0 - k * np.expm1(-t / TAU)) * state[0]
        return [state[1], np.interp(t, dt * np.arange(N), push) - pull]

    exact = solve_ivp(rate, (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-9, atol=1e-12, max_step=dt)
    scale = np.max(np.abs(exact.y[0]))
    np.testing.assert_allclose(np.ravel(found.displacement), exact.y[0], atol=3e-3 * scale)


def test_what_it_feeds_is_what_it_stores_less_the_work():
    spring = ChangingStiffness(RATE, TAU).discrete()
    d, dt = 0.3 * np.sin(np.linspace(0.0, 7.0, 400)), 0.01
    state, work, lost, last = spring.init(), 0.0, 0.0, (0.0, 0.0)
    for now in d:
        reaction = spring.step(np.float64(now), np.float64(0.0), np.float64(dt), state)
        work += 0.5 * (float(reaction.force) + last[1]) * (now - last[0])
        lost += float(reaction.loss)
        state, last = reaction.state, (now, float(reaction.force))
    stored = float(spring.energy(np.float64(d[-1]), state))
    assert work - lost == pytest.approx(stored, abs=1e-3 * K * 0.09)
    # A stiffness that grows while it is stretched is fed from outside.
    assert lost < 0.0
