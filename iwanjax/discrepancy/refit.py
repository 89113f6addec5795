"""Fitting joints and suspected forces to recordings, with a memory that grows."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.discrepancy.prediction import Predictor, Suspects
from iwanjax.joints import AbstractJoint, ParameterInfo
from iwanjax.types import ArrayLike

# Deviations of the joints' parameters about the values that the model was given: of the
# logarithm of a force, a stiffness and a ratio, and of an exponent.
_DEVIATIONS = {"force": 0.5, "force/length": 0.1, "1": 0.6}
_OTHERWISE, _OF_EXPONENTS = 0.5, 0.2
_SMALLEST = 1e-3
# Directions of one call for derivatives.
_WIDTH = 8
_MOST_HALVINGS = 10
# Prior deviations beyond which no joint is looked for.
_FARTHEST = 8.0


class Data(NamedTuple):
    """Recordings, side by side.

    Attributes
    ----------
    force : (recordings, N, substeps, inputs) array
        At the ends of the steps that lead to each sample; zero outside its pulses.
    response : (recordings, N, sensors) array
        As measured.
    weight : (recordings, N, sensors) array
        One over the deviation that a residual may have; zero where nothing was measured.
    """

    force: Float[Array, "recordings N substeps inputs"]
    response: Float[Array, "recordings N sensors"]
    weight: Float[Array, "recordings N sensors"]


class Free(NamedTuple):
    """A suspected force that is fitted: which kind, where, and the sizes of a step in it."""

    kind: int
    place: int
    size: float
    shape: bool


@dataclass(frozen=True, eq=False)
class Refit:
    """A model held against recordings.

    Attributes
    ----------
    z : (parameters,) array
        Joint parameters, in prior deviations from those that were given.
    suspects : Suspects
        Sizes and shapes.
    cost : float
        Sum of squared weighted innovations and of ``z``.
    cycles : float
        Memory of the observer; infinity for the free run.
    converged : bool
        Whether the search ended by itself.
    """

    z: np.ndarray
    suspects: Suspects
    cost: float
    cycles: float
    converged: bool


class Joint(NamedTuple):
    """How a joint's parameters follow from z."""

    given: AbstractJoint

    def at(self, z: Array) -> AbstractJoint:
        """The joint at z prior deviations from the given values."""
        values = {
            info.name: _moved(info, getattr(self.given, info.name), z[i])
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


class Search(NamedTuple):
    """What a refit needs: predictor, joints, data, and the sensors' noise for the observer."""

    predictor: Predictor
    joints: tuple[Joint, ...]
    data: Data
    noise: np.ndarray

    @property
    def parameters(self) -> int:
        """Number of joint parameters."""
        return sum(len(joint.given.parameters) for joint in self.joints)

    def none(self) -> Suspects:
        """No suspected force at all."""
        shape = (len(self.predictor.kinds), self.predictor.places.shape[0])
        return Suspects(jnp.zeros(shape), jnp.ones(shape))

    def gain(self, z: np.ndarray, suspects: Suspects, cycles: float) -> Array:
        """The observer's gain, redesigned for these parameters."""
        joints = joints_at(self.joints, z)
        return jnp.asarray(self.predictor.gain(joints, suspects, self.noise, cycles))

    def residuals(self, z: np.ndarray, suspects: Suspects, gain: Array) -> np.ndarray:
        """Weighted innovations, flat."""
        found = _residuals(self.predictor, self.joints, self.data, jnp.asarray(z), suspects, gain)
        return np.asarray(found).ravel()

    def slopes(
        self, z: np.ndarray, suspects: Suspects, gain: Array, along: Sequence[tuple]
    ) -> np.ndarray:
        """Derivatives along directions (z, size, shape), (residuals, directions)."""
        columns = []
        for first in range(0, len(along), _WIDTH):
            some = list(along[first : first + _WIDTH])
            padded = some + [some[-1]] * (_WIDTH - len(some))
            z_dots, size_dots, shape_dots = (
                jnp.asarray(np.stack([each[i] for each in padded])) for i in range(3)
            )
            found = _slopes(
                self.predictor,
                self.joints,
                self.data,
                jnp.asarray(z),
                suspects,
                gain,
                (z_dots, size_dots, shape_dots),
            )
            columns.append(np.asarray(found).reshape(_WIDTH, -1)[: len(some)])
        return np.concatenate(columns).T


def joints_at(joints: tuple[Joint, ...], z: ArrayLike) -> tuple[AbstractJoint, ...]:
    """All joints at z, the parameters of one after the other."""
    z = jnp.asarray(z)
    ends = np.cumsum([len(joint.given.parameters) for joint in joints])
    parts = jnp.split(z, ends[:-1])
    return tuple(joint.at(part) for joint, part in zip(joints, parts, strict=True))


def _weighted(
    predictor: Predictor,
    joints: tuple[Joint, ...],
    data: Data,
    z: Array,
    suspects: Suspects,
    gain: Array,
) -> Array:
    made = joints_at(joints, z)
    each = jax.vmap(lambda f, y: predictor.innovations(made, suspects, gain, f, y))
    found = each(data.force, data.response) * data.weight
    # A run that breaks down is far from the data, not a fault of the search.
    return jnp.where(jnp.isfinite(found), found, 1e6)


_residuals = eqx.filter_jit(_weighted)


@eqx.filter_jit
def _slopes(
    predictor: Predictor,
    joints: tuple[Joint, ...],
    data: Data,
    z: Array,
    suspects: Suspects,
    gain: Array,
    along: tuple[Array, Array, Array],
) -> Array:
    def slope(z_dot: Array, size_dot: Array, shape_dot: Array) -> Array:
        return jax.jvp(
            lambda z, s: _weighted(predictor, joints, data, z, s, gain),
            (z, suspects),
            (z_dot, Suspects(size_dot, shape_dot)),
        )[1]

    return jax.vmap(slope)(*along)


def refit(
    search: Search, start: Refit, cycles: float, free: Sequence[Free] = (), steps: int = 15
) -> Refit:
    """Levenberg-Marquardt in the joints and in the suspected forces, from a start.

    Parameters
    ----------
    search : Search
        Predictor and data.
    start : Refit
        Where to begin; its memory does not matter.
    cycles : float
        Memory of the observer.
    free : sequence of Free
        Suspected forces that move, with their shapes where they have one.
    steps : int
        At most.

    Returns
    -------
    Refit
    """
    z, suspects = start.z, start.suspects
    gain = search.gain(z, suspects, cycles)
    r = search.residuals(z, suspects, gain)
    cost = float(r @ r + z @ z)
    damping, converged = 1e-2, False
    for _ in range(steps):
        along = _directions(search, suspects, free)
        J = search.slopes(z, suspects, gain, along)
        normal, moment = J.T @ J, J.T @ r
        n = z.size
        normal[:n, :n] += np.eye(n)
        moment[:n] += z
        for _ in range(_MOST_HALVINGS):
            scaled = normal + damping * np.diag(np.diag(normal) + 1e-12)
            move = -np.linalg.solve(scaled, moment)
            z_new = z + move[:n]
            if np.max(np.abs(z_new)) > _FARTHEST:
                damping *= 5.0
                continue
            tried = _moved_suspects(search, suspects, along, move)
            gain_new = search.gain(z_new, tried, cycles)
            r_new = search.residuals(z_new, tried, gain_new)
            cost_new = float(r_new @ r_new + z_new @ z_new)
            if cost_new < cost:
                break
            damping *= 5.0
        else:
            converged = True
            break
        gained = cost - cost_new
        z, suspects, gain, r, cost = z_new, tried, gain_new, r_new, cost_new
        damping = max(damping / 5.0, 1e-9)
        if gained < 1e-4 * cost:
            converged = True
            break
    return Refit(z, suspects, cost, cycles, converged)


def _directions(search: Search, suspects: Suspects, free: Sequence[Free]) -> list[tuple]:
    """One for each joint parameter, one for each size and for each shape's logarithm."""
    blank = np.zeros(suspects.size.shape)
    along = [(row, blank, blank) for row in np.eye(search.parameters)]
    for each in free:
        one = blank.copy()
        one[each.kind, each.place] = 1.0
        along.append((np.zeros(search.parameters), each.size * one, blank))
        if each.shape:
            value = float(suspects.shape[each.kind, each.place])
            along.append((np.zeros(search.parameters), blank, value * one))
    return along


def _moved_suspects(
    search: Search, suspects: Suspects, along: list[tuple], move: np.ndarray
) -> Suspects:
    """Sizes moved as they are, shapes by their logarithm; what must be positive stays so."""
    size, shape = np.array(suspects.size), np.array(suspects.shape)
    for (_, size_dot, shape_dot), m in list(zip(along, move, strict=True))[search.parameters :]:
        size = size + m * size_dot
        safe = np.where(shape_dot != 0, shape, 1.0)
        shape = np.where(
            shape_dot != 0, shape * np.exp(np.clip(m * shape_dot / safe, -1, 1)), shape
        )
    for i, kind in enumerate(search.predictor.kinds):
        if kind.positive:
            size[i] = np.maximum(size[i], 0.0)
    return replace_suspects(size, shape)


def replace_suspects(size: np.ndarray, shape: np.ndarray) -> Suspects:
    """Suspects of plain arrays."""
    return Suspects(jnp.asarray(size), jnp.asarray(shape))


def beginning(search: Search, z: np.ndarray | None = None) -> Refit:
    """The model as given, or at other joint parameters, without suspected forces."""
    at = np.zeros(search.parameters) if z is None else z
    return Refit(at, search.none(), np.inf, np.inf, False)
