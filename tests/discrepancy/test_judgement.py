"""One of three verdicts, and never one that contradicts its own probabilities."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from iwanjax.discrepancy.judgement import (
    Misfit,
    Verdict,
    cut_short,
    judged,
    stopped,
    together,
    worse,
)
from iwanjax.errors import InputError
from iwanjax.estimation.evidence import AS_LIKELY_WRONG

EVIDENCE = st.floats(-1e6, 1e6)
RATIO = st.one_of(st.floats(0.0, 1e9), st.just(math.inf), st.just(math.nan))
UNIT = st.floats(1e-6, 1.0)
MISFIT = st.builds(Misfit, RATIO, RATIO, st.tuples(UNIT, UNIT))


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
    # Fréchet's bounds, which hold whatever the parts have to do with each other.
    unknown = [each.something_else for each in parts]
    assert max(unknown) - 1e-9 <= whole.something_else <= min(1.0, sum(unknown)) + 1e-9
    assert whole.nothing <= min(each.nothing for each in parts) + 1e-12


def test_one_part_without_a_name_is_not_hidden_by_another_that_has_one():
    """Two modes: coupled beyond doubt, and coupled or else something that nobody tried."""
    coupled = judged(0.0, [30.0], Misfit(9.0, 9.0), Misfit(1.0, 1.0))
    strange = judged(0.0, [30.0], Misfit(9.0, 9.0), Misfit(2.0, 2.0))
    assert coupled.something_else < 1e-9
    assert strange.something_else > 0.5
    whole = together([coupled, strange])
    assert (whole.name, whole.detected) == ("something_missing", True)
    assert whole.something_else == pytest.approx(strange.something_else)
    # Of independent parts either may be the one.
    both = together([strange, strange])
    assert both.something_else == pytest.approx(1.0 - (1.0 - strange.something_else) ** 2)
    assert together([coupled]).something_else == coupled.something_else


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
        # So few values that evidence alone stays with nothing, whose misfit refutes it.
        ([-6.0], (2.2, 3.0), (1.0, 1.0), "something_missing", True),
        ([-6.0], (2.2, 3.0), (2.0, 2.8), "undecided", True),
        # Little evidence of something small.
        ([0.0], (1.1, 1.0), (1.0, 1.0), "undecided", False),
    ],
)
def test_what_the_verdict_is(candidates, before, after, name, detected):
    after = None if after is None else Misfit(*after)
    found = judged(0.0, candidates, Misfit(*before), after)
    assert (found.name, found.detected) == (name, detected)


NOTHING, RIGHT, FAR = (1.0, 1.0), (1.2, 1.1), (50.0, 40.0)
"""Misfits of a model that is right, of one that is nearly, and of one that is not."""


@pytest.mark.parametrize(
    ("gain", "before", "after", "floor", "name"),
    [
        # No evidence: the model stands while its misfit is that of noise, and falls with it.
        (-20.0, NOTHING, NOTHING, 0.01, "nothing_missing"),
        (-20.0, RIGHT, RIGHT, 0.01, "nothing_missing"),
        (-20.0, FAR, FAR, 0.01, "undecided"),
        (-20.0, (1.0, 50.0), (1.0, 50.0), 0.01, "undecided"),
        # Evidence, and all is explained.
        (20.0, FAR, NOTHING, 0.01, "something_missing"),
        (20.0, RIGHT, NOTHING, 0.01, "something_missing"),
        # Evidence, and much is left: half, a fifth; a twentieth is no more than models are off by.
        (20.0, FAR, (25.0, 20.0), 0.01, "undecided"),
        (20.0, FAR, (10.0, 8.0), 0.01, "undecided"),
        (20.0, FAR, (2.5, 2.0), 0.01, "something_missing"),
        # Evidence, but what was held out is predicted worse: refused, and the model as it was.
        (20.0, (50.0, 40.0), (1.0, 41.0), 0.01, "undecided"),
        # Neither: what is there is too small for a name, and for doubt.
        (0.0, RIGHT, NOTHING, 0.01, "undecided"),
        # One in e times likelier than nothing has most of the probability.
        (1.0, (3.0, 3.0), NOTHING, 0.01, "something_missing"),
    ],
)
def test_before_after_and_floor_give_a_verdict(gain, before, after, floor, name):
    """Refused where it predicts worse than without; else judged by evidence and what it leaves."""
    held = [x * floor for x in (before[1], after[1])]
    if worse(*held, 1.05 * floor):
        found = judged(0.0, [], Misfit(*before))
    else:
        found = judged(0.0, [gain], Misfit(*before), Misfit(*after))
    assert found.name == name
    unknown = name == "undecided" and max(before) > 1.6
    assert found.detected == (name == "something_missing" or unknown)


def doubt(before: tuple[float, float], after: tuple[float, float]) -> float:
    """Probability that a correction with all the evidence is not what is missing."""
    return judged(0.0, [1e6], Misfit(*before), Misfit(*after)).something_else


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        # Sixteen to one: half of the share at which a law is as likely a neighbour of the truth.
        ((100.0, math.nan), (math.sqrt(1.0 + 0.05**2 * 9999.0), math.nan), 1.0 / 17.0),
        ((100.0, math.nan), (math.sqrt(1.0 + 0.1**2 * 9999.0), math.nan), 0.5),
        ((100.0, math.nan), (math.sqrt(1.0 + 0.2**2 * 9999.0), math.nan), 16.0 / 17.0),
        # The same of what was held out alone, and of both.
        ((math.nan, 100.0), (math.nan, math.sqrt(1.0 + 0.1**2 * 9999.0)), 0.5),
        ((100.0, 100.0), (math.sqrt(1.0 + 0.1**2 * 2 * 9999.0), 1.0), 0.5),
        # Within the noise nothing is left, however much there was.
        ((1.1, 1.1), (1.0, 1.0), 0.0),
        ((1e6, 1e6), (0.9, 1.0), 0.0),
        # What leaves more than there was, or diverges, explains nothing.
        ((50.0, 50.0), (math.inf, 50.0), 1.0),
        ((math.inf, math.inf), (math.inf, math.inf), 1.0),
    ],
)
def test_a_correction_is_doubted_by_the_share_that_it_leaves(before, after, expected):
    assert doubt(before, after) == pytest.approx(expected, abs=1e-9)


def test_what_a_law_leaves_open_of_its_parameters_is_no_credit_to_it():
    """An oscillator taken for a mass and a spring, whose sizes the fit leaves open: what is held
    out is two of their deviations off, and 30 % of what it was, of noise 53 times."""
    before = Misfit(191.0, 169.0, (3.1e-3, 4.2e-3))
    known = Misfit(26.4, 50.2, (3.1e-3, 4.2e-3))
    opened = Misfit(26.4, 1.96, (3.1e-3, 0.108))
    named = [judged(0.0, [1e6], before, after).something_else for after in (known, opened)]
    assert min(named) > 0.9
    # A little less, as what parameters leave open may be all that is wrong of what is held out.
    assert named[1] == pytest.approx(named[0], abs=0.03)


def test_fitted_and_held_out_recordings_are_doubted_together():
    """A cubic spring in Silverbox: by the worse half alone it would be as likely wrong as right."""
    before, after = (78.0, 33.0), (7.8, 2.3)
    assert judged(0.0, [50.0], Misfit(*before), Misfit(*after)).name == "something_missing"
    halves = [doubt((b, math.nan), (a, math.nan)) for b, a in zip(before, after, strict=True)]
    together = doubt(before, after)
    assert min(halves) < together < 0.5 - 0.02
    # Squares beyond the noise, of both: 64.1 of 7171.
    share = math.sqrt((7.8**2 + 2.3**2 - 2.0) / (78.0**2 + 33.0**2 - 2.0))
    assert together == pytest.approx(share**4 / (share**4 + 1e-4))


def test_little_beyond_the_noise_is_little_doubt_whatever_share_it_is():
    """1.3 of 1.4 times the noise: nearly all is left, and next to nothing is there."""
    found = doubt((1.4, 1.4), (1.3, 1.0))
    assert found == pytest.approx(1.0 / (1.0 + 2.0**1.8))


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


@given(EVIDENCE, st.lists(EVIDENCE, min_size=1, max_size=6), MISFIT, MISFIT)
def test_what_was_not_tried_is_as_likely_as_names_that_leave_more_than_noise(
    nothing, candidates, before, after
):
    tried = judged(nothing, sorted(candidates, reverse=True), before, after)
    verdict = cut_short(tried, after)
    assert verdict.nothing == tried.nothing
    if after.largest > AS_LIKELY_WRONG:
        assert verdict.named == tuple(0.5 * each for each in tried.named)
        assert not verdict.found
    else:
        assert verdict is tried


@given(st.floats(1.0, 100.0), st.booleans())
def test_a_search_that_is_stopped_early_tells_no_more_than_that_all_is_well(misfit, fitted):
    by_misfit = judged(0.0, [], Misfit(misfit, math.nan))
    verdict = stopped(by_misfit, fitted)
    if fitted or not by_misfit.detected:
        assert verdict is by_misfit
    else:
        assert verdict.name == "undecided"
        assert verdict.untold
        assert verdict.nothing == 0.5
        # That the misfit is well above the noise is said all the same.
        assert verdict.detected
