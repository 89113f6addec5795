"""Errors of the linear model: what they predict, and that they are told from missing physics."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from linear_pair import (
    JOINT,
    RATE,
    ROWS,
    C,
    M,
    measured_force,
    model,
    problem,
    simulated,
    state_matrix,
    stiffness_with_joint,
)

import iwanjax as ij
from iwanjax.discrepancy import StudyRecording
from iwanjax.discrepancy.histories.diagnose import diagnose_histories
from iwanjax.discrepancy.histories.prepared import PreparedStudy, prepared
from iwanjax.discrepancy.histories.ranking import RankedFit, Scope
from iwanjax.discrepancy.histories.refitted import beyond_trust, corrected_model, modes_refitted
from iwanjax.discrepancy.histories.restarts import nominal_fit
from iwanjax.discrepancy.histories.search import Begun, about_fitted_joints
from iwanjax.dynamics.parabolic_hold import hold
from iwanjax.identification.joint_priors import joints_of
from iwanjax.identification.likelihood import left_by_noise
from iwanjax.identification.linearise import innovations, linearise
from iwanjax.identification.multistart import SHORT_TIME_CONSTANT, multistart
from iwanjax.identification.predictor import predictor
from iwanjax.identification.problem import HistoryProblem, Start
from iwanjax.structures import JointedStructure, LinearStructure, LinearTrust

PEAK, NOISE = 60.0, 1e-3
TRUST = LinearTrust(frequencies=0.005, damping=0.2)
AXES = {"m1": np.eye(2)[0], "m2": np.eye(2)[1]}
OFF = np.array([0.006, -0.004]), np.array([0.25, -0.15])
ONE_OFF = np.array([0.06, 0.0]), OFF[1]
"""Errors of the two modes' frequencies and damping, as logarithms."""


def moved(frequency: np.ndarray, damping: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness without the joint, and damping, with errors of the modes; in plain NumPy."""
    omega2, Phi = scipy.linalg.eigh(stiffness_with_joint(), M)
    shapes, modal = M @ Phi, np.diag(Phi.T @ C @ Phi)
    K = stiffness_with_joint() + (shapes * omega2 * np.expm1(2.0 * frequency)) @ shapes.T
    return K, C + (shapes * modal * np.expm1(damping)) @ shapes.T


def trusting(made: HistoryProblem, trust: LinearTrust = TRUST) -> HistoryProblem:
    uncertain = jnp.asarray(trust.deviations(np.asarray(made.predictor.omega2)))
    by = eqx.tree_at(lambda p: p.uncertain, made.predictor, uncertain)
    return replace(made, predictor=by, compiled=set(), _process={})


def recorded(K: np.ndarray, damping: np.ndarray, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    y = simulated(PEAK, stiffness=K, damping=damping)
    noise = NOISE * np.std(y, axis=0)
    return y + noise * np.random.default_rng(seed).standard_normal(y.shape), noise


@pytest.mark.parametrize("coupled", [False, True])
def test_the_map_over_a_step_is_that_of_the_matrix_exponential(coupled):
    """From slow modes to those of 4 radians a step, and a hundred times critical damping."""
    omega2, dt = np.array([0.0, 1.0, 9e2, 1.5e5]), 1e-2
    C = np.array([0.3, 0.0, 6000.0, 50.0])
    C = np.diag(C) + np.diag([0.1, 0.2, 5.0], 1) + np.diag([0.1, 0.2, 5.0], -1) if coupled else C
    got = hold(omega2, C, dt)
    light = np.minimum(C, 600.0)
    traced = jax.jit(lambda *x: hold(*x, dt, jnp))(omega2, light)
    known = hold(omega2, light, dt)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-12), known, traced)
    n, eye = len(omega2), np.eye(len(omega2))
    damping = C if coupled else np.diag(C)
    # States, then p_0, p_1 and twice p_2, each of which is the rate of the one before it.
    F = np.zeros((5 * n, 5 * n))
    F[:n, n : 2 * n], F[n : 2 * n, :n], F[n : 2 * n, n : 2 * n] = eye, -np.diag(omega2), -damping
    F[n : 2 * n, 2 * n : 3 * n] = F[2 * n : 3 * n, 3 * n : 4 * n] = eye
    F[3 * n : 4 * n, 4 * n :] = eye
    E = scipy.linalg.expm(F * dt)
    rows = (got.q, got.q_by), (got.v, got.v_by)
    for i, (own, by) in enumerate(rows):
        scale = (1.0, 1.0, 1.0, 1.0 / dt, 2.0 / dt**2)
        for j, (each, factor) in enumerate(zip((*own, *by), scale, strict=True)):
            block = factor * E[i * n : (i + 1) * n, j * n : (j + 1) * n]
            np.testing.assert_allclose(each if coupled else np.diag(each), block, atol=1e-9)


def test_errors_of_modes_predict_what_a_structure_with_them_does():
    """To a few thousandths of a deviation each: what a force does within a step is as given."""
    K, damping = moved(*OFF)
    y = simulated(PEAK, stiffness=K, damping=damping)
    made, _ = problem([y], [measured_force(PEAK)], NOISE * np.std(y, axis=0))
    made = trusting(made)
    z = np.concatenate([OFF[0] / 0.005, OFF[1] / 0.2, [0.0]])
    left = innovations(made, made.nothing(), made.still(made.map.given(z)), np.inf)[0]
    off = innovations(made, made.nothing(), made.still(made.map.given()), np.inf)[0]
    assert np.std(left) < 2e-3 * np.std(off)
    assert np.std(off) > 0.05 * np.std(y)


def test_the_linear_system_has_the_errors_and_the_observer_does_not():
    """Its gain is the same whatever the errors: it has no slopes along them."""
    K, damping = moved(*OFF)
    y, noise = recorded(K, damping)
    made, _ = problem([y], [measured_force(PEAK)], noise, joint=False)
    made = trusting(made)
    z = made.map.given(np.concatenate([OFF[0] / 0.005, OFF[1] / 0.2]))
    A, _ = made.system(made.empty(), z)
    true = state_matrix(M, damping, K)
    # The little damping that couples the modes goes with theirs; in the true one it stays.
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(A)), np.sort_complex(np.linalg.eigvals(true)), rtol=1e-6
    )
    gains = made.gains([made.empty()] * 2, np.stack([z, 0.0 * z]), SHORT_TIME_CONSTANT).gain
    np.testing.assert_array_equal(gains[0], gains[1])


@pytest.fixture(scope="module")
def study() -> PreparedStudy:
    """A joint three tenths stiffer than given; errors are of the modes in which it sticks.

    With a second frequency free, two modes and a joint would have any stiffness matrix there is.
    """
    joint = {"J1": (ROWS["J1"], ij.LinearSpring(k=JOINT / 1.3))}
    return prepared(
        JointedStructure(LinearStructure(M, C, stiffness_with_joint(0.0)), joint),
        [StudyRecording("hit", recorded(*moved(*ONE_OFF))[0], measured_force(PEAK))],
        RATE,
        rows=AXES,
        sensors=AXES,
        inputs=AXES,
        hypotheses=("cubic_stiffness",),
        trust=LinearTrust(np.array([0.05, 0.0]), 0.2),
    )


def test_errors_are_of_the_modes_in_which_the_joints_stick(study):
    """With the stiffness that they have: with another no error of a frequency makes up for it."""
    true = np.linalg.eigvals(state_matrix(M, *moved(*ONE_OFF)[::-1]))
    z = np.concatenate([ONE_OFF[0] / 0.05, ONE_OFF[1] / 0.2, [np.log(1.3) / 0.1]])
    off = []
    for k in (JOINT, JOINT / 1.3):
        made = study.about([ij.LinearSpring(k=k)]).with_substeps(2).problem
        A, _ = made.system(made.empty(), made.map.given(z))
        off.append(np.abs(np.sort_complex(np.linalg.eigvals(A)) / np.sort_complex(true) - 1.0))
    assert np.max(off[0]) < 1e-6
    assert np.max(off[1]) > 1e-4


def test_the_nominal_model_goes_over_to_the_modes_of_its_own_joints(study):
    scope = Scope((), (), (), (), lambda: True, lambda line: None)
    now = study.resolution.with_substeps(2).leaving(0.5)
    nominal = nominal_fit(now.problem, scope, 0)
    begun = Begun(study, study.resolution, now, nominal)
    _, resolution, found, fitted = about_fitted_joints(
        begun, RankedFit(now.problem, nominal), scope
    )
    assert nominal.cost > 1.1 * left_by_noise(now.problem)
    assert fitted.cost < 1.02 * left_by_noise(now.problem)
    (stiffness,) = np.asarray(found.problem.predictor.stiffness)
    assert abs(stiffness / JOINT - 1.0) < 1e-3
    assert resolution.with_substeps(2).problem.predictor.stiffness == stiffness
    (joint,) = joints_of(found.problem.joints, jnp.asarray(fitted.theta[0, :5]))
    assert isinstance(joint, ij.LinearSpring)
    assert abs(float(joint.k) / JOINT - 1.0) < 1e-3
    assert found.sides.left_by_steps == 0.5
    # Bent joints tell nothing of their own stiffness.
    bent = replace(nominal, solution=replace(nominal.solution, cost=1e9))
    assert about_fitted_joints(begun, RankedFit(now.problem, bent), scope) is begun
    exact = replace(study, trust=LinearTrust(0.0, 0.0)).resolution.with_substeps(2)
    begun = Begun(study, study.resolution, exact, nominal)
    assert about_fitted_joints(begun, RankedFit(exact.problem, nominal), scope) is begun


def test_only_what_is_uncertain_is_fitted():
    """Damping alone: half as many values, and frequencies stay as given."""
    y, noise = recorded(*moved(*OFF))
    made, _ = problem([y], [measured_force(PEAK)], noise, joint=False)
    whole = trusting(made, LinearTrust(frequencies=0.005, damping=0.2))
    by = predictor(
        JointedStructure(LinearStructure(M, C, stiffness_with_joint()), {}),
        jnp.eye(2),
        jnp.eye(2),
        RATE,
        "acceleration",
        (),
        2,
        LinearTrust(frequencies=0.0, damping=0.2),
    )[0]
    assert (by.errors, whole.predictor.errors) == (2, 4)
    z = np.array([0.5, -0.3])
    omega2, damping = by.modes_at(z)
    both, expected = whole.predictor.modes_at(np.concatenate([[0.0, 0.0], z]))
    np.testing.assert_allclose(omega2, both, rtol=1e-12)
    np.testing.assert_allclose(damping, expected, rtol=1e-12)


def test_derivatives_are_those_of_finite_differences():
    K, damping = moved(*OFF)
    y, noise = recorded(K, damping)
    made, _ = problem([y], [measured_force(PEAK)], noise)
    made = trusting(made)
    theta, step = made.still(made.map.given(np.full(5, 0.3))), 1e-5
    (seen,) = linearise(made, [(made.nothing(), theta)], SHORT_TIME_CONSTANT)
    for i in range(4):
        ends = [theta + sign * step * np.eye(theta.shape[1])[i] for sign in (1.0, -1.0)]
        high, low = (
            linearise(made, [(made.nothing(), each)], SHORT_TIME_CONSTANT)[0].residual
            for each in ends
        )
        slope = np.asarray(seen.slopes)[:, i]
        np.testing.assert_allclose(
            slope, (high - low) / (2.0 * step), atol=1e-5 * np.max(np.abs(slope))
        )


def test_a_fit_recovers_the_errors_and_the_corrected_model_has_them():
    K, damping = moved(*OFF)
    y, noise = recorded(K, damping)
    made, _ = problem([y], [measured_force(PEAK)], noise, joint=False)
    made = trusting(made)
    start = Start(made.nothing(), made.map.given())
    (fit,) = multistart(made, [start], SHORT_TIME_CONSTANT, 12)
    (fit,) = multistart(made, [fit.start], np.inf, 12)
    found = modes_refitted(made, fit, ["mode 1", "mode 2"])
    for mode, *true in zip(found, *OFF, strict=True):
        for each, value in zip(mode.parameters, true, strict=True):
            assert abs(each.value - np.expm1(value)) < 4.0 * each.std + 1e-5
            assert each.std < 0.1 * abs(value)
    assert beyond_trust(made, fit, ["mode 1", "mode 2"]) == []
    tight = trusting(made, LinearTrust(0.001, 0.2))
    (fitted,) = multistart(tight, [Start(tight.nothing(), fit.start.theta)], np.inf, 12)
    assert any(line.startswith("mode 1") for line in beyond_trust(tight, fitted, ["mode 1"]))

    structure = model(joint=False)
    _, modal = predictor(structure, jnp.eye(2), jnp.eye(2), RATE, "acceleration", (), 2)
    corrected = corrected_model(structure, RankedFit(made, fit), {}, modal).structure
    # Of the error, a hundredth is left: the noise's.
    for got, given, true in (
        (corrected.K, stiffness_with_joint(), K),
        (corrected.C, C, damping),
    ):
        assert np.linalg.norm(got - true) < 0.05 * np.linalg.norm(given - true)


@pytest.fixture(scope="module")
def recordings() -> list[StudyRecording]:
    K, damping = moved(*OFF)
    return [
        StudyRecording(f"hit {i}", recorded(K, damping, i)[0], measured_force(PEAK), use)
        for i, use in enumerate(("fit", "fit", "hold_out"))
    ]


def diagnosed(recordings: list[StudyRecording], trust: LinearTrust | None) -> ij.Diagnosis:
    return diagnose_histories(
        model(joint=False),
        recordings,
        RATE,
        rows=AXES,
        sensors=AXES,
        inputs=AXES,
        hypotheses=("stiffness_error", "viscous_damping", "cubic_stiffness"),
        trust=trust,
    )


def test_errors_within_the_trust_are_not_missing_physics(recordings):
    found = diagnosed(recordings, TRUST)
    assert found.verdict.name == "nothing_missing"
    assert [each.name for each in found.modes] == ["mode 1", "mode 2"]
    assert found.after.hold_out < 1.2 * found.noise_floor_95.hold_out


@pytest.mark.long
def test_errors_of_a_model_that_is_taken_to_be_exact_are_missing_physics(recordings):
    assert diagnosed(recordings, None).detected
