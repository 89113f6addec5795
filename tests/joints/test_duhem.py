"""A spring that yields along a curve of any shape, as a term of the general law."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import iwanjax as ij
from iwanjax.joints import BoucWen, UnnamedLaw
from iwanjax.joints.duhem import FIRST_BRANCH, NODES, nearest_branch, scaled
from iwanjax.joints.unnamed_terms import PARTS, TERMS

D, V, T = 2e-3, 0.4, 0.05
OWN = PARTS["duhem"].start
SIDE = NODES[NODES.size // 2 :]
STRENGTH = np.eye(len(TERMS))[OWN]


def along(f, slip: float = 0.25 * D) -> UnnamedLaw:
    """A law of strength 1 by the function f of the share, over the slip."""
    back, onward = np.log(f(-SIDE) * D / slip), np.log(f(SIDE) * D / slip)
    held = np.maximum(back - onward, 0.0)[1:]
    return UnnamedLaw(STRENGTH, D, V, T, np.concatenate([back, held]))


def forces(law: UnnamedLaw, path: np.ndarray) -> np.ndarray:
    """Whatever the time it takes."""
    return np.asarray(ij.hysteresis(law, path, dt=T))


def pinched(w):
    """Bouc and Wen's with the exponent 1, pinched where it grows again (Baber and Noori 1985)."""
    w = np.asarray(w, float)
    open_to = 1.0 - 0.8 * np.exp(-(((w - 0.1) / 0.2) ** 2))
    return open_to * np.maximum(1.0 - np.maximum(w, 0.0), 0.05)


def shares(law: UnnamedLaw, path: np.ndarray) -> np.ndarray:
    """By its differential equation, whose f is linear between nodes."""
    back, held = np.split(np.stack(law.branch), [SIDE.size])
    f = np.exp(np.concatenate([back[::-1], back[1:] - held])) / D
    ends, w = [0.0], 0.0
    for moved in np.diff(path):
        way = np.sign(moved)

        def slope(_: float, w: np.ndarray, way: float = way) -> np.ndarray:
            return np.where(way * w >= 1.0, 0.0, way * np.interp(way * w, NODES, f))

        if moved:
            w = solve_ivp(slope, (0, abs(moved)), [w], rtol=1e-9, atol=1e-11).y[0, -1]
        ends.append(float(w))
    return np.array(ends)


def dahl(w):
    return 1.0 - 0.9 * np.asarray(w, float)


@pytest.mark.parametrize("f", [pinched, dahl])
def test_it_follows_its_equation(f):
    law = along(f)
    turns = np.array([0.0, 0.9, -0.7, 0.5, -0.1, 0.3, -1.5, 0.2]) * D
    path = np.concatenate([np.linspace(a, b, 8)[:-1] for a, b in itertools.pairwise(turns)])
    np.testing.assert_allclose(forces(law, path), shares(law, path), atol=1e-6)


def test_a_step_is_as_long_as_it_likes():
    law = along(pinched)
    turns = np.array([0.0, 0.6, -0.5, 0.1]) * D
    fine = np.concatenate(
        [[0.0], *(np.linspace(a, b, 400)[1:] for a, b in itertools.pairwise(turns))]
    )
    coarse = forces(law, turns)
    np.testing.assert_allclose(forces(law, fine)[::399], coarse, atol=1e-12)


def test_by_default_it_is_bouc_and_wens():
    """Of the exponent 1, but for the last of its strength."""
    law, d = UnnamedLaw(STRENGTH, D, V, T), np.array([0.0, 0.1, 0.5, 1.2]) * D
    named = BoucWen(F_S=1.0, K_T=1.0 / D, n=1.0)
    for method in ("backbone", "dissipation", "tip_stiffness"):
        ours, theirs = getattr(law, method)(d), getattr(named, method)(d)
        np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-16)
    np.testing.assert_allclose(law.loading(0.3 * D, D), named.loading(0.3 * D, D), rtol=1e-8)


@pytest.mark.parametrize("f", [pinched, dahl])
@pytest.mark.parametrize("reach", [0.02, 0.3, 1.0, 4.0])
def test_a_steady_cycle(f, reach):
    law, d = along(f), reach * 0.25 * D
    element, onward = law.duhem, eqx.filter_jit(law.duhem.onward)
    w = jnp.zeros(())
    for turn in range(600):
        w = onward(w, jnp.asarray((-1.0) ** turn * 2.0 * d))
    there = np.linspace(-d, d, 4001)
    steady = jax.jit(jax.vmap(element.onward, (None, 0)))(w, there + d)
    np.testing.assert_allclose(law.loading(there, d), steady, atol=1e-7)
    area = 2.0 * np.trapezoid(law.loading(there, d), there)
    assert float(law.dissipation(d)) == pytest.approx(area, rel=1e-4)
    loss = jax.jit(lambda x: law.dissipation(x))
    near = [float(loss(d * (1.0 + e))) for e in (1e-5, -1e-5)]
    slope = float(jax.grad(loss)(d))
    assert slope == pytest.approx((near[0] - near[1]) / (2e-5 * d), rel=1e-3)


@pytest.mark.parametrize("reach", [0.3, 1.0, 1.7])
def test_the_tip_stiffness_is_that_of_a_slow_decay(reach):
    """Work of a branch of the length 2d, of turns that come closer each time."""
    law = along(pinched)
    d, shrunk, element = reach * 0.25 * D, 1e-5 * D, law.duhem
    lengths = 2.0 * d + 2.0 * shrunk * np.arange(400, -1, -1)
    w, onward, way = (
        -law.loading(lengths[0] / 2.0, lengths[0] / 2.0),
        eqx.filter_jit(element.onward),
        1.0,
    )
    for length in lengths[:-1]:
        w, way = onward(w, jnp.asarray(way * length)), -way
    moved = jnp.asarray(way * 2.0 * d)
    after = onward(w, moved)
    work = float(element.lost(w, after, moved) + element.stored(after) - element.stored(w))
    found = (float(law.dissipation(d)) / 2.0 - work) / (d * shrunk)
    assert found == pytest.approx(float(law.tip_stiffness(d)), rel=0.02)


@eqx.filter_jit
def moved_by(element, w, moved):
    """Share, loss and work of a step, the work by quadrature."""
    after = element.onward(w, moved)
    way = moved * jnp.linspace(0.0, 1.0, 2001)
    force = jax.vmap(element.onward, (None, 0))(w, way)
    return after, element.lost(w, after, moved), jnp.trapezoid(force, way)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.1, 4.0))
def test_no_path_feeds_energy(seed, reach):
    random = np.random.default_rng(seed)
    back, held = random.normal(size=SIDE.size), np.abs(random.normal(size=SIDE.size - 1))
    law = UnnamedLaw(STRENGTH, D, V, T, np.concatenate([back, held]))
    path = np.concatenate([[0.0], reach * D * random.normal(size=30), [0.0]])
    element = law.duhem

    w = jnp.zeros(())
    for moved in np.diff(path):
        stored = element.stored(w)
        w, lost, work = moved_by(element, w, jnp.asarray(moved))
        assert float(lost) >= 0.0
        assert abs(float(w)) <= 1.0
        rest = float(work - lost - element.stored(w) + stored)
        assert abs(rest) < 1e-3 * abs(moved)


def test_forces_are_odd():
    law, path = along(pinched), np.array([0.0, 0.6, -0.5, 0.1]) * D
    np.testing.assert_allclose(forces(law, -path), -forces(law, path))


def test_slopes_of_the_branch_are_those_of_differences():
    law, path = along(pinched), np.array([0.0, 0.6, -0.5, 0.1, 0.9, -0.3]) * D

    def last(branch):
        element = law.with_branch(branch).duhem
        w = jnp.zeros(())
        for moved in np.diff(path):
            w = element.onward(w, jnp.asarray(moved))
        return w

    branch = jnp.stack(law.branch)
    slopes = np.asarray(jax.jit(jax.grad(last))(branch))
    step, run = 1e-6, jax.jit(last)
    each = [
        (run(branch + step * e) - run(branch - step * e)) / (2 * step) for e in np.eye(branch.size)
    ]
    assert np.max(np.abs(slopes)) > 1e-2
    np.testing.assert_allclose(slopes, each, atol=1e-7)


@pytest.mark.parametrize("f", [pinched, dahl])
def test_the_curve_is_seen_from_force_and_motion(f):
    """Of samples so far apart that twenty make a cycle, by a law of another strength."""
    t = np.arange(600) * T / 20.0
    d = D * np.exp(-t / (10.0 * T)) * np.sin(2 * np.pi * t / T)
    law = along(f)
    force = 70.0 * shares(law, d)
    v = np.gradient(d, t[1])
    strength, branch = nearest_branch(d[None], v[None], force[None])
    assert strength == pytest.approx(np.max(np.abs(force)) * (1 + 1 / NODES.size))
    again = UnnamedLaw(strength * STRENGTH, D, V, T, scaled(branch, D))
    # As a start for a search: between samples so far apart the curve is taken to be straight.
    assert np.linalg.norm(forces(again, d) - force) < 0.1 * np.linalg.norm(force)


@pytest.mark.parametrize("force", [0.0, np.nan, np.inf])
def test_of_no_force_no_curve_is_seen(force):
    t = np.linspace(0.0, 1.0, 50)
    d, v = np.sin(9.0 * t)[None], 9.0 * np.cos(9.0 * t)[None]
    strength, branch = nearest_branch(d, v, np.full_like(d, force))
    assert strength == 0.0
    np.testing.assert_array_equal(branch, FIRST_BRANCH)
    # One that falls as the place moves on is none either.
    assert nearest_branch(d, v, -d)[0] == 0.0


def test_a_branch_that_would_feed_energy_is_refused():
    steep = np.concatenate([FIRST_BRANCH[: SIDE.size], -np.ones(SIDE.size - 1)])
    with pytest.raises(ij.InputError, match="less would feed energy"):
        UnnamedLaw(STRENGTH, D, V, T, steep)
    with pytest.raises(ij.InputError, match=f"expected {FIRST_BRANCH.size}"):
        UnnamedLaw(STRENGTH, D, V, T, steep[:3])
