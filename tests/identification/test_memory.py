"""What grows with the samples is held a part at a time, and the results are the same."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from struck_mass import searching, struck

from iwanjax.discrepancy.histories.ranking import TIME_CONSTANT
from iwanjax.discrepancy.histories.score_test import score_test
from iwanjax.identification import kernels
from iwanjax.identification import linearise as linearising
from iwanjax.identification.columns import by_memory
from iwanjax.identification.linearise import linearise, within_memory
from iwanjax.identification.multistart import multistart
from iwanjax.identification.problem import Start
from iwanjax.settings.memory import MemorySettings


@pytest.fixture(scope="module")
def problems():
    """The same search with memory enough, and with next to none."""
    problem, scope = searching(struck(lambda d: 3e10 * d**3))
    none = replace(problem.settings, memory=MemorySettings(derivatives=0, kernels=0))
    return problem, replace(problem, settings=none, compiled=set()), scope


def test_one_direction_at_a_time_and_no_derivatives_kept(problems):
    enough, little, _ = problems
    assert within_memory(little, 4, 8) == (1, 1)
    assert within_memory(enough, 4, 8) == (4, 8)
    points = [(enough.nothing(), enough.still(enough.map.given()))] * 2
    for one, other in zip(
        linearise(enough, points, TIME_CONSTANT),
        linearise(little, points, TIME_CONSTANT, keep=False),
        strict=True,
    ):
        assert other.slopes is None
        for a, b in zip(one[:4], other[:4], strict=True):
            assert_allclose(b, a, rtol=1e-9, atol=1e-12 * np.max(np.abs(a)))


def test_parts_of_the_derivatives_are_no_larger_than_so_many_need(problems, monkeypatch):
    enough, _, _ = problems
    points = [(enough.nothing(), enough.still(enough.map.given()))]
    values = points[0][1].shape[1]
    seen = []

    def slopes(*given):
        seen.append(len(given[4]))
        return kernels_slopes(*given)

    kernels_slopes = kernels.slopes
    monkeypatch.setattr(kernels, "slopes", slopes)
    # Room for all but one of them at once.
    monkeypatch.setattr(linearising, "within_memory", lambda *_: (1, values - 1))
    linearise(enough, points, TIME_CONSTANT)
    assert seen == [math.ceil(values / 2)] * 2


def test_a_search_that_keeps_no_derivatives_ends_in_the_same_place(problems):
    enough, little, _ = problems
    found = []
    for problem in (enough, little):
        start = Start(problem.nothing(), problem.map.given())
        found += multistart(problem, [start], TIME_CONSTANT, 20)
    assert found[1].converged
    assert_allclose(found[1].cost, found[0].cost, rtol=1e-6)
    assert_allclose(found[1].x, found[0].x, atol=1e-3)


def test_places_are_judged_in_groups(problems):
    enough, little, scope = problems
    places = [replace(scope.places[0], label=f"at {i}") for i in range(3)]
    assert len(by_memory(enough, scope.kinds, places)) == 1
    assert [len(group) for group in by_memory(little, scope.kinds, places)] == [1, 1, 1]
    found = []
    for problem in (enough, little):
        start = Start(problem.nothing(), problem.map.given())
        (base,) = multistart(problem, [start], TIME_CONSTANT, 0)
        found.append(score_test(problem, base, scope.kinds, places, ("a1",), ()))
    best = [{c.start.hypothesis.label: c.drop for c in each} for each in found]
    assert set(best[0]) == set(best[1])
    first = found[0][0].start.hypothesis.label
    assert_allclose(best[1][first], best[0][first], rtol=1e-6)
