"""Joints that are evaluated together give what each gives alone."""

import jax.numpy as jnp
import numpy as np
import pytest

import iwanjax as ij
from iwanjax.joints import AbstractJoint
from iwanjax.quasistatic import alike


def iwan(F_S, chi):
    return ij.Iwan4(F_S=F_S, K_T=500.0, chi=chi, beta=1.0)


SETS = np.array([0.5, 1.0, 2.0])
JOINTS = (
    iwan(1.0, -0.5),
    ij.LinearSpring(k=3.0),
    iwan(SETS, -0.2),
    ij.Jenkins(F_S=1.0, K_T=50.0),
    ij.LinearSpring(k=SETS),
    iwan(2.0, -0.8),
)
FUNCTIONS = {
    "law": lambda joint, d: joint.law()(d),
    "dissipation": lambda joint, d: (joint.dissipation(d), joint.harmonic_stiffness(d)),
    "a number for all": lambda joint, d: (0.0, joint.initial_stiffness * d),
}


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("few", [alike.FEW, 0])
def test_each_joint_gets_what_it_gives_alone(monkeypatch, name, few):
    monkeypatch.setattr(alike, "FEW", few)
    function = FUNCTIONS[name]
    d = [(1.0 + i) * jnp.geomspace(1e-4, 1e-2, 7)[:, None] * jnp.ones(3) for i in range(6)]
    together = alike.of_each(function, JOINTS, d)
    for joint, at, found in zip(JOINTS, d, together, strict=True):
        for value, alone in zip(found, function(joint, at), strict=True):
            assert np.allclose(*np.broadcast_arrays(value, alone), rtol=1e-13, atol=0.0)


def test_joints_of_one_type_are_evaluated_once():
    seen: list[AbstractJoint] = []

    def function(joint, d):
        seen.append(joint)
        return (d,)

    alike.of_each(function, JOINTS, [jnp.ones((7, 3))] * 6)
    assert [type(joint).__name__ for joint in seen] == ["Iwan4", "LinearSpring", "Jenkins"]
