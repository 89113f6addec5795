"""Columns of the score test, and residuals, against differences of exact simulations."""

import math
from typing import NamedTuple

import jax
import numpy as np
import pytest
from linear_pair import (
    RATE,
    ROWS,
    C,
    M,
    measured_force,
    problem,
    simulated,
    stiffness_with_joint,
)

from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.identification.columns import (
    columns,
    columns_at_rest,
    sensor_faults,
    unit_effects,
)
from iwanjax.identification.linearise import residuals_at
from iwanjax.identification.multistart import HypothesisFit, multistart
from iwanjax.identification.places import Place
from iwanjax.identification.problem import HistoryProblem, Start
from iwanjax.signals.comparison_band import in_band

PEAK = 60.0
# Effects, what they change of the masses' own matrices, and a size that changes little.
FORCES = {
    "stiffness_error": ("stiffness", stiffness_with_joint(), 5.0),
    "viscous_damping": ("damping", C, 1e-3),
    "mass_error": ("mass", M, 1e-4),
}
compared = jax.jit(in_band)


def weighed(made: HistoryProblem, y: np.ndarray) -> np.ndarray:
    return np.asarray(compared(y)) * np.asarray(made.data.weight)[0]


def change(name: str, where: str, quantity: str) -> np.ndarray:
    """Of what is shown, by a unit of an effect: a central difference of two simulations."""
    what, matrix, size = FORCES[name]
    more = size * np.outer(ROWS[where], ROWS[where])
    up, down = (simulated(PEAK, quantity, **{what: matrix + s * more}) for s in (1.0, -1.0))
    return (up - down) / (2.0 * size)


def off(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


class Struck(NamedTuple):
    """What was measured, without noise, and the model as given beside it."""

    quantity: str
    y: np.ndarray
    made: HistoryProblem
    places: tuple[Place, ...]
    base: HypothesisFit


@pytest.fixture(
    scope="module", params=["acceleration", pytest.param("velocity", marks=pytest.mark.long)]
)
def struck(request: pytest.FixtureRequest) -> Struck:
    y = simulated(PEAK, request.param)
    noise, names = 1e-3 * np.std(y, axis=0), tuple(FORCES)
    made, places = problem([y], [measured_force(PEAK)], noise, names=names, quantity=request.param)
    (base,) = multistart(made, [Start(made.nothing(), made.map.given())], math.inf, 0)
    return Struck(request.param, y, made, places, base)


def test_columns_of_forces_are_differences_of_simulations(struck):
    """With a joint that does not slip both ways to them give the same."""
    quantity, y, made, places, base = struck
    units = unit_effects(made, base, made.predictor.kinds, places)
    assert {(unit.kind.name, unit.where) for unit in units} == {
        (name, where) for name in FORCES for where in ROWS
    }
    found = columns(made, base, units)
    quick = np.zeros((len(units), y.size))
    for which, own in columns_at_rest(made, base, units):
        quick[which] = own
    for unit, column, other in zip(units, found, quick, strict=True):
        # A residual is what was measured less what is predicted.
        exact = -weighed(made, change(unit.kind.name, unit.where, quantity))
        assert off(column[0], exact) < 0.01
        assert off(other.reshape(exact.shape), exact) < 0.01


def test_columns_of_sensor_faults_are_the_signal_and_its_slope(struck):
    _, y, made, _, base = struck
    kinds = (*CATALOGUE["sensor_gain"], *CATALOGUE["sensor_delay"])
    units = sensor_faults(made, kinds, ("a1", "a2"), made.map.given())
    assert len(units) == 4
    # A sample later than it was: of a recording without noise by its Fourier series.
    omega = 2.0 * np.pi * np.fft.rfftfreq(len(y), 1.0 / RATE)[:, None]
    slope = np.fft.irfft(1j * omega * np.fft.rfft(y, axis=0), len(y), axis=0) / RATE
    for unit, column in zip(units, columns(made, base, units), strict=True):
        own = np.zeros(2)
        own[("a1", "a2").index(unit.where)] = 1.0
        shown = -y if unit.kind.name == "sensor_gain" else slope
        assert off(column[0], weighed(made, shown * own)) < 0.02


def test_where_no_force_is_suspected_predictions_are_the_same(struck):
    """Of a problem with suspected sensors only, and of one with forces of size nil."""
    quantity, y, beside, _, _ = struck
    alone, _ = problem([y], [measured_force(PEAK)], beside.noise, names=(), quantity=quantity)
    found, expected = (
        residuals_at(made, [(made.nothing(), made.still(made.map.given()))], 2.0)[0]
        for made in (alone, beside)
    )
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.max(np.abs(expected)))
