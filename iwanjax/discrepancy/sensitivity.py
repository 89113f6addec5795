"""Compiled kernels: residuals of many hypotheses with their derivatives, reduced where made."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.discrepancy.prediction import Data, Predictor, Suspects, Values
from iwanjax.joints import AbstractJoint, ParameterInfo

# Deviations of the joints' parameters about the values that the model was given: of the
# logarithm of a force, a stiffness and a ratio, and of an exponent.
_DEVIATIONS = {"force": 0.5, "force/length": 0.1, "1": 0.6}
_OTHERWISE, _OF_EXPONENTS = 0.5, 0.2
_SMALLEST = 1e-3
# A run that breaks down is far from the data, not a fault of the search.
_BROKEN = 1e6


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


def _moved(info: ParameterInfo, value: Array, z: Array) -> Array:
    """A parameter by z deviations: in its logarithm, its logit within bounds, or as it is."""
    if info.transform == "log":
        scale = _DEVIATIONS.get(info.dimension, _OTHERWISE)
        return jnp.maximum(value, _SMALLEST if info.dimension == "1" else 0.0) * jnp.exp(scale * z)
    if info.transform == "logit":
        low, high = info.usual or (info.lower, info.upper)
        share = jnp.clip((value - low) / (high - low), 0.02, 0.98)
        scale = _OF_EXPONENTS / ((high - low) * share * (1.0 - share))
        return low + (high - low) * jax.nn.sigmoid(jnp.log(share / (1.0 - share)) + scale * z)
    return value + z * jnp.abs(value)


def joints_at(joints: tuple[Joint, ...], z: Array) -> tuple[AbstractJoint, ...]:
    """All joints at z, the parameters of one after the other."""
    ends = np.cumsum([len(joint.given.parameters) for joint in joints])
    parts = jnp.split(jnp.asarray(z), ends[:-1])
    return tuple(joint.at(part) for joint, part in zip(joints, parts, strict=True))


@eqx.filter_jit
def tangents(
    joints: tuple[Joint, ...], z: Float[Array, "lanes parameters"]
) -> Float[Array, "lanes joints"]:
    """Initial stiffnesses of all joints."""

    def one(z: Array) -> Array:
        return jnp.stack([joint.initial_stiffness for joint in joints_at(joints, z)])

    return jax.vmap(one)(z)


class Reduced(NamedTuple):
    """Weighted residuals e and what least squares needs of their derivatives J.

    Attributes
    ----------
    e : (lanes, recordings, N, sensors) array
        Residuals.
    cost : (lanes, recordings) array
        Their sum of squares.
    moment : (lanes, recordings, directions) array
        J^T e.
    normal : (lanes, recordings, directions, directions) array
        J^T J.
    """

    e: Float[Array, "lanes recordings N sensors"]
    cost: Float[Array, "lanes recordings"]
    moment: Float[Array, "lanes recordings directions"]
    normal: Float[Array, "lanes recordings directions directions"]


def split(theta: Array, parameters: int, slots: int) -> Values:
    """Values from one vector: joints, slots, state."""
    end = parameters + 2 * slots
    return Values(theta[:parameters], theta[parameters:end].reshape(slots, 2), theta[end:])


def _weighted(
    predictor: Predictor,
    joints: tuple[Joint, ...],
    suspects: Suspects,
    values: Values,
    gain: Array,
    data: Data,
) -> Array:
    made = joints_at(joints, values.z)
    return predictor.innovations(made, suspects, values, gain, data) * data.weight


@eqx.filter_jit
def reduced(
    predictor: Predictor,
    joints: tuple[Joint, ...],
    suspects: Suspects,
    theta: Float[Array, "lanes recordings values"],
    gain: Float[Array, "lanes states sensors"],
    slope: Float[Array, "lanes values states sensors"],
    data: Data,
) -> Reduced:
    """Residuals of each lane's hypothesis in each recording, with derivatives in theta.

    ``slope`` is how the observer's gain, designed for each theta, changes with it.
    """
    parameters = sum(len(joint.given.parameters) for joint in joints)
    slots = suspects.row.shape[1]

    def one(suspects: Suspects, theta: Array, gain: Array, slope: Array, data: Data) -> Reduced:
        def residual(theta: Array, gain: Array) -> Array:
            values = split(theta, parameters, slots)
            return _weighted(predictor, joints, suspects, values, gain, data)

        def along(one: Array, turned: Array) -> tuple[Array, Array]:
            return jax.jvp(residual, (theta, gain), (one, turned))

        # The residual itself is worked out once for all directions.
        e, J = jax.vmap(along, out_axes=(None, 0))(jnp.eye(theta.shape[0]), slope)
        J = J.reshape(theta.shape[0], -1)
        e = jnp.where(jnp.isfinite(e), e, _BROKEN * (data.weight > 0))
        J = jnp.where(jnp.isfinite(J), J, 0.0)
        return Reduced(e, jnp.sum(e**2), J @ e.ravel(), J @ J.T)

    each = jax.vmap(one, in_axes=(None, 0, None, None, 0))
    return jax.vmap(each, in_axes=(0, 0, 0, 0, None))(suspects, theta, gain, slope, data)


@eqx.filter_jit
def columns(
    predictor: Predictor,
    joints: tuple[Joint, ...],
    suspects: Suspects,
    theta: Float[Array, "lanes recordings values"],
    along: Float[Array, "lanes values"],
    gain: Float[Array, "states sensors"],
    data: Data,
) -> Float[Array, "lanes recordings N sensors"]:
    """Derivatives of the residuals along one direction of each lane's values."""
    parameters = sum(len(joint.given.parameters) for joint in joints)
    slots = suspects.row.shape[1]

    def one(suspects: Suspects, theta: Array, along: Array, data: Data) -> Array:
        def residual(theta: Array) -> Array:
            values = split(theta, parameters, slots)
            return _weighted(predictor, joints, suspects, values, gain, data)

        return jax.jvp(residual, (theta,), (along,))[1]

    each = jax.vmap(one, in_axes=(None, 0, None, 0))
    return jax.vmap(each, in_axes=(0, 0, 0, None))(suspects, theta, along, data)
