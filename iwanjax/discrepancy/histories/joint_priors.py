"""Joints about the values that a study gives: their priors, and how parameters follow from z."""

import math
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.joints import AbstractJoint, ParameterInfo
from iwanjax.types import Scalar

# Deviations of the joints' parameters about the values that the model was given: of the
# logarithm of a force, a stiffness and a ratio, and of an exponent.
_DEVIATIONS = {"force": 0.5, "force/length": 0.1, "1": 0.6}
_OTHERWISE, _OF_EXPONENTS = 0.5, 0.2
# Least value of a ratio that a logarithm is taken of.
_SMALLEST = 1e-3
# Distance from a bound, as a share of the range, that a given value is taken to have at least, and
# one that is looked for.
_LEAST, _BORDER = 0.02, 1e-6


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

    def at(self, z: Array) -> AbstractJoint:
        """The joint at z prior deviations from the given values."""
        values = {
            info.name: _moved(info, getattr(self.given, info.name), self.loose[i] * z[i])
            for i, info in enumerate(self.given.parameters)
        }
        return type(self.given)(**values)


def located(joint: Joint, values: Mapping[str, float]) -> np.ndarray:
    """The z at which some parameters have these values, the others those given."""
    z = np.zeros(len(joint.given.parameters))
    for i, info in enumerate(joint.given.parameters):
        if info.name not in values:
            continue
        given, value = float(getattr(joint.given, info.name)), values[info.name]
        if info.transform == "log":
            z[i] = math.log(value / given) / _of_logarithm(info)
        elif info.transform == "logit":
            z[i] = (_logit(info, value, _BORDER) - _logit(info, given)) / _of_logit(info, given)
        else:
            z[i] = value / given - 1.0
        z[i] /= float(np.asarray(joint.loose)[i])
    return z


def _moved(info: ParameterInfo, value: Array, z: Array) -> Array:
    """A parameter by z deviations: in its logarithm, its logit within bounds, or as it is."""
    if info.transform == "log":
        least = _SMALLEST if info.dimension == "1" else 0.0
        return jnp.maximum(value, least) * jnp.exp(_of_logarithm(info) * z)
    if info.transform == "logit":
        low, high = info.usual or (info.lower, info.upper)
        moved = _logit(info, value) + _of_logit(info, value) * z
        return low + (high - low) * jax.nn.sigmoid(moved)
    return value + z * jnp.abs(value)


def _of_logarithm(info: ParameterInfo) -> float:
    """Prior deviation of a parameter's logarithm."""
    return _DEVIATIONS.get(info.dimension, _OTHERWISE)


def _share(info: ParameterInfo, value: Scalar, least: float = _LEAST) -> Scalar:
    low, high = info.usual or (info.lower, info.upper)
    return jnp.clip((value - low) / (high - low), least, 1.0 - least)


def _logit(info: ParameterInfo, value: Scalar, least: float = _LEAST) -> Scalar:
    share = _share(info, value, least)
    return jnp.log(share / (1.0 - share))


def _of_logit(info: ParameterInfo, value: Scalar) -> Scalar:
    """Prior deviation of a parameter's logit."""
    low, high = info.usual or (info.lower, info.upper)
    share = _share(info, value)
    return _OF_EXPONENTS / ((high - low) * share * (1.0 - share))


def joints_at(joints: tuple[Joint, ...], z: Array) -> tuple[AbstractJoint, ...]:
    """All joints at z, the parameters of one after the other."""
    if not joints:
        return ()
    ends = np.cumsum([len(joint.given.parameters) for joint in joints])
    parts = jnp.split(jnp.asarray(z), ends[:-1])
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
