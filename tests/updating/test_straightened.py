"""Ridges that a walk has found: straight, of the same volume, and walked along without bias."""

import emcee
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from iwanjax.updating.straightened import AlongRidges, Straightened

WIDTH, BEND = 0.02, 0.08


def bent(count: int, seed: int = 0) -> np.ndarray:
    """A band along two variables that follows the first, thinner than it is bent."""
    x = np.random.default_rng(seed).standard_normal((count, 3))
    across = BEND * (x[:, 0] ** 2 - 1.0) + WIDTH * x[:, 2]
    return np.column_stack([3.0 * x[:, 0], x[:, 1], x[:, 0] + x[:, 1] + across])


def parts(y: np.ndarray) -> np.ndarray:
    """The independent normal variables that these are made of."""
    x = y[..., 0] / 3.0
    across = y[..., 2] - x - y[..., 1] - BEND * (x**2 - 1.0)
    return np.stack([x, y[..., 1], across / WIDTH], axis=-1)


def log_density(y: np.ndarray) -> np.ndarray:
    """Of the same points."""
    return -0.5 * np.sum(parts(y) ** 2, axis=-1)


@pytest.fixture(scope="module")
def known():
    return Straightened.of(bent(20_000))


@settings(max_examples=20)
@given(st.integers(0, 10**6), st.integers(1, 6), st.integers(30, 300))
def test_there_and_back(seed, variables, count):
    random = np.random.default_rng(seed)
    points = random.standard_normal((count, variables)) @ random.standard_normal(2 * [variables])
    points[:, -1] += points[:, 0] ** 2
    found = Straightened.of(points)
    far = 3.0 * points
    scale = np.max(np.abs(far))
    np.testing.assert_allclose(found.as_given(found.straight(far)), far, atol=1e-6 * scale)


def test_the_volume_is_the_same_everywhere(known):
    volumes = []
    for point in bent(5, seed=1):
        ends = [point + sign * 1e-6 * np.eye(3) for sign in (1.0, -1.0)]
        slopes = (known.straight(ends[0]) - known.straight(ends[1])) / 2e-6
        volumes.append(np.linalg.det(slopes))
    np.testing.assert_allclose(volumes, 1.0 / np.linalg.det(known.root), rtol=1e-5)


def test_what_is_bent_fills_less_when_it_is_straight(known):
    """By the volume of normal points of the same covariance."""
    y = bent(20_000, seed=2)
    filled = np.sqrt(np.linalg.det(np.cov(known.straight(y).T))) * abs(np.linalg.det(known.root))
    assert 3.0 * WIDTH < filled < 0.3 * np.sqrt(np.linalg.det(np.cov(y.T)))


def test_a_variable_that_never_moves_stays_where_it_is():
    points = np.column_stack([bent(100), np.full(100, 7.0)])
    found = Straightened.of(points)
    np.testing.assert_allclose(found.as_given(found.straight(points)), points, atol=1e-8)


def walked(move: emcee.moves.Move, steps: int) -> emcee.EnsembleSampler:
    """Of the density."""
    sampler = emcee.EnsembleSampler(24, 3, log_density, moves=move, vectorize=True)
    state = emcee.State(bent(24, seed=3), random_state=np.random.RandomState(0).get_state())
    sampler.run_mcmc(state, steps, skip_initial_state_check=True)
    return sampler


@pytest.mark.parametrize("move", [emcee.moves.DEMove, emcee.moves.StretchMove])
def test_more_is_taken_of_what_is_proposed_along_them(known, move):
    taken = [walked(each, 500).acceptance_fraction for each in (AlongRidges(move(), known), move())]
    assert np.mean(taken[0]) > 1.3 * np.mean(taken[1])


def test_a_walk_along_them_has_the_density_that_it_is_to_have(known):
    sampler = walked(AlongRidges(emcee.moves.DEMove(), known), 5000)
    x = parts(sampler.get_chain()).reshape(-1, 3)
    tau = emcee.autocorr.integrated_time(sampler.get_chain(), tol=0).max()
    error = 4.0 * np.sqrt(tau / len(x))
    np.testing.assert_allclose(x.mean(axis=0), 0.0, atol=error)
    # Of a normal variable's square the deviation is the square root of two.
    np.testing.assert_allclose(np.cov(x.T), np.eye(3), atol=np.sqrt(2.0) * error)
