"""What attached oscillators leave, by receptances: against exact motion, and against runs."""

import math

import numpy as np
import pytest
from linear_pair import RATE, ROWS, C, M, measured_force, problem, simulated, stiffness_with_joint

from iwanjax.effects.catalogue import kinds_in_time
from iwanjax.effects.kinds import JointKind
from iwanjax.identification.hypotheses import LawStart, with_law
from iwanjax.identification.linearise import squares_at
from iwanjax.identification.problem import HistoryProblem
from iwanjax.identification.receptance import left_with, nearest_oscillators
from iwanjax.joints import AttachedOscillator

HITS = ((60.0, 0), (25.0, 1))
OMEGA = 2.0 * math.pi * 70.0
TRUTH = AttachedOscillator(0.05, 0.05 * OMEGA**2, 0.06 * 0.05 * OMEGA)
KIND = next(k for k in kinds_in_time() if isinstance(k, JointKind) and k.law is AttachedOscillator)


def attached(where="m2", quantity="acceleration", missing=False):
    """Two hits of the masses with the oscillator, without noise; and the place where it is."""
    m, k, c = (float(x) for x in (TRUTH.m, TRUTH.k, TRUTH.c))
    mass, row = np.diag([*np.diag(M), m]), np.append(ROWS[where], -1.0)
    stiffness, damping = np.zeros((2, 3, 3))
    stiffness[:2, :2], damping[:2, :2] = stiffness_with_joint(), C
    whole = {
        "mass": mass,
        "stiffness": stiffness + k * np.outer(row, row),
        "damping": damping + c * np.outer(row, row),
    }
    seen = [simulated(peak, quantity, struck=at, **whole) for peak, at in HITS]
    if missing:
        seen[1][:, 1] = math.nan
    forces = [measured_force(*hit) for hit in HITS]
    scale = np.max(np.abs(seen[0])) / 100.0 * np.ones(2)
    made, places = problem(seen, forces, scale, quantity=quantity)
    (place,) = (each for each in places if each.label == where)
    return made, place


def by_runs(made, place, z, laws, memory):
    """The same by the elements in motion."""
    own, starts = with_law(made, KIND, place, [LawStart(law, z) for law in laws])
    return np.array(squares_at(own, [(s.hypothesis, own.still(s.theta)) for s in starts], memory))


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
@pytest.mark.parametrize("memory", [2.0, math.inf])
def test_the_oscillator_that_is_there_leaves_nothing(quantity, memory):
    made, place = attached(quantity=quantity)
    z = np.zeros(made.parameters)
    (without,) = squares_at(made, [(made.nothing(), made.still(made.map.given(z)))], memory)
    heavier = AttachedOscillator(1.1 * TRUTH.m, 1.1 * TRUTH.k, 1.1 * TRUTH.c)
    true, other = left_with(made, place, z, [TRUTH, heavier], memory)
    # A force that is straight from sample to sample is so much off.
    assert true < ((OMEGA / RATE) ** 2 / 12.0) ** 2 * without
    assert other > 10.0 * true


@pytest.mark.parametrize("missing", [False, True])
@pytest.mark.parametrize("memory", [2.0, math.inf])
def test_runs_leave_the_same(memory, missing):
    made, place = attached(missing=missing)
    z, laws = np.zeros(made.parameters), AttachedOscillator.begun(place.scales)
    runs = by_runs(made, place, z, laws, memory)
    found = left_with(made, place, z, laws, memory)
    assert np.argmin(found) == np.argmin(runs)
    # As heavy as its place it is off where a run takes its steps, and where it is corrected.
    light = np.array([law.m < 0.02 * place.scales.mass for law in laws])
    np.testing.assert_allclose(found[light], runs[light], rtol=0.01)


def test_a_search_begins_where_runs_leave_least():
    """Beside joints that are right and joints that are not: beside the former."""
    made, place = attached()
    beside = [np.ones(made.parameters), np.zeros(made.parameters)]
    laws = AttachedOscillator.begun(place.scales)
    runs = np.stack([by_runs(made, place, z, laws, 2.0) for z in beside])
    near = nearest_oscillators(made, place, beside, 2.0)
    which, law = np.unravel_index(np.argmin(runs), runs.shape)
    assert len(near) == made.settings.joint_faults.near
    assert np.all(near[0].z == beside[which])
    assert float(near[0].law.m) == float(laws[law].m)
    assert float(near[0].law.k) == float(laws[law].k)


def test_without_an_observer_no_oscillator_is_nearer_than_another(monkeypatch):
    made, place = attached()
    gains = HistoryProblem.gains

    def none(*known, **options):
        found = gains(*known, **options)
        return found._replace(gain=math.nan * found.gain)

    monkeypatch.setattr(HistoryProblem, "gains", none)
    assert np.all(np.isinf(left_with(made, place, np.zeros(made.parameters), [TRUTH], 2.0)))
