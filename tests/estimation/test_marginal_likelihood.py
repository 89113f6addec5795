"""Evidence against linear models with Gaussian priors, whose marginal likelihood is a formula.

With y = X b + e, e of covariance R, and b of covariance P, y is Gaussian of covariance R + X P X^T:
no fit, no expansion. The prior that evidence stands for says as much as one datum does,
P = n (X^T R^-1 X)^-1 (Kass and Wasserman 1995), with n independent data.
"""

import math

import numpy as np
import pytest
import scipy.linalg
import scipy.stats

from iwanjax.correlation import correlation_time
from iwanjax.estimation.evidence import (
    linearised,
    log_evidence,
    misspecification_probability,
    shares,
)

SIGMA = 0.7


def design(count: int, columns: int, model: int) -> np.ndarray:
    """Decaying sines, as the effects of a law on a ring-down are; of each model its own."""
    t = np.linspace(0.0, 1.0, count)[:, None]
    f = 3.0 + 1.3 * model + 2.0 * np.arange(columns)
    return np.exp(-2.0 * t) * np.sin(2.0 * np.pi * f * t)


def marginal(y: np.ndarray, X: np.ndarray, R: np.ndarray, independent: float) -> float:
    """Log density of y with the prior that says as much as one datum."""
    prior = independent * np.linalg.inv(X.T @ np.linalg.solve(R, X)) if X.size else np.zeros((0, 0))
    cov = R + X @ prior @ X.T
    return float(scipy.stats.multivariate_normal(np.zeros(len(y)), cov).logpdf(y))


def cost(y: np.ndarray, X: np.ndarray, sigma: float = SIGMA) -> float:
    """Least sum of squares, in deviations of the noise."""
    left = y - X @ np.linalg.lstsq(X, y, rcond=None)[0] if X.size else y
    return float(left @ left) / sigma**2


@pytest.mark.parametrize("count", [200, 400])
@pytest.mark.parametrize("columns", [(0, 1), (1, 3), (2, 2)])
def test_evidence_of_white_noise_is_the_marginal_likelihood(count, columns):
    """Odds of two models, of one, two or more values, by either way."""
    models = [design(count, k, i) for i, k in enumerate(columns)]
    random = np.random.default_rng(3)
    y = models[1] @ random.normal(0.3, 0.1, columns[1]) + SIGMA * random.standard_normal(count)
    exact = [marginal(y, X, SIGMA**2 * np.eye(count), count) for X in models]
    found = log_evidence([cost(y, X) for X in models], columns, count, 1.0, 1.0)
    # With n + 1 for n, the prior's own share of the data: what an expansion in 1/n leaves out.
    off = 0.5 * max(columns) / count + 0.5 * abs(cost(y, models[0]) - cost(y, models[1])) / count
    assert found[1] - found[0] == pytest.approx(exact[1] - exact[0], abs=1.5 * off + 1e-9)
    assert abs(exact[1] - exact[0]) > 10.0 * off


@pytest.mark.parametrize("again", [2, 5])
def test_values_measured_again_say_nothing_new(again):
    """Each value so many times: evidence is that of one of each, with the time they are alike."""
    count = 120
    X, random = design(count, 2, 0), np.random.default_rng(8)
    y = X @ np.array([0.5, -0.4]) + SIGMA * random.standard_normal(count)
    once = log_evidence([cost(y, X[:, :k]) for k in (0, 1, 2)], [0, 1, 2], count, 1.0, 1.0)
    many_y, many_X = np.repeat(y, again), np.repeat(X, again, axis=0)
    costs = [cost(many_y, many_X[:, :k]) for k in (0, 1, 2)]
    found = log_evidence(costs, [0, 1, 2], count * again, 1.0, float(again))
    np.testing.assert_allclose(found, once, rtol=1e-12)


def test_evidence_of_correlated_noise_is_the_marginal_likelihood():
    """Noise of first order, and effects that are slow beside it, as misfits along a curve are."""
    count, rho = 1000, 0.6
    tau = (1.0 + rho) / (1.0 - rho)
    R = SIGMA**2 * scipy.linalg.toeplitz(rho ** np.arange(count))
    X, random = design(count, 2, 5), np.random.default_rng(4)
    e = np.linalg.cholesky(R) @ random.standard_normal(count)
    y = X @ np.array([1.0, -1.0]) + e
    exact = [marginal(y, X[:, :k], R, count / tau) for k in (1, 2)]
    costs = [cost(y, X[:, :k]) for k in (1, 2)]
    found = log_evidence(costs, [1, 2], count, 1.0, tau)
    assert exact[1] - exact[0] > 20.0
    assert found[1] - found[0] == pytest.approx(exact[1] - exact[0], rel=0.05)
    # Taken for white, the noise would speak four times as loud.
    white = log_evidence(costs, [1, 2], count, 1.0, 1.0)
    assert white[1] - white[0] > 3.0 * (exact[1] - exact[0])
    assert correlation_time(e[None, :, None]) == pytest.approx(tau, rel=0.25)


def test_deviations_are_those_of_the_conjugate_posterior():
    """Without a prior, of correlated noise: (X^T R^-1 X)^-1 where effects are slow."""
    count, rho = 1000, 0.6
    R = SIGMA**2 * scipy.linalg.toeplitz(rho ** np.arange(count))
    X = design(count, 3, 6)
    exact = np.sqrt(np.diag(np.linalg.inv(X.T @ np.linalg.solve(R, X))))
    expected_cost = float(count)
    found = linearised(X / SIGMA, expected_cost, (1.0 + rho) / (1.0 - rho))
    np.testing.assert_allclose(found, exact, rtol=0.05)


def test_shares_are_calibrated():
    """Of worlds drawn from the models and their priors, as many are a model's as it is given."""
    count, worlds = 150, 1500
    models = [design(count, k, i) for i, k in ((0, 0), (1, 1), (2, 1), (3, 2))]
    random = np.random.default_rng(12)
    given, came = [], []
    for _ in range(worlds):
        true = int(random.integers(len(models)))
        X = models[true]
        y = SIGMA * random.standard_normal(count)
        if X.size:
            scale = SIGMA * math.sqrt(count) * np.linalg.inv(np.linalg.cholesky(X.T @ X)).T
            # Often no larger than what noise looks like: none of the models is sure.
            y = y + X @ (scale @ random.standard_normal(X.shape[1]))
        costs = [cost(y, each) for each in models]
        found = shares(log_evidence(costs, [x.shape[1] for x in models], count, 1.0, 1.0))
        given.append(found)
        came.append(np.arange(len(models)) == true)
    given, came = np.array(given), np.array(came)
    np.testing.assert_allclose(given.sum(axis=1), 1.0)
    # All models together, and each alone: three deviations of a share.
    for k in range(len(models)):
        assert given[:, k].mean() == pytest.approx(came[:, k].mean(), abs=3 * 0.5 / worlds**0.5)
    bins = np.digitize(given, [0.02, 0.3, 0.7, 0.98])
    for b in np.unique(bins):
        inside = bins == b
        expected, found = given[inside].mean(), came[inside].mean()
        deviation = math.sqrt(max(expected * (1.0 - expected), 1e-4) / inside.sum())
        assert found == pytest.approx(expected, abs=3.5 * deviation + 0.005)


def test_data_that_say_nothing_leave_the_prior():
    """Of equal costs and equal numbers of values, whatever the costs are."""
    for level in (0.0, 1e6):
        found = shares(log_evidence([level] * 4, [2] * 4, 1000, 0.5, 3.0))
        np.testing.assert_allclose(found, 0.25)
    # What was likelier before by some log odds still is: here by 1 and by 12.
    prior = np.array([12.0, 1.0, 0.0])
    found = shares(prior + log_evidence([5.0] * 3, [1] * 3, 1000, 1.0, 1.0))
    np.testing.assert_allclose(found, np.exp(prior) / np.exp(prior).sum())


def test_huge_evidences_are_shared_out_all_the_same():
    np.testing.assert_allclose(shares(np.array([-1e8, -1e8 + math.log(3.0)])), [0.25, 0.75])
    np.testing.assert_allclose(shares(np.array([1e8, 0.0])), [1.0, 0.0])


@pytest.mark.parametrize(
    ("ratio", "expected"),
    [
        (0.5, 0.0),
        (1.0, 0.0),
        # As likely wrong as right where 0.6 of the noise is left beyond it; odds to the power 1.8.
        (1.6, 0.5),
        (1.0 + 0.6 * 3.0 ** (1 / 1.8), 0.75),
        (1.0 + 0.6 * 99.0 ** (1 / 1.8), 0.99),
        (math.inf, 1.0),
        (math.nan, 0.0),
    ],
)
def test_doubt_by_what_a_fit_leaves(ratio, expected):
    assert misspecification_probability(ratio) == pytest.approx(expected, abs=1e-12)
