"""A slider with a dead band: limits, a route of its own, Caughey's published harmonics."""

import numpy as np
import pytest

import iwanjax as ij
from iwanjax.joints import Backlash

F_S, K_T, GAP = 2.0, 40.0, 0.03
SLIP = F_S / K_T
TURNS = np.array([0.02, 0.06, 0.2, 0.19, 0.11, -0.3, -0.26, -0.2, 0.4, -0.01])


def test_its_limits_are_dry_friction_and_a_gap():
    np.testing.assert_allclose(
        ij.hysteresis(Backlash(F_S, K_T, 0.0), TURNS),
        ij.hysteresis(ij.Jenkins(F_S, K_T), TURNS),
        atol=1e-14,
    )
    np.testing.assert_allclose(
        ij.hysteresis(Backlash(1e6, K_T, GAP), TURNS),
        ij.hysteresis(ij.Gap(K_T, GAP), TURNS),
        atol=1e-14,
    )


def by_small_steps(d: np.ndarray, fine: int = 4000) -> np.ndarray:
    """Another route: where the block stands, dragged by the force that exceeds its friction."""
    block, play, last, found = 0.0, 0.0, 0.0, []
    for end in d:
        for to in np.linspace(last, end, fine + 1)[1:]:
            play = np.sign(to - block) * max(abs(to - block) - GAP, 0.0)
            if K_T * abs(play) > F_S:
                block += play - np.sign(play) * SLIP
                play = np.sign(play) * SLIP
        found.append(K_T * play)
        last = end
    return np.array(found)


def test_a_history_is_that_of_a_block_that_is_dragged():
    found = ij.hysteresis(Backlash(F_S, K_T, GAP), TURNS)
    np.testing.assert_allclose(found, by_small_steps(TURNS), atol=1e-10)
    # Just after a reversal the spring unloads, in the dead band there is no force.
    assert float(found[3]) == pytest.approx(F_S - 0.01 * K_T)
    assert float(found[4]) == 0.0


def test_its_loop_is_the_steady_one_and_encloses_what_it_loses():
    joint = Backlash(F_S, K_T, GAP)
    for amplitude in (0.01, 0.06, 0.2):
        d, force = joint.loop(amplitude, points=4001)
        steady = ij.hysteresis(joint, np.concatenate([[amplitude, -amplitude], d]))[2:]
        np.testing.assert_allclose(force, steady, atol=1e-12)
        lost = 4.0 * F_S * max(amplitude - GAP - SLIP, 0.0)
        assert float(joint.dissipation(amplitude)) == pytest.approx(lost, abs=1e-15)
        assert np.trapezoid(force, d) == pytest.approx(lost, abs=1e-6)


def test_without_clearance_its_first_harmonic_is_caughey_s():
    """Caughey (1960), bilinear hysteresis: k/pi (t - sin(2 t)/2), cos t = 1 - 2 slip/d."""
    d = SLIP * np.array([1.5, 3.0, 10.0])
    t = np.arccos(1.0 - 2.0 * SLIP / d)
    found = Backlash(F_S, K_T, 0.0).harmonic_stiffness(d)
    np.testing.assert_allclose(found, K_T / np.pi * (t - 0.5 * np.sin(2.0 * t)), rtol=2e-3)


def test_a_search_holds_slip_at_so_many_clearances():
    joint = Backlash.scaled(40.0, 0.05, slip=2.0)
    assert (float(joint.F_S), float(joint.gap)) == (4.0, 0.05)
    assert [info.name for info in Backlash.searched()] == ["k", "gap"]
