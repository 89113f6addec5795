"""Evidence against linear models with normal priors, whose evidence is known in closed form."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal, norm

from iwanjax.estimation import Normal, Parameter
from iwanjax.estimation.evidence import linearised, log_evidence, shares
from iwanjax.estimation.minima import Minimum, mixture


def linear(seed, count, known):
    """Data of a linear model with unit noise: slopes, values, data."""
    random = np.random.default_rng(seed)
    J, truth = random.standard_normal((count, known)), random.standard_normal(known)
    return J, truth, J @ truth + random.standard_normal(count)


def conjugate(J, truth, y):
    """Exact log evidence beyond that of no parameters.

    The prior holds as much as one value does (Kass & Wasserman 1995), about the truth.
    """
    count = len(y)
    prior = count * np.linalg.inv(J.T @ J)
    exact = multivariate_normal(J @ truth, np.eye(count) + J @ prior @ J.T).logpdf(y)
    nothing = multivariate_normal(np.zeros(count), np.eye(count)).logpdf(y)
    return exact - nothing


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("known", [1, 4])
def test_evidence_is_that_of_a_prior_worth_one_value(seed, known):
    count = 100
    J, truth, y = linear(seed, count, known)
    exact = conjugate(J, truth, y)
    left = y - J @ np.linalg.lstsq(J, y, rcond=None)[0]
    found = log_evidence([left @ left, y @ y], [known, 0], count, 1.0, 1.0)
    # Exact but for ln(1 + 1/N) and for how far the estimate is from the truth, over N.
    assert found[0] - found[1] == pytest.approx(exact, abs=0.1)


def test_residuals_that_repeat_count_once():
    """Every value twice, at twice the correlation time: the same evidence."""
    once = log_evidence([30.0, 50.0], [2, 0], 40, 1.0, 1.0)
    twice = log_evidence([60.0, 100.0], [2, 0], 80, 1.0, 2.0)
    np.testing.assert_allclose(twice, once, rtol=1e-14)


def test_shares_are_probabilities_also_of_what_would_overflow():
    np.testing.assert_allclose(shares(np.array([2e4, 2e4 - np.log(3.0)])), [0.75, 0.25])


def test_minima_are_weighed_by_their_exact_evidence():
    """Two linear models of one value, a flat and a steep valley, under one normal prior."""
    std, slopes, ends, costs = 10.0, np.array([3.0, 30.0]), np.array([2.0, -4.0]), (1.0, 0.2)
    row = [Parameter("a", float(ends[0]), Normal(0.0, std))]
    minima = [
        Minimum(np.array([end]), cost, np.array([[slope]]), {}, {})
        for end, cost, slope in zip(ends, costs, slopes, strict=True)
    ]
    found = mixture(minima, row, [0], np.array([std]), 1.0)
    # The data's likelihood is a normal density about each end: its product with the prior's mass.
    width = 1.0 / slopes
    exact = np.exp(-0.5 * np.array(costs)) * width * norm.pdf(ends, 0.0, np.hypot(std, width))
    np.testing.assert_allclose(found.weight, exact / exact.sum(), rtol=1e-3)
    # And the spread is that of the mixture about the best end, in units of the prior's.
    inside = 1.0 / (slopes**2 + std**-2)
    square = found.weight @ (inside + (ends - ends[0]) ** 2)
    np.testing.assert_allclose(found.covariance, square / std**2, rtol=1e-12)


@given(st.integers(0, 10**6), st.integers(1, 4), st.floats(1.0, 5.0))
def test_deviations_are_those_of_a_linear_model(seed, known, tau):
    """Flat priors and unit noise: the diagonal of (J^T J)^-1, times the correlation time."""
    J, _, _ = linear(seed, 60, known)
    exact = np.sqrt(tau * np.diag(np.linalg.inv(J.T @ J)))
    np.testing.assert_allclose(linearised(J, 20.0, tau), exact, rtol=1e-9)
    nothing = np.column_stack([J, np.zeros(60)])
    assert np.isnan(linearised(nothing, 20.0, tau)[-1])
    assert jnp.all(linearised(J, 6e4, tau) > exact)
