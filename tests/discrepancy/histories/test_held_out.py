from types import SimpleNamespace

import numpy as np
import pytest

from iwanjax.discrepancy.histories.validation import FreeRun, joined, zeros_off
from iwanjax.identification.free_values import elapsed, rates
from iwanjax.identification.multistart import laid_out
from iwanjax.identification.suspects import ParameterMap
from iwanjax.settings.histories import HISTORIES

RNG = np.random.default_rng(3)


def run(noise: list[float], scatter: list[float]) -> FreeRun:
    """Of a measured root mean square of one over 50 samples of two sensors."""
    count = len(noise)
    blank = np.zeros((count, 50, 2))
    names = tuple(f"rec{i}" for i in range(count))
    return FreeRun(
        names,
        blank,
        blank + 1.0,
        np.array(noise),
        np.array(scatter),
        np.zeros(count),
        np.zeros((count, 1)),
    )


def test_without_scatter_a_perfect_model_leaves_its_floor():
    found = run([1.0, 4.0], [0.0, 0.0])
    assert found.floor_95 == pytest.approx(found.floor)
    assert found.floors_95() == pytest.approx(found.floors())
    assert found.floors()["rec1"] == pytest.approx(0.2)


@pytest.mark.parametrize("ways", [[1.0], [1.0, 0.3], [2.0, 2.0, 2.0, 1.0, 0.1]])
def test_noise_that_goes_a_few_ways_leaves_more_in_one_case_of_twenty(ways):
    squares = np.array(ways)
    draws = 0.5 + RNG.standard_normal((200_000, len(ways))) ** 2 @ squares
    found = run([0.5 + squares.sum()], [2.0 * np.sum(squares**2)])
    assert found.floor_95**2 * 100 == pytest.approx(np.quantile(draws, 0.95), rel=0.05)


def test_over_several_recordings_it_averages_out():
    one, several = run([1.0], [2.0]), run([1.0] * 6, [2.0] * 6)
    assert one.floors_95()["rec0"] == pytest.approx(several.floors_95()["rec5"])
    assert several.floor_95 < 0.8 * one.floor_95
    assert joined([one, several]).floor_95 < several.floor_95


@pytest.mark.parametrize("broken", [np.nan, np.inf, 1e200])
def test_a_prediction_that_has_left_the_numbers_is_infinitely_far_off(broken):
    good = run([1.0, 4.0], [0.0, 0.0])
    error = good.error.copy()
    error[1, 3] = broken
    found = good._replace(error=error)
    assert found.relative == np.inf
    assert found.by_recording() == {"rec0": 0.0, "rec1": np.inf}


def test_a_constant_that_is_most_of_what_is_left_is_told():
    """Of one sensor in one recording; those filled up or broken down show none."""
    found = run([1.0, 1.0, 1.0], [0.0] * 3)
    error = 0.1 * RNG.standard_normal(found.error.shape)
    error[1, :, 1] += 0.2
    error[2, 4] = np.inf
    measured = found.measured.copy()
    # A shorter recording, filled up: its constant counts over its own samples.
    error[1, 30:], measured[1, 30:] = 0.0, 0.0
    (said,) = zeros_off(found._replace(error=error, measured=measured), ("a", "b"))
    assert said.startswith("b is off by a constant")
    assert f"(rec1 {error[1, :30, 1].mean():+.2g})" in said
    assert "response: {offset: mean}" in said


@pytest.fixture
def loosening(monkeypatch):
    """A joint of four parameters whose F_S and K_T drift over recordings 0, 1 and 3 of a study."""
    hypothesis = SimpleNamespace(drifting=0, sizes=(False,), shapes=(False,))
    parameters = [SimpleNamespace(name=name) for name in ("F_S", "K_T", "chi", "beta")]
    joint = SimpleNamespace(
        given=SimpleNamespace(parameters=parameters), least=np.full(len(parameters), -np.inf)
    )
    problem = SimpleNamespace(
        parameters=4,
        predictor=SimpleNamespace(errors=0),
        settings=HISTORIES,
        map=ParameterMap(4),
        recordings=3,
        directions=6,
        order=(0, 1, 3),
        joints=(joint,),
    )
    return hypothesis, problem


def test_a_drift_goes_on_in_line(loosening):
    hypothesis, problem = loosening
    theta = np.zeros((3, 6))
    theta[:, 0] = 0.4, 0.2, -0.2
    theta[:, 1] = 0.3, 0.25, 0.25
    layout, x = laid_out(problem, SimpleNamespace(hypothesis=hypothesis, theta=theta))
    np.testing.assert_allclose((layout.base + layout.T @ x)[:, :6], theta, atol=1e-12)
    of_strength, of_stiffness = rates(problem, hypothesis)
    assert x[of_strength] == pytest.approx(-0.6)
    assert x[of_stiffness] == pytest.approx(-0.05)
    # An even change costs less than the same one all at once.
    off_the_line = layout.precision * x**2
    np.testing.assert_allclose(off_the_line[of_strength + 1 : of_strength + 3], 0.0, atol=1e-12)
    assert off_the_line[of_stiffness + 1] > off_the_line[of_stiffness]
    np.testing.assert_allclose(elapsed(problem, [2, 4]), [2 / 3, 4 / 3])
