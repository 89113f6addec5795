"""One element along a history: parameters that change on the way, and where a recording begins."""

import numpy as np
import pytest

import iwanjax as ij
from iwanjax.errors import InputError
from iwanjax.joints import JOINTS

D = 3.0 * np.sin(np.linspace(0.0, 12.0, 400))
SLIP = 1.0 + 0.4 * np.sin(np.linspace(0.0, 31.0, 400))
STIFFNESS = np.linspace(1.0, 1.5, 400)


def bank(phi, k, slip, stiffness):
    """Sliders by their own rule: a spring slips where it pulls more than its slider holds."""
    stretch, last, force = np.zeros_like(phi), 0.0, []
    for now, a, b in zip(D, slip, stiffness, strict=True):
        stretch, last = np.clip(stretch + now - last, -phi * a / b, phi * a / b), now
        force.append(b * (k @ stretch))
    return np.array(force)


@pytest.mark.parametrize(
    "joint", [ij.Jenkins(F_S=1.2, K_T=0.8), ij.Iwan4(F_S=1.2, K_T=0.8, chi=-0.5, beta=1.0)]
)
def test_strengths_that_change_along_a_history(joint):
    given = {"F_S": joint.F_S * SLIP, "K_T": joint.K_T * STIFFNESS}
    found = ij.hysteresis(joint, D, varying=given)
    sliders = joint.discrete(200)
    wanted = bank(np.asarray(sliders.phi), np.asarray(sliders.k), SLIP, STIFFNESS)
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", ["iwan5", "backlash"])
def test_parameters_that_do_not_change_are_those_of_the_joint(name):
    """An Iwan element that has sliders' friction twice, too."""
    kind = JOINTS[name]
    known = {"F_S": 1.2, "K_T": 0.8, "chi": -0.5, "beta": 1.0, "theta": 0.8, "gap": 0.5}
    joint = kind(**{info.name: known[info.name] for info in kind.parameters})
    element = joint.slider_bank(200) if name == "iwan5" else joint
    varying = {info.name: np.full_like(D, known[info.name]) for info in kind.parameters}
    found = ij.hysteresis(joint, D, sliders=None, varying=varying)
    np.testing.assert_allclose(found, ij.hysteresis(element, D), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("joint", "varying", "told"),
    [
        (ij.Jenkins(F_S=1.0, K_T=1.0), {"chi": D}, r"varying: chi .* one of F_S, K_T, of shape"),
        (ij.Jenkins(F_S=1.0, K_T=1.0), {"F_S": D[:5]}, r"F_S of shape \(5,\).* \(400,\) as d"),
        (ij.Jenkins(F_S=1.0, K_T=1.0).discrete(), {"F_S": SLIP}, "a joint, which has parameters"),
    ],
)
def test_what_cannot_change_is_refused(joint, varying, told):
    with pytest.raises(InputError, match=told):
        ij.hysteresis(joint, D, varying=varying)


def test_what_leads_to_a_recording_is_before_its_time():
    element = JOINTS["changing_stiffness"](rate=-2.0, tau=3.0)
    t = np.linspace(0.0, 5.0, 51)
    d = np.concatenate([np.ones(20), np.ones(51)])
    force = ij.hysteresis(element, d, dt=0.1, lead=2.1)
    wanted = np.concatenate([np.zeros(20), -6.0 * (1.0 - np.exp(-t / 3.0))])
    np.testing.assert_allclose(force, wanted, atol=1e-12)
