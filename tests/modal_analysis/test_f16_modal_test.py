"""The F-16's ground vibration test at its lowest level: modes that the literature knows."""

import numpy as np
import pytest
import scipy.io

import iwanjax as ij


@pytest.fixture(scope="module")
def test(reference_data):
    file = reference_data / "f16" / "F16Data_FullMSine_Level1.mat"
    if not file.is_file():
        pytest.skip(f"no {file}")
    held = scipy.io.loadmat(file)
    recording = ij.as_recording(
        held["Acceleration"].T,
        held["Force"].ravel(),
        sampling_rate=400.0,
        sensors=["a1", "a2", "a3"],
        inputs="F",
        quantity="acceleration",
        name="level 1",
    )
    return ij.modal_test(recording, (2.0, 15.0), driving_points={"F": "a1"})


def test_its_modes(test):
    """Noel and Schoukens (2017): wing bending near 5.2 Hz, torsion near 7.3 Hz, one near 9.2 Hz."""
    for known in (5.2, 7.3, 9.2):
        k = int(np.argmin(np.abs(test.frequency - known)))
        assert abs(test.frequency[k] - known) < 0.05
        assert 0.0 < test.frequency_std[k] < 0.005 * known
        assert 0.0 < test.damping_std[k] < 0.1 * test.damping[k]
    assert test.responses.averages == 8  # the first period still holds the start


def test_what_is_left_is_no_scatter_and_is_said(test):
    """Periods repeat to 0.1 %, modes leave a tenth: distortion of the joint, at this level too."""
    assert np.all(test.scatter < 2e-3)
    assert np.all((test.misfit > 0.05) & (test.misfit < 0.2))
    assert any("not linear at this level" in each for each in test.warnings)
    # Weighted by what is left, most of the measured functions lie within three deviations.
    away = np.abs(test.fitted - test.responses.frf) / test.distortion
    assert np.mean(away < 3.0) > 0.95
