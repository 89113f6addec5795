"""Sizes that are found and named, against draws of the evidence itself."""

import numpy as np
import pytest

from iwanjax.estimation.evidence import LEAST_GAIN
from iwanjax.planning.information import RecordingInformation, fisher
from iwanjax.planning.power import POWER, found_from, told_apart_from

RNG = np.random.default_rng(7)
DRAWS, UNIT, NONE = 40_000, 1.7, np.zeros((2, 2), bool)


def drops(columns: np.ndarray, e: np.ndarray) -> np.ndarray:
    """What a column alone takes off squared residuals, (draws,)."""
    return (e @ columns) ** 2 / (columns @ columns)


@pytest.mark.parametrize("unknowns", [1, 2])
def test_nine_of_ten_are_found_from_the_size_that_is_said(unknowns):
    h = RNG.standard_normal(30)
    (size,) = found_from(np.array([h @ h]), np.array([unknowns]), UNIT, 3000.0)
    e = size * h + np.sqrt(UNIT) * RNG.standard_normal((DRAWS, 30))
    spent = 0.5 * unknowns * np.log(3000.0) + LEAST_GAIN + 0.06 * 3000.0 / 2.0
    shares = [np.mean(drops(h, e - less * h) / (2.0 * UNIT) > spent) for less in (0.0, size / 2)]
    assert shares[0] == pytest.approx(POWER, abs=0.01)
    assert shares[1] < 0.02


@pytest.mark.parametrize("unknowns", [(1, 1), (2, 1), (1, 2)])
def test_nine_of_ten_are_told_from_a_rival_from_the_size_that_is_said(unknowns):
    own = RNG.standard_normal(30)
    rival = own + 0.4 * RNG.standard_normal(30)
    both = np.stack([own, rival])
    count, k = 500.0, np.array(unknowns)
    size = told_apart_from(both @ both.T, k, UNIT, count, NONE)[0, 1]
    if size == 0.0:
        assert unknowns == (1, 2)
        return
    e = size * own + np.sqrt(UNIT) * RNG.standard_normal((DRAWS, 30))
    ahead = (drops(own, e) - drops(rival, e)) / (2.0 * UNIT)
    ahead -= 0.5 * (k[0] - k[1]) * np.log(count)
    assert np.mean(ahead > 0.0) == pytest.approx(POWER, abs=0.01)
    # A limit of the effect's own explains as well, but for errors of the model.
    stricter = told_apart_from(both @ both.T, k, UNIT, count, ~NONE)[0, 1]
    e = stricter * own + np.sqrt(UNIT) * RNG.standard_normal((DRAWS, 30))
    ahead = (drops(own, e) - drops(rival, e)) / (2.0 * UNIT)
    ahead -= 0.5 * (k[0] - k[1]) * np.log(count) + 0.06 * count / 2.0
    assert np.mean(ahead > 0.0) == pytest.approx(POWER, abs=0.01)


def test_what_others_do_as_well_is_never_told_apart():
    h = RNG.standard_normal(30)
    both = np.stack([h, 3.0 * h, np.zeros(30)])
    size = told_apart_from(both @ both.T, np.ones(3), UNIT, 500.0, np.zeros((3, 3), bool))
    assert size[0, 1] == size[1, 0] == np.inf
    assert found_from(np.diag(both @ both.T), np.ones(3), UNIT, 500.0)[2] == np.inf


def test_information_is_that_of_least_squares_with_everything_refitted():
    """Of two recordings with states of their own, against one QR of all columns and priors."""
    shared, effects, states, N, sensors = 2, 3, 2, 40, 2
    whole = RNG.standard_normal((2, shared + effects + states, sensors, N))
    parts = [
        RecordingInformation(
            np.einsum("vsn,wsn->svw", own, own), shared, states, np.full(sensors, N)
        )
        for own in whole
    ]
    found = fisher([part.of([0, 1]) for part in parts], shared)
    fitted = np.zeros((2 * sensors * N + shared + 2 * states, shared + 2 * states))
    acting = np.zeros((len(fitted), effects))
    for r, own in enumerate(whole.reshape(2, -1, sensors * N)):
        at = slice(r * sensors * N, (r + 1) * sensors * N)
        fitted[at, :shared] = own[:shared].T
        fitted[at, shared + r * states : shared + (r + 1) * states] = own[shared + effects :].T
        acting[at] = own[shared : shared + effects].T
    fitted[2 * sensors * N :] = np.eye(shared + 2 * states)
    Q, _ = np.linalg.qr(fitted)
    left = acting - Q @ (Q.T @ acting)
    np.testing.assert_allclose(found, left.T @ left, rtol=1e-10)
    some = fisher([part.among([2, 0]).of([1]) for part in parts], shared)
    only = fisher(
        [RecordingInformation(p.products[1:], shared, states, p.samples).of([0]) for p in parts],
        shared,
    )
    np.testing.assert_allclose(some, only[np.ix_([2, 0], [2, 0])], rtol=1e-10)
