"""Compiled kernels: residuals of a hypothesis, their derivatives, what a small suspect changes."""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.discrepancy.effects import PlaceMotion, shipped
from iwanjax.discrepancy.histories.innovations import innovations, motions
from iwanjax.discrepancy.histories.predictor import Data, Predictor, Suspects, Values
from iwanjax.joints import AbstractJoint, ParameterInfo
from iwanjax.kernels import Kept
from iwanjax.signals.comparison_band import in_band
from iwanjax.types import Scalar

# Deviations of the joints' parameters about the values that the model was given: of the
# logarithm of a force, a stiffness and a ratio, and of an exponent.
_DEVIATIONS = {"force": 0.5, "force/length": 0.1, "1": 0.6}
_OTHERWISE, _OF_EXPONENTS = 0.5, 0.2
_SMALLEST = 1e-3
# Distance from a bound, as a share of the range, that a given value is taken to have at least, and
# one that is looked for.
_LEAST, _BORDER = 0.02, 1e-6
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
    return in_band(innovations(predictor, made, suspects, values, gain, data)) * data.weight


def _compiled_in(predictor: Predictor, joints: tuple[Joint, ...], *others: Any) -> str | None:
    """What is in a kernel beside arrays; None with physics of the user's own, which may change."""
    kinds, made = predictor.kinds, [type(joint.given).__module__ for joint in joints]
    if not all(map(shipped, kinds)) or not all(x.startswith("iwanjax.") for x in made):
        return None
    names = [(kind.name, kind.variant) for kind in kinds]
    shape = jax.tree.structure((joints, others))
    return f"{names} {predictor.quantity} {predictor.substeps} {shape}"


def _kept(function: Callable[..., Any]) -> Kept:
    return Kept(function, _compiled_in)


@_kept
def residuals(
    predictor: Predictor,
    joints: tuple[Joint, ...],
    suspects: Suspects,
    theta: Float[Array, "recordings values"],
    gain: Float[Array, "states sensors"],
    data: Data,
) -> tuple[Float[Array, "recordings N sensors"], Float[Array, "recordings N sensors"]]:
    """Weighted residuals of a hypothesis in each recording, and what they are made of."""
    parameters = sum(len(joint.given.parameters) for joint in joints)
    slots = suspects.row.shape[0]

    def one(theta: Array, data: Data) -> tuple[Array, Array]:
        values = split(theta, parameters, slots)
        made = joints_at(joints, values.z)
        found = innovations(predictor, made, suspects, values, gain, data)
        return _whole(in_band(found) * data.weight, data), found

    return jax.vmap(one)(theta, data)


def _whole(e: Array, data: Data) -> Array:
    """Residuals, far from zero where the run broke down."""
    return jnp.where(jnp.abs(e) < _BROKEN, e, _BROKEN * (data.weight > 0))


@_kept
def slopes(
    predictor: Predictor,
    joints: tuple[Joint, ...],
    suspects: Suspects,
    theta: Float[Array, "recordings values"],
    ways: Float[Array, "ways values"],
    gain: Float[Array, "states sensors"],
    turned: Float[Array, "ways states sensors"],
    data: Data,
) -> tuple[Float[Array, "recordings N sensors"], Float[Array, "recordings ways N sensors"]]:
    """Residuals of a hypothesis in each recording, and their derivatives along some ways.

    ``turned`` is how the observer's gain, designed for each theta, changes along them.
    """
    parameters = sum(len(joint.given.parameters) for joint in joints)
    slots = suspects.row.shape[0]

    def one(theta: Array, data: Data) -> tuple[Array, Array]:
        def residual(theta: Array, gain: Array) -> Array:
            values = split(theta, parameters, slots)
            return _weighted(predictor, joints, suspects, values, gain, data)

        def along(way: Array, turned: Array) -> tuple[Array, Array]:
            return jax.jvp(residual, (theta, gain), (way, turned))

        # The residual itself is worked out once for all ways.
        e, J = jax.vmap(along, out_axes=(None, 0))(ways, turned)
        return _whole(e, data), jnp.where(jnp.isfinite(J), J, 0.0)

    return jax.vmap(one)(theta, data)


class Small(NamedTuple):
    """Small forces and faults of sensors, one to a member.

    Attributes
    ----------
    row : (batch, modes) array
        Where the force acts.
    force : (batch, recordings, steps) array
        What it opposes the motion with at the end of each step.
    fault : (batch, 2, sensors) array
        Error of each sensor's gain, and samples that it is late.
    shown : (recordings, 2, N, sensors) array
        What the sensors show, and its change by a delay of one sample.
    """

    row: Float[Array, "batch modes"]
    force: Float[Array, "batch recordings steps"]
    fault: Float[Array, "batch 2 sensors"]
    shown: Float[Array, "recordings 2 N sensors"]


@_kept
def unit_forces(
    predictor: Predictor,
    joints: tuple[Joint, ...],
    suspects: Suspects,
    rows: Float[Array, "places modes"],
    shapes: tuple[Float[Array, "places grid"], ...],
    theta: Float[Array, "recordings values"],
    gain: Float[Array, "states sensors"],
    data: Data,
) -> tuple[Float[Array, "recordings steps places grid"], ...]:
    """Of each kind, the force that it would have at each place if it were of size 1.

    ``suspects`` are those that act already. ``shapes`` has a grid for each of the predictor's
    kinds; a kind with an empty one is left out.
    """
    parameters = sum(len(joint.given.parameters) for joint in joints)
    slots, places = suspects.row.shape[0], rows.shape[0]
    watched = Suspects(
        jnp.concatenate([suspects.row, rows]),
        *(jnp.pad(x, [(0, places), *[(0, 0)] * (x.ndim - 1)]) for x in suspects[1:]),
    )

    def one(theta: Array, data: Data) -> tuple[Array, ...]:
        values = split(theta, parameters, slots)
        made = joints_at(joints, values.z)
        values = values._replace(suspects=jnp.pad(values.suspects, [(0, places), (0, 0)]))
        moved = motions(predictor, made, watched, values, gain, data)
        d, v, a, change = (x[:, slots:, None] for x in (moved.d, moved.v, moved.a, moved.moved))
        at_places = PlaceMotion(d, v, a, change, moved.dt)

        def step(memory: tuple[Array, ...], motion: PlaceMotion) -> tuple[Any, tuple[Array, ...]]:
            found = [
                jnp.broadcast_arrays(*kind.unit_force(motion, shape, kept), shape)[:2]
                for kind, shape, kept in zip(predictor.kinds, shapes, memory, strict=True)
            ]
            return tuple(kept for _, kept in found), tuple(unit for unit, _ in found)

        return jax.lax.scan(step, tuple(jnp.zeros(s.shape) for s in shapes), at_places)[1]

    return jax.vmap(one)(theta, data)


@_kept
def responses(
    predictor: Predictor,
    joints: tuple[Joint, ...],
    suspects: Suspects,
    small: Small,
    theta: Float[Array, "recordings values"],
    gain: Float[Array, "states sensors"],
    data: Data,
) -> tuple[Float[Array, "batch recordings N sensors"]]:
    """What small forces and faults of sensors would change in the residuals."""
    parameters = sum(len(joint.given.parameters) for joint in joints)
    slots = suspects.row.shape[0]

    def one(theta: Array, force: Array, shown: Array, data: Data) -> Array:
        values = split(theta, parameters, slots)

        def residual(push: Array, response: Array) -> Array:
            moved = data._replace(push=push, response=response)
            return _weighted(predictor, joints, suspects, values, gain, moved)

        def along(row: Array, force: Array, fault: Array) -> Array:
            # A sensor that shows more is as one that has measured less.
            moved = (-predictor.pushed(row, force), -jnp.sum(fault[:, None] * shown, axis=0))
            found = jax.jvp(residual, (data.push, data.response), moved)[1]
            # Beyond the end of a shorter recording nothing is compared, whatever happens there.
            return jnp.where(data.weight > 0, found, 0.0)

        return jax.vmap(along)(small.row, force, small.fault)

    each = jax.vmap(one, in_axes=(0, 1, 0, 0), out_axes=1)
    return (each(theta, small.force, small.shown, data),)
