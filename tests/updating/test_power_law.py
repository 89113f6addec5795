"""Free power laws: known exponents, and whether two are the same."""

import re

import numpy as np
import pytest
import scipy.optimize

import iwanjax as ij
from iwanjax.errors import InputError
from iwanjax.updating import free_exponents

AMPLITUDE = np.geomspace(1e-6, 1e-4, 30)
F_STD, ZETA_STD = 2e-3, 1e-5


def laws(p, r, seed=0, a=0.5, b=3e-3, amplitude=AMPLITUDE, quantity="displacement"):
    """f_0 - a s^p and zeta_0 + b s^r with noise."""
    s = amplitude / AMPLITUDE.max()
    error = np.random.default_rng(seed).standard_normal((2, s.size))
    return ij.ModalCurves(
        amplitude,
        118.0 - a * s**p + F_STD * error[0],
        4e-4 + b * s**r + ZETA_STD * error[1],
        frequency_std=np.full(s.size, F_STD),
        damping_std=np.full(s.size, ZETA_STD),
        quantity=quantity,
    )


@pytest.mark.parametrize(("p", "r"), [(0.55, 0.55), (1.0, 0.4), (0.3, 1.2), (2.0, 1.0)])
def test_known_exponents_come_back_within_their_deviations(p, r):
    z = []
    for seed in range(20):
        found = free_exponents(laws(p, r, seed))
        z.append([(found.frequency[0] - p) / found.frequency[1]])
        z[-1].append((found.damping[0] - r) / found.damping[1])
        assert found.frequency_rms == pytest.approx(F_STD, rel=0.5)
        assert found.damping_rms == pytest.approx(ZETA_STD, rel=0.5)
    # Student's t of 27 degrees of freedom: 5 deviations once in 30000; its scatter, 20 draws.
    assert np.max(np.abs(z)) < 5.0
    assert np.all(np.std(z, axis=0) > 0.4)
    assert np.all(np.std(z, axis=0) < 1.8)


def test_exact_laws_are_found_exactly():
    s = AMPLITUDE / AMPLITUDE.max()
    exact = ij.ModalCurves(
        AMPLITUDE,
        118.0 - 0.5 * s**0.7,
        4e-4 + 3e-3 * s**0.45,
        frequency_std=np.full(30, F_STD),
        damping_std=np.full(30, ZETA_STD),
        quantity="displacement",
    )
    found = free_exponents(exact)
    assert found.frequency[0] == pytest.approx(0.7, abs=1e-5)
    assert found.damping[0] == pytest.approx(0.45, abs=1e-5)


@pytest.mark.parametrize("n", [0.3, 0.55, 0.9])
def test_equal_exponents_are_not_declared_apart(n):
    apart = [free_exponents(laws(n, n, seed)).apart for seed in range(40)]
    # Three deviations: once in 370 for normal ones, and t has wider tails.
    assert sum(abs(x) > 3.0 for x in apart) <= 2
    assert abs(np.mean(apart)) < 4.0 / np.sqrt(40)
    assert "equal within their deviations" in free_exponents(laws(n, n)).statement()


@pytest.mark.parametrize(("p", "r"), [(0.4, 0.9), (0.9, 0.4)])
def test_different_exponents_are_declared_apart(p, r):
    found = free_exponents(laws(p, r))
    assert np.sign(found.apart) == np.sign(r - p)
    assert abs(found.apart) > 3.0
    statement = found.statement()
    assert f"{abs(found.apart):.0f} deviations apart" in statement
    pairs = [float(x) for pair in re.findall(r"([\d.]+) ± ([\d.]+)", statement) for x in pair]
    assert pairs == pytest.approx([*found.frequency, *found.damping], rel=0.1, abs=6e-4)
    assert pairs[::2] == pytest.approx([p, r], abs=0.03)


def test_the_joint_in_microslip_has_the_exponent_chi_plus_one():
    joint = ij.Iwan4(F_S=1.8, K_T=2.75e4, chi=-0.45, beta=0.8)
    mode = ij.ModalOscillator(118.0, 4e-4, joint)
    q = float(joint.phi_max) * np.geomspace(0.01, 0.8, 30)
    f, zeta = (np.asarray(x) for x in mode.frequency_and_damping(q))
    error = np.random.default_rng(1).standard_normal((2, 30))
    found = free_exponents(
        ij.ModalCurves(
            q,
            f + F_STD * error[0],
            zeta + ZETA_STD * error[1],
            frequency_std=np.full(30, F_STD),
            damping_std=np.full(30, ZETA_STD),
            quantity="displacement",
        )
    )
    for value, std in (found.frequency, found.damping):
        # f is the root of a power law and zeta is over omega^2: a per cent of bend.
        assert value == pytest.approx(0.55, abs=4 * std + 0.01)
    assert abs(found.apart) < 3.0


def test_several_hits_are_one_curve():
    whole = laws(0.7, 0.5)
    rows = ("amplitude", "frequency", "damping", "frequency_std", "damping_std")
    halves = []
    for part in (slice(0, 15), slice(15, None)):
        a, f, zeta, f_std, zeta_std = (np.asarray(getattr(whole, k))[part] for k in rows)
        halves.append(
            ij.ModalCurves(
                a, f, zeta, frequency_std=f_std, damping_std=zeta_std, quantity="displacement"
            )
        )
    one, two = free_exponents(whole), free_exponents(halves[::-1])
    assert two.frequency == pytest.approx(one.frequency, rel=1e-4)
    assert two.damping == pytest.approx(one.damping, rel=1e-4)


def test_what_has_no_exponent_is_refused():
    curve = laws(0.5, 0.5)
    with pytest.raises(InputError, match="no standard deviations"):
        free_exponents(
            ij.ModalCurves(curve.amplitude, curve.frequency, curve.damping, quantity="displacement")
        )
    with pytest.raises(InputError, match="different quantities"):
        free_exponents([curve, laws(0.5, 0.5, quantity="velocity")])
    with pytest.raises(InputError, match="4 levels; expected at least 5"):
        free_exponents(laws(0.5, 0.5, amplitude=AMPLITUDE[:4]))
    with pytest.raises(InputError, match="at least 3"):
        free_exponents(laws(0.5, 0.5, amplitude=AMPLITUDE[:2]))


def test_curves_without_any_trend_claim_no_exponent():
    """Noise about constants: some exponent is found, but not as a sharp one."""
    for seed in range(5):
        found = free_exponents(laws(0.5, 0.5, seed, a=0.0, b=0.0))
        for value, std in (found.frequency, found.damping):
            assert std > 0.1
            assert np.isfinite(value)


# --- the damping's law (3.32) -------------------------------------------------------------

C_1, CHI, ZETA_0 = 0.9, -0.1, 5e-4


def bent(seed, scale=1.0):
    """Curves like Table 3.3's, deviations that differ from level to level, and the noise."""
    Q = np.geomspace(1e-4, 5e-3, 40)
    zeta = C_1 * Q ** (CHI + 1.0) + ZETA_0
    std = 2e-5 * np.linspace(0.5, 2.0, Q.size)
    noise = np.random.default_rng([3, seed]).standard_normal(Q.size)
    return ij.ModalCurves(
        Q,
        100.0 - 20.0 * Q,
        zeta + scale * std * noise,
        frequency_std=np.full(Q.size, F_STD),
        damping_std=std,
        quantity="displacement",
    )


@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_the_law_is_the_weighted_least_squares_one(scale):
    """SciPy's, whose covariance with absolute_sigma=False includes the misfit as well."""
    curve = bent(0, scale)
    values, covariance = scipy.optimize.curve_fit(
        lambda Q, c, chi, zeta_0: c * Q ** (chi + 1.0) + zeta_0,
        np.asarray(curve.amplitude),
        np.asarray(curve.damping),
        p0=(C_1, CHI, ZETA_0),
        sigma=np.asarray(curve.damping_std),
        x_scale=(1.0, 0.1, 1e-4),
        method="trf",
        ftol=1e-14,
        xtol=1e-14,
        gtol=1e-14,
    )
    found = free_exponents(curve)
    stds = np.sqrt(np.diag(covariance))
    for pair, value, std in zip((found.c_1, found.chi, found.zeta_0), values, stds, strict=True):
        assert pair[0] == pytest.approx(value, abs=1e-3 * std)
        assert pair[1] == pytest.approx(std, rel=1e-3)
    assert found.damping == (found.chi[0] + 1.0, found.chi[1])


def test_stated_deviations_of_the_law_cover_the_truth():
    z = []
    for seed in range(200):
        found = free_exponents(bent(seed))
        log_c = (np.log(found.c_1[0] / C_1)) / (found.c_1[1] / found.c_1[0])
        chi, zeta_0 = (
            (pair[0] - truth) / pair[1]
            for pair, truth in ((found.chi, CHI), (found.zeta_0, ZETA_0))
        )
        z.append((log_c, chi, zeta_0))
    within = np.mean(np.abs(z) < 1.0, axis=0), np.mean(np.abs(z) < 2.0, axis=0)
    # Student's t of 37 degrees: 0.676 and 0.947; three deviations of 200 draws.
    assert np.all(np.abs(within[0] - 0.676) < 0.1)
    assert np.all(np.abs(within[1] - 0.947) < 0.05)


def test_a_background_alone_is_known_and_its_law_is_not():
    for seed in range(5):
        found = free_exponents(laws(0.5, 0.5, seed, b=0.0))
        assert abs(found.zeta_0[0] - 4e-4) < 4.0 * found.zeta_0[1]
        assert found.c_1[1] >= found.c_1[0]


def test_the_law_in_words():
    found = free_exponents(bent(0))
    told = re.findall(r"(\w+) = ([-\d.e]+) ± ([-\d.e]+)", found.law())
    for (name, value, std), pair in zip(told, (found.c_1, found.chi, found.zeta_0), strict=True):
        assert (float(value), float(std)) == pytest.approx(pair, rel=0.1), name
