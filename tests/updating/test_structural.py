"""Fits of a structure's joint to curves of two modes, which NumPy and SciPy alone have made."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
import scipy.ndimage
import scipy.optimize
import scipy.stats
from updating.simulated import LEVELS, make_hits, steady_cycle

import iwanjax as ij
from iwanjax.errors import InputError
from iwanjax.estimation import LogNormal, Parameter, Uniform
from iwanjax.updating import fit, structural_parameters
from iwanjax.updating.background import with_background
from iwanjax.updating.microslip import alike_in_microslip
from iwanjax.updating.structural import structural_problem

SIGMAS, RARE = 4.0, 1e-4
MODES = (1, 2)
M, K = 10.0 * np.eye(3), np.array([[18.0, -9.0, 0.0], [-9.0, 18.0, -9.0], [0.0, -9.0, 9.0]])
ROW = np.array([0.0, -1.0, 1.0])
NAMES = ("F_S", "K_T", "chi", "beta")
# Damping of the two modes beside the joint: about what it adds at the lowest amplitude.
ZETA_0 = {"mode1.zeta_0": 3e-4, "mode2.zeta_0": 8e-4}
TRUTH = {"F_S": 6.0, "K_T": 1.3, "chi": -0.3, "beta": 2.0}
SENSORS = (np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.5, -0.2]))
# What the linear model is wrong by in each mode, Hz; several hundred deviations.
OFFSETS = (0.01, -0.02)
STARTS = 16
# Named as a mode's, not as a structure's.
STRENGTH = Parameter("F_S", 1.0, LogNormal(1.0, 1.0), lower=0.0, transform="log")


def chain(joints):
    return ij.JointedStructure(ij.LinearStructure(M, None, K), joints)


@pytest.fixture(scope="module")
def guess():
    return chain({"J1": (ROW, ij.Iwan4(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0))})


def statics(mode, most=60.0):
    """Loads, modal displacement and the joint's deflection, from one scalar equation.

    Up to a load ``most``; the last slider slips from 32 on.
    """
    phi, k = make_hits.sliders(make_hits.Oscillator(1.0, 0.0, **TRUTH), count=1500, ratio=1.01)
    shape = mode_of(mode)[1]
    free, give = np.linalg.solve(K, M @ shape), np.linalg.solve(K, ROW)

    def force(d):
        return np.sign(d) * np.minimum(abs(d), phi) @ k

    q, d, alpha = [], [], np.geomspace(0.1, most, LEVELS)
    for a in alpha:
        far = abs(a * ROW @ free) + 1.0
        root = scipy.optimize.brentq(
            lambda x, a=a: x + (ROW @ give) * force(x) - a * ROW @ free, -far, far, xtol=1e-14
        )
        d.append(root)
        q.append(shape @ M @ (a * free - give * force(root)))
    return alpha, np.array(q), np.array(d), phi, k


def mode_of(mode):
    """Squared frequency and shape of a mode of the chain at rest."""
    omega2, shapes = scipy.linalg.eigh(K + TRUTH["K_T"] * np.outer(ROW, ROW), M)
    return omega2[mode], shapes[:, mode]


def computed(mode, most=60.0):
    """Modal displacement, frequency, damping and shape."""
    alpha, q, d, phi, k = statics(mode, most)
    omega2, shape = mode_of(mode)
    harmonic, loss = steady_cycle(phi, k, np.abs(d))
    omega = np.sqrt(omega2 - (ROW @ shape) * (TRUTH["K_T"] - harmonic) * d / q)
    # The joint's own damping.
    return q, omega / (2 * np.pi), loss / (2 * np.pi * alpha * q), shape


def noisy(background, seed=7, most=60.0):
    """Curves of both modes, with damping of their own and noise."""
    made = []
    for i, (mode, zeta_0) in enumerate(zip(MODES, background, strict=True)):
        q, f, zeta, _ = computed(mode, most)
        zeta = zeta + zeta_0
        f_std, zeta_std = 1e-5 * f, 0.01 * zeta + 1e-7
        error = np.random.default_rng([seed, i]).standard_normal((2, LEVELS))
        made.append(
            ij.ModalCurves(
                q,
                f + OFFSETS[i] + f_std * error[0],
                zeta + zeta_std * error[1],
                frequency_std=f_std,
                damping_std=zeta_std,
            )
        )
    return made


@pytest.fixture(scope="module")
def curves():
    return noisy(ZETA_0.values())


@pytest.fixture(scope="module")
def found(guess, curves):
    return fit(guess, curves, modes=MODES, starts=STARTS)


@pytest.mark.long
def test_the_joint_comes_back_whatever_the_linear_model_is_wrong_by(found):
    assert found.converged
    assert not found.active_bounds
    truth = {f"J1.{name}": value for name, value in TRUTH.items()} | ZETA_0
    assert found.determined == dict.fromkeys(truth, True)
    for name, value in truth.items():
        assert abs(found.values[name] - value) < SIGMAS * found.std[name], name
        assert found.std[name] < 0.1 * abs(value)
    # One offset a curve has been found as well.
    freedom = 4 * LEVELS - 6 - 2
    low, high = scipy.stats.chi2.ppf([RARE / 2, 1 - RARE / 2], freedom)
    f, zeta = (np.asarray(x) for x in found.problem.differences(values(found)))
    assert low < np.sum(f**2) + np.sum(zeta**2) < high


def searched(guess, curves, **changed):
    """The problem of these curves, with some parameters replaced."""
    row = {**structural_parameters(guess, None, curves)}
    row = [replace(p, **changed.get(name, {})) for name, p in row.items()]
    return structural_problem(guess, curves, row, None, None, None, "shift")


def test_variables_are_those_of_the_parameters(found):
    problem = found.problem
    theta = jnp.asarray([p.value for p in found.parameters])
    np.testing.assert_allclose(problem.to_values(problem.to_variables(theta)), theta, rtol=1e-12)


@pytest.mark.parametrize("moved", [2, 3])  # chi, beta
def test_the_drop_stays_where_chi_or_beta_moves(found, moved):
    """Of the secant at the deflection where the problem takes it, by the joint's own formula."""
    problem = found.problem
    (d,) = np.asarray(problem.deflection)
    z = problem.to_variables(jnp.asarray([p.value for p in found.parameters]))
    drops = []
    for by in (0.0, 0.3, -0.3):
        F_S, K_T, chi, beta = problem.to_values(z.at[moved].add(by))[:4]
        joint = ij.Iwan4(F_S=F_S, K_T=K_T, chi=chi, beta=beta)
        assert d < joint.phi_max
        drops.append(float(K_T - joint.secant(d)))
    np.testing.assert_allclose(drops, drops[0], rtol=1e-9)
    assert drops[0] > 1e-3


def test_a_strength_that_is_held_or_bounded_is_a_variable_of_its_own(guess, curves):
    for changed in ({"fixed": True}, {"upper": 20.0}):
        problem = searched(guess, curves, **{"J1.F_S": changed})
        assert problem.by_drop == ()
        theta = jnp.asarray([p.value for p in structural_parameters(guess, None, curves).values()])
        np.testing.assert_allclose(problem.to_values(problem.to_variables(theta)), theta)
    assert searched(guess, curves).by_drop == (0,)


def values(found):
    return jnp.asarray([p.value for p in found.parameters])


def test_offsets_are_what_remains_between_prediction_and_curves(found, curves):
    for offset, measured, predicted in zip(OFFSETS, curves, found.predicted, strict=True):
        std = np.asarray(measured.frequency_std)
        rest = np.asarray(measured.frequency) - np.asarray(predicted.frequency)
        assert np.average(rest, weights=std**-2.0) == pytest.approx(offset, abs=0.05 * abs(offset))
        np.testing.assert_array_equal(predicted.amplitude, measured.amplitude)


def test_there_are_no_residuals_where_there_is_no_joint(found):
    """At chi = -1, which traced values reach without a word."""
    theta = jnp.asarray([p.value for p in found.parameters])
    names = [p.name for p in found.parameters]
    residuals = eqx.filter_jit(found.problem.residuals)
    assert np.all(np.isfinite(residuals(theta)))
    assert not np.any(np.isfinite(residuals(theta.at[names.index("J1.chi")].set(-1.0))))


def test_predictions_are_those_of_statics(found):
    truth = jnp.asarray([TRUTH[name] for name in NAMES] + [0.0, 0.0])
    f, zeta = (np.asarray(x) for x in found.problem.predict(truth))
    for part, mode in zip(found.problem.measured.slices, MODES, strict=True):
        q, known_f, known_zeta, _ = computed(mode)
        # To a part in a thousand of the amplitude, as is said, and what the bank is exact to.
        for got, known, bank in ((f[part], known_f, 1e-6), (zeta[part], known_zeta, 1e-3)):
            slope = np.abs(np.gradient(np.log(known), np.log(q)))
            off = np.abs(got / known - 1.0)
            assert np.all(off < 1e-3 * scipy.ndimage.maximum_filter1d(slope, 3) + bank)


def test_summary_names_the_joint(found):
    summary = found.summary()
    assert summary.startswith("JointedStructure: residuals are ")
    for name in NAMES:
        assert f"J1.{name} " in summary
    assert isinstance(found.model, ij.JointedStructure)
    joint = found.model.joints["J1"]
    assert isinstance(joint, ij.Iwan4)
    assert float(joint.F_S) == found.values["J1.F_S"]


def test_a_sensors_amplitudes_are_the_modes(guess, curves, found):
    """What a sensor sees of each mode, in its own displacement, velocity or acceleration."""
    seen = []
    for mode, row, each in zip(MODES, SENSORS, curves, strict=True):
        # Of the linear model that is known before the fit.
        shape = np.asarray(guess.modes().Phi)[:, mode]
        seen.append(each.scaled(abs(row @ shape), "displacement"))
    rotated = [seen[0].as_quantity("velocity"), seen[1].as_quantity("acceleration")]
    other = fit(guess, rotated, modes=MODES, sensors=SENSORS, starts=STARTS)
    for name, value in found.values.items():
        assert other.values[name] == pytest.approx(value, abs=1e-2 * found.std[name])


@pytest.mark.long
@pytest.mark.parametrize("factor", [1e3, 1e-3, 1e-12])
def test_amplitudes_in_another_unit_give_the_strength_in_it(guess, curves, found, factor):
    """Nothing but F_S has a length in it, far from where its prior would start it or not."""
    scaled = [each.scaled(factor, "modal displacement") for each in curves]
    other = fit(guess, scaled, modes=MODES, starts=STARTS)
    for name, value in found.values.items():
        expected = value * (factor if name == "J1.F_S" else 1.0)
        assert other.values[name] == pytest.approx(expected, rel=1e-5)


def test_parameters_of_a_structure():
    joint = ij.Iwan4(F_S=10.0, K_T=1.0, chi=-0.5, beta=0.0)
    stiction = ij.Iwan5(F_S=1.0, K_T=1.0, chi=0.4, beta=1.0, theta=0.8)
    known = structural_parameters(chain({"A": (ROW, joint), "B": (ROW[::-1], stiction)}))
    assert list(known) == [f"A.{n}" for n in NAMES] + [f"B.{n}" for n in (*NAMES, "theta")]
    assert isinstance(known["A.F_S"].prior, LogNormal)
    assert isinstance(known["A.chi"].prior, Uniform)
    assert known["A.F_S"].value == 10.0
    assert (known["A.chi"].lower, known["A.chi"].upper) == (-1.0, 0.0)
    # A value outside the usual range widens it.
    assert (known["B.chi"].lower, known["B.chi"].upper) == (-1.0, 0.4)
    # The logarithm of a beta of zero is no place to start from.
    assert known["A.beta"].value > 0.0


def two_joints():
    joint = ij.Iwan4(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0)
    return chain({"left": ([-1.0, 1.0, 0.0], joint), "right": (ROW, joint)})


def test_joints_of_a_group_share_their_parameters(curves):
    structure, groups = two_joints(), {"bolts": ["left", "right"]}
    known = structural_parameters(structure, groups, curves, MODES)
    assert list(known) == [f"bolts.{name}" for name in NAMES] + list(ZETA_0)
    problem = structural_problem(
        structure, curves, tuple(known.values()), MODES, None, groups, "shift"
    )
    theta = jnp.asarray([*TRUTH.values(), *ZETA_0.values()])
    joints = problem.model(theta).joints
    assert set(joints) == {"left", "right"}
    for joint in joints.values():
        assert {name: float(getattr(joint, name)) for name in NAMES} == pytest.approx(TRUTH)
    alone = structural_parameters(structure, {"bolt": ["right"]})
    assert [name.split(".")[0] for name in alone][::4] == ["bolt", "left"]


@pytest.mark.parametrize(
    ("groups", "told"),
    [
        ({"bolts": ["left", "middle"]}, "'middle'; there are left, right"),
        ({"a": ["left"], "b": ["left", "right"]}, "'left' belongs to two groups"),
        ({"bolts": []}, "bolts holds joints of types"),
    ],
)
def test_groups_that_do_not_exist_are_refused(groups, told):
    with pytest.raises(InputError, match=told):
        structural_parameters(two_joints(), groups)


def test_a_group_holds_one_type(guess):
    other = ij.Jenkins(F_S=1.0, K_T=1.0)
    mixed = chain({"left": ([-1.0, 1.0, 0.0], other), "right": (ROW, guess.joints["J1"])})
    with pytest.raises(InputError, match="bolts holds joints of types"):
        structural_parameters(mixed, {"bolts": ["left", "right"]})


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"modes": [0]}, "got modes \\[0\\] for 2 curve"),
        ({"modes": [1, 1]}, "all different"),
        ({"modes": [1, 3]}, "mode 3 does not exist; expected 0 to 2"),
        ({"modes": [-1, 1]}, "mode -1 does not exist"),
        ({"sensors": [ROW]}, "got 1 sensors for 2 curves"),
        ({"sensors": [ROW, [1.0, 0.0]]}, r"sensors\[1\] has shape \(2,\); expected \(3,\)"),
        ({"sensors": [ROW, np.zeros(3)]}, r"sensors\[1\] sits on a node of mode 2"),
        ({"sensors": [ROW, [np.nan, 0.0, 0.0]]}, r"sensors\[1\]"),
        ({"groups": {"A": ["J2"]}}, "'J2'; there are J1"),
        ({"parameters": {"F_S": STRENGTH}}, "no parameter is called 'F_S'; there are J1.F_S"),
    ],
)
def test_what_does_not_belong_to_the_structure_is_refused(guess, curves, options, told):
    with pytest.raises(InputError, match=told):
        fit(guess, curves, **{"modes": MODES, **options})


def test_a_sensors_curve_needs_the_sensor(guess, curves):
    with pytest.raises(InputError, match="curve 0 is against the velocity of a sensor"):
        fit(guess, [curves[0].as_quantity("velocity"), curves[1]], modes=MODES)


def test_a_joint_that_is_known_may_be_left_out(guess):
    curve = ij.ModalCurves(
        [1.0, 2.0, 3.0], [0.1] * 3, [1e-3] * 3, frequency_std=[1e-3] * 3, damping_std=[1e-4] * 3
    )
    known = structural_parameters(guess, None, [curve])
    with pytest.raises(InputError, match="all parameters are fixed"):
        fit(guess, [curve], fixed=list(known))
    with pytest.raises(InputError, match=r"called 'chi'; there are J1.F_S.*did you mean 'J1.chi'"):
        fit(guess, [curve], fixed={"chi": -0.5})


# --- damping beside the joints ------------------------------------------------------------


def test_modes_without_damping_of_their_own_are_refused(guess, curves):
    """C = 0 and nothing else that damps: such fits ended 54 % off in damping."""
    with pytest.raises(InputError, match=r"mode1.zeta_0 is fixed at 0.*leave it free, or fix it"):
        fit(guess, curves, modes=MODES, fixed={"mode1.zeta_0": 0.0})


def test_a_truth_without_damping_of_its_own_is_found_within_its_deviation(guess):
    found = fit(guess, noisy((0.0, 0.0)), modes=MODES, starts=STARTS)
    # A search that moved the ratios towards zero by their logits used to run out of steps.
    assert found.converged
    for name in ZETA_0:
        on_bound = found.active_bounds.get(name) == 0.0
        assert on_bound or found.values[name] < SIGMAS * found.std[name]
    for name in NAMES:
        z = (found.values[f"J1.{name}"] - TRUTH[name]) / found.std[f"J1.{name}"]
        assert abs(z) < SIGMAS, name


def ratios(structure):
    """Damping ratios of all modes of a structure's C."""
    omega, Phi = (np.asarray(x) for x in structure.modes())
    return np.diag(Phi.T @ np.asarray(structure.structure.C) @ Phi) / (2.0 * omega)


def test_the_fitted_model_has_the_fitted_damping(found, guess):
    told = [found.values[name] for name in ZETA_0]
    omega2, Phi = (np.asarray(x) for x in (guess.basis.omega2, guess.basis.Phi))
    C = np.asarray(found.model.structure.C)
    assert np.diag(Phi.T @ C @ Phi) / (2.0 * np.sqrt(omega2)) == pytest.approx([0.0, *told])
    # What the structure with the estimates loses beside its joint, as the analysis reads it.
    low = ij.qsma(found.model, list(MODES), [1e-12]).curves.damping[:, 0]
    assert np.asarray(low) == pytest.approx(told, rel=1e-3)


@pytest.mark.parametrize("ratio", [1e-4, 5e-2])
def test_dampers_that_a_mode_has_are_scaled(guess, ratio):
    """One damper to the ground, which couples the modes: C stays what dampers can make."""
    C = np.diag([0.0, 0.0, 0.3])
    coupled = ij.JointedStructure(ij.LinearStructure(M, C, K), {"J1": (ROW, guess.joints["J1"])})
    before = ratios(coupled)
    changed = with_background(coupled, (1, 2), jnp.asarray([ratio, 2e-3]))
    assert ratios(changed) == pytest.approx([before[0], ratio, 2e-3])
    eigenvalues = np.linalg.eigvalsh(np.asarray(changed.structure.C))
    assert eigenvalues.min() > -1e-12 * eigenvalues.max()


def test_damping_of_a_structure_is_the_middle_of_its_prior(guess, curves):
    C = guess.structure.damping_matrix([0.0, 5e-4, 0.0])
    damped = ij.JointedStructure(ij.LinearStructure(M, C, K), {"J1": (ROW, guess.joints["J1"])})
    # The modes of the stiffness without joint are others.
    expected = ratios(damped)
    known = structural_parameters(damped, None, curves, MODES)
    for mode in MODES:
        p = known[f"mode{mode}.zeta_0"]
        assert isinstance(p.prior, LogNormal)
        assert p.value == pytest.approx(float(expected[mode]))
        assert float(p.prior.median) == p.value
    # Without it the curves say how much it may be at most, noise allowed for.
    for name, curve in zip(ZETA_0, curves, strict=True):
        p = structural_parameters(guess, None, curves, MODES)[name]
        assert isinstance(p.prior, Uniform)
        least = float(np.min(np.asarray(curve.damping)))
        assert ZETA_0[name] < least < float(p.prior.high) < 1.1 * least
        assert 0.0 < p.value < least


# --- below macroslip ----------------------------------------------------------------------

# The load that takes the joint to two thirds of the way to macroslip.
GENTLE = 20.0
JOINT = ij.Iwan4(**TRUTH)


@pytest.mark.parametrize("seed", [100, 104, 108])
def test_microslip_determines_r_and_a_lower_bound_of_phi_max(guess, seed):
    """S to a third of itself, and F_S not: their deviations hold the truth all the same."""
    found = fit(guess, noisy(ZETA_0.values(), seed, GENTLE), modes=MODES, starts=STARTS)
    reach = max(np.abs(statics(mode, GENTLE)[2]).max() for mode in MODES)
    assert reach < 0.7 * float(JOINT.phi_max)
    assert found.reaches["J1"] == pytest.approx(reach, rel=0.01)
    assert found.least("J1.phi_max") == found.reaches["J1"]
    # Whatever the priors narrow them to.
    assert not found.determined["J1.F_S"]
    assert not found.determined["J1.beta"]
    assert not found.follows("J1.S")
    assert found.follows("J1.R")
    assert not found.determined["J1.F_S"]
    for name in ("R", "S"):
        value, std = found.derived[f"J1.{name}"]
        assert abs(value - float(getattr(JOINT, name))) < SIGMAS * std, name
    truth = {f"J1.{name}": value for name, value in TRUTH.items()} | ZETA_0
    for name, value in truth.items():
        assert abs(found.values[name] - value) < SIGMAS * found.std[name], name
    summary = found.summary()
    assert f">= {found.reaches['J1']:.3g} (largest deflection)" in summary
    assert "J1.S" in summary


@pytest.mark.long
def test_a_kink_that_noise_has_made_is_not_the_strength(guess):
    """With the stiffness known F_S was 3.98 +- 0.002 for 6: the end of the measured range."""
    known = {"J1.K_T": TRUTH["K_T"]}
    for seed in (104, 108):
        curves = noisy(ZETA_0.values(), seed, GENTLE)
        found = fit(guess, curves, modes=MODES, fixed=known, starts=STARTS)
        assert not found.determined["J1.F_S"]
        assert abs(found.values["J1.F_S"] - TRUTH["F_S"]) < 2.0 * found.std["J1.F_S"]
        low, high = found.rivals["J1.F_S"]
        assert low < TRUTH["F_S"] < high
        assert found.determined["J1.chi"]


def test_macroslip_in_the_curves_leaves_no_bound(found):
    assert not found.reaches
    for name in ("phi_max", "R", "S"):
        value, std = found.derived[f"J1.{name}"]
        assert found.follows(f"J1.{name}")
        assert abs(value - float(getattr(JOINT, name))) < SIGMAS * std


def test_joints_that_are_alike_below_macroslip_are():
    """Sliders of each of them, driven up to the reach: the same stiffness and loss."""
    reach = 0.6 * float(JOINT.phi_max)
    d = reach * np.array([0.1, 0.5, 1.0])

    def cycle(joint):
        phi, k = make_hits.sliders(make_hits.Oscillator(1.0, 0.0, **joint), count=3000, ratio=1.005)
        return steady_cycle(phi, k, d)

    alike = alike_in_microslip(**TRUTH, reach=reach)
    assert len(alike) == 7
    expected = cycle(TRUTH)
    for joint in alike:
        assert joint["K_T"] == pytest.approx(TRUTH["K_T"])
        for found, known in zip(cycle(joint), expected, strict=True):
            np.testing.assert_allclose(found, known, rtol=5e-3)
    # From where the curves end to where the last slider would have no strength.
    phi_max = [float(ij.Iwan4(**joint).phi_max) for joint in alike]
    n = TRUTH["chi"] + 1.0
    end = (n * TRUTH["K_T"] / float(JOINT.R)) ** (1.0 / n)
    assert phi_max[0] == pytest.approx(reach, rel=0.01)
    assert phi_max[-1] == pytest.approx(0.98 * min(end, 10.0 * reach / 0.98), rel=0.01)
    assert not alike_in_microslip(**TRUTH, reach=2.0 * end)
