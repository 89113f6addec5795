"""Fits of one mode to curves that discrete sliders have made: NumPy's, not the package's."""

from dataclasses import replace
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats
from updating.simulated import FREQUENCY_STD, LEVELS, NAMES, TRUTH, Oscillator, clean, noisy

import iwanjax as ij
from iwanjax.errors import InputError
from iwanjax.estimation import Normal
from iwanjax.estimation.parameters import fixed_at
from iwanjax.updating import fit, modal_parameters
from iwanjax.updating.modal import modal_problem

# Chance alone fails one of these in 16000 parameters, and chi^2's limits once in 10^4.
SIGMAS, RARE = 4.0, 1e-4
# Of tests that draw noise again and again: the others draw a third as often.
MANY = pytest.mark.long
TRUTHS = (
    TRUTH,
    Oscillator(f_0=118.0, zeta_0=1e-3, F_S=3.0, K_T=5e4, chi=-0.8, beta=0.2),
    Oscillator(f_0=118.0, zeta_0=4e-4, F_S=0.8, K_T=4e4, chi=-0.2, beta=4.0),
)


@cache
def solution(seed=0, o=TRUTH, low=0.02, high=2.0):
    return fit("iwan4", noisy(seed, o, low, high))


def deviations(found, o=TRUTH):
    """Estimate less truth over the stated deviation, of what the data determine."""
    return {
        name: (found.values[name] - getattr(o, name)) / found.std[name]
        for name, known in found.determined.items()
        if known
    }


def chi2(found):
    return sum(float(np.sum(np.asarray(r) ** 2)) for r in residuals(found))


@eqx.filter_jit
def slopes_of(problem, theta):
    return jax.jacfwd(problem.residuals)(theta)


@eqx.filter_jit
def residuals_of(problem, theta):
    return problem.residuals(theta)


def estimate(found):
    return jnp.asarray([p.value for p in found.parameters])


def residuals(found):
    return np.split(np.asarray(residuals_of(found.problem, estimate(found))), 2)


# --- six parameters -----------------------------------------------------------------------


@pytest.mark.parametrize("i", range(len(TRUTHS)))
def test_six_parameters_come_back_from_curves_into_macroslip(i):
    found = solution(i, TRUTHS[i])
    assert found.converged
    assert not found.active_bounds
    assert not found.undetermined
    assert found.determined == dict.fromkeys(NAMES, True)
    assert max(abs(z) for z in deviations(found, TRUTHS[i]).values()) < SIGMAS
    low, high = scipy.stats.chi2.ppf([RARE / 2, 1 - RARE / 2], 2 * LEVELS - 6)
    assert low < chi2(found) < high
    assert found.misfit**2 * (2 * LEVELS - 6) == pytest.approx(chi2(found), rel=1e-9)
    f, zeta = residuals(found)
    assert found.misfit_frequency**2 == pytest.approx(np.mean(np.asarray(f) ** 2))
    assert found.misfit_damping**2 == pytest.approx(np.mean(np.asarray(zeta) ** 2))


def test_without_noise_the_truth_itself_comes_back():
    """To what a bank of 400 sliders differs by from the joint: a hundredth of a deviation or so."""
    found = fit("iwan4", noisy(0, noise=0.0))
    assert max(abs(z) for z in deviations(found).values()) < 0.2
    assert found.misfit < 0.05


def test_what_follows_from_the_parameters():
    found = solution()
    known = {
        "phi_max": TRUTH.phi_max,
        "K_inf": TRUTH.omega_0**2 - TRUTH.K_T,
        "S": TRUTH.K_T * TRUTH.beta / (1 + TRUTH.beta),
        "R": TRUTH.K_T / (1 + TRUTH.beta) * (TRUTH.chi + 1) / TRUTH.phi_max ** (TRUTH.chi + 1),
    }
    assert set(found.derived) == set(known)
    for name, truth in known.items():
        value, std = found.derived[name]
        assert abs(value - truth) < SIGMAS * std, name
        # That of a function, by moving the parameters along their covariance.
        assert 0.0 < std < 0.1 * abs(value)
    # phi_max is known better than F_S and K_T separately would allow.
    std = {k: found.std[k] / found.values[k] for k in ("F_S", "K_T")}
    assert found.derived["phi_max"][1] / TRUTH.phi_max < np.hypot(*std.values())


def test_predictions_go_with_the_curves():
    found = solution()
    (predicted,), (measured,) = found.predicted, found.measured
    np.testing.assert_array_equal(predicted.amplitude, measured.amplitude)
    _, f, zeta = clean()
    np.testing.assert_allclose(predicted.frequency, f, atol=2 * FREQUENCY_STD)
    np.testing.assert_allclose(predicted.damping, zeta, rtol=0.02)
    assert isinstance(found.model, ij.ModalOscillator)
    again = found.model.ringdown_frequency_and_damping(predicted.amplitude)
    np.testing.assert_allclose(again[0], predicted.frequency, rtol=1e-12)
    np.testing.assert_allclose(again[1], predicted.damping, rtol=1e-12)


def test_the_same_seed_gives_the_same_answer_and_any_other_agrees():
    first, again, other = (fit("iwan4", noisy(0), seed=s) for s in (0, 0, 9))
    assert first.values == again.values
    np.testing.assert_array_equal(first.covariance, again.covariance)
    for name in NAMES:
        assert abs(first.values[name] - other.values[name]) < 1e-2 * first.std[name]


def test_the_order_of_levels_and_the_unit_do_not_matter():
    c = noisy(0)
    turned = ij.ModalCurves(
        *(np.asarray(getattr(c, k))[::-1] for k in ("amplitude", "frequency", "damping")),
        frequency_std=np.asarray(c.frequency_std)[::-1],
        damping_std=np.asarray(c.damping_std)[::-1],
        quantity="displacement",
    )
    in_mm = c.scaled(1e3, "displacement", "mm")
    velocity = c.as_quantity("velocity")
    for other, factor in ((turned, 1.0), (in_mm, 1e3), (velocity, 1.0)):
        found = fit("iwan4", other)
        for name in NAMES:
            scale = factor if name == "F_S" else 1.0
            assert found.values[name] / scale == pytest.approx(
                solution().values[name], abs=0.02 * solution().std[name]
            )


# --- how sure it is -----------------------------------------------------------------------


@pytest.mark.computes
@pytest.mark.parametrize("draws", [10, pytest.param(30, marks=MANY)])
def test_covariance_is_the_scatter_of_fits_to_other_noise(draws):
    found = [solution(seed) for seed in range(draws)]
    z = np.array([[s.values[n] - getattr(TRUTH, n) for n in NAMES] for s in found])
    # Where chi^2 is above expectation the covariance is widened; not so for this.
    plain = [s.covariance / max(s.misfit, 1.0) ** 2 for s in found]
    ends = [RARE / 2, 1 - RARE / 2]
    low, high = scipy.stats.chi2.ppf(ends, draws)
    for i, name in enumerate(NAMES):
        total = sum(z_j[i] ** 2 / C[i, i] for z_j, C in zip(z, plain, strict=True))
        assert low < total < high, name
    low, high = scipy.stats.chi2.ppf(ends, 6 * draws)
    assert low < sum(z_j @ np.linalg.solve(C, z_j) for z_j, C in zip(z, plain, strict=True)) < high
    low, high = scipy.stats.chi2.ppf(ends, (2 * LEVELS - 6) * draws)
    assert low < sum(chi2(s) for s in found) < high


def test_errors_that_are_larger_than_stated_widen_the_deviations():
    found = fit("iwan4", noisy(0, noise=3.0))
    assert found.misfit == pytest.approx(3.0, rel=0.25)
    assert max(abs(z) for z in deviations(found).values()) < SIGMAS
    for name in NAMES:
        assert found.std[name] / solution().std[name] == pytest.approx(found.misfit, rel=0.15)
    assert "times the stated deviations" in found.summary()
    assert "does not explain" in found.summary()


MICROSLIP = {"low": 0.02, "high": 0.4}


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_microslip_leaves_strength_open_and_says_so(seed):
    found = solution(seed, **MICROSLIP)
    told = deviations(found)
    assert {"f_0", "zeta_0", "chi"} <= set(told)
    assert max(abs(told[name]) for name in ("f_0", "zeta_0", "chi")) < SIGMAS
    assert not found.determined["F_S"]
    assert not found.determined["beta"]
    summary = found.summary()
    for name in ("F_S", "beta"):
        (line,) = (x for x in summary.splitlines() if x.startswith(f"  {name} "))
        assert "(undetermined)" in line
        assert "±" not in line
    assert "These curves do not determine:" in summary or "Other minima" in summary


@pytest.mark.computes
@pytest.mark.parametrize("draws", [6, pytest.param(20, marks=MANY)])
def test_microslip_is_never_taken_for_macroslip(draws):
    """Noise at the last levels looks like a kink just below them."""
    for seed in range(draws):
        found = solution(seed, **MICROSLIP)
        wrong = {name: z for name, z in deviations(found).items() if abs(z) > SIGMAS}
        assert not wrong, (seed, wrong)


@pytest.mark.long
def test_the_five_parameter_joint_explains_the_four_parameter_ones_curves():
    """Theta = 1 is the joint behind the data; the kink has as many valleys as with four."""
    for seed in range(3):
        found = fit("iwan5", noisy(seed))
        assert found.misfit < 1.3
        truth = {name: getattr(TRUTH, name) for name in NAMES} | {"theta": 1.0}
        for name, sure in found.determined.items():
            if sure and name not in found.active_bounds:
                assert abs(found.values[name] - truth[name]) < SIGMAS * found.std[name], name


# --- bounds -------------------------------------------------------------------------------


def test_an_exponent_beyond_its_bound_rests_on_it_and_is_reported():
    beyond = replace(TRUTH, chi=0.3)
    found = solution(0, beyond)
    assert found.values["chi"] == 0.0
    assert found.active_bounds == {"chi": 0.0}
    assert found.std["chi"] == 0.0
    assert found.misfit > 2.0
    summary = found.summary()
    assert "BOUND: chi rests on its bound 0" in summary
    assert "(on its bound)" in summary
    # With wider bounds the same data are explained, and the truth comes back.
    chi = modal_parameters(ij.Iwan4, noisy(0, beyond))["chi"]
    wider = fit("iwan4", noisy(0, beyond), {"chi": replace(chi, value=0.0, upper=1.0)})
    assert not wider.active_bounds
    assert wider.misfit < 1.5
    assert max(abs(z) for z in deviations(wider, beyond).values()) < SIGMAS


def test_the_estimate_on_a_bound_is_the_least_within_it():
    """No point inside costs less, whatever the other parameters do about it."""
    found = solution(0, replace(TRUTH, chi=0.3))
    row = np.concatenate(residuals(found))
    slope = 2.0 * row @ np.asarray(slopes_of(found.problem, estimate(found)))
    # Moving chi inside costs; moving anything else as little as a deviation gains nothing.
    assert slope[NAMES.index("chi")] < 0
    for i, name in enumerate(NAMES):
        if name != "chi":
            assert abs(slope[i]) * found.std[name] < 1e-2 * chi2(found)


@pytest.mark.computes
@pytest.mark.parametrize("draws", [3, pytest.param(8, marks=MANY)])
def test_no_damping_beside_the_joint_is_found_on_the_bound_or_within_its_deviation(draws):
    none = replace(TRUTH, zeta_0=0.0)
    resting = []
    for seed in range(draws):
        found = solution(seed, none)
        value = found.values["zeta_0"]
        assert value >= 0.0
        assert (value == 0.0) == ("zeta_0" in found.active_bounds)
        assert ("BOUND: zeta_0" in found.summary()) == (value == 0.0)
        resting.append(value == 0.0)
        if value > 0.0:
            assert value < SIGMAS * found.std["zeta_0"]
        others = {k: z for k, z in deviations(found, none).items() if k != "zeta_0"}
        assert max(abs(z) for z in others.values()) < SIGMAS
    # The unbounded estimate would be negative in one half of them.
    assert 1 <= sum(resting) < draws


def test_a_bound_that_is_not_near_changes_nothing():
    zeta_0 = modal_parameters(ij.Iwan4, noisy(0))["zeta_0"]
    found = fit("iwan4", noisy(0), {"zeta_0": replace(zeta_0, upper=0.5)})
    for name in NAMES:
        assert abs(found.values[name] - solution().values[name]) < 1e-2 * solution().std[name]


@pytest.mark.long
def test_a_bound_holds_where_another_transform_was_asked_for():
    f_0 = modal_parameters(ij.Iwan4, noisy(0))["f_0"]
    bounded = replace(f_0, value=117.9, upper=117.95, transform="identity", lower=100.0)
    found = fit("iwan4", noisy(0), known_joint() | {"f_0": bounded}, starts=4)
    assert found.values["f_0"] == 117.95
    assert found.active_bounds == {"f_0": 117.95}


@pytest.mark.long
def test_an_exponent_beside_a_bound_that_has_no_model():
    """At chi = -1 itself there is no joint; beside it chi is all but free."""
    found = solution(0, replace(TRUTH, chi=-0.9995))
    assert -1.0 < found.values["chi"] < -0.9
    assert found.misfit < 1.5
    assert "chi" not in found.active_bounds


def test_a_normal_prior_of_a_positive_parameter():
    K_T = modal_parameters(ij.Iwan4, noisy(0))["K_T"]
    found = fit("iwan4", noisy(0), {"K_T": replace(K_T, prior=Normal(2.7e4, 1e4))})
    assert found.values["K_T"] == pytest.approx(solution().values["K_T"], rel=1e-4)


# --- fixed parameters, offsets, weights ---------------------------------------------------


def known_joint():
    known = modal_parameters(ij.Iwan4, noisy(0))
    return {
        name: replace(known[name], value=getattr(TRUTH, name), fixed=True)
        for name in ("F_S", "K_T", "chi", "beta")
    }


def test_fixed_parameters_stay_where_they_are():
    fixed = known_joint()
    found = fit("iwan4", noisy(0), fixed, starts=4)
    assert set(found.determined) == {"f_0", "zeta_0"}
    for name in fixed:
        assert found.values[name] == getattr(TRUTH, name)
        assert found.std[name] == 0.0
    assert max(abs(z) for z in deviations(found).values()) < SIGMAS
    assert found.summary().count("(fixed)") == 4
    # What is known makes the rest better known.
    assert found.std["f_0"] < 0.5 * solution().std["f_0"]
    # Two linear parameters: a closed form.
    f = clean()[1]
    weight = (TRUTH.f_0 / f) ** 2 / FREQUENCY_STD**2
    assert found.std["f_0"] == pytest.approx(np.sum(weight) ** -0.5, rel=0.05)


def test_fixing_a_parameter_is_one_argument():
    """At a value, or by name alone at the value it starts from."""
    found = fit("iwan4", noisy(0), fixed={"chi": TRUTH.chi, "beta": TRUTH.beta}, starts=16)
    assert (found.values["chi"], found.values["beta"]) == (TRUTH.chi, TRUTH.beta)
    assert set(found.determined) == {"f_0", "zeta_0", "F_S", "K_T"}
    assert max(abs(z) for z in deviations(found).values()) < SIGMAS
    # A value that is taken for known leaves less open.
    for name in ("F_S", "K_T"):
        assert found.std[name] < solution().std[name]
    known = modal_parameters(ij.Iwan4, noisy(0))
    start = {n: replace(known[n], value=getattr(TRUTH, n)) for n in ("chi", "beta")}
    named = fit("iwan4", noisy(0), start, fixed=["chi", "beta"], starts=16)
    assert named.values == found.values
    assert named.determined == found.determined


@pytest.mark.long
def test_a_fixed_damping_leaves_the_search_its_own_variables():
    """Levels far into macroslip: in F_S and K_T themselves the starts all end 17 deviations off."""
    far = noisy(0, TRUTH, 0.02, 30.0)
    found = fit("iwan4", far, fixed={"zeta_0": TRUTH.zeta_0}, starts=16)
    assert found.values["zeta_0"] == TRUTH.zeta_0
    assert found.misfit < 1.2
    assert max(abs(z) for z in deviations(found).values()) < SIGMAS


def test_variables_of_microslip_carry_what_is_fixed():
    """Of a five-parameter joint with a known theta, whose kink then needs no further starts."""
    known = tuple(modal_parameters(ij.Iwan5, noisy(0)).values())
    row = fixed_at(known, {"theta": 0.5, "zeta_0": TRUTH.zeta_0})
    problem = modal_problem(ij.Iwan5, [noisy(0)], row, "absolute")
    theta = np.array([p.value for p in row])
    z = problem.to_variables(jnp.asarray(theta))
    assert z.size == theta.size - 2
    np.testing.assert_allclose(problem.to_values(z), theta, rtol=1e-12)
    assert problem.restarts(theta, 8) is None
    better = np.asarray(problem.improved(jnp.asarray(theta)))
    held = [row.index(p) for p in row if p.fixed]
    assert np.array_equal(better[held], theta[held])
    assert np.sum(np.square(problem.residuals(better))) < np.sum(
        np.square(problem.residuals(jnp.asarray(theta)))
    )


@pytest.mark.parametrize(
    ("fixed", "told"),
    [
        ({"Chi": -0.5}, "no parameter is called 'Chi'; there are f_0, .*did you mean 'chi'"),
        (["ch"], "no parameter is called 'ch'.*did you mean 'chi'"),
        ({"chi": 0.5}, "chi: value 0.5 lies outside its bounds"),
        ({"chi": "-0.5"}, r"fixed\['chi'\]: expected a number, got '-0.5'"),
        ("chi", "fixed: expected values by name, for instance {'f_0': "),
        (0.5, "fixed: expected values by name"),
    ],
)
def test_what_cannot_be_fixed_is_refused(fixed, told):
    with pytest.raises(InputError, match=told):
        fit("iwan4", noisy(0), fixed=fixed)


def test_shift_removes_an_offset_of_all_frequencies():
    """Residuals do not see it, and the offset is the one that fits best."""
    c = noisy(0)
    off = ij.ModalCurves(
        c.amplitude,
        c.frequency + 0.7,
        c.damping,
        frequency_std=np.asarray(c.frequency_std) * np.linspace(1.0, 3.0, LEVELS),
        damping_std=c.damping_std,
        quantity="displacement",
    )
    problem = replace_reference(off, "shift")
    theta = jnp.asarray([getattr(TRUTH, n) for n in NAMES])
    f, zeta = (np.asarray(x) for x in problem.differences(theta))
    plain_f, plain_zeta = replace_reference(off, "absolute").differences(theta)
    std = np.asarray(off.frequency_std)
    np.testing.assert_array_equal(zeta, plain_zeta)
    assert np.sum(f / std) == pytest.approx(0.0, abs=1e-9 * np.sum(1 / std))
    offset = np.asarray(plain_f) * std - f * std
    np.testing.assert_allclose(offset, offset[0], rtol=1e-9)
    assert offset[0] == pytest.approx(-0.7, abs=4 * np.sum(std**-2.0) ** -0.5)


def replace_reference(c, reference):
    from iwanjax.updating.modal import modal_problem

    return modal_problem(ij.Iwan4, [c], tuple(modal_parameters(ij.Iwan4, c).values()), reference)


def test_residuals_derivatives_are_central_differences():
    problem = solution().problem
    theta = np.asarray(estimate(solution()))
    # Not on an amplitude's kink: phi_max lies between two levels.
    gap = np.log(np.asarray(problem.measured.q) / solution().derived["phi_max"][0])
    assert np.min(np.abs(gap)) > 1e-3
    slopes = np.asarray(slopes_of(problem, jnp.asarray(theta)))
    for i in range(6):
        h = 1e-6 * theta[i]
        step = h * np.eye(6)[i]
        ahead, behind = (residuals_of(problem, jnp.asarray(theta + x)) for x in (step, -step))
        expected = np.asarray(ahead - behind) / (2 * h)
        np.testing.assert_allclose(slopes[:, i] * h, expected * h, rtol=1e-4, atol=1e-9)


# --- words --------------------------------------------------------------------------------


def test_summary_holds_the_numbers():
    found = solution()
    summary = found.summary()
    assert summary.startswith("ModalOscillator with Iwan4: residuals are ")
    assert f"{found.misfit:.2f} times the stated deviations" in summary
    assert f"{found.agreeing} of {found.runs} runs agree" in summary
    for name in NAMES:
        (line,) = (x for x in summary.splitlines() if x.startswith(f"  {name} "))
        value, std = (float(x) for x in line.split(maxsplit=1)[1].replace("±", " ").split()[:2])
        assert value == pytest.approx(found.values[name], abs=0.1 * found.std[name])
        assert std == pytest.approx(found.std[name], rel=0.06)
        assert found.parameters[NAMES.index(name)].meaning in line
    for name, (value, _) in found.derived.items():
        (line,) = (x for x in summary.splitlines() if x.startswith(f"  {name} "))
        assert float(line.split()[1]) == pytest.approx(value, rel=0.05)
    assert "undetermined" not in summary
    assert "BOUND" not in summary
    assert "NOT CONVERGED" not in summary


# --- refusals -----------------------------------------------------------------------------


def without(c, **options):
    given = {"frequency_std": c.frequency_std, "damping_std": c.damping_std}
    given |= {"quantity": "displacement"} | options
    return ij.ModalCurves(c.amplitude, c.frequency, c.damping, **given)


def spoiled(c, name, value):
    rows = {k: np.array(getattr(c, k)) for k in ("amplitude", "frequency", "damping")}
    rows[name][3] = value
    return ij.ModalCurves(
        *rows.values(),
        frequency_std=c.frequency_std,
        damping_std=c.damping_std,
        quantity="displacement",
    )


def few(c, count):
    rows = ("amplitude", "frequency", "damping", "frequency_std", "damping_std")
    a, f, zeta, f_std, zeta_std = (np.asarray(getattr(c, k))[:count] for k in rows)
    return ij.ModalCurves(
        a, f, zeta, frequency_std=f_std, damping_std=zeta_std, quantity="displacement"
    )


C = noisy(0)
FIXED = {n: replace(p, fixed=True) for n, p in modal_parameters(ij.Iwan4, C).items()}


@pytest.mark.parametrize(
    ("model", "curves", "options", "told"),
    [
        ("iwan4", without(C, frequency_std=None), {}, "curve 0 has no standard deviations"),
        ("iwan4", [C, without(C, damping_std=None)], {}, "curve 1 has no standard deviations"),
        ("iwan4", without(C, name="hit 7", damping_std=None), {}, r"curve 0 \(hit 7\)"),
        ("iwan4", without(C, damping_std=np.zeros(LEVELS)), {}, "damping_std holds 0"),
        ("iwan4", spoiled(C, "damping", np.nan), {}, "holds NaN"),
        ("iwan4", spoiled(C, "frequency", np.inf), {}, "holds NaN"),
        ("iwan4", spoiled(C, "amplitude", 0.0), {}, "amplitude holds 0"),
        ("iwan4", spoiled(C, "frequency", -1.0), {}, "frequency holds -1"),
        ("iwan4", few(C, 2), {}, "at least 3"),
        ("iwan5", few(C, 3), {}, "7 free parameters for 6 measured values"),
        ("iwan4", C.scaled(1.0, "volts"), {}, "'volts' is none of"),
        ("iwan4", [], {}, "no curves"),
        ("iwan4", [np.zeros(3)], {}, "expected ModalCurves, got ndarray"),
        (
            "iwan4",
            C,
            {"parameters": {"F_s": replace(FIXED["F_S"], name="F_s")}},
            "no parameter is called 'F_s'",
        ),
        ("iwan4", C, {"parameters": FIXED}, "all parameters are fixed"),
        ("iwan4", C, {"starts": 0}, "starts = 0"),
        ("iwan4", C, {"starts": 2.5}, "starts = 2.5"),
        ("iwan4", C, {"reference": "Shift"}, "reference = 'Shift'"),
        ("iwan4", C, {"groups": {"A": ["J1"]}}, "groups belong to a JointedStructure"),
        ("iwan4", C, {"modes": [0]}, "modes belong to a JointedStructure"),
        ("iwan4", C, {"sensors": [[1.0]]}, "sensors belong to a JointedStructure"),
        ("iwan9", C, {}, "did you mean"),
        (ij.Iwan4(F_S=1.0, K_T=1.0, chi=-0.5, beta=1.0), C, {}, "a joint's name or class"),
        (float, C, {}, "a joint's name or class"),
        (None, C, {}, "a joint's name or class"),
    ],
)
def test_what_cannot_be_fitted_is_refused_in_words(model, curves, options, told):
    with pytest.raises(InputError, match=told):
        fit(model, curves, **options)


@pytest.mark.parametrize(
    "options",
    [
        {"seed": -1},
        {"parameters": {"F_S": 1.0}},
        {"parameters": {"F_S": FIXED["K_T"]}},
        {"parameters": [FIXED["K_T"]]},
    ],
    ids=["seed", "number", "name", "list"],
)
def test_wrong_options_are_refused_in_words(options):
    with pytest.raises(InputError):
        fit("iwan4", C, **options)


def test_a_fit_comes_back_from_its_file_with_model_and_problem(tmp_path):
    found = solution()
    loaded = ij.FitSolution.load(found.save(tmp_path / "fit.npz"))
    assert loaded.summary() == found.summary()
    assert loaded.values == found.values
    for a, b in zip(residuals(loaded), residuals(found), strict=True):
        np.testing.assert_array_equal(a, b)
    assert eqx.tree_equal(loaded.model, found.model)


def test_the_notebooks_table_names_every_parameter_and_what_follows():
    found = solution()
    shown = found._repr_html_()
    assert all(f">{name}</td>" in shown for name in (*found.values, *found.derived))


def test_whoever_searches_ends_at_the_same_minimum():
    curves = noisy(0)
    found = {
        method: fit("jenkins", curves, starts=2, method=method)
        for method in ("optimistix", "jaxopt", "host")
    }
    for each in found.values():
        assert each.misfit == pytest.approx(found["optimistix"].misfit, rel=1e-6)
        for name, value in found["optimistix"].values.items():
            # A hundredth of a deviation adds 5e-5 to it: nothing beside what the data leave open.
            assert abs(each.values[name] - value) <= 1e-2 * each.std[name]
    with pytest.raises(InputError, match="expected 'optimistix', 'jaxopt' or 'host'"):
        fit("jenkins", curves, starts=2, method="newton")  # type: ignore[arg-type]
