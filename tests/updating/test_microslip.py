"""Where joints come to macroslip by an estimate, and by others that are as good."""

import numpy as np
import pytest

from iwanjax.joints import Iwan4
from iwanjax.updating.microslip import IwanPlace, in_other_ends, without_macroslip

POSITIONS = {"F_S": 1, "K_T": 2, "chi": 3, "beta": 4}
REACH = 2e-4
AT = IwanPlace("inner", POSITIONS, REACH)


def theta_of(phi_max: float) -> np.ndarray:
    """Parameters of one joint, among others."""
    joint = Iwan4.from_distribution(R=5e5, S=4e3, chi=-0.6, phi_max=phi_max)
    return np.array([7.0, *(float(getattr(joint, name)) for name in POSITIONS), 8.0])


def joint_of(theta: np.ndarray) -> Iwan4:
    return Iwan4(**{name: theta[i] for name, i in POSITIONS.items()})


def test_a_joint_that_slips_is_also_tried_as_one_that_does_not():
    given = theta_of(0.4 * REACH)
    found = without_macroslip(AT, given)
    assert len(found) > 5
    for theta in found:
        joint = joint_of(theta)
        assert float(joint.phi_max) > REACH
        # What sliders do before macroslip is what they did.
        assert (float(joint.R), float(joint.chi)) == (pytest.approx(5e5), pytest.approx(-0.6))
        assert theta[[0, 5]].tolist() == [7.0, 8.0]
    stiffness = [theta[2] for theta in found]
    assert min(stiffness) > given[2]
    assert max(stiffness) > 5.0 * given[2]


def test_a_joint_that_stays_in_microslip_is_let_alone():
    assert without_macroslip(AT, theta_of(1.5 * REACH)) == []


@pytest.mark.parametrize("F_S", [0.0, 1e-300])
def test_a_joint_without_strength_left_is_let_alone(F_S):
    lost = theta_of(0.4 * REACH)
    lost[POSITIONS["F_S"]] = F_S
    for theta in without_macroslip(AT, lost):
        assert np.all(np.isfinite(theta))


def test_macroslip_is_not_known_where_another_end_is_without():
    slips, stays = theta_of(0.4 * REACH), theta_of(1.5 * REACH)
    farther = AT._replace(reach=1.2 * REACH)
    ends = [([AT], stays), ([farther], stays), ([AT], slips)]
    assert in_other_ends([AT], slips, ends) == {"inner": pytest.approx(1.2 * REACH)}
    assert in_other_ends([AT], slips, ends[2:]) == {}
    # Of one that stays in microslip, the estimate's own family of joints tells.
    assert in_other_ends([AT], stays, ends) == {}
