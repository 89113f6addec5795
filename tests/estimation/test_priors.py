"""Priors: densities that integrate to one, draws that come from them."""

import itertools

import jax
import numpy as np
import pytest
import scipy.integrate
import scipy.stats

from iwanjax.errors import InputError
from iwanjax.estimation import PRIORS, LogNormal, LogUniform, Normal, Uniform

# Each with SciPy's own distribution and its support.
CASES = [
    (Uniform(-2.0, 5.0), scipy.stats.uniform(-2.0, 7.0), (-2.0, 5.0)),
    (LogUniform(1e-3, 1e4), scipy.stats.loguniform(1e-3, 1e4), (1e-3, 1e4)),
    (Normal(-3.0, 0.2), scipy.stats.norm(-3.0, 0.2), (-np.inf, np.inf)),
    (LogNormal(50.0, 1.5), scipy.stats.lognorm(1.5, scale=50.0), (0.0, np.inf)),
]
IDS = [type(prior).__name__ for prior, _, _ in CASES]
CASE = pytest.mark.parametrize(("prior", "known", "support"), CASES, ids=IDS)
DRAWS = 20_000


@CASE
def test_density_is_the_known_one_and_integrates_to_one(prior, known, support):
    x = known.ppf(np.array([1e-6, 0.01, 0.3, 0.5, 0.9, 1 - 1e-6]))
    np.testing.assert_allclose(prior.log_density(x), known.logpdf(x), rtol=1e-10, atol=1e-12)
    # In the quantile's own steps, so that a density over many decades is as easy as any.
    edges = known.ppf(np.linspace(1e-12, 1 - 1e-12, 20))
    total = sum(
        scipy.integrate.quad(lambda v: float(np.exp(prior.log_density(v))), a, b)[0]
        for a, b in itertools.pairwise(edges)
    )
    assert total == pytest.approx(1.0, abs=1e-7)


@CASE
def test_draws_come_from_the_density(prior, known, support):
    draws = prior.draw(np.random.default_rng(5), DRAWS)
    assert draws.shape == (DRAWS,)
    # Kolmogorov's test: chance alone fails it once in a thousand seeds.
    assert scipy.stats.kstest(draws, known.cdf).pvalue > 1e-3
    np.testing.assert_array_equal(draws, prior.draw(np.random.default_rng(5), DRAWS))
    assert np.all(np.isfinite(prior.log_density(draws)))


@CASE
def test_outside_the_support_there_is_nothing_and_no_nan(prior, known, support):
    low, high = support
    outside = [x for x in (low - 1.0, high + 1.0, -1e300) if not low <= x <= high]
    for x in outside:
        if np.isfinite(x):
            assert float(prior.log_density(x)) == -np.inf
    gradient = jax.grad(lambda v: prior.log_density(v))
    for x in (*outside, float(known.median())):
        if np.isfinite(x):
            assert np.isfinite(float(gradient(x)))


@CASE
def test_gradient_is_the_densitys(prior, known, support):
    x = known.ppf(np.array([0.1, 0.5, 0.8]))
    found = jax.vmap(jax.grad(prior.log_density))(x)
    h = 1e-5 * np.abs(x)
    expected = (known.logpdf(x + h) - known.logpdf(x - h)) / (2 * h)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


def test_ends_belong_to_the_range():
    for prior in (Uniform(1.0, 2.0), LogUniform(1.0, 2.0)):
        assert np.all(np.isfinite(prior.log_density(np.array([1.0, 2.0]))))
        np.testing.assert_array_equal(prior.log_density(np.array([0.999, 2.001])), -np.inf)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Uniform(2.0, 1.0), "low < high"),
        (lambda: Uniform(1.0, 1.0), "low < high"),
        (lambda: Uniform(0.0, np.inf), "low < high"),
        (lambda: Uniform(np.nan, 1.0), "low < high"),
        (lambda: LogUniform(2.0, 1.0), "low < high"),
        (lambda: LogUniform(0.0, 1.0), "low = 0"),
        (lambda: LogUniform(-1.0, 1.0), "low = -1"),
        (lambda: Normal(0.0, 0.0), "std = 0"),
        (lambda: Normal(0.0, -1.0), "std = -1"),
        (lambda: Normal(0.0, np.nan), "std = nan"),
        (lambda: Normal(np.nan, 1.0), "mean"),
        (lambda: LogNormal(0.0, 1.0), "median = 0"),
        (lambda: LogNormal(1.0, 0.0), "sigma = 0"),
        (lambda: LogNormal(1.0, np.inf), "sigma = inf"),
    ],
)
def test_what_is_no_distribution_is_refused(make, told):
    with pytest.raises(InputError, match=told):
        make()


def test_names_of_study_files():
    kinds = {"uniform": Uniform, "log_uniform": LogUniform}
    assert kinds | {"normal": Normal, "log_normal": LogNormal} == PRIORS
