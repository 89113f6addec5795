"""Blocks of places against least squares by brute force, their evidence against a Gaussian's."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
import scipy.stats
from linear_pair import JOINT, NAMES, ROWS, C, K, measured_force, problem, simulated

from iwanjax.discrepancy.findings import PlaceEvidence
from iwanjax.discrepancy.histories.place_test import (
    Block,
    Remaining,
    beyond_linear,
    like_no_linear_error,
    log_evidence,
    more_there,
    places_by_evidence,
    with_verdict,
)
from iwanjax.discrepancy.histories.score_test import (
    excluded,
    places_of,
    score_test,
    where_something_acts,
)
from iwanjax.effects.catalogue import CATALOGUE, kinds_in_time
from iwanjax.effects.kinds import Kind
from iwanjax.identification.columns import columns, columns_at_rest, unit_effects
from iwanjax.identification.likelihood import evidence
from iwanjax.identification.linearise import linearise
from iwanjax.identification.multistart import HypothesisFit, multistart
from iwanjax.identification.places import Place
from iwanjax.identification.problem import HistoryProblem, Start

HITS = ((60.0, 0), (25.0, 1))
NOISE = np.array([0.3, 0.2])


def lacking(stiffness: float, damping: float, where: str):
    """Two masses that lack a spring and a damper at one place: no kind alone is both."""
    random, more = np.random.default_rng(3), np.outer(ROWS[where], ROWS[where])
    inside = K + JOINT * np.outer(ROWS["J1"], ROWS["J1"]) + stiffness * more
    seen = [
        y + NOISE * random.standard_normal(y.shape)
        for peak, struck in HITS
        for y in [simulated(peak, struck=struck, stiffness=inside, damping=C + damping * more)]
    ]
    made, places = problem(seen, [measured_force(*hit) for hit in HITS], NOISE, names=NAMES)
    (base,) = multistart(made, [Start(made.nothing(), made.map.given())], math.inf, 12)
    return made, places, base


@pytest.fixture(scope="module")
def pair():
    return lacking(200.0, 0.5, "m2")


def explained(made: HistoryProblem, base: HypothesisFit) -> tuple[np.ndarray, np.ndarray]:
    """What is fitted, column by column with its prior's row, and the residual with its prior's."""
    (seen,) = linearise(made, [(base.hypothesis, base.theta)], base.time_constant)
    slopes = np.asarray(seen.slopes)
    recordings, p, values = len(slopes), made.parameters, base.values
    rows = [slopes[:, i].ravel() for i in range(p)]
    for r in range(recordings):
        for i in range(values, slopes.shape[1]):
            own = np.zeros_like(slopes[:, i])
            own[r] = slopes[r, i]
            rows.append(own.ravel())
    whole = np.hstack([np.array(rows), np.eye(len(rows))]).T
    states = base.theta[:, values:].ravel()
    return whole, np.concatenate([base.residual.ravel(), base.theta[0, :p], states])


def least(A: np.ndarray, b: np.ndarray) -> float:
    """Squared residual of least squares, of columns of one size."""
    A = A / np.linalg.norm(A, axis=0)
    return float(np.sum((b - A @ np.linalg.lstsq(A, b, rcond=1e-12)[0]) ** 2))


@pytest.mark.parametrize("moving", [True, False])
def test_a_block_takes_what_least_squares_with_all_its_columns_take(pair, moving):
    made, places, base = pair
    A, b = explained(made, base)
    Q, _ = np.linalg.qr(A)
    remaining = Remaining(Q, b - Q @ (Q.T @ b))
    assert remaining.square == pytest.approx(least(A, b))
    for place in places:
        units = unit_effects(made, base, made.predictor.kinds, [place])
        if moving:
            h = columns(made, base, units).reshape(len(units), -1)
        else:
            ((which, h),) = columns_at_rest(made, base, units)
            assert list(which) == list(range(len(units)))
        block = remaining.seen(h).block()
        beside = np.hstack([A, np.vstack([h.T, np.zeros((len(A) - h.shape[1], len(h)))])])
        taken = remaining.square - least(beside, b)
        assert block.reduction == pytest.approx(taken, rel=1e-3, abs=1e-3)
        rank = np.linalg.matrix_rank(beside / np.linalg.norm(beside, axis=0), 1e-7)
        assert len(block.taken) <= rank - A.shape[1] + 1


def test_what_other_laws_take_is_beyond_errors_of_the_linear_model_anywhere(pair):
    """By least squares with all kinds' columns, of which the problem itself has but a few."""
    made, places, base = pair
    own = made.of_kinds(kinds_in_time())
    (again,) = multistart(own, [Start(own.nothing(), base.theta)], math.inf, 0)
    A, b = explained(own, again)

    def beside(A: np.ndarray, kinds: list[Kind], places: Sequence[Place]) -> np.ndarray:
        units = unit_effects(own, again, kinds, places)
        h = columns(own, again, units).reshape(len(units), -1)
        return np.hstack([A, np.vstack([h.T, np.zeros((len(A) - h.shape[1], len(h)))])])

    kinds = own.predictor.kinds
    assert {k.name for k in kinds if k.linear} == {
        "stiffness_error",
        "viscous_damping",
        "mass_error",
    }
    linear = beside(A, [k for k in kinds if k.linear], places)
    left = beyond_linear(made, base, places).square
    assert left == pytest.approx(least(linear, b), rel=1e-4)
    # What is missing is a spring and a damper: nothing does more than these.
    assert left < 0.1 * base.cost
    # Twelve nats of evidence are asked beside them.
    known = evidence(made, [base])
    gain = 2.0 * 12.0 * known.temperature * known.tau
    for share, more in ((1.01, True), (0.99, False)):
        assert like_no_linear_error(made, base, places, left - share * gain) is more
    for place in places:
        whole = beside(linear, [k for k in kinds if not k.linear], [place])
        taken = least(linear, b) - least(whole, b)
        more = more_there(made, base, place, places).reduction
        assert more == pytest.approx(taken, rel=1e-2, abs=1e-2)
        # What is missing is a spring and a damper.
        assert taken < 0.01 * base.cost


def test_the_evidence_is_that_of_gaussian_coefficients():
    """Against the density of the residual itself, whose covariance is the noise's and theirs."""
    random, unit = np.random.default_rng(0), 1.7
    H = random.standard_normal((30, 5)) * [1.0, 10.0, 0.1, 3.0, 1.0]
    H[:, 4] = H[:, 0] + 0.1 * H[:, 1]
    e = H @ random.standard_normal(5) + math.sqrt(unit) * random.standard_normal(30)
    free = np.zeros((30, 0))
    block = Remaining(free, e).seen(H.T).block()
    assert len(block.strength) == 4
    assert block.strength.sum() == pytest.approx(5.0)
    total, worth = float(e @ e), []
    nothing = scipy.stats.multivariate_normal(cov=unit * np.eye(30)).logpdf(e)
    prior = 1.0
    while prior <= total / unit:
        spread = prior * unit * (H / np.sum(H**2, axis=0)) @ H.T
        own = scipy.stats.multivariate_normal(cov=unit * np.eye(30) + spread)
        worth.append(own.logpdf(e) - nothing)
        prior *= 2.0
    expected = np.log(np.mean(np.exp(np.array(worth) - max(worth)))) + max(worth)
    assert log_evidence(block, unit, total) == pytest.approx(expected, rel=1e-9)


def test_columns_that_noise_explains_speak_against_a_place():
    """Of noise alone each direction takes one unit off: odds of 3 to 1 come up once in three."""
    random = np.random.default_rng(1)
    worth = []
    for _ in range(300):
        e = random.standard_normal(400)
        block = Remaining(np.zeros((400, 0)), e).seen(random.standard_normal((12, 400))).block()
        worth.append(log_evidence(block, 1.0, float(e @ e)))
    # Of any Bayes factor, by Markov's inequality.
    assert np.mean(np.array(worth) > math.log(3.0)) <= 1.0 / 3.0
    assert np.mean(worth) < -1.0


def test_the_place_of_two_laws_comes_first_by_all_laws_there(pair):
    made, places, base = pair
    tried = tuple(kind for name in (*NAMES, "sensor_gain") for kind in CATALOGUE[name])
    candidates = score_test(made, base, tried, places, ("a1", "a2"), ("J1",))
    found = places_of(candidates)
    assert found[0].where == "m2"
    assert found[0].probability > 0.95
    # Neither the spring alone nor the damper alone takes what both do.
    alone = max(c.drop for c in candidates if c.place.where == "m2")
    assert found[0].reduction > 1.05 * alone
    assert sum(each.probability for each in found) <= 1.0 + 1e-12
    assert {c.place.where for c in where_something_acts(candidates)} == {"m2"}
    assert excluded([candidates]) == {each.where for each in found} - {"m2"}


def test_where_nothing_is_missing_nothing_acts_anywhere():
    made, places, base = lacking(0.0, 0.0, "m2")
    tried = tuple(kind for name in NAMES for kind in CATALOGUE[name])
    candidates = score_test(made, base, tried, places, ("a1", "a2"), ("J1",))
    assert all(each.probability < 0.01 for each in places_of(candidates))


def test_one_weak_law_does_not_pay_for_all_others_there():
    """Twelve units by one column of sixteen: as a mixture alone they would be lost."""
    random = np.random.default_rng(4)
    strength = np.ones(16)
    taken = random.chisquare(1, 16)
    taken[0] = 45.0
    block = Block(strength, taken)
    (place,) = places_by_evidence({"m1": [block]}, {"m1": list(taken)}, 4000.0, 1.0)
    assert place.log_evidence > log_evidence(block, 1.0, 4000.0) + 1.0
    assert place.probability > 0.5
    assert place.columns == 16


def test_a_verdict_with_a_name_outweighs_blocks_and_one_without_follows_them():
    blocks = (PlaceEvidence("m1", 0.9, 0.8, 16, 20.0), PlaceEvidence("m2", 0.1, 0.7, 16, 17.8))
    shares = np.exp([0.0, -2.2])
    shares /= shares.sum()
    named = with_verdict(blocks, [(("m2",), 0.9), (("m1",), 0.02)], 0.08)
    assert [each.where for each in named] == ["m2", "m1"]
    assert named[0].probability == pytest.approx(0.9 + 0.08 * shares[1])
    assert sum(each.probability for each in named) == pytest.approx(1.0)
    unknown = with_verdict(blocks, [(("m2",), 0.01)], 0.99)
    assert [each.where for each in unknown] == ["m1", "m2"]
    both = with_verdict(blocks, [(("m1", "m2"), 1.0)], 0.0)
    assert [each.probability for each in both] == [1.0, 1.0]
    assert with_verdict((), [(("m1",), 1.0)], 0.0) == ()
