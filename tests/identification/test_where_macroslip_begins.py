"""Where macroslip may begin when no recording has reached it."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import iwanjax as ij
from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.identification.conditioning import conditioned
from iwanjax.identification.joint_priors import Joint, joints_at
from iwanjax.identification.linearise import residuals_at
from iwanjax.identification.macroslip import (
    alternatives,
    in_the_middle,
    with_later_macroslip,
)
from iwanjax.identification.multistart import multistart
from iwanjax.identification.predictor import predictor
from iwanjax.identification.problem import HistoryProblem, Start
from iwanjax.identification.recordings import StudyRecording
from iwanjax.settings.conditioning import CONDITIONING

RATE, N = 1024.0, 700
TRUE = ij.Iwan4(F_S=20.0, K_T=3e4, chi=-0.5, beta=1.5)


def iwan(joints: tuple[Joint, ...], z) -> ij.Iwan4:
    """The only joint at z."""
    (found,) = joints_at(joints, jnp.asarray(z))
    assert isinstance(found, ij.Iwan4)
    return found


@given(
    st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=4),
    st.floats(-1.0, 1.0),
)
def test_another_macroslip_leaves_the_microslip_as_it_is(z, farther):
    joint = Joint(TRUE, jnp.ones(4))
    fit = iwan((joint,), z)
    found = with_later_macroslip(joint, fit, np.array(z), farther)
    # Without a last slider left there is nothing to begin later.
    strongest = (1.0 + float(fit.beta)) * math.exp(-farther * (1.0 + float(fit.chi))) - 1.0
    assert (found is None) == (strongest <= 0)
    if found is None or strongest < 1e-3:
        return
    moved = iwan((joint,), found)
    for name in ("K_T", "chi", "R"):
        assert float(getattr(moved, name)) == pytest.approx(float(getattr(fit, name)), rel=1e-9)
    ratio = float(moved.phi_max / fit.phi_max)
    assert math.log(ratio) == pytest.approx(farther, abs=1e-9)


def fitted(peak: float, F_S: float):
    """A mass on a joint hit with some force, its joint refitted from another strength."""
    one = np.ones((1, 1))
    linear = ij.LinearStructure(one, 2.5 * one, 3e4 * one)
    t = np.arange(16 * N) / (16 * RATE)
    acts = (t > 0.05) & (t < 0.062)
    force = peak * np.sin(np.pi * (t - 0.05) / 0.012) ** 2 * acts
    true = ij.simulate(
        ij.JointedStructure(linear, {"J1": (np.ones(1), TRUE)}),
        force[:, None],
        t[1],
        inputs=one,
        sliders=None,
    )
    response = np.asarray(true.acceleration)[::16]
    noise = np.array([3e-3 * np.std(response)])
    response = response + noise * np.random.default_rng(1).standard_normal(response.shape)
    given = ij.Iwan4(F_S=F_S, K_T=3e4, chi=-0.5, beta=1.5)
    model = ij.JointedStructure(linear, {"J1": (np.ones(1), given)})
    made, modal = predictor(
        model,
        jnp.asarray(one),
        jnp.asarray(one),
        RATE,
        "acceleration",
        CATALOGUE["cubic_stiffness"],
        2,
    )
    recording = StudyRecording("rec", response, force[::16, None])
    seen = conditioned([recording], made, modal, noise, N, 1, 6)
    problem = HistoryProblem(made, (Joint(given, jnp.ones(4)),), seen.data, noise, (0,))
    start = Start(problem.nothing(), np.zeros(6))
    short = multistart(problem, [start], 8.0, 20)[0]
    return problem, multistart(problem, [short.start], math.inf, 20)[0]


@pytest.mark.long
def test_macroslip_is_open_where_it_was_never_reached():
    problem, fit = fitted(15.0, 12.0)
    joint = iwan(problem.joints, fit.theta[0, :4])
    found = alternatives(problem, fit)
    assert sum(each.weight for each in found if each.farther > 0) > 0.3
    middle = in_the_middle(problem, fit)
    moved = iwan(problem.joints, middle.theta[0, :4])
    assert float(moved.phi_max) >= float(joint.phi_max)
    assert float(moved.R) == pytest.approx(float(joint.R), rel=1e-9)
    # Where it is makes no difference to what was recorded: less than noise does.
    assert abs(middle.misfit.sum() - fit.misfit.sum()) < 30.0
    assert np.count_nonzero(np.asarray(problem.data.weight)) > 500


def test_what_a_right_model_may_be_off_by_is_no_macroslip():
    """The loudest moment goes just beyond: without noise or error it would tell to five digits."""
    problem, fit = fitted(40.55, 16.0)
    found = alternatives(problem, fit)
    assert sum(each.weight for each in found if each.farther > 0) > 0.5
    there = fit.theta.copy()
    there[:, :4] += next(each.change for each in found if each.farther > 0)[:4]
    (seen,) = residuals_at(problem, [(fit.hypothesis, there)], math.inf)
    weight, response = np.asarray(problem.data.weight), np.asarray(problem.data.response)
    moved, whole = (seen - fit.residual) ** 2, (weight * response) ** 2
    # Sixty times as unlikely as the fit by the noise alone, less than the model's own 0.2 %.
    assert np.sum(seen**2) - fit.misfit.sum() > 2.0 * math.log(60.0)
    assert math.sqrt(np.sum(moved) / np.sum(whole)) < CONDITIONING.model_error


def test_macroslip_is_known_where_it_was_reached():
    problem, fit = fitted(200.0, 16.0)
    assert sum(each.weight for each in alternatives(problem, fit)) < 1e-3
    assert in_the_middle(problem, fit) is fit
