"""One fit type for curves, modes and loops: what it says of effects of every kind."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import iwanjax as ij
from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.identification.steady import modes
from iwanjax.identification.steady.curves import ModeProblem, fit_alone
from iwanjax.identification.steady.cycle import ActingForce, ActingJoint, unit_on
from iwanjax.identification.steady.fit import JointValues, PlacedEffect, Size, SteadyFit
from iwanjax.joints.iwan import IWAN_PARAMETERS
from iwanjax.updating.joint_groups import structural_parameters
from iwanjax.updating.modal import modal_parameters, modal_problem
from iwanjax.updating.structural import structural_problem

THETA = np.array([120.0, 0.002, 5.0, 3.0e4, -0.5, 1.0, 0.6])


@pytest.fixture(scope="module")
def curves():
    """Of a mode with an Iwan5 joint, from below where its kinetic friction shows."""
    q = np.geomspace(1e-6, 1e-4, 12)
    joint = ij.Iwan5(*THETA[2:])
    largest = 1.5e-4
    f, zeta = ij.ModalOscillator(*THETA[:2], joint).ringdown_frequency_and_damping(
        q, largest=largest
    )
    std = (np.full(12, 1e-2), np.full(12, 1e-5))
    given = {"frequency_std": std[0], "damping_std": std[1]}
    return ij.ModalCurves(q, f, zeta, quantity="modal displacement", largest=largest, **given)


@pytest.fixture(scope="module")
def base(curves):
    row = tuple(modal_parameters(ij.Iwan5, [curves]).values())
    return modal_problem(ij.Iwan5, [curves], row, "absolute")


def problem(base, names, beside, acting):
    return ModeProblem(
        base.measured, base.chart, (*base.names, *names), "absolute", base, beside, acting
    )


@pytest.fixture(scope="module")
def with_joint(base, curves):
    row = tuple(modal_parameters(ij.Iwan4, [curves]).values())
    own = modal_problem(ij.Iwan4, [curves], row, "absolute")
    names = [info.name for info in IWAN_PARAMETERS]
    return problem(base, names, JointValues(own, 2), ActingJoint())


@pytest.fixture(scope="module")
def with_force(base):
    effect = PlacedEffect(CATALOGUE["gap_contact"][0], 3e-5)
    q, size = base.measured.q, Size(jnp.asarray(100.0), jnp.ones(()))
    omega = 2.0 * np.pi * float(np.mean(base.measured.frequency))
    return effect, problem(base, ("size",), size, ActingForce(unit_on(effect, q, omega)))


def test_a_joint_of_no_strength_changes_nothing(base, with_joint):
    """Also of a joint that remembers the largest amplitude of its decay."""
    nothing = [1e-9, 1e-5, -0.5, 1.0]
    found = with_joint.predict(jnp.asarray([*THETA, *nothing]))
    for own, both in zip(base.predict(jnp.asarray(THETA)), found, strict=True):
        np.testing.assert_allclose(both, own, rtol=1e-9)


def test_values_stand_behind_the_models_own(with_joint, with_force):
    joint = SteadyFit(
        PlacedEffect(CATALOGUE["iwan_joint"][0]),
        with_joint,
        np.array([*THETA, 1.0, 2e4, -0.5, 1.0]),
        0.0,
        0.0,
    )
    effect, problem = with_force
    force = SteadyFit(effect, problem, np.append(THETA, 50.0), 0.0, 0.0)
    assert joint.values.tolist() == [1.0, 2e4, -0.5, 1.0]
    assert force.values.tolist() == [50.0]
    for fit, own in ((joint, 4), (force, 2)):
        assert fit.problem.given.tolist() == list(range(len(THETA)))
        assert fit.unknowns == len(THETA) + own
        assert fit.count == 24
        z = fit.problem.to_variables(jnp.asarray(fit.theta))
        np.testing.assert_allclose(fit.problem.to_values(z), fit.theta, rtol=1e-9)


def test_deviations_of_size_and_shape_are_those_of_both_linearised(with_force):
    """Against a central difference of residuals in all values and in the shape's logarithm."""
    effect, problem = with_force
    theta = np.append(THETA, 50.0)
    fit = SteadyFit(effect, problem, theta, 0.0, 0.0)

    def residuals(values, shape):
        other = problem.reshaped(effect._replace(shape=shape))
        return np.asarray(eqx.filter_jit(other.residuals)(jnp.asarray(values)))

    step = 1e-5
    columns = []
    for i, value in enumerate(theta):
        up, down = theta.copy(), theta.copy()
        up[i], down[i] = value + step * abs(value), value - step * abs(value)
        both = (residuals(each, effect.shape) for each in (up, down))
        columns.append(np.subtract(*both) / (2.0 * step * abs(value)))
    wide = np.exp(1e-2)
    both = (residuals(theta, effect.shape * by) for by in (wide, 1.0 / wide))
    columns.append(np.subtract(*both) / 2e-2)
    J = np.column_stack(columns)
    size, shape = fit.estimates()
    for found, at, unit in ((size, -2, 1.0), (shape, -1, effect.shape)):
        # Of nine directions these curves determine six; differences make the others no more than
        # nearly nothing.
        others = np.delete(J / np.linalg.norm(J, axis=0), at, axis=1)
        known, *_ = np.linalg.lstsq(others, J[:, at], rcond=1e-6)
        left = np.linalg.norm(J[:, at] - others @ known)
        np.testing.assert_allclose(found.std, unit * np.sqrt(fit.correlation()) / left, rtol=1e-3)


def test_the_model_alone_predicts_what_it_is_fitted_to(base, curves):
    alone = fit_alone(base, np.tile(THETA, (4, 1)))
    (found,) = alone.predicted([curves])
    np.testing.assert_allclose(found.frequency, curves.frequency, rtol=1e-6)
    np.testing.assert_allclose(found.damping, curves.damping, rtol=1e-3)
    assert alone.effect is None
    assert alone.unknowns == len(THETA)


def test_a_joint_left_out_whose_stiffness_hides_the_modes_stands_as_first_found(monkeypatch):
    """A search may end at a rigid link, about which no modes can be worked out."""
    K, q = np.array([[2.0, -1.0], [-1.0, 2.0]]) * 1e5, np.geomspace(1e-6, 1e-4, 8)
    linear = ij.LinearStructure(np.eye(2), 1e-4 * K, K)
    structure = ij.JointedStructure(linear, {"J": ([1.0, 0.0], ij.Iwan4(10.0, 1e5, -0.5, 1.0))})
    omega = np.sqrt(np.asarray(structure.basis.omega2))
    curves = [
        ij.ModalCurves(
            q,
            (1.0 - 1e2 * q) * w / (2.0 * np.pi),
            0.01 + 10.0 * q,
            frequency_std=np.full(8, 1e-2),
            damping_std=np.full(8, 1e-5),
            quantity="modal displacement",
        )
        for w in omega
    ]
    row = tuple(structural_parameters(structure, None, curves, (0, 1)).values())
    base = structural_problem(structure, curves, row, (0, 1), None, None, "absolute")

    def ends(effect, problem, starts, *_):
        theta = starts[0].copy()
        if len(theta) > len(row) + 1:
            theta[4:8] = [1.0, 1e20, -0.5, 1.0]
        return SteadyFit(effect, problem, theta, 1.0, 1.0)

    monkeypatch.setattr(modes, "searched", ends)
    alone = modes.modes_alone(base, np.array([[p.value for p in row]]))
    kind, place = CATALOGUE["iwan_joint"][0], ("m2", np.array([0.0, 1.0]))
    fit = modes.modes_with_joint(alone, kind, place, curves, row, None, ())
    assert fit.values.tolist() == [1.0, 1e20, -0.5, 1.0]
    assert fit.problem.given.tolist() == [0, 1, 2, 3, 8, 9]
    assert fit.effect == PlacedEffect(kind, where="m2")
