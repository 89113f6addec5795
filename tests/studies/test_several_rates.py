"""Recordings of several rates, lengths and sensors say what they say at one rate with all."""

import numpy as np
import pytest
from discrepancy.histories import two_masses
from discrepancy.histories.two_masses import PLACES, RATE, recorded
from numpy.testing import assert_allclose

import iwanjax as ij

pytestmark = pytest.mark.long

CUBIC = 4e9
SENSORS = {"a1": [1.0, 0.0], "a2": [0.0, 1.0]}
HITS = [(0, 40.0, "fit"), (1, 160.0, "fit"), (0, 120.0, "fit"), (0, 90.0, "hold_out")]


def law(d, rate, change):
    return CUBIC * d**3


def verdict(takes):
    """Of hits, each (rate, samples, its sensors)."""
    recordings = []
    for hit, (rate, samples, sensors) in zip(HITS, takes, strict=True):
        made = recorded(law, *hit, rate, samples)
        shown = made.response[:, [list(SENSORS).index(name) for name in sensors]]
        data = ij.as_recording(
            shown,
            made.force,
            sampling_rate=rate,
            sensors=list(sensors),
            inputs=["m1", "m2"],
            quantity="acceleration",
        )
        recordings.append(ij.Measurement(data, use=made.use, name=made.name))
    study = ij.Study(
        ij.JointedStructure(ij.LinearStructure(two_masses.M, two_masses.DAMPING, two_masses.K), {}),
        recordings,
        rows=PLACES,
        sensors=SENSORS,
        inputs={"m1": [1.0, 0.0], "m2": [0.0, 1.0]},
        hypotheses=("cubic_stiffness", "gap_contact", "sensor_gain", "sensor_saturation"),
    )
    return study.diagnose().only


@pytest.fixture(scope="module")
def both():
    # As long as the first of the others is at this rate: one set of kernels serves both.
    alike = [(RATE, 676, ("a1", "a2"))] * 4
    several = [
        (2 * RATE, 1400, ("a1", "a2")),
        (RATE, 500, ("a2",)),
        (RATE, 650, ("a2", "a1")),
        (1.6 * RATE, 960, ("a1",)),
    ]
    return verdict(alike), verdict(several)


def test_the_verdict_is_the_same(both):
    for found in both:
        assert found.what[0].label == "cubic_stiffness@m1-m2"
        k3 = found.what[0].parameters[0]
        assert_allclose(k3.value, CUBIC, rtol=2e-3)
        assert len(found.found) == 1
    k3 = [found.what[0].parameters[0] for found in both]
    assert_allclose(k3[1].value, k3[0].value, rtol=2e-3)


def test_held_out_recordings_are_predicted_to_the_noise(both):
    for found in both:
        assert found.after.hold_out < 1.3 * found.noise_floor.hold_out
        assert found.before.hold_out > 0.5
    assert_allclose(both[1].noise_floor.hold_out, both[0].noise_floor.hold_out, rtol=0.3)


def test_the_rate_is_told(both):
    alike, several = both
    assert alike.sampling_rate == several.sampling_rate == RATE
    assert not any("measured at" in line for line in alike.warnings)
    told = [line for line in several.warnings if "measured at" in line]
    assert len(told) == 2
    assert "fit 40 was measured at 2048 Hz and is compared at 1024 Hz" in told
    assert "hold_out 90 was measured at 1638.4 Hz and is compared at 1024 Hz" in told


def test_a_sensor_that_is_missing_is_no_part_of_an_error(both):
    """Errors are over what was measured; nothing is said of a sensor that was not there."""
    names = list(both[1].by_recording)
    run = both[1].runs[1]
    lacking = np.all(run.measured == 0.0, axis=1)
    assert lacking.tolist() == [[False, False], [True, False], [False, False], [False, True]]
    assert np.all(run.error[lacking[:, None, :].repeat(run.error.shape[1], axis=1)] == 0.0)
    assert max(both[1].by_recording[name][1] for name in names) < 0.02
