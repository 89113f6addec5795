"""Deviations of curves' parameters hold where their errors are correlated along a curve."""

import numpy as np
import pytest
from scipy.signal import lfilter

from iwanjax.correlation import correlation_time
from iwanjax.estimation.evidence import linearised

LEVELS, DRAWS, SHARE = 60, 300, 0.6


@pytest.mark.parametrize("misfit", [1.0, 5.0])
def test_the_truth_lies_within_two_deviations_of_a_straight_line(misfit):
    """An error of correlation time 4 levels, ``misfit`` times as large as stated."""
    random = np.random.default_rng(4)
    X = np.column_stack([np.ones(LEVELS), np.linspace(-1.0, 1.0, LEVELS)])
    white = random.standard_normal((DRAWS, 200 + LEVELS))
    errors = misfit * np.sqrt(1.0 - SHARE**2) * lfilter([1.0], [1.0, -SHARE], white)[:, 200:]
    within = {"correlated": 0, "white": 0}
    for e in errors:
        off = np.linalg.lstsq(X, e, rcond=None)[0]
        left = e - X @ off
        tau = correlation_time(left[None, :, None])
        for name, taken in (("correlated", tau), ("white", 1.0)):
            within[name] += int(np.sum(np.abs(off) < 2.0 * linearised(X, left @ left, taken)))
    assert within["correlated"] > 0.85 * 2 * DRAWS
    # As if each level said something new.
    assert within["white"] < 0.75 * 2 * DRAWS


def test_what_is_seen_only_together_is_not_known():
    # Strength and spread of a joint that never slips altogether: a pseudo-inverse takes the
    # direction that nothing is seen of as known, and said F_S = 55.3 +- 0.1 where the truth was 40.
    rng = np.random.default_rng(4)
    X = rng.standard_normal((40, 3))
    X = np.column_stack([X, 2.0 * X[:, 0] - X[:, 1]])
    std = linearised(X, 40.0, 1.0)
    assert np.all(np.isposinf(std[[0, 1, 3]]))
    alone = linearised(X[:, :3], 40.0, 1.0)
    assert std[2] == pytest.approx(alone[2], rel=0.05)
    assert np.all(np.isfinite(alone))
