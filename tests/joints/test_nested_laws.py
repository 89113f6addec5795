"""What a law is said to become at an end of its range is what its formulas become there."""

import numpy as np
import pytest

from iwanjax.effects.kinds import force_laws
from iwanjax.joints import Backlash, Gap, Jenkins, Scales

SEEN = Scales(deflection=2e-3, period=0.02)
DEFLECTIONS = np.array([1e-4, 3e-4, 6e-4, 1.1e-3, 2e-3])
OMEGA = 2.0 * np.pi / SEEN.period
# A stiffness or a damper, and where it slips.
VALUES = (3e4, 5e-4)
WHOLE = [
    pytest.param(law, nested, id=f"{law.__name__}, {nested.law.__name__}")
    for law in force_laws().values()
    for nested in law.nested_whole()
    # What changes within a recording has no steady cycle.
    if law.__name__ != "ChangingStiffness"
]


@pytest.mark.parametrize(("law", "nested"), WHOLE)
def test_a_law_has_the_simpler_one_s_force_and_loss(law, nested):
    values = VALUES[: len(nested.law.searched())]
    simpler = nested.law.scaled(*values, *(1.0,) * (2 - len(values)))
    whole = law(*nested.widened(values, SEEN, 1e-6))
    force = np.asarray(simpler.backbone(DEFLECTIONS))
    lost = np.asarray(simpler.dissipation(DEFLECTIONS, omega=OMEGA))
    most = np.max(VALUES[0] * DEFLECTIONS**2)
    np.testing.assert_allclose(whole.backbone(DEFLECTIONS), force, rtol=1e-2, atol=1e-9)
    np.testing.assert_allclose(
        whole.dissipation(DEFLECTIONS, omega=OMEGA), lost, rtol=1e-2, atol=1e-3 * most
    )


@pytest.mark.parametrize("name", ["bouc_wen", "backlash"])
def test_dry_friction_is_within(name):
    assert Jenkins in {nested.law for nested in force_laws()[name].nested_whole()}


def test_a_dead_band_that_never_slips_is_a_gap():
    (nested,) = (each for each in Backlash.nested_whole() if each.law is Gap)
    assert nested.narrowed((52.0, *VALUES)) == (VALUES,)
    F_S, *contact = nested.widened(VALUES, SEEN, 1.0)
    assert tuple(contact) == VALUES
    assert np.all(Backlash(F_S, *VALUES).dissipation(DEFLECTIONS) == 0.0)
