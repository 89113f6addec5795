"""Real hammer recordings, from file to joint; skipped where the data are not at hand.

What is asserted is what the recordings showed when this was written, within bounds that an
independent analysis of the same data gave, and that the fits do not hide what they cannot do.
"""

import numpy as np
import pytest

import iwanjax as ij
from iwanjax.updating import free_exponents

HELD_OUT = (3, 7, 11)


def errors(solution, curves):
    q = curves.as_quantity("displacement").amplitude
    f, zeta = (np.asarray(x) for x in solution.model.ringdown_frequency_and_damping(q))
    relative = zeta / np.asarray(curves.damping) - 1.0
    difference = f - np.asarray(curves.frequency)
    return np.sqrt(np.mean(difference**2)), np.sqrt(np.mean(relative**2))


@pytest.fixture(scope="module")
def double_beam(reference_data):
    recordings = ij.read_recordings(
        reference_data / "double_beam" / "data.mat", variable="xData", quantity="velocity"
    )
    return [
        ij.ringdown_curves(r.response[:, 0], r.sampling_rate, (80, 170), unit="m/s")
        for r in recordings
    ]


@pytest.fixture(scope="module")
def nine_hits(double_beam):
    return ij.merge_curves([c for i, c in enumerate(double_beam) if i not in HELD_OUT])


@pytest.fixture(scope="module")
def one_joint(nine_hits):
    return ij.fit("iwan4", nine_hits.weighted_hits)


@pytest.mark.computes
def test_nine_hits_predict_the_other_three_to_about_twice_their_repeatability(
    double_beam, nine_hits, one_joint
):
    repeat_f = np.sqrt(np.mean(nine_hits.frequency_spread**2))
    relative = nine_hits.damping_spread / np.asarray(nine_hits.curves.damping)
    repeat_z = np.sqrt(np.mean(relative**2))
    assert repeat_f < 0.01
    for i in HELD_OUT:
        f, zeta = errors(one_joint, double_beam[i])
        assert f < 0.015
        assert f < 3.0 * repeat_f
        assert zeta < 0.05
        assert zeta < 3.0 * repeat_z


def test_one_joint_is_in_tension_with_the_double_beam_and_says_so(nine_hits, one_joint):
    assert one_joint.misfit > 2.0
    assert "does not explain the curves to their noise" in one_joint.summary()
    free = free_exponents(nine_hits.curves)
    assert free.frequency[0] == pytest.approx(1.05, abs=0.08)
    assert free.damping[0] == pytest.approx(1.45, abs=0.05)
    assert free.apart > 5.0
    assert "one Iwan joint in microslip wants them equal, so it has to" in free.statement()


@pytest.mark.parametrize(
    ("band", "explained", "f_0"), [((60, 105), False, 80.65), ((250, 350), True, 297.78)]
)
def test_one_joint_explains_mode_2_of_the_brake_reuss_beam_but_not_mode_1(
    reference_data, band, explained, f_0
):
    recording = ij.read_recording(
        reference_data / "brb_rice" / "HammerImpact.mat",
        variable="HIdata",
        response=["acc3"],
        quantity="acceleration",
        unit="m/s^2",
    )
    signal = recording.response[:, 0]
    curves = ij.ringdown_curves(
        signal, recording.sampling_rate, band, quantity="acceleration", unit="m/s^2"
    )
    solution = ij.fit("iwan4", curves)
    assert (solution.misfit < 2.0) == explained
    assert ("does not explain" in solution.summary()) != explained
    # Even so it follows both curves closely for a model of one mode.
    assert solution.frequency_rms < 0.025
    assert solution.damping_rms < 0.08
    assert abs(solution.values["f_0"] - f_0) < 4.0 * solution.std["f_0"]
    assert -1.0 < solution.values["chi"] < 0.0
