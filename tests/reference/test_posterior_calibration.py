"""How often 90 per cent intervals hold the truth, over simulated data sets of one mode.

The data are steady cycles of discrete sliders, with the step from the cycle's damping to that
of a ring-down worked out beside the package.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats
from modal_ringdown import FOLDER, make_hits
from updating.simulated import NAMES, TRUTH, clean, noisy, ringdown_of, steady_cycle

import iwanjax as ij
from iwanjax.updating import fit
from iwanjax.updating.sampling import sample_posterior

DATA_SETS = 100
PROBABILITY, RARE = 0.9, 1e-3
SCALES = ("noise_scale_frequency", "noise_scale_damping")
# Levels that are looked at: neighbours share the parameters' errors.
BAND_LEVELS = (0, 13, 26, 39)

pytestmark = pytest.mark.reference


@eqx.filter_jit
def predictions(problem, theta):
    return jax.lax.map(problem.predict, theta)


@pytest.fixture(scope="module")
def counts():
    """Of each parameter: intervals that hold it, and sets that determine it."""
    held = dict.fromkeys((*NAMES, *SCALES), 0)
    known = dict.fromkeys(held, 0)
    bands = np.zeros((2, len(BAND_LEVELS)), int)
    tail = 0.5 * (1.0 - PROBABILITY)
    for seed in range(1000, 1000 + DATA_SETS):
        found = fit("iwan4", noisy(seed))
        posterior = sample_posterior(found, walkers=24, seed=seed, effective=1000)
        assert posterior.enough
        for name in held:
            if not found.determined.get(name, True):
                continue
            low, high = posterior.interval(name, PROBABILITY)
            known[name] += 1
            held[name] += low <= getattr(TRUTH, name, 1.0) <= high
        drawn = predictions(found.problem, jnp.asarray(posterior.draws(400)))
        for i, (curve, truth) in enumerate(zip(drawn, clean()[1:], strict=True)):
            low, high = np.quantile(np.asarray(curve), [tail, 1.0 - tail], axis=0)
            inside = (low <= truth) & (truth <= high)
            bands[i] += inside[list(BAND_LEVELS)]
    print(f"of {DATA_SETS}: held {held}, determined {known}, bands {bands.tolist()}")
    return held, known, bands


def limits(total):
    return scipy.stats.binom.ppf([RARE / 2, 1 - RARE / 2], total, PROBABILITY)


@pytest.mark.long
def test_macroslip_determines_all(counts):
    _, known, _ = counts
    assert known == dict.fromkeys(known, DATA_SETS)


@pytest.mark.long
def test_intervals_hold_the_truth_as_often_as_they_say(counts):
    held, known, _ = counts
    for name, count in held.items():
        low, high = limits(known[name])
        assert low <= count <= high, (name, held)


@pytest.mark.long
def test_bands_hold_the_true_curves_as_often_as_they_say(counts):
    _, _, bands = counts
    low, high = limits(DATA_SETS)
    assert np.all((bands >= low) & (bands <= high)), bands


# --- that the data are what they are said to be -------------------------------------------


def test_the_truth_is_the_studys():
    stored = (FOLDER / "truth.json").read_text(encoding="utf-8")
    for name in NAMES:
        assert f'"{name}": {getattr(TRUTH, name)}' in stored


def test_the_cycles_are_those_of_the_joint():
    """Driven sliders against adaptive quadrature would be better still: tests/joints has that."""
    joint = ij.Iwan4(F_S=TRUTH.F_S, K_T=TRUTH.K_T, chi=TRUTH.chi, beta=TRUTH.beta)
    q = clean()[0]
    harmonic, loss = steady_cycle(*make_hits.sliders(TRUTH), q)
    np.testing.assert_allclose(joint.harmonic_stiffness(q), harmonic, atol=1e-4 * TRUTH.K_T)
    # Beside phi_max an interval of the bank is three per cent of amplitude.
    np.testing.assert_allclose(joint.dissipation(q), loss, rtol=3e-3)


def test_what_is_left_of_their_errors_is_small_beside_the_noise():
    mode = ij.ModalOscillator(
        TRUTH.f_0,
        TRUTH.zeta_0,
        ij.Iwan4(F_S=TRUTH.F_S, K_T=TRUTH.K_T, chi=TRUTH.chi, beta=TRUTH.beta),
    )
    q, f, zeta = clean()
    found_f, found_zeta = mode.ringdown_frequency_and_damping(q)
    measured = noisy(0)
    assert np.max(np.abs(found_f - f) / np.asarray(measured.frequency_std)) < 0.05
    assert np.max(np.abs(found_zeta - zeta) / np.asarray(measured.damping_std)) < 0.05
    np.testing.assert_array_equal(ringdown_of(TRUTH, q)[0], f)
