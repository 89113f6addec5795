"""Posteriors: a case with a known answer, walks that are interrupted, files that do not belong."""

import importlib.util
import os
import pickle
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import cache
from typing import ClassVar

import emcee
import h5py
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats
from updating.simulated import LEVELS, NAMES, TRUTH, clean, noisy

import iwanjax as ij
from iwanjax.correlation import autocorrelation_times
from iwanjax.errors import InputError
from iwanjax.estimation import LogNormal
from iwanjax.updating import fit, modal_parameters, sampling
from iwanjax.updating.density import Density, log_densities
from iwanjax.updating.sampling import sample_posterior

# Errors of Monte Carlo means are compared with so many of their own deviations.
SIGMAS = 4.0
WALKERS, WANTED = 48, 1000
FREE = ("f_0", "zeta_0")
SCALES = ("noise_scale_frequency", "noise_scale_damping")


@cache
def two_free(seed=0):
    """All that is not linear is known: the posterior is Gauss's, given the noise scales."""
    known = modal_parameters(ij.Iwan4, noisy(seed))
    fixed = {
        name: replace(known[name], value=getattr(TRUTH, name), fixed=True)
        for name in set(NAMES) - set(FREE)
    }
    return fit("iwan4", noisy(seed), fixed, starts=4)


def walk(solution=None, **options):
    settings = {"walkers": WALKERS, "effective": WANTED} | options
    return sample_posterior(solution or two_free(), **settings)


@pytest.fixture(scope="module")
def posterior():
    """Uninterrupted."""
    return walk()


@cache
def six_free():
    return sample_posterior(fit("iwan4", noisy(0)), walkers=24, effective=800)


def steps(found):
    return found.burnt + len(found.chain)


def scale_moments(cost, least=-3.0):
    """Mean of ln s and of s^2 where the data are N, less one for the parameter beside it."""
    log = np.linspace(least, 3.0, 60001)
    density = -0.5 * log**2 - (LEVELS - 1) * log - 0.5 * cost * np.exp(-2 * log)
    weight = np.exp(density - density.max())
    weight /= weight.sum()
    mean = weight @ log
    return mean, np.sqrt(weight @ (log - mean) ** 2), weight @ np.exp(2 * log)


def same_statistics(a, b):
    """Means and deviations agree to the Monte Carlo error of both."""
    assert a.names == b.names
    for name in a.names:
        x, y = a.samples[name], b.samples[name]
        share = np.sqrt(1 / a.effective[name] + 1 / b.effective[name])
        assert abs(x.mean() - y.mean()) < SIGMAS * share * x.std(), name
        # The scales' tails are a little longer than Gauss's: half as much again.
        assert abs(np.log(x.std() / y.std())) < SIGMAS * 1.5 * share / np.sqrt(2), name


# --- the known answer ---------------------------------------------------------------------


def test_linear_parameters_have_the_fits_covariance_and_the_scales_their_own_density(posterior):
    found, samples = posterior.solution, posterior.samples
    costs = [float(np.sum(np.asarray(r) ** 2)) for r in found.problem.differences(values(found))]
    for name, scale, cost in zip(FREE, SCALES, costs, strict=True):
        mean, std, square = scale_moments(cost)
        x, n = samples[name], posterior.effective[name]
        plain = found.std[name] / max(found.misfit, 1.0)
        expected = plain * np.sqrt(square)
        assert abs(x.mean() - found.values[name]) < SIGMAS * expected / np.sqrt(n)
        assert x.std() == pytest.approx(expected, rel=SIGMAS * 1.2 / np.sqrt(2 * n))
        log, n = np.log(samples[scale]), posterior.effective[scale]
        assert abs(log.mean() - mean) < SIGMAS * std / np.sqrt(n)
        assert log.std() == pytest.approx(std, rel=SIGMAS * 1.2 / np.sqrt(2 * n))
    # Frequency alone says f_0, damping zeta_0.
    joint = np.corrcoef(samples["f_0"], samples["zeta_0"])[0, 1]
    assert abs(joint) < SIGMAS / np.sqrt(min(posterior.effective.values()))
    low, high = posterior.interval("f_0", 0.5)
    assert high - low == pytest.approx(2 * 0.6745 * samples["f_0"].std(), rel=0.1)


def values(found):
    return jnp.asarray([p.value for p in found.parameters])


def test_it_walks_until_there_are_enough(posterior):
    assert posterior.enough
    assert posterior.wanted == WANTED
    assert posterior.names == (*FREE, *SCALES)
    assert posterior.chain.shape == (len(posterior.chain), WALKERS, 4)
    assert posterior.log_density.shape == posterior.chain.shape[:2]
    assert np.all(np.isfinite(posterior.log_density))
    assert 0.1 < posterior.acceptance < 0.9
    for name in posterior.names:
        tau = posterior.autocorrelation[name]
        assert posterior.effective[name] == pytest.approx(len(posterior.chain) * WALKERS / tau)
        assert posterior.effective[name] >= WANTED
        assert len(posterior.chain) > 40 * tau
        assert posterior.burnt >= 5 * tau


@pytest.mark.long
def test_effective_samples_are_what_the_means_of_walks_scatter_by(posterior):
    """The claim itself, about the means that are known."""
    walks = [posterior, *(walk(seed=s, most_steps=500) for s in range(1, 4))]
    found = posterior.solution
    costs = [float(np.sum(np.asarray(r) ** 2)) for r in found.problem.differences(values(found))]
    known = dict.fromkeys(FREE, lambda x: x) | dict.fromkeys(SCALES, np.log)
    means = [found.values[name] for name in FREE] + [scale_moments(c)[0] for c in costs]
    for (name, of), mean in zip(known.items(), means, strict=True):
        z = []
        for each in walks:
            x = of(each.samples[name])
            z.append((x.mean() - mean) / x.std() * np.sqrt(each.effective[name]))
        assert np.sum(np.square(z)) < scipy.stats.chi2.ppf(1 - 1e-4, len(walks)), name


def test_summary_holds_the_numbers(posterior):
    summary = posterior.summary()
    assert "NOT LONG ENOUGH" not in summary
    assert summary.startswith("posterior of 2 parameters: at least ")
    for name in posterior.names:
        (line,) = (x for x in summary.splitlines() if x.startswith(f"  {name} "))
        told = [float(x.strip("[],")) for x in line.split()[1:4]]
        width = np.diff(posterior.interval(name))[0]
        expected = [np.median(posterior.samples[name]), *posterior.interval(name)]
        assert told == pytest.approx(expected, abs=0.02 * width)


@pytest.mark.parametrize("kept", [0.1, 0.9, 0.99])
def test_autocorrelation_times_are_told_by_some_of_the_steps(kept):
    """Of a first-order process, beside one that forgets at once."""
    random, steps = np.random.default_rng(1), 20_000
    x = random.standard_normal((steps, 30, 2))
    for i in range(1, steps):
        x[i, :, 0] = kept * x[i - 1, :, 0] + np.sqrt(1.0 - kept**2) * x[i, :, 0]
    tau = autocorrelation_times(x[..., :1])
    assert tau == pytest.approx([(1.0 + kept) / (1.0 - kept)], rel=0.1)
    both = autocorrelation_times(x)
    assert both == pytest.approx([(1.0 + kept) / (1.0 - kept), 1.0], rel=0.1)


def test_too_few_steps_are_told():
    short = walk(most_steps=250, effective=10**6)
    assert not short.enough
    assert steps(short) == 250
    summary = short.summary()
    assert summary.startswith("posterior NOT LONG ENOUGH")
    assert f"{min(short.effective.values()):.0f} effective samples" in summary
    assert "1000000" in summary


def test_enough_needs_a_chain_that_is_long_beside_its_memory():
    """A few wanted are there soon, but nothing tells how long the memory is."""
    short = walk(most_steps=250, effective=10)
    tau = max(short.autocorrelation.values())
    assert min(short.effective.values()) > 10
    assert short.enough == (len(short.chain) > 40 * tau)


def test_no_more_steps_than_asked_for():
    assert steps(walk(most_steps=100, effective=10**6)) <= 100


def test_the_same_seed_gives_the_same_walk():
    first, again, other = (walk(seed=s, most_steps=250) for s in (3, 3, 4))
    np.testing.assert_array_equal(first.chain, again.chain)
    assert not np.array_equal(first.chain, other.chain)


# --- six parameters -----------------------------------------------------------------------


def test_where_all_is_determined_the_fits_deviations_are_the_posteriors():
    found = six_free()
    for name in NAMES:
        fitted = found.solution
        scale = fitted.misfit / max(fitted.misfit, 1.0)
        ratio = found.samples[name].std() / (fitted.std[name] * scale)
        assert ratio == pytest.approx(1.0, abs=0.25), name
        offset = found.samples[name].mean() - fitted.values[name]
        assert abs(offset) < 0.5 * fitted.std[name], name


def test_bands_hold_the_true_curves():
    found = six_free()
    _, f, zeta = clean()
    (narrow,), (wide,) = found.bands(0.9), found.bands(0.998, count=4000)
    for truth, inner, outer in (
        (f, narrow.frequency, wide.frequency),
        (zeta, narrow.damping, wide.damping),
    ):
        assert inner.shape == (3, LEVELS)
        assert np.all(np.diff(inner, axis=0) > 0)
        assert np.all((truth > outer[0]) & (truth < outer[2]))
        assert np.all((outer[0] < inner[0]) & (outer[2] > inner[2]))
    # They are about the parameters: narrower than the 90 % that a level's noise has.
    measured = found.solution.measured[0]
    assert np.all(
        narrow.frequency[2] - narrow.frequency[0] < 3.29 * np.asarray(measured.frequency_std)
    )
    np.testing.assert_array_equal(narrow.amplitude, measured.amplitude)


def test_draws_are_whole_parameter_vectors(posterior):
    theta = posterior.draws(500, seed=2)
    assert theta.shape == (500, 6)
    np.testing.assert_array_equal(
        theta[:, 2:], np.tile([getattr(TRUTH, n) for n in NAMES[2:]], (500, 1))
    )
    assert set(theta[:, 0]) <= set(posterior.samples["f_0"])
    np.testing.assert_array_equal(theta, posterior.draws(500, seed=2))


def test_density_is_likelihood_times_priors_times_the_volume_of_the_variables():
    """In NumPy, up to one constant for all points."""
    found = six_free().solution
    problem = found.problem
    free = [p.prior for p in found.parameters]
    rng = np.random.default_rng(0)
    z = np.asarray(problem.to_variables(values(found)))
    y = np.concatenate([np.tile(z, (12, 1)), np.zeros((12, 2))], axis=1)
    y += rng.standard_normal(y.shape) * np.array([1e-3, 1e-2, 1e-2, 1e-2, 1e-2, 1e-2, 0.2, 0.2])

    def expected(point):
        theta = np.asarray(problem.to_values(point[:6]))
        h = 1e-6
        columns = [
            (problem.to_values(point[:6] + h * e) - problem.to_values(point[:6] - h * e)) / (2 * h)
            for e in np.eye(6)
        ]
        total = np.log(abs(np.linalg.det(np.array(columns) / theta))) + np.sum(np.log(abs(theta)))
        total += sum(float(p.log_density(v)) for p, v in zip(free, theta, strict=True))
        for r, log in zip(problem.differences(jnp.asarray(theta)), point[6:], strict=True):
            r = np.asarray(r)
            total += np.sum(-0.5 * (r / np.exp(log)) ** 2 - log) - 0.5 * log**2
        return total

    got = np.asarray(log_densities(Density.of(found), jnp.asarray(y)))
    wanted = np.array([expected(point) for point in y[:4]])
    np.testing.assert_allclose(got[:4] - got[0], wanted - wanted[0], rtol=1e-6, atol=1e-5)


def test_a_models_own_error_is_no_scatter_that_residuals_would_show():
    """Residuals say that it is a tenth; the intervals stay what the fit's deviations are."""
    fixed = {p.name: p for p in two_free().parameters if p.fixed}
    curves = noisy(0)
    error = tuple(
        10.0 * float(np.median(np.asarray(std) / np.asarray(value)))
        for std, value in (
            (curves.frequency_std, curves.frequency),
            (curves.damping_std, curves.damping),
        )
    )
    found = fit("iwan4", curves, fixed, model_error=error, starts=4)
    assert found.misfit < 0.2
    walked = walk(found)
    costs = [float(np.sum(np.asarray(r) ** 2)) for r in found.problem.differences(values(found))]
    for name, cost in zip(SCALES, costs, strict=True):
        assert walked.samples[name].min() >= 1.0
        mean, std, _ = scale_moments(cost, least=0.0)
        log, n = np.log(walked.samples[name]), walked.effective[name]
        assert abs(log.mean() - mean) < SIGMAS * std / np.sqrt(n)
        assert log.std() == pytest.approx(std, rel=SIGMAS * 1.5 / np.sqrt(2 * n))
    for name in FREE:
        assert walked.samples[name].std() == pytest.approx(found.std[name], rel=0.1)


def test_pieces_of_the_walkers_are_the_whole(posterior, monkeypatch):
    """However many cores there are, and whether or not they divide the walkers."""
    monkeypatch.setattr(sampling, "available_threads", lambda: 5)
    same_statistics(walk(), posterior)


def test_a_prior_counts(posterior):
    """One as narrow as the data, two deviations away: half way between, and narrower."""
    found = two_free()
    f_0 = found.parameters[0]
    std = posterior.samples["f_0"].std()
    prior = LogNormal(f_0.value + 2 * std, std / f_0.value)
    told = replace(found, parameters=(replace(f_0, prior=prior), *found.parameters[1:]))
    moved = walk(solution=told)
    error = SIGMAS * std / np.sqrt(min(moved.effective.values()))
    assert moved.samples["f_0"].mean() == pytest.approx(f_0.value + std, abs=error + 0.1 * std)
    assert moved.samples["f_0"].std() == pytest.approx(std / np.sqrt(2), rel=0.15)


# --- interruptions ------------------------------------------------------------------------


def test_an_interrupted_walk_goes_on_as_if_it_had_not_been(tmp_path, posterior):
    file = tmp_path / "new" / "chain.h5"
    first = walk(file=file, most_steps=250)
    assert steps(first) == 250
    second = walk(file=file, most_steps=500)
    assert steps(second) == 500
    last = walk(file=file)
    assert last.enough
    assert steps(last) == steps(posterior)
    same_statistics(last, posterior)
    # To the last digit, as the random numbers go on where they stopped.
    np.testing.assert_array_equal(last.chain, posterior.chain)
    assert last.acceptance == pytest.approx(posterior.acceptance)
    assert [path.name for path in file.parent.iterdir()] == ["chain.h5"]
    # Nothing is left to do: it is only read.
    again = walk(file=file)
    np.testing.assert_array_equal(again.chain, last.chain)


def test_a_walk_that_has_straightened_its_ridges_goes_on_along_them(tmp_path, monkeypatch):
    """What it was interrupted with is found again from the chain on disk."""
    plain = walk(most_steps=600, effective=10**6)
    monkeypatch.setattr(sampling, "STRAIGHTENED_AFTER", 150)
    file, whole = tmp_path / "chain.h5", walk(most_steps=600, effective=10**6)
    assert not np.array_equal(whole.chain[-1], plain.chain[-1])
    for most in (190, 450, 600):
        found = walk(file=file, most_steps=most, effective=10**6)
    assert steps(found) == 600
    np.testing.assert_array_equal(found.chain, whole.chain)


CHILD = """
import pickle, sys
import jax
jax.config.update("jax_enable_x64", True)
from iwanjax.updating.sampling import sample_posterior
with open(sys.argv[1], "rb") as stored:
    solution = pickle.load(stored)
sample_posterior(
    solution, walkers=int(sys.argv[3]), effective=10**9, most_steps=10**9, file=sys.argv[2]
)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL on this system")
def test_a_walk_that_was_killed_goes_on(tmp_path, posterior):
    stored, file = tmp_path / "fit.pickle", tmp_path / "chain.h5"
    stored.write_bytes(pickle.dumps(two_free()))
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(stored), str(file), str(WALKERS)],
        env=os.environ | {"JAX_PLATFORMS": "cpu"},
        stderr=subprocess.PIPE,
    )
    try:
        until = time.monotonic() + 120.0
        while not file.exists() and child.poll() is None and time.monotonic() < until:
            time.sleep(0.01)
        # Somewhere in what comes after the first copy.
        time.sleep(0.35)
        assert child.poll() is None, child.stderr.read().decode()
    finally:
        child.send_signal(signal.SIGKILL)
        child.communicate()
    assert child.returncode == -signal.SIGKILL
    assert file.exists()
    with h5py.File(file) as whole:
        kept = int(whole["posterior"].attrs["iteration"])
    assert kept >= 250
    found = walk(file=file)
    assert found.enough
    assert steps(found) >= kept
    same_statistics(found, posterior)
    # What the killed one left beside it is gone.
    assert sorted(path.name for path in tmp_path.iterdir()) == ["chain.h5", "fit.pickle"]


def test_a_file_that_a_kill_has_left_half_written_is_not_looked_at(tmp_path):
    file = tmp_path / "chain.h5"
    first = walk(file=file, most_steps=250)
    (tmp_path / ".chain.h5.new").write_bytes(b"half of")
    again = walk(file=file, most_steps=250)
    np.testing.assert_array_equal(again.chain, first.chain)


# --- files of something else --------------------------------------------------------------


@pytest.fixture(scope="module")
def chain_file(tmp_path_factory):
    file = tmp_path_factory.mktemp("chain") / "chain.h5"
    walk(file=file, most_steps=250)
    return file


def garbage(path):
    path.write_bytes(b"no HDF5 at all\n" * 100)


def empty(path):
    path.touch()


def other_hdf5(path):
    with h5py.File(path, "w") as file:
        file["data"] = np.zeros(3)


def no_fingerprint(path):
    with h5py.File(path, "w") as file:
        file.create_group("posterior")


@pytest.mark.parametrize("make", [garbage, empty, other_hdf5, no_fingerprint])
def test_a_file_of_something_else_is_refused_and_kept(tmp_path, make):
    file = tmp_path / "chain.h5"
    make(file)
    before = file.read_bytes()
    with pytest.raises(InputError, match=r"chain\.h5: .*name another file"):
        walk(file=file)
    assert file.read_bytes() == before


def test_a_truncated_chain_is_refused(tmp_path, chain_file):
    file = tmp_path / "chain.h5"
    whole = chain_file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"chain\.h5"):
        walk(file=file)


def test_a_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match="is not a chain"):
        walk(file=tmp_path)


def test_a_chain_of_another_fit_is_refused(chain_file):
    before = chain_file.read_bytes()
    found = two_free()
    prior = replace(found.parameters[0], prior=LogNormal(118.0, 0.1))
    others = {
        "data": {"solution": two_free(1)},
        "prior": {"solution": replace(found, parameters=(prior, *found.parameters[1:]))},
        "walkers": {"walkers": WALKERS + 2},
        "parameters": {"solution": fit("iwan4", noisy(0)), "walkers": WALKERS},
    }
    for options in others.values():
        with pytest.raises(InputError, match="holds the chain of another fit"):
            walk(file=chain_file, **options)
    assert chain_file.read_bytes() == before


def test_a_chain_of_another_reference_or_transform_is_refused(chain_file):
    found = two_free()
    shift = replace(found, problem=replace(found.problem, reference="shift"))
    with pytest.raises(InputError, match="another fit"):
        walk(file=chain_file, solution=shift, most_steps=250)


def test_no_file_is_left_by_a_walk_without_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    walk(most_steps=250)
    assert not list(tmp_path.iterdir())


# --- refusals and words -------------------------------------------------------------------


@pytest.mark.parametrize("walkers", [0, -2, 6, 7, 17])
def test_walkers_must_be_even_and_many(walkers):
    with pytest.raises(InputError, match=f"walkers = {walkers}; expected an even number"):
        walk(walkers=walkers)


def test_a_prior_that_excludes_the_fit_is_refused():
    found = two_free()
    away = replace(found.parameters[1], prior=ij.Uniform(0.5, 0.6))
    told = replace(found, parameters=(found.parameters[0], away, *found.parameters[2:]))
    with pytest.raises(InputError, match="does a prior exclude it"):
        walk(solution=told)


class Recorded(emcee.moves.DEMove):
    """Differential evolution whose steps are kept."""

    steps: ClassVar[list[float]] = []

    def __init__(self, gamma0):
        self.steps.append(gamma0)
        super().__init__(gamma0=gamma0)


@pytest.mark.parametrize(("taken", "shorter"), [(5, True), (20, True), (30, False)])
def test_steps_that_are_hardly_ever_taken_are_halved_after_the_first_ones(
    monkeypatch, taken, shorter
):
    """Of a density that lets walkers go on in so many of the first 250 steps."""
    monkeypatch.setattr(emcee.moves, "DEMove", Recorded)
    monkeypatch.setattr(Recorded, "steps", [])
    monkeypatch.setattr(
        emcee.EnsembleSampler, "run_mcmc", lambda self, state, steps, **_: moved(self, state, taken)
    )
    sample_posterior(two_free(), walkers=8, effective=10**6, most_steps=250)
    before, after = Recorded.steps[0], Recorded.steps[2]
    assert after == pytest.approx(before / 2 if shorter else before)
    # Jumps between minima stay.
    assert Recorded.steps[1] == Recorded.steps[3] == 1.0


def moved(sampler, state, often):
    """250 steps of which all walkers take so many."""
    steps = np.arange(250) // (250 // often)
    chain = state.coords + 1e-3 * steps[:, None, None]
    backend = sampler.backend
    backend.reset(*state.coords.shape)
    backend.iteration, backend.initialized = 250, True
    backend.chain, backend.log_prob = chain, np.zeros(chain.shape[:2])
    return state


@pytest.mark.skipif(importlib.util.find_spec("arviz") is not None, reason="arviz is installed")
def test_without_arviz_it_says_what_to_install(posterior):
    with pytest.raises(InputError, match="install iwanjax with the extra 'bayes'"):
        posterior.to_arviz()


@pytest.mark.skipif(importlib.util.find_spec("arviz") is None, reason="arviz is not installed")
def test_arviz_has_chains_of_draws(posterior):
    found = posterior.to_arviz().posterior
    assert dict(found.sizes) == {"chain": WALKERS, "draw": len(posterior.chain)}
    np.testing.assert_array_equal(found["f_0"].values, posterior.chain[..., 0].T)


def test_progress_goes_to_stderr(capsys):
    walk(most_steps=250, progress=True)
    told = capsys.readouterr()
    assert told.out == ""
    assert "effective samples" in told.err
    walk(most_steps=250)
    assert capsys.readouterr().err == ""


def test_it_comes_back_from_its_own_file(posterior, tmp_path):
    loaded = ij.Posterior.load(posterior.save(tmp_path / "posterior.npz"))
    np.testing.assert_array_equal(loaded.chain, posterior.chain)
    assert loaded.summary() == posterior.summary()
    np.testing.assert_array_equal(loaded.bands()[0].frequency, posterior.bands()[0].frequency)
