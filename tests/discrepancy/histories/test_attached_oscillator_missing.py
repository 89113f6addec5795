"""Something that vibrates on its own: found where it is attached, with its mass and frequency."""

import math

import numpy as np
import pytest
from two_masses import Law, diagnosed

from iwanjax.joints import AttachedOscillator

pytestmark = pytest.mark.long

# Between the two modes of the masses.
MASS, OMEGA, RATIO = 0.08, 330.0, 0.03
STIFFNESS, DAMPER = MASS * OMEGA**2, 2.0 * RATIO * MASS * OMEGA
NAMES = ("attached_oscillator", "mass_error", "stiffness_error")


def attached() -> Law:
    """Semi-implicit Euler of the mass that is carried along, in the steps of the others."""
    y, rate = [0.0], [0.0]
    dt = 1.0 / (1024.0 * 64)

    def force(d: float, v: float, moved: float) -> float:
        pull = STIFFNESS * (d - y[0]) + DAMPER * (v - rate[0])
        rate[0] += dt * pull / MASS
        y[0] += dt * rate[0]
        return pull

    return force


@pytest.fixture(scope="module")
def found():
    return diagnosed(attached, NAMES, "m2-ground")


def test_it_is_found_where_it_is_with_its_mass_and_frequency(found):
    first = found.what[0]
    assert first.label == "attached_oscillator@m2-ground"
    assert first.probability > 0.9
    assert found.verdict.name == "something_missing"
    assert found.after.hold_out < 1.3 * found.noise_floor.hold_out
    assert found.before.hold_out > 10.0 * found.noise_floor.hold_out
    m, k, c = first.parameters
    assert m.value == pytest.approx(MASS, rel=0.02)
    assert math.sqrt(k.value / m.value) == pytest.approx(OMEGA, rel=0.005)
    assert c.value == pytest.approx(DAMPER, rel=0.1)
    for each, truth in zip((m, k, c), (MASS, STIFFNESS, DAMPER), strict=True):
        assert abs(each.value - truth) < 4.0 * each.std + 0.01 * truth


def test_the_corrected_model_carries_it(found):
    (joint,) = found.model.elements
    assert isinstance(joint, AttachedOscillator)
    assert float(joint.m) == pytest.approx(MASS, rel=0.02)
    np.testing.assert_array_equal(found.model.rows, [[0.0, 1.0]])
