"""Compiled kernels: residuals of a hypothesis, their derivatives, what a small suspect changes."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwanjax.effects.catalogue import shipped
from iwanjax.identification.innovations import AtSamples, at_samples, innovations, motions
from iwanjax.identification.joint_priors import Joint, joints_at, parameters_of
from iwanjax.identification.predictor import Data, Predictor
from iwanjax.identification.suspects import ParameterMap, Suspects, Values
from iwanjax.joints import PlaceMotion
from iwanjax.kernels import Kept
from iwanjax.signals.comparison_band import in_band

# A run that breaks down is far from the data, not a fault of the search.
_BROKEN = 1e6


def _split(
    predictor: Predictor, joints: tuple[Joint, ...], suspects: Suspects, theta: Array
) -> Values:
    """Values of a theta that belongs to these."""
    at = ParameterMap(predictor.errors + parameters_of(joints))
    return at.split(theta, suspects.row.shape[0])


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
    names += [(fault.name, "") for fault in predictor.faults]
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

    def one(theta: Array, data: Data) -> tuple[Array, Array]:
        values = _split(predictor, joints, suspects, theta)
        made = joints_at(joints, values.z)
        found = innovations(predictor, made, suspects, values, gain, data)
        return _whole(in_band(found) * data.weight, data), found

    return jax.vmap(one)(theta, data)


@_kept
def observed(
    predictor: Predictor,
    joints: tuple[Joint, ...],
    suspects: Suspects,
    theta: Float[Array, "recordings values"],
    gain: Float[Array, "states sensors"],
    data: Data,
) -> AtSamples:
    """Innovations of each recording, with what the suspects' places do meanwhile."""

    def one(theta: Array, data: Data) -> AtSamples:
        values = _split(predictor, joints, suspects, theta)
        return at_samples(predictor, joints_at(joints, values.z), suspects, values, gain, data)

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

    def one(theta: Array, data: Data) -> tuple[Array, Array]:
        def residual(theta: Array, gain: Array) -> Array:
            values = _split(predictor, joints, suspects, theta)
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
    fault : (batch, faults, sensors) array
        Size of each sensor's faults.
    ground : (batch, base) array
        1 where the force is the acceleration of the ground.
    shown : (recordings, faults, N, sensors) array
        Change of what the sensors show by each fault of size 1.
    """

    row: Float[Array, "batch modes"]
    force: Float[Array, "batch recordings steps"]
    fault: Float[Array, "batch faults sensors"]
    ground: Float[Array, "batch base"]
    shown: Float[Array, "recordings faults N sensors"]


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
    slots, places = suspects.row.shape[0], rows.shape[0]
    watched = Suspects(
        jnp.concatenate([suspects.row, rows]),
        *(jnp.pad(x, [(0, places), *[(0, 0)] * (x.ndim - 1)]) for x in suspects[1:]),
    )

    def one(theta: Array, data: Data) -> tuple[Array, ...]:
        values = _split(predictor, joints, suspects, theta)
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

    def one(theta: Array, force: Array, shown: Array, data: Data) -> Array:
        values = _split(predictor, joints, suspects, theta)

        def residual(push: Array, response: Array) -> Array:
            moved = data._replace(push=push, response=response)
            return _weighted(predictor, joints, suspects, values, gain, moved)

        def along(row: Array, force: Array, fault: Array, ground: Array) -> Array:
            # A sensor that shows more is as one that has measured less.
            pushed = predictor.pushed(row, force, ground)
            moved = (-pushed, -jnp.sum(fault[:, None] * shown, axis=0))
            found = jax.jvp(residual, (data.push, data.response), moved)[1]
            # Beyond the end of a shorter recording nothing is compared, whatever happens there.
            return jnp.where(data.weight > 0, found, 0.0)

        return jax.vmap(along)(small.row, force, small.fault, small.ground)

    each = jax.vmap(one, in_axes=(0, 1, 0, 0), out_axes=1)
    return (each(theta, small.force, small.shown, data),)
