"""The attached oscillator: its stiffness at a frequency, its motion, its energy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import iwanjax as ij
from iwanjax.joints import AttachedOscillator, Dashpot, Inertia, Scales, UnnamedLaw
from iwanjax.joints.unnamed_terms import RESONATES, TERMS

M, K, C = 0.3, 4.0e3, 5.0


def driven(element, d, v, dt):
    """Forces and losses along a history of a foot that begins at rest, and the energy in the end.

    By deflections and rates of the foot.
    """

    def advance(state, ends):
        found = element.step(*ends, dt, state)
        return found.state, (found.force, found.loss)

    state, seen = jax.lax.scan(advance, element.init(), (jnp.asarray(d), jnp.asarray(v)))
    return (*map(np.asarray, seen), float(element.energy(d[-1], state)))


@pytest.mark.parametrize(("c", "per_step"), [(0.05, 0.4), (5.0, 1e-4), (70.0, 0.003), (2e3, 0.4)])
def test_its_motion_follows_its_equation(c, per_step):
    """From lightly damped to overdamped, by SciPy; the foot follows a cubic over each step."""
    dt = per_step / np.sqrt(K / M)
    t = dt * np.arange(2000)
    w = 2.0 * np.pi / (200.0 * dt)
    d, v = 1e-3 * (1.0 - np.cos(w * t)) ** 2, 2e-3 * w * (1.0 - np.cos(w * t)) * np.sin(w * t)

    def rate(at, x):
        foot = 1e-3 * (1.0 - np.cos(w * at)) ** 2
        speed = 2e-3 * w * (1.0 - np.cos(w * at)) * np.sin(w * at)
        pull = K * (foot - x[0]) + c * (speed - x[1])
        return [x[1], pull / M, c * (speed - x[1]) ** 2]

    x = solve_ivp(rate, (0.0, t[-1]), [0.0, 0.0, 0.0], "LSODA", t, rtol=1e-10, atol=1e-16).y
    expected = K * (d - x[0]) + c * (v - x[1])
    force, lost, stored = driven(AttachedOscillator(M, K, c).discrete(), d, v, dt)
    size = np.max(np.abs(expected))
    np.testing.assert_allclose(force, expected, atol=2e-4 * size)
    assert np.sum(lost) == pytest.approx(x[2, -1], rel=5e-3)
    held = 0.5 * K * (d[-1] - x[0, -1]) ** 2 + 0.5 * M * x[1, -1] ** 2
    assert stored == pytest.approx(held, rel=1e-3, abs=1e-6 * x[2, -1])
    assert np.min(lost) >= 0.0


@pytest.mark.parametrize("ratio", [0.05, 0.9, 1.0, 1.3, 8.0])
def test_a_steady_cycle_has_its_stiffness_and_loss(ratio):
    law = AttachedOscillator(M, K, C)
    w = ratio * np.sqrt(K / M)
    G = -M * w**2 * (K + 1j * C * w) / (K - M * w**2 + 1j * C * w)
    assert float(law.secant(2.0, omega=w)) == pytest.approx(G.real, rel=1e-9)
    assert float(law.dissipation(2.0, omega=w)) == pytest.approx(4.0 * np.pi * G.imag, rel=1e-9)
    assert float(law.backbone(2.0)) == float(law.initial_stiffness) == 0.0
    with pytest.raises(ij.InputError, match="omega"):
        law.dissipation(1.0)


@settings(max_examples=25, deadline=None)
@given(st.floats(1e-3, 2.0), st.floats(1e-4, 3.0), st.integers(0, 1000))
def test_derivatives_are_those_of_differences(per_step, ratio, seed):
    random = np.random.default_rng(seed)
    dt = per_step / np.sqrt(K / M)
    element = AttachedOscillator(M, K, 2.0 * ratio * np.sqrt(K * M)).discrete()
    scale = np.array([1e-3, 1e-3 / dt, 1e-3, 1e-3 / dt])
    state = element.init()._replace(**dict(zip("dvrs", scale * random.normal(size=4), strict=True)))
    d, v = scale[:2] * random.normal(size=2)
    found = element.step(d, v, dt, state)
    for given_, by, step in (
        (found.stiffness, (1.0, 0.0), 1e-5),
        (found.damping, (0.0, 1.0), 1e-5 / dt),
    ):
        ends = [
            float(element.step(d + s * by[0] * step, v + s * by[1] * step, dt, state).force)
            for s in (1.0, -1.0)
        ]
        size = abs(float(found.force)) / step
        assert float(given_) == pytest.approx((ends[0] - ends[1]) / (2 * step), abs=1e-7 * size)


def test_it_is_the_mass_where_it_is_held_stiffly():
    seen = Scales(1e-3, 0.05)
    held = AttachedOscillator.nested_whole()[0]
    stiff = AttachedOscillator(*held.widened((M,), seen, 1e-2))
    assert held.law is Inertia
    assert held.narrowed((M, K, C)) == ((M,),)
    w = 2.0 * np.pi / seen.period
    assert float(stiff.secant(1.0, omega=w)) == pytest.approx(-M * w**2, rel=1e-3)


def test_it_is_a_damper_where_its_mass_stays_at_rest():
    seen = Scales(1e-3, 0.05)
    rest = AttachedOscillator.nested_whole()[1]
    heavy = AttachedOscillator(*rest.widened((C,), seen, 1e-3))
    assert rest.law is Dashpot
    assert rest.narrowed((M, K, C)) == ((C,),)
    w = 2.0 * np.pi / seen.period
    assert float(heavy.dissipation(1.0, omega=w)) == pytest.approx(np.pi * C * w, rel=2e-3)
    assert abs(float(heavy.secant(1.0, omega=w))) < 3e-3 * C * w


def thirds():
    return {f"J{i}": ([1.0], AttachedOscillator(M / 3, K / 3, C / 3)) for i in range(3)}


def general_law():
    """What resonates of it, its scales those of another motion."""
    strengths, w = np.zeros(len(TERMS)), np.sqrt(K / M)
    strengths[RESONATES] = M * 2.0 * (2.0 * np.pi / 0.05)
    shape = np.log([w * 0.05 / (2.0 * np.pi), 0.5 * C / np.sqrt(K * M)])
    law = UnnamedLaw(strengths, 1e-3, 2.0, 0.05).with_resonance(shape)
    return {"J": ([1.0], law)}


@pytest.mark.parametrize(
    "carried",
    [lambda: {"J": ([1.0], AttachedOscillator(M, K, C))}, thirds, general_law],
    ids=["one", "in three parts", "general law"],
)
def test_a_structure_carries_it_as_one_of_its_own_masses(carried):
    """A mass on a spring that carries another, by the eigenvectors of both."""
    m, k = np.array([2.0, M]), 9.0e3
    alone = ij.LinearStructure([[m[0]]], [[3.0]], [[k]])
    dt, N = 2e-4, 4000
    push = np.zeros((N, 1))
    push[:40, 0] = np.sin(np.pi * np.arange(40) / 40)
    found = ij.simulate(ij.JointedStructure(alone, carried()), push, dt)
    both = ij.LinearStructure(np.diag(m), [[3.0 + C, -C], [-C, C]], [[k + K, -K], [-K, K]])
    pair = ij.simulate(ij.JointedStructure(both, {}), np.hstack([push, 0 * push]), dt)
    expected = np.asarray(pair.displacement)[:, 0]
    error = np.asarray(found.displacement)[:, 0] - expected
    assert np.sqrt(np.mean(error**2)) < 1e-3 * np.sqrt(np.mean(expected**2))


def test_a_step_that_led_further_is_settled_exactly():
    element, dt = AttachedOscillator(M, K, C).discrete(), jnp.asarray(0.01)
    at = element.step(1e-3, 0.2, dt, element.init()).state
    found = element.step(3e-3, 0.1, dt, at)
    settled = element.settled(found.state, 2e-4, -0.05, found.stiffness)
    again = element.step(3.2e-3, 0.05, dt, at)
    for one, other in zip(settled, again.state, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-15)
