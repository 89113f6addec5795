"""Probabilities of hypotheses against a posterior worked out by hand, from costs and numbers."""

import math

import numpy as np
import pytest
from test_ranking import SEARCH, WHITE, N, entry

from iwanjax.correlation import correlation_time
from iwanjax.discrepancy.histories.ranking import RankedFit, missing, ranked
from iwanjax.discrepancy.judgement import Misfit, judged

TAU = correlation_time(WHITE)
# Of a fit to the noise; of nothing, far from it: which of the others it is decides.
GOOD, FAR = 0.9, 30.0
RIGHT = Misfit(1.0, 1.0)


def posterior(base: RankedFit, entries: list[RankedFit]) -> dict[str, float]:
    """As a diagnosis tells it: of each label, and of nothing."""
    base, entries = ranked(base, entries)
    found = judged(base.behind, [e.behind for e in entries], RIGHT)
    labels = [e.fitted.hypothesis.label for e in entries]
    return {"nothing": found.nothing, **dict(zip(labels, found.named, strict=True))}


def by_hand(odds: dict[str, float]) -> dict[str, float]:
    """Log odds as probabilities."""
    highest = max(odds.values())
    whole = sum(math.exp(x - highest) for x in odds.values())
    return {label: math.exp(x - highest) / whole for label, x in odds.items()}


def check(found: dict[str, float], odds: dict[str, float]) -> None:
    expected = by_hand(odds)
    assert found.keys() == expected.keys()
    for label, probability in expected.items():
        assert found[label] == pytest.approx(probability, rel=1e-6, abs=1e-12)


def test_of_equal_costs_and_numbers_all_are_equally_likely():
    labels = ["mass_error@a", "stiffness_error@b", "viscous_damping@c"]
    found = posterior(entry(FAR), [entry(GOOD, label) for label in labels])
    check(found, {"nothing": -math.inf, **dict.fromkeys(labels, 0.0)})


def test_of_equal_costs_each_value_more_costs_its_share():
    """Half the logarithm of the independent values: a joint has five values here, mass one."""
    found = posterior(entry(FAR), [entry(GOOD, "mass_error@a"), entry(GOOD, "iwan_joint@b")])
    lost = 0.5 * 4 * math.log(N / TAU)
    check(found, {"nothing": -math.inf, "mass_error@a": 0.0, "iwan_joint@b": -lost})


@pytest.mark.parametrize("more", [0.5, 4.0, 12.0])
def test_of_equal_numbers_squares_decide(more):
    """A fall of the sum of squares over twice what noise leaves, in independent values."""
    costs = GOOD, GOOD + more / N
    found = posterior(
        entry(FAR), [entry(costs[0], "mass_error@a"), entry(costs[1], "stiffness_error@b")]
    )
    lost = more / (2.0 * GOOD * TAU)
    check(found, {"nothing": -math.inf, "mass_error@a": 0.0, "stiffness_error@b": -lost})


@pytest.mark.parametrize("gain", [-3.0, 0.0, 3.0, 11.9, 12.1])
def test_nothing_is_granted_what_a_models_own_errors_are_worth(gain):
    """6 % of its squares; and before the data it is likelier, by 12 of log odds.

    With S squares without mass, and T N with it, the evidence for mass is larger by
    (S - 0.06 S - T N) / (2 T tau) - ln(N / tau) / 2: solved here for T.
    """
    spent = 0.5 * math.log(N / TAU)
    left = 0.94 * GOOD * N / (N + 2.0 * TAU * (gain + spent))
    base, (best,) = ranked(entry(GOOD), [entry(left, "mass_error@a")])
    assert best.behind - base.behind == pytest.approx(gain, abs=1e-9)
    assert missing(base, best) == (gain > 12.0)


@pytest.mark.parametrize("gain", [-2.0, -0.5, 0.5])
@pytest.mark.parametrize("place", ["a", "b"])
def test_a_law_that_contains_another_has_to_be_better_by_what_errors_are_worth(gain, place):
    """A joint has a slider for a limit: it owes 6 % of its squares, until it is ahead by them.

    At another place it is not the same, and owes nothing. With T N squares of the joint the slider
    has as many more as its four values, these 6 %, and ``gain`` are worth.
    """
    left, spent, owed = 0.5, 4 * 0.5 * math.log(N / TAU), 0.06 * N / (2.0 * TAU)
    slider = left * (1.0 + 2.0 * TAU * (spent + owed + gain) / N)
    entries = [entry(slider, "coulomb_friction@a"), entry(left, f"iwan_joint@{place}")]
    _, found = ranked(entry(FAR), entries)
    behind = {e.fitted.hypothesis.label: e.behind for e in found}
    expected = gain if place == "a" and gain < 0.0 else gain + owed
    ahead = behind[f"iwan_joint@{place}"] - behind["coulomb_friction@a"]
    assert ahead == pytest.approx(expected, abs=1e-9)


def test_a_poor_fit_tells_rivals_apart_less():
    """The same fall in squares where the best leaves four times the noise: a quarter as loud."""
    fall, odds = 6.0, []
    for level in (1.0, 4.0):
        found = posterior(
            entry(100.0),
            [entry(level, "mass_error@a"), entry(level + fall / N, "stiffness_error@b")],
        )
        odds.append(math.log(found["mass_error@a"] / found["stiffness_error@b"]))
    assert odds[0] == pytest.approx(fall / (2.0 * TAU))
    assert odds[1] == pytest.approx(odds[0] / 4.0)


def test_a_fit_better_than_the_noise_is_not_believed():
    """Below 0.3 of the noise's squares no residual is trusted: odds do not grow any more."""
    fall, odds = 2.0, []
    for level in (0.3, 0.1):
        found = posterior(
            entry(100.0),
            [entry(level, "mass_error@a"), entry(level + fall / N, "stiffness_error@b")],
        )
        odds.append(math.log(found["mass_error@a"] / found["stiffness_error@b"]))
    np.testing.assert_allclose(odds, fall / (2.0 * 0.3 * TAU), rtol=1e-6)
    assert SEARCH.data.weight.size == N
