"""Innovations: what each sample shows that was not predicted from those before.

A compiled kernel serves every hypothesis: which kind of force acts at which place, or which
sensor is at fault, are arrays, not code.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.dynamics.balance import Joints
from iwanjax.dynamics.parabolic_hold import on
from iwanjax.identification.predictor import Data, Predictor, Suspects, Values, sizes_of
from iwanjax.joints import AbstractJoint, PlaceMotion, Reaction
from iwanjax.structures.small import solve_general

DELAY_NODES = 16
"""Samples that a delayed sensor is interpolated from: the last ones, as no later ones are known."""
LONGEST_DELAY = 4.0
"""Samples by which a sensor may be late."""
# Bands from zero, as shares of the sampling rate, and what errors of an interpolation weigh in
# them: structures move most at low frequencies, and recordings are compared up to the last one.
# Beyond it only the weights' own size counts, little.
_BANDS, _OWN = ((0.06, 1e4), (0.14, 1e2), (0.24, 1e1), (0.35, 1.0)), 1e-8


def chain(suspects: Suspects, size: Array, shape: Array) -> tuple[Array, Array]:
    """Weights of the last samples in what each sensor shows, and the largest that it can."""
    gain, delay = (jnp.sum(size[:, None] * suspects.chain[:, i], axis=0) for i in range(2))
    weight = _delayed(jnp.clip(delay, 0.0, LONGEST_DELAY))
    largest = jnp.sum(shape[:, None] * suspects.chain[:, 2], axis=0)
    return (1.0 + gain) * weight, jnp.where(largest > 0, largest, jnp.inf)


def _delayed(late: Array) -> Array:
    """Weights of the last samples in one that is late by so many, (nodes, ...).

    Of least squared error at all frequencies of the bands: a polynomial through the nodes, exact
    at low ones, is off by a fifth at a quarter of the sampling rate, as the delayed sample lies at
    the nodes' end. Without delay the last sample itself.
    """
    none = np.eye(DELAY_NODES)[0].reshape(-1, *[1] * late.ndim)
    change = _matched(late) - _matched(jnp.zeros_like(late))
    return none + jnp.tensordot(_SOLVED, change, axes=1)


def _matched(late: Array) -> Array:
    """What the bands have in common with each node of a signal that is late, (nodes, ...)."""
    apart = np.arange(DELAY_NODES).reshape(-1, *[1] * late.ndim) - late
    parts = [weight * 2.0 * end * jnp.sinc(2.0 * end * apart) for end, weight in _BANDS]
    return sum(parts[1:], parts[0])


def _nodes_in_common() -> np.ndarray:
    """The same for the nodes themselves, inverted, (nodes, nodes)."""
    apart = np.subtract.outer(np.arange(DELAY_NODES), np.arange(DELAY_NODES))
    common = sum(weight * 2.0 * end * np.sinc(2.0 * end * apart) for end, weight in _BANDS)
    return np.linalg.inv(common + _OWN * np.eye(DELAY_NODES))


_SOLVED = _nodes_in_common()


def change_by_delay(shown: Float[np.ndarray, "recordings N sensors"]) -> np.ndarray:
    """What sensors would show more for each sample that they are late, from rest."""
    slopes = np.asarray(jax.jacfwd(_delayed)(jnp.zeros(())))
    early = np.pad(shown, [(0, 0), (DELAY_NODES - 1, 0), (0, 0)])
    length = shown.shape[1]
    first = DELAY_NODES - 1
    return sum(
        (slope * early[:, first - j : first - j + length] for j, slope in enumerate(slopes)),
        np.zeros_like(shown),
    )


# Of a deflection: a smaller change of it says nothing of a stiffness; nor does one whose square,
# by which a derivative divides, is no number any more (after 1400 silent cycles, say).
_STILL, _NOTHING = 1e-6, 1e-150


def innovations(
    predictor: Predictor,
    joints: tuple[AbstractJoint, ...],
    suspects: Suspects,
    values: Values,
    gain: Float[Array, "states sensors"],
    data: Data,
) -> Float[Array, "N sensors"]:
    """Measured less predicted at each sample of one recording, from rest.

    ``gain`` of zeros is the free run.
    """
    return _run(predictor, joints, suspects, values, gain, data, lambda *_: None)[0]


def motions(
    predictor: Predictor,
    joints: tuple[AbstractJoint, ...],
    suspects: Suspects,
    values: Values,
    gain: Float[Array, "states sensors"],
    data: Data,
) -> PlaceMotion:
    """What the suspects' places do meanwhile, (N substeps, slots); dt for each step."""
    motion = _run(predictor, joints, suspects, values, gain, data, lambda motion, _: motion)[1]
    return PlaceMotion(*(x.reshape(-1, *x.shape[2:]) for x in motion))


class AtSamples(NamedTuple):
    """A run, at each sample.

    Attributes
    ----------
    e : (N, sensors) array
        Innovations.
    d, v, a : (N, slots) array
        Deflections, rates and accelerations of the suspects' places, as predicted.
    force : (N, slots) array
        What the suspects oppose them with.
    """

    e: Float[Array, "N sensors"]
    d: Float[Array, "N slots"]
    v: Float[Array, "N slots"]
    a: Float[Array, "N slots"]
    force: Float[Array, "N slots"]


def at_samples(
    predictor: Predictor,
    joints: tuple[AbstractJoint, ...],
    suspects: Suspects,
    values: Values,
    gain: Float[Array, "states sensors"],
    data: Data,
) -> AtSamples:
    """Innovations, with what the suspects' places do and the suspects do to them."""
    e, (motion, force) = _run(
        predictor, joints, suspects, values, gain, data, lambda motion, force: (motion, force)
    )
    d, v, a, force = (x[:, -1] for x in (motion.d, motion.v, motion.a, force))
    return AtSamples(e, d, v, a, force)


def _run(
    predictor: Predictor,
    joints: tuple[AbstractJoint, ...],
    suspects: Suspects,
    values: Values,
    gain: Array,
    data: Data,
    kept: Callable[[PlaceMotion, Array], Any],
) -> tuple[Array, Any]:
    """Innovations, and what is kept of the places' motion and the suspects' forces at each step."""
    predictor = predictor.with_errors(values.z)
    run = _Run.of(predictor, joints, suspects, values, data.push)
    kick = data.unsure @ values.state
    # A sensor that this recording lacks corrects nothing.
    there = jnp.any(data.weight > 0, axis=0)

    def step(at: _State, felt: Array) -> tuple[_State, Any]:
        at, motion = run.step(at, felt)
        first, last = predictor.joints.shape[0], run.mobility.shape[0]
        return at, kept(motion, -at.g[first:last])

    def sample(at: _State, measured: tuple[Array, ...]) -> tuple[_State, tuple[Array, Any]]:
        push, felt, y, kicked = measured
        # A loop, not unrolled: half the time to compile, and no slower.
        at, motion = jax.lax.scan(step, at, felt)
        at = at._replace(z=at.z + kicked * kick)
        seen = jnp.concatenate([run.seen(at, push), at.seen[:-1]])
        e = jnp.where(there, y - run.chained(seen), 0.0)
        return at._replace(z=at.z + gain @ e, seen=seen), (e, motion)

    measured = (data.push[:, -1], run.felt, data.response, data.kick)
    return jax.lax.scan(sample, run.rest(), measured)[1]


class _State(NamedTuple):
    """Of a run: modes as predicted, late by what the last forces were off, and memories.

    ``g`` holds the forces at the last three steps and what the last of them was off.
    """

    z: Array
    g: Array
    d: Array
    joints: tuple[Any, ...]
    memory: Array
    seen: Array


class _Run(NamedTuple):
    """Everything of a run that does not change from step to step.

    One matrix takes modes and forces to the end of a step: to the modes there, the forces
    expected, and the deflections, rates and accelerations that the places see.
    """

    by: Predictor
    suspects: Suspects
    size: Array
    shape: Array
    elements: Joints
    onward: Array
    felt: Array
    compliance: Array
    mobility: Array
    inertance: Array
    sensed_by: Array
    largest: Array
    observe: Array

    @classmethod
    def of(
        cls,
        predictor: Predictor,
        joints: tuple[AbstractJoint, ...],
        suspects: Suspects,
        values: Values,
        push: Array,
    ) -> "_Run":
        elements = Joints.of(tuple(joint.discrete(None) for joint in joints))
        whole = jnp.concatenate([predictor.joints, suspects.row])
        kept = predictor.kept
        rows, left = whole[:, :kept], whole[:, kept:]
        new = suspects.row[:, :kept]
        by = predictor.by
        q = [on(b, rows.T) for b in by.q_by]
        v = [on(b, rows.T) for b in by.v_by]
        # A force that ends e off what was extrapolated is (s + s^2)/2 e off on the way.
        q_late, v_late = 0.5 * (q[1] + q[2]), 0.5 * (v[1] + v[2])
        q_on, v_on = by.free(q_late, v_late)
        # Parabolas through the last three values: what multiplies each of them.
        through = ((1.0, 1.5, 0.5), (0.0, -2.0, -1.0), (0.0, 0.5, 0.5))
        q_from, v_from = (
            [sum(c * b for c, b in zip(row, x, strict=True)) for row in through] for x in (q, v)
        )
        m, none = rows.shape[0], jnp.zeros_like(rows)
        eye, blank = jnp.eye(kept), jnp.zeros((kept, kept))
        (q_q, q_v), (v_q, v_v) = by.free(eye, blank), by.free(blank, eye)
        modes = jnp.concatenate(
            [
                jnp.concatenate([q_q, v_q, *q_from, q_on], axis=1),
                jnp.concatenate([q_v, v_v, *v_from, v_on], axis=1),
            ]
        )
        one, nil = jnp.eye(m), jnp.zeros((m, m))
        expected = jnp.concatenate(
            [jnp.zeros((m, 2 * kept)), 3.0 * one, -3.0 * one, one, nil], axis=1
        )
        watch = jnp.concatenate(
            [
                jnp.concatenate([rows, none], axis=1),
                jnp.concatenate([none, rows], axis=1),
                jnp.concatenate([-new * predictor.omega2, -on(predictor.C.T, new.T).T], axis=1),
            ]
        )
        flexibility = (left * predictor.left) @ left.T
        inertance = new @ rows.T
        at_once = jnp.concatenate([flexibility, nil, inertance]) @ expected
        size = sizes_of(suspects, values.suspects)
        shape = jnp.exp(jnp.clip(values.suspects[:, 1], -80.0, 80.0))
        pushed = push[..., : 2 * kept]
        felt = jnp.concatenate(
            [
                push[..., 3 * kept :] @ (left * predictor.left).T,
                jnp.zeros((*push.shape[:-1], m)),
                push[..., 2 * kept : 3 * kept] @ new.T,
            ],
            axis=-1,
        )
        return cls(
            predictor,
            suspects,
            size,
            shape,
            elements,
            jnp.concatenate([modes, expected, watch @ modes + at_once]),
            jnp.concatenate(
                [pushed, jnp.zeros((*push.shape[:-1], m)), pushed @ watch.T + felt], axis=-1
            ),
            rows @ q_late + flexibility,
            rows @ v_late,
            inertance,
            *chain(suspects, size, shape),
            predictor.observation(rows, jnp.concatenate([q_late, v_late])),
        )

    def rest(self) -> _State:
        """Nothing moves yet."""
        predictor, m = self.by, self.mobility.shape[0]
        return _State(
            jnp.zeros(2 * predictor.kept),
            jnp.zeros(4 * m),
            jnp.zeros(m),
            self.elements.init(),
            jnp.zeros(self.suspects.force.shape),
            jnp.zeros((DELAY_NODES, predictor.sensors.shape[0])),
        )

    def step(self, at: _State, felt: Array) -> tuple[_State, PlaceMotion]:
        """Over one step, with what the measured force does over it; and what places do."""
        r, m = self.by.kept, self.mobility.shape[0]
        new = self.onward @ jnp.concatenate([at.z, at.g]) + felt
        z, expected, d, rate, a = jnp.split(new, np.cumsum([2 * r, m, m, m]))
        n = self.by.joints.shape[0]
        motion = PlaceMotion(d[n:], rate[n:], a, d[n:] - at.d[n:], self.by.dt)
        e, joints, memory = self._forces(d[:n], rate[:n], motion, at, expected)
        g = jnp.concatenate([expected + e, at.g[: 2 * m], e])
        return _State(z, g, d, joints, memory, at.seen), motion

    def _forces(
        self, d: Array, v: Array, motion: PlaceMotion, at: _State, expected: Array
    ) -> tuple[Array, tuple[Any, ...], Array]:
        """Pseudo-forces less the expected ones, and what joints and suspects remember."""
        predictor, n = self.by, self.by.joints.shape[0]
        reaction = self.elements.step(d, v, predictor.dt, at.joints)
        off = predictor.stiffness * d - reaction.force - expected[:n]
        stiffness = self._chords(d, reaction, at)
        slope = (predictor.stiffness - stiffness)[:, None] * self.compliance[:n, :n]
        slope = slope - reaction.damping[:, None] * self.mobility[:n, :n]
        J = jnp.eye(n) - slope
        rows = [[J[i, j] for j in range(n)] for i in range(n)]
        e = jnp.stack(solve_general(rows, list(off))) if n else off
        total, inertia, memory = jnp.zeros_like(self.size), jnp.zeros_like(self.size), []
        for i, kind in enumerate(predictor.kinds):
            unit, state = kind.unit_force(motion, self.shape, at.memory[:, i])
            total = total + self.size * self.suspects.force[:, i] * unit
            if kind.inertial:
                own = jnp.diagonal(self.inertance[:, n:])
                inertia = inertia + self.size * self.suspects.force[:, i] * own
            memory.append(state)
        # The acceleration holds the expected force already, which an inertia acts back on.
        late = (-total - expected[n:]) / (1.0 + inertia)
        # What remembers too early an end turns back from it: at strong slip that would build up.
        by = self.compliance[:n, :n] @ e
        joints = self.elements.settled(reaction.state, by, stiffness)
        # Without any kind of force, as where only sensors are suspected, nothing is remembered.
        kept = jnp.stack(memory, axis=1) if memory else at.memory
        return jnp.concatenate([e, late]), joints, kept

    def _chords(self, d: Array, reaction: Reaction, at: _State) -> Array:
        """Stiffnesses from the end of the last step to d.

        Where macroslip begins a tangent jumps, and with it a whole recording by as little as
        the last digit of a parameter: a chord does not, and elsewhere differs to an order that
        does not count. What depends on the rate keeps its tangent.
        """
        n, m = self.by.joints.shape[0], self.mobility.shape[0]
        last = at.d[:n] + self.compliance[:n, :n] @ at.g[3 * m : 3 * m + n]
        moved, risen = d - last, reaction.force - self.by.stiffness * last + at.g[:n]
        least = jnp.maximum(_STILL * jnp.abs(d), _NOTHING)
        known = (jnp.abs(moved) > least) & (reaction.damping == 0.0)
        chord = risen / jnp.where(known, moved, 1.0)
        # Between stuck and what it is at d: a little way back and forth tells less than that.
        ends = reaction.stiffness, self.by.stiffness
        chord = jnp.clip(chord, jnp.minimum(*ends), jnp.maximum(*ends))
        return jnp.where(known, chord, reaction.stiffness)

    def seen(self, at: _State, push: Array) -> Array:
        """What faultless sensors show."""
        predictor, r, m = self.by, self.by.kept, self.mobility.shape[0]
        forces = jnp.concatenate([at.g[:m], at.g[3 * m :]])
        shown = self.observe @ jnp.concatenate([at.z, forces])
        if predictor.quantity == "acceleration":
            shown = shown + predictor.sensors @ push[2 * r : 3 * r]
        return shown[None]

    def chained(self, seen: Array) -> Array:
        """What the sensors show, from the last samples of what faultless ones would."""
        shown = jnp.sum(self.sensed_by * seen, axis=0)
        return jnp.clip(shown, -self.largest, self.largest)
