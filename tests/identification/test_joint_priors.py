"""Priors of joints' parameters about the given values, worked out apart from the code."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special

import iwanjax as ij
from iwanjax.identification.joint_priors import Joint, joints_at, located, tangents
from iwanjax.joints import UnnamedLaw

GIVEN = ij.Iwan4(F_S=800.0, K_T=3e5, chi=-0.3, beta=0.4)
LOOSE = np.array([1.0, 2.0, 0.5, 1.0])
JOINT = Joint(GIVEN, jnp.array(LOOSE))
NAMES = [info.name for info in GIVEN.parameters]


def values_of(joint: ij.AbstractJoint) -> np.ndarray:
    return np.array([float(getattr(joint, info.name)) for info in joint.parameters])


def by_hand(z: np.ndarray) -> dict[str, float]:
    """Logarithms move by 0.5, 0.1 and 0.6; chi's logit within its usual range by 0.2 in chi."""
    F_S, K_T, chi, beta = z * LOOSE
    (info,) = (info for info in GIVEN.parameters if info.name == "chi")
    low, high = info.usual or (info.lower, info.upper)
    share = (-0.3 - low) / (high - low)
    # Slope of chi over its logit, by SciPy's logistic function and a central difference.
    at, h = scipy.special.logit(share), 1e-6
    rise = scipy.special.expit(at + h) - scipy.special.expit(at - h)
    slope = (high - low) * rise / (2.0 * h)
    return {
        "F_S": 800.0 * math.exp(0.5 * F_S),
        "K_T": 3e5 * math.exp(0.1 * K_T),
        "chi": low + (high - low) * float(scipy.special.expit(at + 0.2 * chi / slope)),
        "beta": 0.4 * math.exp(0.6 * beta),
    }


@pytest.mark.parametrize("seed", range(5))
def test_parameters_at_z_are_those_by_hand(seed):
    z = np.random.default_rng(seed).standard_normal(4)
    expected = by_hand(z)
    np.testing.assert_allclose(
        values_of(JOINT.at(jnp.array(z))), [expected[name] for name in NAMES], rtol=1e-8
    )


def test_the_given_values_are_at_zero():
    np.testing.assert_allclose(values_of(JOINT.at(jnp.zeros(4))), values_of(GIVEN), rtol=1e-12)


def test_draws_of_the_prior_scatter_as_stated():
    """Of 4000 draws the deviation is known to 1.1 %; of chi, whose logit is bent, to the bend."""
    z = jnp.array(np.random.default_rng(0).standard_normal((4000, 4)))
    drawn = {
        name: np.asarray(jax.vmap(lambda z, name=name: getattr(JOINT.at(z), name))(z))
        for name in NAMES
    }
    for name, deviation in {"F_S": 0.5, "K_T": 0.2, "beta": 0.6}.items():
        assert np.std(np.log(drawn[name])) == pytest.approx(deviation, rel=0.04)
        assert np.median(drawn[name]) == pytest.approx(float(getattr(GIVEN, name)), rel=0.05)
    assert np.std(drawn["chi"]) == pytest.approx(0.1, rel=0.05)
    (info,) = (info for info in GIVEN.parameters if info.name == "chi")
    assert np.all(info.contains(drawn["chi"]))


@pytest.mark.parametrize("seed", range(5))
def test_values_are_found_again(seed):
    z = np.random.default_rng(seed).standard_normal(4)
    there = dict(zip(NAMES, values_of(JOINT.at(jnp.array(z))), strict=True))
    np.testing.assert_allclose(located(JOINT, there), z, atol=1e-9)
    # What is not asked for stays as given.
    some = located(JOINT, {"F_S": there["F_S"]})
    assert some[NAMES.index("F_S")] == pytest.approx(z[NAMES.index("F_S")])
    assert np.count_nonzero(some) == 1


def test_a_parameter_of_either_sign_moves_by_its_own_size():
    spring = Joint(ij.CubicSpring(k3=-4e9), jnp.array([1.0]))
    np.testing.assert_allclose(values_of(spring.at(jnp.array([0.5]))), [-2e9])
    np.testing.assert_allclose(located(spring, {"k3": -2e9}), [0.5])


def test_stiffnesses_of_all_joints_are_slopes_of_their_forces_at_rest():
    """Of both in one vector z, by the force itself long before slip."""
    joints = (JOINT, Joint(ij.LinearSpring(k=2e4), jnp.array([1.0])))
    z = np.random.default_rng(3).standard_normal((3, 5))
    found = np.asarray(tangents(joints, jnp.array(z)))
    for row, at in zip(found, z, strict=True):
        both = joints_at(joints, jnp.array(at))
        expected = [float(joint.backbone(1e-9)) / 1e-9 for joint in both]
        np.testing.assert_allclose(row, expected, rtol=1e-3)
    assert tangents((), jnp.zeros((3, 0))).shape == (3, 0)


def test_what_is_no_parameter_of_a_joint_stays():
    """A one-sided gap was fitted as a two-sided one; a law without a name could not be fitted."""
    gap = ij.Gap(k=2e4, gap=1e-4, sides="positive")
    moved = joints_at((Joint(gap, jnp.ones(2)),), jnp.array([0.3, -0.2]))[0]
    assert isinstance(moved, ij.Gap)
    assert moved.sides == "positive"
    assert float(moved.k) != float(gap.k)
    law = UnnamedLaw.blank(1e-3, 0.1, 0.02)
    law = law.with_strengths(jnp.ones(len(law.strengths)))
    (same,) = joints_at((Joint(law, jnp.ones(0)),), jnp.zeros(0))
    assert float(same.backbone(5e-4)) == float(law.backbone(5e-4))
