"""Joints about the values that a study gives: their priors, and how parameters follow from z."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.estimation.transforms import share_of, to_value, to_variable
from iwanjax.joints import AbstractJoint, ParameterInfo, UnnamedLaw
from iwanjax.joints.duhem import FIRST_BRANCH
from iwanjax.joints.unnamed_terms import BANKS, ELASTIC, PARTS, RESONANCE, TERMS
from iwanjax.types import Scalar

# Deviations of the joints' parameters about the values that the model was given: of the
# logarithm of a force (and of what else there is), a stiffness and a ratio, and of an exponent.
_DEVIATIONS, _OF_EXPONENTS = {"force": 0.5, "force/length": 0.1, "1": 0.6}, 0.2
# Least value of a ratio, less its lower bound, that a logarithm is taken of.
_SMALLEST = 1e-3
# Prior deviation of what nothing is known of: of a logarithm, or over its own size.
_ANYTHING = 4.0
# Distance from a bound, as a share of the range, that a given value is taken to have at least.
_LEAST = 0.02


class Joint(eqx.Module):
    """How a joint's parameters follow from z.

    Attributes
    ----------
    given : AbstractJoint
        The joint at z = 0.
    loose : (parameters,) array
        Factors of the prior deviations.
    """

    given: AbstractJoint
    loose: Array

    @property
    def parameters(self) -> tuple[ParameterInfo, ...]:
        """What z moves, where its values have names."""
        return self.given.parameters

    @property
    def count(self) -> int:
        """Length of z."""
        return len(self.parameters)

    @property
    def least(self) -> np.ndarray:
        """Least value of each of z."""
        return np.full(self.count, -math.inf)

    def at(self, z: Array) -> AbstractJoint:
        """The joint at z prior deviations from the given values."""
        values = {
            info.name: _moved(info, getattr(self.given, info.name), self.loose[i] * z[i])
            for i, info in enumerate(self.parameters)
        }
        return self.given.with_parameters(**values)


class FreeLaw(Joint):
    """A general law whose strengths follow from z: so many of their prior deviations.

    Of those that are free. The frequency and the damping of the mass that resonates come after the
    strengths in z, by factors of e^4 that nothing is known of; where the spring that yields along a
    curve is free the shape of that curve comes last, about that of the first branch by a factor of
    e for each.

    Attributes
    ----------
    given : UnnamedLaw
        With the scales of its motion; its strengths do not count.
    loose : (terms,) array
        Prior deviations of the strengths, force.
    free : tuple of int
        Terms whose strengths are fitted; the others' are zero.
    """

    free: tuple[int, ...] = eqx.field(default=BANKS, static=True)

    @property
    def terms(self) -> np.ndarray:
        """Which strengths are free."""
        return np.array(self.free)

    @property
    def duhem(self) -> bool:
        """Whether the spring that yields along a curve is one of them."""
        return PARTS["duhem"].start in self.free

    @property
    def count(self) -> int:
        """Number of free strengths, of the resonance's, and of the shape's."""
        return self.terms.size + RESONANCE.size + (FIRST_BRANCH.size if self.duhem else 0)

    @property
    def least(self) -> np.ndarray:
        """None of the spring's, nor of ways back: what is less elsewhere would feed energy."""
        strengths = np.where(self.terms < ELASTIC, -math.inf, 0.0)
        strengths = np.append(strengths, np.full(RESONANCE.size, -math.inf))
        if not self.duhem:
            return strengths
        back = FIRST_BRANCH.size // 2 + 1
        return np.concatenate([strengths, np.full(back, -math.inf), -FIRST_BRANCH[back:]])

    def at(self, z: Array) -> UnnamedLaw:
        """The law of these strengths."""
        assert isinstance(self.given, UnnamedLaw)
        free, shape = jnp.split(z, [self.terms.size])
        resonance, branch = shape[: RESONANCE.size], shape[RESONANCE.size :]
        # Terms that are not fitted are numbers, whatever JAX does with z.
        strengths = dict(zip(self.free, self.loose[self.terms] * free, strict=True))
        found = self.given.with_strengths(tuple(strengths.get(i, 0.0) for i in range(len(TERMS))))
        found = found.with_resonance(RESONANCE + _ANYTHING * resonance)
        return found.with_branch(FIRST_BRANCH + branch) if self.duhem else found

    def reached(self, law: UnnamedLaw) -> np.ndarray:
        """The z at which it is a law whose other strengths are zero."""
        free = self.terms
        strengths = np.stack(law.strengths)[free] / np.asarray(self.loose)[free]
        shapes = [(np.stack(law.resonance) - RESONANCE) / _ANYTHING]
        shapes += [np.stack(law.branch) - FIRST_BRANCH] if self.duhem else []
        return np.concatenate([strengths, *shapes])


def located(joint: Joint, values: Mapping[str, float]) -> np.ndarray:
    """The z at which some parameters have these values, the others those given."""
    z = np.zeros(len(joint.given.parameters))
    for i, info in enumerate(joint.given.parameters):
        if info.name not in values:
            continue
        given = float(getattr(joint.given, info.name))
        there = to_variable(info.transform, values[info.name], *_bounds(info), xp=np)
        z[i] = (there - _origin(info, given, np)) / _deviation(info, given, np)
        z[i] /= float(np.asarray(joint.loose)[i])
    return z


def _moved(info: ParameterInfo, value: Scalar, z: Scalar) -> Scalar:
    """A parameter by z deviations: in its logarithm, its logit within bounds, or as it is."""
    there = _origin(info, value) + _deviation(info, value) * z
    return to_value(info.transform, there, *_bounds(info))


def unknown(given: AbstractJoint) -> Joint:
    """A joint of which no more is known than where a search begins."""

    def loose(info: ParameterInfo) -> float:
        if info.transform == "identity":
            return _ANYTHING
        return _ANYTHING / float(_deviation(info, float(getattr(given, info.name)), np))

    return Joint(given, jax.device_put(np.array([loose(info) for info in given.parameters])))


def _bounds(info: ParameterInfo) -> tuple[float, float]:
    if info.transform == "logit":
        return info.usual or (info.lower, info.upper)
    return max(info.lower, 0.0), math.inf


def _origin(info: ParameterInfo, value: Scalar, xp: Any = jnp) -> Scalar:
    """The variable of a value that is given, far enough from its bounds to be moved."""
    if info.transform == "log" and info.dimension == "1":
        value = xp.maximum(value, _bounds(info)[0] + _SMALLEST)
    return to_variable(info.transform, value, *_bounds(info), inside=_LEAST, xp=xp)


def of_logarithm(info: ParameterInfo) -> float:
    """Prior deviation of a parameter's logarithm."""
    return _DEVIATIONS.get(info.dimension, _DEVIATIONS["force"])


def _deviation(info: ParameterInfo, value: Scalar, xp: Any = jnp) -> Scalar:
    """Prior deviation of the variable about a value that is given."""
    if info.transform == "log":
        return of_logarithm(info)
    if info.transform == "logit":
        low, high = _bounds(info)
        share = share_of(value, low, high, _LEAST, xp)
        return _OF_EXPONENTS / ((high - low) * share * (1.0 - share))
    return xp.abs(value)


def parameters_of(joints: Sequence[Joint]) -> int:
    """How many parameters joints have in all."""
    return sum(joint.count for joint in joints)


def least_of(joints: Sequence[Joint]) -> np.ndarray:
    """Least value of each of the joints' z."""
    return np.concatenate([np.zeros(0), *(joint.least for joint in joints)])


def joints_at(joints: tuple[Joint, ...], z: Array) -> tuple[AbstractJoint, ...]:
    """All joints at z, whose last values are the parameters of one after the other."""
    if not joints:
        return ()
    ends = np.cumsum([joint.count for joint in joints])
    parts = jnp.split(jnp.asarray(z)[-ends[-1] :], ends[:-1])
    return tuple(joint.at(part) for joint, part in zip(joints, parts, strict=True))


joints_of = eqx.filter_jit(joints_at)
"""The same outside of kernels."""


@eqx.filter_jit
def tangents(
    joints: tuple[Joint, ...], z: Float[Array, "batch parameters"]
) -> Float[Array, "batch joints"]:
    """Initial stiffnesses of all joints."""
    if not joints:
        return jnp.zeros((z.shape[0], 0))

    def one(z: Array) -> Array:
        return jnp.stack([joint.initial_stiffness for joint in joints_at(joints, z)])

    return jax.vmap(one)(z)
