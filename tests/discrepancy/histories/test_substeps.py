"""Steps between samples against many more of them, and against an exact solution."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from struck_mass import JOINT, RATE, N, resolution, struck

from iwanjax.discrepancy.histories import time_steps
from iwanjax.discrepancy.histories.ranking import TIME_CONSTANT, RankedFit
from iwanjax.discrepancy.histories.time_steps import StepRefinement
from iwanjax.errors import InputError
from iwanjax.identification.linearise import innovations, residuals_at
from iwanjax.identification.multistart import multistart
from iwanjax.identification.problem import HistoryProblem, Start
from iwanjax.identification.step_errors import Change, changed, of_own_motion

MANY = 32
# A joint that slips, and a mode that turns by 1.4 radians from sample to sample.
SLIPPING, EVERY = replace(JOINT, F_S=3.0), 6


@pytest.fixture(scope="module")
def coarse() -> StepRefinement:
    return resolution(struck(lambda d: 0.0), SLIPPING, every=EVERY)


def off(made: HistoryProblem, exact: HistoryProblem, time_constant: float) -> float:
    """Root mean square of what residuals of the model as given are off by, in deviations."""
    found = [
        residuals_at(each, [(each.nothing(), each.still(each.map.given()))], time_constant)[0]
        for each in (made, exact)
    ]
    return float(np.sqrt(np.mean((found[0] - found[1]) ** 2)))


@pytest.fixture(scope="module")
def exact(coarse) -> HistoryProblem:
    return coarse.with_substeps(MANY).problem


def test_errors_fall_with_the_square_of_the_step(coarse, exact):
    """Of a slipping joint, whose stiffness jumps at each turn; a third of it is left at most."""
    found = [off(coarse.with_substeps(k).problem, exact, math.inf) for k in (2, 4, 8)]
    assert found[0] > 3.0 * found[1] > 9.0 * found[2]


def test_a_fast_mode_is_taken_with_more_steps(coarse, exact):
    """Which halves what is left, at least: of all that may be taken none leaves less."""
    now = coarse.of_model().problem
    assert now.predictor.substeps == coarse.settings.steps.most
    assert off(now, exact, TIME_CONSTANT) < 0.5 * off(
        coarse.with_substeps(2).problem, exact, TIME_CONSTANT
    )
    start = Start(now.nothing(), np.zeros(6))
    given = RankedFit(now, multistart(now, [start], TIME_CONSTANT, 0)[0])
    there = coarse.of_model()
    assert coarse.of_free_run(there, given) is there


@pytest.mark.parametrize(
    "times",
    [
        pytest.param(
            1.0,
            marks=pytest.mark.xfail(
                strict=True, reason="0.44 of a deviation where 0.4 is allowed, 0.57 at other rates"
            ),
        ),
        1.5,
    ],
)
def test_steps_that_are_chosen_leave_what_is_allowed(times):
    """Against many more steps; of a joint that slips it is foreseen to within a half only."""
    taken = resolution(struck(lambda d: 0.0), SLIPPING, every=3)
    now, many = taken.of_model(), taken.with_substeps(MANY).problem
    assert now.sides.left_by_steps == 0.0
    assert off(now.problem, many, TIME_CONSTANT) < times * taken.settings.steps.compared


def test_what_the_most_steps_leave_is_told(coarse):
    """A joint that slips within a few samples; where fewer steps are enough nothing is told."""
    now, many = coarse.of_model(), coarse.with_substeps(MANY).problem
    left = off(now.problem, many, TIME_CONSTANT)
    assert now.sides.left_by_steps == pytest.approx(left, rel=0.5)
    assert any("time integration" in line for line in now.sides.warnings())
    enough = resolution(struck(lambda d: 0.0)).of_model()
    assert not any("time integration" in line for line in enough.sides.warnings())


def test_a_verdict_tells_what_steps_leave_of_its_own_model(coarse):
    """Neither what they left of another one, nor less than they leave of this one."""

    def told(taken, left):
        now = taken.of_model().leaving(left)
        start = Start(now.problem.nothing(), np.zeros(6))
        shown = RankedFit(now.problem, multistart(now.problem, [start], TIME_CONSTANT, 0)[0])
        return taken.of_verdict(now.sides, shown)

    enough = told(resolution(struck(lambda d: 0.0)), 2e3)
    assert enough.left_by_steps == 0.0
    assert not any("time integration" in line for line in enough.warnings())
    known = coarse.of_model()
    exact = coarse.with_substeps(MANY).problem
    # With the memory for which it counts most, and for errors that fall slowly.
    left = max(off(known.problem, exact, memory) for memory in (TIME_CONSTANT, math.inf))
    assert left < told(coarse, 2e3).left_by_steps < 1.5 * left


def test_no_finer_steps_are_taken_where_they_change_more_and_more(coarse, monkeypatch):
    """As of a model that is unstable; where changes fall the most that may be taken are."""
    seen = []

    def more_and_more(problem, *others):
        seen.append(problem.predictor.substeps)
        return Change(1e3 * 2.0 ** len(seen), 1e3 * 2.0 ** len(seen))

    assert coarse.of_model().problem.predictor.substeps == coarse.settings.steps.most
    monkeypatch.setattr(time_steps, "changed", more_and_more)
    found = coarse.of_model()
    assert seen == [2, 4]
    assert found.problem.predictor.substeps == 2
    assert found.sides.left_by_steps > 1e3


def test_what_steps_leave_is_known_without_more_of_them():
    """A joint that slips, the model's own motion: as the residuals of both numbers of steps say."""
    taken = resolution(struck(lambda d: 0.0), replace(JOINT, F_S=1e3))
    problem, twice = (taken.with_substeps(k).problem for k in (2, 4))
    point = problem.nothing(), problem.still(problem.map.given())
    for time_constant in (TIME_CONSTANT, math.inf):
        same = {time_constant: 1.0}
        foreseen = of_own_motion(problem, twice, *point, same)
        assert 0.8 < foreseen.change / changed(problem, twice, *point, same).change < 2.0


def test_of_a_linear_model_steps_are_exact():
    """A joint that never slips: the matrix exponential knows it all, at any number of steps."""
    stuck = replace(JOINT, F_S=1e9)
    taken = resolution(struck(lambda d: 0.0), stuck)
    A = np.array([[0.0, 1.0], [-6e4, -2.5]])
    predicted = []
    for steps in (2, 4):
        made = taken.with_substeps(steps).problem
        e = innovations(made, made.nothing(), made.still(made.map.given()), math.inf)[0]
        predicted.append(np.asarray(made.data.response)[0] - e)
    # After the blow the state goes from sample to sample by its map: two samples give all others.
    free = predicted[0][120:, 0]
    E = scipy.linalg.expm(A / RATE)
    trace, determinant = np.trace(E), np.linalg.det(E)
    np.testing.assert_allclose(
        free[2:], trace * free[1:-1] - determinant * free[:-2], atol=1e-5 * np.max(np.abs(free))
    )
    np.testing.assert_allclose(predicted[0], predicted[1], atol=1e-4 * np.max(np.abs(free)))
    assert len(free) > N // 2


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_other_units_are_refused(factor):
    taken = resolution(factor * struck(lambda d: 0.0))
    with pytest.raises(InputError, match="one system of units"):
        taken.of_model()
