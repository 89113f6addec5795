"""A size that is not determined is no suspect."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from struck_mass import JOINT, RATE, resolution, struck

from iwanjax.discrepancy.histories.ranking import TIME_CONSTANT
from iwanjax.discrepancy.steady.verdict import Ranking
from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.identification import estimates, hypotheses
from iwanjax.identification.estimates import determined
from iwanjax.identification.multistart import multistart
from iwanjax.identification.recordings import StudyRecording
from iwanjax.identification.steady.fit import PlacedEffect
from iwanjax.identification.suspects import ParameterMap

SEARCH = SimpleNamespace(parameters=0, map=ParameterMap(0), recordings=1, directions=0, order=(0,))


def fitted(name, theta, shape=False, fixed=False):
    kind = CATALOGUE[name][0]
    hypothesis = SimpleNamespace(
        kinds=(kind,),
        where=("a1",),
        sizes=(not fixed,),
        shapes=(shape,),
        drifting=None,
        logarithmic=lambda slot: getattr(kind, "positive", False),
    )
    return SimpleNamespace(hypothesis=hypothesis, theta=np.array([theta]))


@pytest.fixture
def known(monkeypatch):
    """Sets the covariance of what was fitted."""
    return lambda C: monkeypatch.setattr(estimates, "covariance", lambda *_: np.array(C))


@pytest.mark.parametrize(("gain", "std", "sure"), [(-0.127, 1.6, False), (-0.127, 0.01, True)])
def test_a_gain_within_its_deviation_of_none_is_no_suspect(known, gain, std, sure):
    known([[std**2]])
    assert determined(SEARCH, fitted("sensor_gain", [gain, 0.0])) == sure


@pytest.mark.parametrize("free", [pytest.param(True, marks=pytest.mark.long), False])
def test_a_gain_has_no_size_in_a_free_decay(free):
    """A sensor that shows 0.87 of the motion: known by the force, and by nothing without it."""
    response = 0.87 * struck(lambda d: 0.0)
    noise = 1e-3 * np.std(response) * np.random.default_rng(0).standard_normal(response.shape)
    shown = resolution(response + noise, replace(JOINT, F_S=1e7))
    if free:
        # From after the blow on, the state then unknown.
        decay = StudyRecording("decay", (response + noise)[int(0.08 * RATE) :], None)
        shown = replace(shown, recordings=[decay])
    problem = shown.of_model().problem
    (gain,) = CATALOGUE["sensor_gain"]
    start = hypotheses.sensor(problem, gain, 0, "a1", np.zeros(problem.parameters), -0.1)
    (found,) = multistart(problem, [start], TIME_CONSTANT, 12)
    (size,) = estimates.estimates(problem, found, 0)
    assert determined(problem, found) != free
    assert (size.std > abs(size.value)) == free
    assert free or size.value == pytest.approx(-0.13, abs=0.002)


@pytest.mark.parametrize(("std", "sure"), [(0.1, True), (1.0, False)])
def test_a_positive_size_counts_by_its_logarithm(known, std, sure):
    known([[std**2]])
    assert determined(SEARCH, fitted("sensor_delay", [-9.0, 0.0])) == sure


def test_a_slider_that_slips_from_the_first_has_a_force(known):
    """Its force k times slip is known to a hundredth, either of them to a factor of e^5."""
    known([[25.0, -25.0], [-25.0, 25.0 + 1e-4]])
    assert determined(SEARCH, fitted("coulomb_friction", [3.0, -8.0], shape=True))
    known([[25.0, 0.0], [0.0, 0.01]])
    assert not determined(SEARCH, fitted("coulomb_friction", [3.0, -8.0], shape=True))


def test_a_wrong_sign_has_no_size_to_be_determined(known):
    known(np.zeros((0, 0)))
    assert determined(SEARCH, fitted("sensor_polarity", [-2.0, 0.0], fixed=True))


def test_of_a_model_that_broke_down_no_size_is_known(known):
    known([[math.nan]])
    assert not determined(SEARCH, fitted("sensor_gain", [0.5, 0.0]))


def fit(cost, name=None, size=0.0, std=math.nan):
    """A joint's fit to 1000 white values."""
    return SimpleNamespace(
        effect=PlacedEffect(CATALOGUE[name][0]) if name else None,
        values=np.array([size]),
        cost=cost,
        count=1000,
        unknowns=1,
        correlation=lambda: 1.0,
        std=lambda: np.array([std]),
    )


def test_beside_a_joint_the_next_that_is_determined_leads():
    alone = fit(3000.0)
    open_one, known_one = (
        fit(900.0, "cubic_stiffness", 0.127, 1.6),
        fit(1000.0, "stiffness_error", 0.127, 0.01),
    )
    standing = Ranking.of(alone, [open_one, known_one])
    assert standing.chosen is known_one
    assert [each.fit for each in standing.entries] == [known_one]
    assert Ranking.of(alone, [open_one]).chosen is alone
