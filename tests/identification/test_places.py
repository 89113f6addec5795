"""What places did in a recording, against the exact motion of two masses.

The simulation that made the recording also says how the masses were displaced and how fast, of
which an observer sees accelerations or velocities alone.
"""

import math

import numpy as np
import pytest
from linear_pair import (
    JOINT,
    RATE,
    ROWS,
    M,
    measured_force,
    problem,
    simulated,
    stiffness_with_joint,
)
from scipy.linalg import eigh

from iwanjax.identification.linearise import residuals_at
from iwanjax.identification.places import followed

PEAK = 60.0
SHAPES = eigh(stiffness_with_joint(), M)[1]
"""Of the model's modes, of unit modal mass: their signs are of no matter here."""


def recorded(quantity: str, joint: float) -> tuple:
    """A recording of masses with another joint than the model's, and how they moved."""
    stiffness = stiffness_with_joint(joint)
    d, v, y = (
        simulated(PEAK, each, stiffness=stiffness)
        for each in ("displacement", "velocity", quantity)
    )
    made, places = problem([y], [measured_force(PEAK)], 1e-3 * np.std(y, axis=0), quantity=quantity)
    return made, places, d, v


def off(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
def test_places_that_follow_a_right_model_move_as_the_masses_did(quantity):
    made, places, d, v = recorded(quantity, JOINT)
    seen = followed(made)
    assert [each.label for each in places] == list(ROWS)
    for place in places:
        row = ROWS[place.label]
        np.testing.assert_allclose(np.abs(place.row), np.abs(row @ SHAPES), rtol=1e-9)
        assert off(seen.q[0] @ place.row, d @ row) < 2e-3
        assert off(seen.v[0] @ place.row, v @ row) < 2e-3


@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
@pytest.mark.parametrize("share", [0.1, 0.01])
def test_places_are_followed_where_the_model_is_wrong(quantity, share):
    """In proportion to what the joint is off by, and four times as well as by the model alone."""
    made, places, d, v = recorded(quantity, (1.0 + share) * JOINT)
    seen = followed(made)
    (free,) = residuals_at(made, [(made.nothing(), made.still(made.map.given()))], math.inf)
    weighed = np.asarray(made.data.weight)[0] * np.asarray(made.data.response)[0]
    by_itself = float(np.linalg.norm(free) / np.linalg.norm(weighed))
    assert by_itself > 5.0 * share
    for place in places:
        row = ROWS[place.label]
        assert off(seen.q[0] @ place.row, d @ row) < 0.25 * by_itself
        assert off(seen.v[0] @ place.row, v @ row) < 0.25 * by_itself


@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
def test_scales_are_the_largest_deflection_and_the_mean_period(quantity):
    """Of a sum of sines: 2 pi times the deflection's root mean square over the rate's."""
    _, places, d, v = recorded(quantity, JOINT)
    modes = np.sqrt(eigh(stiffness_with_joint(), M, eigvals_only=True))
    for place in places:
        row = ROWS[place.label]
        used = slice(20, len(d) - 20)
        assert place.scales.deflection == pytest.approx(np.max(np.abs(d @ row)), rel=5e-3)
        period = 2.0 * math.pi * np.std((d @ row)[used]) / np.std((v @ row)[used])
        assert place.scales.period == pytest.approx(period, rel=0.02)
        assert 2.0 * math.pi / modes[1] < place.scales.period < 2.0 * math.pi / modes[0]
        assert place.scales.period > 2.0 / RATE
