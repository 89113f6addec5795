"""A corrected model, integrated in time, does what the diagnosis predicts with what it found."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from struck_mass import JOINT, NAMES, RATE, N, pulse, searching, struck

import iwanjax as ij
from iwanjax.discrepancy.histories.ranking import RankedFit
from iwanjax.discrepancy.histories.refitted import corrected_model
from iwanjax.dynamics.coordinates import modal_coordinates
from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.identification.hypotheses import JointStart, force, with_joint, with_stiction
from iwanjax.identification.linearise import innovations
from iwanjax.identification.multistart import multistart

FINE = 16
ROW = np.ones(1)
GIVEN = ij.JointedStructure(
    ij.LinearStructure(np.eye(1), 2.5 * np.eye(1), 3e4 * np.eye(1)), {"J1": (ROW, JOINT)}
)
MODAL = modal_coordinates(GIVEN, jnp.ones((1, 1)), jnp.ones((1, 1)), None)


@pytest.fixture(scope="module")
def problem():
    names = (*NAMES, "mass_error")
    return searching(struck(lambda d: 0.0), names=names)


def agrees(problem, start):
    """The corrected model, after its prediction and its integration were compared."""
    (fitted,) = multistart(problem, [start], math.inf, 0)
    model = corrected_model(GIVEN, RankedFit(problem, fitted), {"m1": ROW, "J1": ROW}, MODAL)
    measured = np.asarray(problem.data.response)[0]
    off = innovations(problem, fitted.hypothesis, fitted.theta, math.inf)[0]
    push = np.array([[pulse(i / (RATE * FINE))] for i in range(N * FINE)])
    seen = ij.simulate(model, push, 1.0 / (RATE * FINE), keep=("acceleration",), every=FINE)
    predicted = (measured - off)[: len(seen.acceleration)]
    apart = np.asarray(seen.acceleration)[: len(predicted)] - predicted
    assert np.sqrt(np.mean(apart**2) / np.mean(predicted**2)) < 0.01
    return model


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "size", "shape"),
    [
        ("cubic_stiffness", 2e9, 1.0),
        ("gap_contact", 2e4, 5e-4),
        ("viscoelastic", 1e4, 5e-3),
    ],
)
def test_a_law_is_a_joint_more(problem, name, size, shape):
    problem, _ = problem
    kind = CATALOGUE[name][0]
    start = force(problem, kind, "m1", ROW, np.zeros(problem.parameters), size, shape)
    model = agrees(problem, start)
    assert model.labels == ("J1", f"{name}@m1")


@pytest.mark.parametrize(
    ("name", "size", "matrix"),
    [("stiffness_error", -5e3, "K"), ("viscous_damping", 4.0, "C"), ("mass_error", 0.1, "M")],
)
def test_what_is_linear_goes_into_the_matrices(problem, name, size, matrix):
    problem, _ = problem
    kind = CATALOGUE[name][0]
    start = force(problem, kind, "m1", ROW, np.zeros(problem.parameters), size, 1.0)
    model = agrees(problem, start)
    assert model.labels == ("J1",)
    change = np.asarray(getattr(model.structure, matrix) - getattr(GIVEN.structure, matrix))
    assert change == pytest.approx(size)


@pytest.mark.long
def test_a_joint_left_out_and_one_that_sticks(problem):
    problem, scope = problem
    z = np.zeros(problem.parameters)
    more, starts = with_joint(
        problem, CATALOGUE["iwan_joint"][0], scope.places[0], [JointStart(1e4, 1e-3, z)]
    )
    model = agrees(more, starts[0])
    assert model.labels == ("J1", "iwan_joint@J1")
    left_out = model.elements[1]
    assert isinstance(left_out, ij.Iwan4)
    assert float(left_out.K_T) == pytest.approx(1e4)
    other, starts = with_stiction(problem, CATALOGUE["stiction"][0], 0, "J1", (0.7,), z)
    model = agrees(other, starts[0])
    sticking = model.elements[0]
    assert isinstance(sticking, ij.Iwan5)
    assert float(sticking.theta) == pytest.approx(0.7, rel=1e-3)
