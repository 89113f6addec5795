"""The four-parameter joint in closed form along any history, beside sliders."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import Distribution

import iwanjax as ij
from iwanjax.dynamics import half_sine, point_input

JOINT = ij.Iwan4(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0)
PHI_MAX = float(JOINT.phi_max)
# Sliders of the comparison; their own error of force is of the order of its inverse square.
MANY, ERROR = 5000, 2e-7
# One length of history for all, so that one kernel does.
LENGTH = 400


def compared(history, joint=JOINT):
    """Largest difference between closed form and many sliders, over F_S."""
    closed = np.asarray(ij.hysteresis(joint, history, sliders=None))
    sliders = np.asarray(ij.hysteresis(joint, history, sliders=MANY))
    return np.max(np.abs(closed - sliders)) / float(joint.F_S)


T = np.linspace(0.0, 40.0, LENGTH)
HISTORIES = {
    "steady": 1.5 * np.sin(T),
    "microslip": 0.3 * np.sin(T),
    "decay": np.exp(-0.05 * T) * np.cos(3.0 * T),
    "growing": 0.02 * T * np.cos(2.0 * T),
    "beat": 0.6 * np.sin(T) + 0.5 * np.sin(2.87 * T),
    "offset": 0.7 + 0.4 * np.sin(T),
}


@pytest.mark.parametrize("name", HISTORIES)
def test_it_is_the_limit_of_many_sliders(name):
    assert compared(PHI_MAX * HISTORIES[name]) < ERROR


@given(st.integers(0, 10_000), st.floats(0.02, 1.0))
@settings(max_examples=20, deadline=None)
def test_any_history(seed, size):
    """Random walks: loops within loops, closed, reopened and forgotten, through macroslip."""
    walk = np.cumsum(np.random.default_rng(seed).standard_normal(LENGTH))
    assert compared(size * PHI_MAX * walk) < ERROR


def test_the_largest_loop_is_kept_when_the_stack_overflows():
    """A hundred shrinking loops, then back beyond all of them: the virgin curve goes on."""
    shrinking = np.exp(-0.02 * np.arange(200)) * (-1.0) ** np.arange(200)
    history = PHI_MAX * 0.9 * np.concatenate([shrinking, np.linspace(0.0, 1.3, 200)])
    closed = np.asarray(ij.hysteresis(JOINT, history, sliders=None))
    sliders = np.asarray(ij.hysteresis(JOINT, history, sliders=MANY))
    off = np.abs(closed - sliders) / float(JOINT.F_S)
    assert off[:200].max() < ERROR
    assert off[history > 0.9 * PHI_MAX][-20:].max() < ERROR
    # On the way back through loops that were left out; which ones these are hangs on the last
    # digit, and so on the processor. Neighbours of a left-out loop differ by 2 % of it.
    assert 1e-5 < off.max() < 2e-3


@given(st.integers(0, 10_000), st.floats(0.005, 0.03), st.floats(-5.0, -2.0))
@settings(max_examples=20, deadline=None)
def test_small_loops_do_not_push_large_ones_out(seed, decay, noise):
    """Two modes, a drift and a sensor's noise fill the stack with loops of all sizes."""
    random, t = np.random.default_rng(seed), np.linspace(0.0, 200.0, 10 * LENGTH)
    slow, fast = random.uniform(0.1, 0.5, 2)
    modes = slow * np.cos(t) + fast * np.cos(random.uniform(2.0, 7.0) * t) + 0.3
    history = np.exp(-decay * t) * modes + 10.0**noise * random.standard_normal(len(t))
    assert compared(PHI_MAX * history) < 1e-3


def test_steady_loop_against_quadrature():
    distribution = Distribution(float(JOINT.R), float(JOINT.S), float(JOINT.chi), PHI_MAX)
    d_0 = 0.6 * PHI_MAX
    history = d_0 * np.array([1.0, -1.0, -0.2, 0.5])
    force = np.asarray(ij.hysteresis(JOINT, history, sliders=None))
    assert force[2:] == pytest.approx(
        [distribution.loading(-0.2 * d_0, d_0), distribution.loading(0.5 * d_0, d_0)], rel=1e-9
    )


def test_derivatives_with_respect_to_the_parameters():
    """Smooth in the parameters, where sliders have kinks."""
    history = PHI_MAX * HISTORIES["beat"]

    def work(values):
        joint = ij.Iwan4(F_S=values[0], K_T=values[1], chi=values[2], beta=values[3])
        return (ij.hysteresis(joint, history, sliders=None) ** 2).mean()

    at = np.array([10.0, 1.0, -0.5, 5.0])
    slope = np.asarray(jax.jit(jax.grad(work))(at))
    value = jax.jit(work)
    for i, h in enumerate(1e-6 * np.abs(at)):
        step = h * np.eye(4)[i]
        difference = float(value(at + step) - value(at - step)) / (2 * h)
        assert slope[i] == pytest.approx(difference, rel=1e-6)


def test_in_motion_it_agrees_with_sliders():
    js = ij.three_mass(zeta=1e-4)
    dt = 0.1
    force = half_sine(dt * np.arange(4001), np.array([[300.0], [15_000.0]]), 1.744115)[..., None]
    found = [
        np.asarray(
            ij.simulate(
                js,
                force,
                dt,
                inputs=point_input(js, 1),
                keep=("displacement",),
                sliders=count,
                accuracy=None,
            ).displacement
        )
        for count in (None, 1000)
    ]
    for closed, sliders in zip(*found, strict=True):
        assert np.max(np.abs(closed - sliders)) < 5e-6 * np.max(np.abs(sliders))


@jax.jit
def further_along_a_branch(first, then, by):
    """States after a step that is settled ``by`` further, and after a step that ends there."""
    element = JOINT.discrete(None)
    at = element.step(first, 0.0, 1.0, element.init()).state
    found = element.step(then, 0.0, 1.0, at)
    return (
        element.settled(found.state, by, 0.0, found.stiffness),
        element.step(then + by, 0.0, 1.0, at).state,
    )


@given(st.floats(-1.2, 1.2), st.floats(0.2, 1.0), st.sampled_from([-1.0, 1.0]))
@settings(deadline=None)
def test_a_step_that_led_further_is_settled_along_its_branch(first, length, way):
    further = 1e-4
    then = first + way * length
    settled, again = further_along_a_branch(
        PHI_MAX * first, PHI_MAX * then, jnp.asarray(PHI_MAX * further)
    )
    assert float(settled.d) == pytest.approx(float(again.d), abs=1e-12 * PHI_MAX)
    # The square of what it went further, but where it leaves the microslip on the way.
    at_kink = min(abs(abs(then) - 1.0), abs(length - 2.0), abs(abs(then) - abs(first)))
    limit = 1e-6 if at_kink > 2 * further else further
    assert abs(float(settled.force - again.force)) < limit * float(JOINT.F_S)


def test_an_element_that_knows_no_better_stays_as_it_was():
    element = JOINT.discrete(10)
    state = element.step(0.1, 0.0, 1.0, element.init()).state
    assert element.settled(state, 0.1, 0.2, 1.0) is state
