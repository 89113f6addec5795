"""What curves of a mode say beyond the levels that were fitted, and of curves of another state."""

import numpy as np
import pytest

import iwanjax as ij
from iwanjax.discrepancy.steady.diagnose_joint import diagnose_curves
from iwanjax.discrepancy.steady.repeatability import disagreements
from iwanjax.discrepancy.steady.runs import CurveRun
from iwanjax.joints.iwan import phi_max_of
from iwanjax.updating.microslip import alike_in_microslip

JOINT = ij.Iwan4(F_S=2.0, K_T=1e4, chi=-0.4, beta=0.1)
MODE = ij.ModalOscillator(80.0, 1e-3, JOINT)


def curves(q, f_off=0.0, zeta_off=0.0, noise=0.0, seed=0, name=""):
    """Of the mode, with an offset in Hz and a share of the damping."""
    f, zeta = map(np.asarray, MODE.ringdown_frequency_and_damping(q))
    random = np.random.default_rng(seed)
    f_std, zeta_std = np.full(q.size, 3e-3), 1e-2 * zeta
    return ij.ModalCurves(
        q,
        f + f_off + noise * f_std * random.standard_normal(q.size),
        zeta * (1.0 + zeta_off) + noise * zeta_std * random.standard_normal(q.size),
        frequency_std=f_std,
        damping_std=zeta_std,
        quantity="displacement",
        unit="m",
        name=name,
    )


def test_joints_alike_in_microslip_have_the_curves_of_a_mode_and_another_macroslip():
    q = np.geomspace(1e-6, 1e-4, 12)
    own = {"F_S": 2.0, "K_T": 1e4, "chi": -0.4, "beta": 0.1}
    family = alike_in_microslip(**own, reach=1e-4, stiffest=float(MODE.K_inf) + 1e4)
    limits = [float(phi_max_of(**joint)) for joint in family]
    assert limits[0] == pytest.approx(1.001e-4)
    assert limits[-1] > 9.0e-4
    for joint in family:
        other = ij.ModalOscillator(80.0, 1e-3, ij.Iwan4(**joint))
        for a, b in zip(
            MODE.ringdown_frequency_and_damping(q),
            other.ringdown_frequency_and_damping(q),
            strict=True,
        ):
            np.testing.assert_allclose(a, b, rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_macroslip_is_not_taken_from_noise_and_held_out_levels_lie_within_what_is_left_open(seed):
    """Five noisy levels in microslip, three beyond: the search alone may end on a kink."""
    q = np.geomspace(1e-5, 2.4e-4, 8)
    fitted, beyond = (curves(x, noise=1.0, seed=seed, name=str(x.size)) for x in (q[:5], q[5:]))
    found = diagnose_curves("iwan4", fitted, beyond, hypotheses=("cubic_stiffness",))
    assert found.verdict.name == "nothing_missing"
    assert found.after.hold_out < 3.0 * np.hypot(
        found.noise_floor.hold_out, found.parameter_spread.hold_out
    )
    values = {each.info.name: each for each in found.joints[0].parameters}
    assert np.isnan(values["F_S"].std)
    assert "macroslip" in found.statement()


def test_curves_of_another_state_are_told_and_held_against_no_law():
    q = np.geomspace(1e-6, 1e-4, 12)
    measured = (
        curves(q, name="fitted"),
        curves(q[2:8], name="same", noise=1.0),
        curves(q[2:8], 0.1, 0.2, name="other"),
        curves(200.0 * q, 0.1, name="elsewhere"),
    )
    predicted = tuple(curves(each.amplitude) for each in measured)
    found = disagreements(CurveRun.of(measured, predicted, 1), measured)
    assert set(found) == {2}
    assert found[2].frequency == pytest.approx(0.1)
    assert found[2].damping == pytest.approx(0.2 / 1.2)
    assert str(found[2]).startswith("other was measured on another state of the mode")
    # A model that does not explain what was fitted says nothing of the others.
    wrong = tuple(curves(each.amplitude, 0.1) for each in measured)
    assert not disagreements(CurveRun.of(measured, wrong, 1), measured)
