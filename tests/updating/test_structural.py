"""Fits of a structure's joint to curves of two modes, which NumPy and SciPy alone have made."""

from dataclasses import replace

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
from iwanjax.updating import LogNormal, Parameter, Uniform, fit, structural_parameters
from iwanjax.updating.structural import structural_problem

SIGMAS, RARE = 4.0, 1e-4
MODES = (1, 2)
M, K = 10.0 * np.eye(3), np.array([[18.0, -9.0, 0.0], [-9.0, 18.0, -9.0], [0.0, -9.0, 9.0]])
ROW = np.array([0.0, -1.0, 1.0])
NAMES = ("F_S", "K_T", "chi", "beta")
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


def computed(mode):
    """Modal displacement, frequency, damping and shape: statics of one scalar equation."""
    o = make_hits.Oscillator(f_0=1.0, zeta_0=0.0, **TRUTH)
    phi, k = make_hits.sliders(o, count=1500, ratio=1.01)
    omega2, shapes = scipy.linalg.eigh(K + o.K_T * np.outer(ROW, ROW), M)
    shape = shapes[:, mode]
    free, give = np.linalg.solve(K, M @ shape), np.linalg.solve(K, ROW)

    def force(d):
        return np.sign(d) * np.minimum(abs(d), phi) @ k

    q, d, alpha = [], [], np.geomspace(0.1, 60.0, LEVELS)
    for a in alpha:
        far = abs(a * ROW @ free) + 1.0
        root = scipy.optimize.brentq(
            lambda x, a=a: x + (ROW @ give) * force(x) - a * ROW @ free, -far, far, xtol=1e-14
        )
        d.append(root)
        q.append(shape @ M @ (a * free - give * force(root)))
    q, d = np.array(q), np.array(d)
    harmonic, loss = steady_cycle(phi, k, np.abs(d))
    omega = np.sqrt(omega2[mode] - (ROW @ shape) * (o.K_T - harmonic) * d / q)
    # The structure has no damping but the joint's.
    return q, omega / (2 * np.pi), loss / (2 * np.pi * alpha * q), shape


@pytest.fixture(scope="module")
def curves():
    made = []
    for i, mode in enumerate(MODES):
        q, f, zeta, _ = computed(mode)
        f_std, zeta_std = 1e-5 * f, 0.01 * zeta + 1e-7
        error = np.random.default_rng([7, i]).standard_normal((2, LEVELS))
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
def found(guess, curves):
    return fit(guess, curves, modes=MODES, starts=STARTS)


def test_the_joint_comes_back_whatever_the_linear_model_is_wrong_by(found):
    assert found.converged
    assert not found.active_bounds
    assert found.determined == {f"J1.{name}": True for name in NAMES}
    for name in NAMES:
        z = (found.values[f"J1.{name}"] - TRUTH[name]) / found.std[f"J1.{name}"]
        assert abs(z) < SIGMAS, name
        assert found.std[f"J1.{name}"] < 0.1 * abs(TRUTH[name])
    # One offset a curve has been found as well.
    freedom = 4 * LEVELS - 4 - 2
    low, high = scipy.stats.chi2.ppf([RARE / 2, 1 - RARE / 2], freedom)
    f, zeta = (np.asarray(x) for x in found.problem.differences(values(found)))
    assert low < np.sum(f**2) + np.sum(zeta**2) < high


def values(found):
    return jnp.asarray([p.value for p in found.parameters])


def test_offsets_are_what_remains_between_prediction_and_curves(found, curves):
    for offset, measured, predicted in zip(OFFSETS, curves, found.predicted, strict=True):
        std = np.asarray(measured.frequency_std)
        rest = np.asarray(measured.frequency) - np.asarray(predicted.frequency)
        assert np.average(rest, weights=std**-2.0) == pytest.approx(offset, abs=0.05 * abs(offset))
        np.testing.assert_array_equal(predicted.amplitude, measured.amplitude)


def test_predictions_are_those_of_statics(found):
    truth = jnp.asarray([TRUTH[name] for name in NAMES])
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
    known = structural_parameters(structure, groups)
    assert list(known) == [f"bolts.{name}" for name in NAMES]
    problem = structural_problem(
        structure, curves, tuple(known.values()), MODES, None, groups, "shift"
    )
    joints = problem.model(jnp.asarray(list(TRUTH.values()))).joints
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
    known = structural_parameters(guess)
    fixed = {name: replace(p, fixed=True) for name, p in known.items()}
    curve = ij.ModalCurves(
        [1.0, 2.0, 3.0], [0.1] * 3, [1e-3] * 3, frequency_std=[1e-3] * 3, damping_std=[1e-4] * 3
    )
    with pytest.raises(InputError, match="all parameters are fixed"):
        fit(guess, [curve], fixed)
