"""One of three verdicts, and never one that contradicts its own probabilities."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from iwanjax.discrepancy.judgement import Misfit, Verdict, judged, together, worse
from iwanjax.errors import InputError

EVIDENCE = st.floats(-1e6, 1e6)
RATIO = st.one_of(st.floats(0.0, 1e9), st.just(math.inf), st.just(math.nan))
MISFIT = st.builds(Misfit, RATIO, RATIO)


@given(EVIDENCE, st.lists(EVIDENCE, max_size=6), MISFIT, st.none() | MISFIT)
def test_no_evidence_and_no_misfit_gives_a_verdict_that_contradicts_itself(
    nothing, candidates, before, after
):
    candidates = sorted(candidates, reverse=True)
    found = judged(nothing, candidates, before, after)
    every = (found.nothing, found.something_else, *found.named)
    assert all(0.0 <= each <= 1.0 for each in every)
    assert sum(every) == pytest.approx(1.0)
    assert len(found.named) == len(candidates)
    if found.name == "nothing_missing":
        assert found.nothing > 0.5
        assert not found.detected
        assert before.largest < 1.6
    elif found.name == "something_missing":
        assert found.detected
        assert found.nothing <= found.named[0] == max(found.named)
        assert found.something_else < 0.5
    else:
        assert found.nothing <= 0.5
        assert found.detected == (before.largest > 1.6)


@given(st.lists(st.builds(judged, EVIDENCE, st.lists(EVIDENCE, max_size=1), MISFIT), min_size=1))
def test_the_verdict_on_several_parts_agrees_with_theirs(parts):
    whole = together(parts)
    assert whole.detected == any(each.detected for each in parts)
    assert (whole.nothing > 0.5) == (whole.name == "nothing_missing")
    assert (whole.name == "something_missing") == any(each.found for each in parts)
    assert whole.nothing + whole.something_else <= 1.0 + 1e-9
    if whole.name == "something_missing":
        assert whole.something_else < 0.5


@given(EVIDENCE, st.floats(1.7, 1e6), st.floats(1.0, 10.0))
def test_a_worse_fit_does_not_raise_the_bar_for_its_own_detection(nothing, misfit, times):
    """Whatever evidence says of what was tried: a model far off is not all there is."""
    candidates = [nothing - 50.0]
    near, far = (judged(nothing, candidates, Misfit(x, 1.0)) for x in (misfit, times * misfit))
    assert near.detected
    assert far.detected
    assert far.nothing <= near.nothing + 1e-12


@pytest.mark.parametrize(
    ("candidates", "before", "after", "name", "detected"),
    [
        ([], (1.0, 1.0), None, "nothing_missing", False),
        ([-50.0], (1.02, 0.9), None, "nothing_missing", False),
        # Nothing that was tried explains a model that is 50 times the noise off.
        ([-50.0], (50.0, 60.0), None, "undecided", True),
        ([], (50.0, math.nan), None, "undecided", True),
        # Fitted recordings show nothing, those held out do.
        ([-50.0], (1.0, 100.0), None, "undecided", True),
        ([50.0], (9.0, 9.0), (1.0, 1.0), "something_missing", True),
        # What it leaves is 20 times the noise, but a tenth of what there was.
        ([50.0], (200.0, 200.0), (20.0, 20.0), "something_missing", True),
        ([50.0], (200.0, 200.0), (150.0, 150.0), "undecided", True),
        ([50.0], (200.0, 200.0), (2.0, 150.0), "undecided", True),
        # Little evidence of something small.
        ([0.0], (1.1, 1.0), (1.0, 1.0), "undecided", False),
    ],
)
def test_what_the_verdict_is(candidates, before, after, name, detected):
    after = None if after is None else Misfit(*after)
    found = judged(0.0, candidates, Misfit(*before), after)
    assert (found.name, found.detected) == (name, detected)


GOOD = judged(0.0, [20.0], Misfit(9.0, 9.0), Misfit(1.0, 1.0))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"name": "nothing_missing", "detected": False}, "expected something_missing"),
        ({"detected": False}, "detected is False"),
        ({"nothing": 1.0}, "add up to"),
        ({"nothing": -1.0, "something_else": 1.0}, "expected 0 to 1"),
        ({"named": (0.2, 0.8), "nothing": 0.0, "something_else": 0.0}, "not in order"),
    ],
)
def test_a_contradiction_is_refused(changed, message):
    with pytest.raises(InputError, match=message):
        replace(GOOD, **changed)


def test_nothing_missing_is_refused_far_from_the_noise():
    with pytest.raises(InputError, match="times the noise off"):
        Verdict("nothing_missing", False, 1.0, 0.0, (), 3.0)


@pytest.mark.parametrize(
    ("before", "after", "refused"),
    [
        (0.16, 0.53, True),
        (1.24, 28559.0, True),
        (1.24, math.inf, True),
        (1.24, math.nan, True),
        (0.28, 0.031, False),
        # Both to within the noise: chance.
        (0.0100, 0.0101, False),
        (math.nan, math.nan, False),
    ],
)
def test_a_correction_that_predicts_worse_is_refused(before, after, refused):
    assert worse(before, after, 0.0105) == refused
