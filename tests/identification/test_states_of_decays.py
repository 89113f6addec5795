"""The state in which a free decay began, against least squares of SciPy."""

import math
from dataclasses import replace

import numpy as np
import scipy.optimize
from struck_mass import RATE, resolution, struck

import iwanjax as ij
from iwanjax.identification.linearise import residuals_at
from iwanjax.identification.multistart import with_states_of_decays
from iwanjax.identification.recordings import StudyRecording

# The pulse is over.
FIRST = int(0.08 * RATE)
SLIPPING = ij.Iwan4(F_S=3.0, K_T=3e4, chi=-0.5, beta=1.5)


def decaying(joint, **options):
    response = struck(lambda d: 0.0)[FIRST:]
    noise = np.random.default_rng(0).standard_normal(response.shape)
    response += 1e-3 * np.std(response) * noise
    decay = StudyRecording("decay", response, **({"force": None} | options))
    return replace(resolution(response, joint), recordings=[decay]).of_model().problem


def test_the_state_is_that_of_least_squares_in_the_free_run():
    problem = decaying(SLIPPING)
    nothing, rows = problem.nothing(), problem.still(problem.map.given())
    found = with_states_of_decays(problem, nothing, rows, np.array([True]))
    values = problem.map.end(1)

    def residuals(state):
        row = np.concatenate([rows[0, :values], state])[None]
        (e,) = residuals_at(problem, [(nothing, row)], math.inf)
        return np.concatenate([e.ravel(), state])

    best = scipy.optimize.least_squares(residuals, rows[0, values:], x_scale=0.1)
    assert np.sum(residuals(found[0, values:]) ** 2) < 2.0 * best.cost * (1.0 + 1e-3)
    # It was not there from the first.
    assert np.sum(residuals(rows[0, values:]) ** 2) > 2.0 * best.cost * 1.01
    np.testing.assert_array_equal(found[0, :values], rows[0, :values])


def test_what_begins_in_motion_under_a_force_of_zero_is_a_free_decay():
    """A recording that began after its shock, the channel of the force still among its arrays."""
    decay = decaying(SLIPPING)
    silent = np.zeros((decay.data.response.shape[1], 1))
    shown = decaying(SLIPPING, force=silent, initial="unknown")
    for found, expected in zip(shown.data, decay.data, strict=True):
        np.testing.assert_array_equal(np.asarray(found), np.asarray(expected))
    np.testing.assert_array_equal(shown.noise, decay.noise)
