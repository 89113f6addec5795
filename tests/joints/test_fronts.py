"""A five-parameter element by its slip fronts, against 20 000 sliders and what must always hold."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles import drive_sliders

import iwanjax as ij

MANY = 20_000
STEPS = 12
UNIT = 0.9876543210987654
HISTORY = st.lists(st.integers(-2000, 2000), min_size=STEPS, max_size=STEPS).map(
    lambda d: UNIT * np.array(d) / 1000.0
)


def scaled(chi, beta, theta, kind=ij.Iwan5):
    """An element of phi_max = 1 and K_T = 1."""
    more = {"theta": theta} if kind is ij.Iwan5 else {}
    trial = kind(F_S=1.0, K_T=1.0, chi=chi, beta=beta, **more)
    return kind(F_S=1.0 / float(trial.phi_max), K_T=1.0, chi=chi, beta=beta, **more)


IWAN5 = st.builds(
    scaled,
    st.floats(-0.99, 1.0),
    st.one_of(st.just(0.0), st.floats(1e-3, 1e3)),
    st.floats(0.01, 1.0),
)


def by_sliders(joint, d, count=MANY):
    bank = joint.slider_bank(count)
    return drive_sliders(np.asarray(bank.phi), np.asarray(bank.k), float(joint.theta), d)


def histories():
    """Random turns, a band of frequencies, beats, and a decay of hundreds of turns."""
    random = np.random.default_rng(1)
    t = np.arange(1200) / 20.0
    waves = [
        random.standard_normal() * np.sin(2 * np.pi * f * t / t[-1] + 7.0 * random.uniform())
        for f in range(1, 60)
    ]
    band = np.sum(waves, axis=0)
    return {
        "turns": random.uniform(-1.0, 1.0, 300),
        "band": band / np.max(np.abs(band)),
        "beats": (0.6 + 0.4 * np.sin(2 * np.pi * t / 31.0)) * np.sin(2 * np.pi * t),
        "decay": np.exp(-t / 30.0) * np.sin(2 * np.pi * t),
    }


@pytest.mark.parametrize("name", ["turns", "band", "beats", "decay"])
@pytest.mark.parametrize(("chi", "beta", "theta"), [(-0.5, 0.2, 0.3), (-0.2, 0.8, 0.6)])
def test_within_a_tenth_of_a_per_cent_of_20000_sliders(chi, beta, theta, name):
    """Of the range of the force; a bank of 200 is 0.05 to 5 per cent off."""
    joint = scaled(chi, beta, theta)
    for stroke in (0.1, 1.3):
        d = stroke * histories()[name]
        expected = by_sliders(joint, d)
        off = np.max(np.abs(np.asarray(ij.hysteresis(joint, d)) - expected))
        assert off < 1e-3 * np.ptp(expected)


@pytest.mark.parametrize("theta", [0.2, 0.5, 0.9])
def test_over_strokes_and_exponents(theta):
    random = np.random.default_rng(7)
    worst, bank = 0.0, 0.0
    for chi in (-0.8, -0.5, 0.2):
        joint = scaled(chi, 0.3, theta)
        for stroke in (0.03, 0.3, 1.5):
            d = stroke * random.uniform(-1.0, 1.0, 60)
            expected = by_sliders(joint, d)
            found = np.asarray(ij.hysteresis(joint, d))
            size = np.ptp(expected)
            worst = max(worst, np.max(np.abs(found - expected)) / size)
            bank = max(bank, np.max(np.abs(by_sliders(joint, d, 200) - expected)) / size)
    assert worst < 1e-3
    # What the grid cost, of the first order in its width.
    assert bank > 5.0 * worst


def test_the_error_falls_with_the_square_of_the_segments():
    """Until there is room for all that a history leaves; from there on it is exact."""
    joint, d = scaled(-0.5, 0.2, 0.3), 0.1 * histories()["beats"]
    exact = np.asarray(ij.hysteresis(joint, d, sliders=500))
    few, more = (
        np.sqrt(np.mean((np.asarray(ij.hysteresis(joint, d, sliders=n)) - exact) ** 2))
        for n in (80, 160)
    )
    # The order is 2, to a tenth of it.
    assert np.log2(few / more) > 1.8
    assert few < 0.02 * np.ptp(exact)


def test_with_one_friction_it_is_the_four_parameter_elements_closed_form():
    five, four = scaled(-0.4, 0.7, 1.0), scaled(-0.4, 0.7, 1.0, ij.Iwan4)
    d = 1.3 * histories()["turns"]
    # Not by sliders: (4.9) on a stack of reversals.
    expected = ij.hysteresis(four, d, sliders=None)
    np.testing.assert_allclose(ij.hysteresis(five, d), expected, atol=1e-10)


@eqx.filter_jit
def driven(element, d):
    def advance(state, to):
        reaction = element.step(to, to, jnp.asarray(0.1), state)
        return reaction.state, (reaction, element.energy(to, reaction.state))

    return jax.lax.scan(advance, element.init(), d)[1]


@given(IWAN5, HISTORY)
def test_energy_is_never_given_and_always_accounted_for(joint, history):
    """Work of many small steps against what is stored and lost in a large one."""
    element = joint.discrete(200)
    reactions, stored = driven(element, history)
    assert np.all(np.asarray(reactions.loss) >= -1e-15)
    assert np.all(np.asarray(stored) >= 0.0)
    fine = 64
    # Ends to the last digit: a turn by rounding is a turn, after which all sliders stick.
    ends = itertools.pairwise([0.0, *history])
    path = np.concatenate([np.linspace(a, b, fine + 1)[1:] for a, b in ends])
    along, _ = driven(element, path)
    force = np.concatenate([[0.0], np.asarray(along.force)])
    moved = np.diff(np.concatenate([[0.0], path]))
    work = np.sum((0.5 * (force[1:] + force[:-1]) * moved).reshape(-1, fine), axis=1)
    account = np.diff(np.concatenate([[0.0], stored])) + np.asarray(reactions.loss)
    # A trapezoid misses half a drop of the Dirac slider, and of a tangent's changes an eighth.
    h = np.max(np.abs(moved))
    drop = float(element.last * (1.0 - element.theta))
    changes = 2.0 * STEPS + np.sum(np.abs(np.diff(along.stiffness)))
    assert np.all(np.abs(work - account) <= 0.5 * h * drop + 0.125 * h**2 * changes + 1e-12)


@given(IWAN5, HISTORY, st.floats(0.1, 0.9))
def test_a_step_is_the_same_in_two_parts_and_turned_round(joint, history, share):
    element = joint.discrete(200)
    whole, _ = driven(element, history)
    between = np.diff(history, prepend=0.0) * share + np.append(0.0, history[:-1])
    parts, _ = driven(element, np.stack([between, history], axis=1).ravel())
    np.testing.assert_allclose(parts.force[1::2], whole.force, atol=1e-11)
    back, _ = driven(element, -history)
    np.testing.assert_allclose(back.force, -np.asarray(whole.force), atol=1e-15)


def test_stiffness_and_strength_are_the_elements_own():
    joint = scaled(-0.4, 0.7, 0.6)
    # As many steps as in the histories above, which share their kernel.
    d = np.append(1e-30, np.linspace(1.5, 1.6, STEPS - 1))
    reactions, _ = driven(joint.discrete(), d)
    assert float(reactions.stiffness[0]) == pytest.approx(1.0, rel=1e-9)
    kinetic = 0.6 * float(joint.F_S)
    np.testing.assert_allclose(reactions.force[1:], kinetic, rtol=1e-14)
    np.testing.assert_allclose(reactions.stiffness[1:], 0.0, atol=1e-15)


def test_a_rest_changes_nothing():
    joint, d = scaled(-0.4, 0.7, 0.6), np.array([0.4, -0.3, 0.5, 0.55])
    straight, _ = driven(joint.discrete(), np.concatenate([d, np.full(STEPS - 4, d[-1])]))
    rests, _ = driven(joint.discrete(), np.repeat(d, 3))
    np.testing.assert_allclose(rests.force[2::3], straight.force[:4], rtol=1e-14)
    np.testing.assert_allclose(rests.loss[1::3], 0.0, atol=1e-16)
    np.testing.assert_allclose(rests.stiffness[1::3], joint.K_T, rtol=1e-13)
