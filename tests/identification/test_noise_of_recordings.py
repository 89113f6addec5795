"""Which of several ways to tell a sensor's noise is taken, and what is said where they differ."""

import numpy as np
import pytest

from iwanjax.identification.recordings import StudyRecording, noise_of, with_noise
from iwanjax.signals.sensor_noise import SensorNoise

N, BEFORE, S = 4000, 200, 0.01
SENSORS = ("a1", "a2")
T = np.arange(N)
LINE = np.sin(0.05 * 2.0 * np.pi * T)


def struck(name: str, random: np.random.Generator, before: int = BEFORE) -> StudyRecording:
    """A mode that rings after a blow, seen by two sensors of noise S and 3 S."""
    force = np.zeros((N, 1))
    force[before : before + 10, 0] = np.hanning(10)
    ring = np.where(before <= T, np.exp(-4e-3 * (T - before)) * np.sin(0.4 * (T - before)), 0.0)
    noise = np.array([S, 3.0 * S]) * random.standard_normal((N, 2))
    return StudyRecording(name, ring[:, None] + noise, force, initial="rest")


def noted(
    recordings: list[StudyRecording], given: tuple[float, float] = (np.nan, np.nan)
) -> tuple[list[SensorNoise], list[str]]:
    found, told = with_noise(recordings, np.array(given), SENSORS)
    levels = [each.noise for each in found if each.noise is not None]
    assert len(levels) == len(recordings)
    return levels, told


def test_all_hits_have_the_noise_before_all_of_them():
    random = np.random.default_rng(0)
    levels, told = noted([struck(name, random) for name in "abc"])
    assert not told
    for each in levels:
        assert each.source == ("before the force",) * 2
        np.testing.assert_array_equal(each.deviation, levels[0].deviation)
        # Lines that chance makes of one record in a hundred cost three each.
        assert np.all(each.freedom >= 3 * (BEFORE - 16 - 1 - 3))
    np.testing.assert_allclose(levels[0].deviation, [S, 3.0 * S], rtol=0.1)


def test_one_without_a_pause_takes_the_others_where_its_own_is_more():
    random = np.random.default_rng(1)
    loud = struck("loud", random, 10)
    # All over the band: something strikes at random, as long as it lasts.
    loud.response[:, 1] += random.standard_normal(N)
    levels, _ = noted([struck("a", random), struck("b", random), loud])
    assert levels[2].source[1] == "before the force"
    np.testing.assert_allclose(levels[2].deviation, [S, 3.0 * S], rtol=0.1)


def test_another_range_is_another_noise():
    random = np.random.default_rng(2)
    soft, hard = struck("soft", random), struck("hard", random)
    hard.response[:] *= 10.0
    levels, _ = noted([soft, hard])
    np.testing.assert_allclose(levels[0].deviation, [S, 3.0 * S], rtol=0.2)
    np.testing.assert_allclose(levels[1].deviation, [10.0 * S, 30.0 * S], rtol=0.2)


@pytest.mark.parametrize("size", [1.0, 10.0, 100.0])
def test_hum_before_a_force_is_no_noise(size):
    each = struck("hum", np.random.default_rng(3))
    each.response[:, 0] += size * S * LINE
    (level,), _ = noted([each])
    np.testing.assert_allclose(level.deviation, [S, 3.0 * S], rtol=0.25)


def test_motion_before_a_force_is_told_and_is_no_noise():
    random = np.random.default_rng(4)
    each = struck("late", random)
    # Many modes ring on from before, none of them a line.
    slow = np.cumsum(random.standard_normal(N)) * np.exp(-5e-3 * T)
    each.response[:, 0] += 0.1 * slow
    (level,), (line,) = noted([each])
    assert level.source == ("in quiet bands", "before the force")
    np.testing.assert_allclose(level.deviation, [S, 3.0 * S], rtol=0.4)
    assert line.startswith("late: before the force a1 shows")
    assert "its noise is taken in quiet bands" in line


def test_what_the_study_gives_is_taken_and_checked():
    random = np.random.default_rng(5)
    recordings = [struck(name, random) for name in "ab"]
    levels, told = noted(recordings, (S, np.nan))
    assert not told
    assert levels[0].source == ("as given", "before the force")
    assert levels[0].deviation[0] == S
    assert levels[0].freedom[0] == np.inf
    for factor in (2.0, 0.5):
        levels, told = noted(recordings, (factor * S, np.nan))
        assert levels[1].deviation[0] == factor * S
        assert len(told) == 2
        assert told[0].startswith(f"a: noise of a1 is given as {factor * S:.2g}, but it shows 0.0")
        assert told[0].endswith("before the force")


def test_quiet_bands_that_hold_motion_do_not_contradict_what_is_given():
    random = np.random.default_rng(6)
    each = StudyRecording("run", random.standard_normal((N, 2)), None, initial="unknown")
    _, told = noted([each], (S, S))
    assert not told
    _, told = noted([each], (10.0, 10.0))
    assert len(told) == 2


def test_a_sensor_that_a_recording_lacks_has_no_noise_in_it():
    each = struck("one", np.random.default_rng(7))
    each.response[:, 1] = np.nan
    found = noise_of(each)
    assert found.deviation[0] == pytest.approx(S, rel=0.2)
    assert np.isnan(found.deviation[1])
