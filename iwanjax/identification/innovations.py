"""Innovations: what each sample shows that was not predicted from those before.

A compiled kernel serves every hypothesis: which kind of force acts at which place, or which
sensor is at fault, are arrays, not code.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.dynamics.balance import Joints
from iwanjax.dynamics.parabolic_hold import on, slope_at_end, slopes_at_ends
from iwanjax.effects.kinds import ForceKind
from iwanjax.identification.predictor import Data, Predictor
from iwanjax.identification.suspects import Suspects, Values, sizes_of
from iwanjax.joints import AbstractJoint, PlaceMotion, Reaction
from iwanjax.structures.small import Turned, solve_general, through, turned

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
    corrects, left = turned(gain), predictor.left

    first, last = predictor.joints.shape[0], run.mobility.shape[0]

    def step(at: _State, felt: Array) -> tuple[_State, Any]:
        at, motion = run.step(at, felt)
        return at, (kept(motion, -at.g[first:last]), at.g[:last] if left.number else None)

    def sample(at: _State, measured: tuple[Array, ...]) -> tuple[_State, tuple[Array, Any]]:
        push, beyond, felt, y, kicked = measured
        # A loop, not unrolled: half the time to compile, and no slower.
        at, (motion, forces) = jax.lax.scan(step, at, felt)
        at = at._replace(z=at.z + kicked * kick)
        shown, chain = run.chained(run.seen(at, push) + beyond, at.chain)
        e = jnp.where(there, y - shown, 0.0)
        return at._replace(z=at.z + through(corrects, e), chain=chain), (e, (motion, forces))

    measured = (data.push[:, -1], data.beyond, run.felt, data.response, data.kick)
    e, (motion, forces) = jax.lax.scan(sample, run.rest(), measured)[1]
    if left.number:
        rate = 1.0 / (predictor.dt * predictor.substeps)
        rows = jnp.concatenate([predictor.joints, suspects.row])[:, predictor.kept :]
        # Of forces that are known when all is over: no observer is corrected by it.
        more = left.shown(rows, forces, rate, predictor.quantity, jnp)
        e = e - jnp.where(there, more, 0.0)
    return e, motion


class _State(NamedTuple):
    """Of a run: modes as predicted, late by what the last forces were off, and memories.

    ``g`` holds the forces at the last three steps and what the last of them was off, ``chain``
    what the sensors remember for each of their faults.
    """

    z: Array
    g: Array
    d: Array
    joints: tuple[Any, ...]
    memory: Array
    chain: tuple[Any, ...]


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
    heavy: tuple[tuple[int, Any], ...]
    onward: Turned
    felt: Array
    compliance: Array
    mobility: Array
    ends: Turned
    inertance: Array
    opposed: Array
    spread: Array
    faults: tuple[Any, ...]
    observe: Turned

    @classmethod
    def of(
        cls,
        predictor: Predictor,
        joints: tuple[AbstractJoint, ...],
        suspects: Suspects,
        values: Values,
        push: Array,
    ) -> "_Run":
        # Inertia that followed from deflections would bounce on the flexibility of modes left out.
        parts = [joint.discrete(None).apart() for joint in joints]
        elements = Joints.of(tuple(element for element, _ in parts))
        heavy = tuple((i, masses) for i, (_, masses) in enumerate(parts) if masses is not None)
        if joints:
            own = jnp.stack([joint.initial_stiffness for joint in joints])
            own = jnp.where(predictor.within > 0, own, predictor.stiffness)
            predictor = eqx.tree_at(lambda p: p.stiffness, predictor, own)
        whole = jnp.concatenate([predictor.joints, suspects.row])
        kept = predictor.kept
        rows, left = whole[:, :kept], whole[:, kept:]
        feel = jnp.concatenate([suspects.row, *(predictor.joints[i : i + 1] for i, _ in heavy)])
        new = feel[:, :kept]
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
        last, before, third, _ = jnp.eye(2 * kept + 4 * m)[2 * kept :].reshape(4, m, -1)
        expected = 3.0 * (last - before) + third
        watch = jnp.concatenate(
            [
                jnp.concatenate([rows, none], axis=1),
                jnp.concatenate([none, rows], axis=1),
                jnp.concatenate([-new * predictor.omega2, -on(predictor.C.T, new.T).T], axis=1),
            ]
        )
        inertial, viscous, elastic = (
            suspects.force @ np.array([float(getattr(kind.law, how)) for kind in predictor.kinds])
            for how in ("inertial", "viscous", "elastic")
        )
        n, yielding = len(joints), left * predictor.left.flexibility
        flexibility, inertance = yielding @ left.T, new @ rows.T
        # Modes left out move as fast as forces change. How fast those do that follow from rates,
        # and are corrected as if they did not, is not told: they would chase themselves.
        rate = flexibility * jnp.concatenate([jnp.ones(n), viscous != 0.0])
        speed = rate @ slope_at_end(expected, last, before, predictor.dt)
        at_once = jnp.concatenate([flexibility @ expected, speed, inertance @ expected])
        size = sizes_of(suspects, values.suspects)
        shape = jnp.exp(jnp.clip(values.suspects[:, 1], -80.0, 80.0))
        compliance = rows @ q_late + flexibility
        mobility = rows @ v_late + slope_at_end(rate, 0.0, 0.0, predictor.dt)
        by_own = inertance, mobility[n:], compliance[n:]
        a_own, v_own, d_own = (jnp.diagonal(x[:, n:]) for x in by_own)
        pushed = predictor.parts(push)
        # What has inertia feels the absolute acceleration, though places see the relative motion.
        carried, yields = feel @ predictor.ground.modes, pushed.left @ yielding.T
        felt = jnp.concatenate(
            [
                yields,
                slopes_at_ends(yields, predictor.dt),
                pushed.modal @ new.T + pushed.ground @ carried.T,
            ],
            axis=-1,
        )
        return cls(
            predictor,
            suspects,
            size,
            shape,
            elements,
            heavy,
            turned(jnp.concatenate([modes, expected, watch @ modes + at_once])),
            jnp.concatenate(
                [pushed.state, jnp.zeros((*push.shape[:-1], m)), pushed.state @ watch.T + felt],
                axis=-1,
            ),
            compliance,
            mobility,
            turned(jnp.concatenate([compliance[:n, :n], mobility[:n, :n]])),
            inertance,
            size * (inertial * a_own + viscous * v_own + elastic * d_own),
            jnp.concatenate([jnp.eye(m), jnp.zeros((2 * m, m)), jnp.eye(m)]),
            _set_up(predictor, suspects, size),
            turned(predictor.observation(rows, jnp.concatenate([q_late, v_late]))),
        )

    def rest(self) -> _State:
        """Nothing moves yet."""
        predictor, m = self.by, self.mobility.shape[0]
        # The first sample is taken after the first steps.
        early = self.elements.earlier(self.elements.init(), predictor.dt * predictor.substeps)
        return _State(
            jnp.zeros(2 * predictor.kept),
            jnp.zeros(4 * m),
            jnp.zeros(m),
            early,
            jnp.zeros(self.suspects.force.shape[0]),
            tuple(fault.rest(predictor.sensors.shape[0]) for fault in predictor.faults),
        )

    def step(self, at: _State, felt: Array) -> tuple[_State, PlaceMotion]:
        """Over one step, with what the measured force does over it; and what places do."""
        r, m = self.by.kept, self.mobility.shape[0]
        new = through(self.onward, jnp.concatenate([at.z, at.g])) + felt
        z, expected, d, rate, a = jnp.split(new, np.cumsum([2 * r, m, m, m]))
        n = self.by.joints.shape[0]
        a, carried = jnp.split(a, [m - n])
        motion = PlaceMotion(d[n:], rate[n:], a, d[n:] - at.d[n:], self.by.dt)
        late, joints, memory = self._forces(d[:n], rate[:n], carried, motion, at, expected)
        g = jnp.concatenate([expected, at.g[: 2 * m], jnp.zeros(m)]) + late
        return _State(z, g, d, joints, memory, at.chain), motion

    def _forces(
        self,
        d: Array,
        v: Array,
        carried: Array,
        motion: PlaceMotion,
        at: _State,
        expected: Array,
    ) -> tuple[Array, tuple[Any, ...], Array]:
        """Pseudo-forces less the expected ones, and what joints and suspects remember."""
        predictor, n, m = self.by, self.by.joints.shape[0], self.mobility.shape[0]
        reaction = self.elements.step(d, v, predictor.dt, at.joints)
        off = predictor.stiffness * d - reaction.force - expected[:n]
        stiffness = self._chords(d, reaction, at)
        slope = (predictor.stiffness - stiffness)[:, None] * self.compliance[:n, :n]
        slope = slope - reaction.damping[:, None] * self.mobility[:n, :n]
        J = jnp.eye(n) - slope
        for (i, masses), a, by in zip(self.heavy, carried, self.inertance[m - n :], strict=True):
            off = off.at[i].add(-masses.force(d[i], v[i], a))
            J = J.at[i].add(masses.at(d[i]) * by[:n])
        rows = [[J[i, j] for j in range(n)] for i in range(n)]
        e = jnp.stack(solve_general(rows, list(off))) if n else off
        total, memory = self._suspected(motion, at.memory)
        # The motion holds the expected force already. What a linear force is off that changes the
        # acceleration, the rate or the deflection, and this the force.
        late = (-total - expected[n:]) / (1.0 + self.opposed)
        # As one product: what goes into sums alone a compiler works out again for each of its uses.
        last = self.spread @ jnp.concatenate([e, late])
        # What remembers too early an end turns back from it: at strong slip that would build up.
        late = last[3 * m : 3 * m + n]
        end, rate = jnp.split(through(self.ends, late), 2)
        joints = self.elements.settled(reaction.state, end, rate, stiffness)
        return last, joints, memory

    def _suspected(self, motion: PlaceMotion, memory: Array) -> tuple[Array, Array]:
        """Forces of the suspects, and what their places remember, (slots,) each.

        Of all kinds only that of a slot is worked out.
        """
        kinds, force = self.by.kinds, self.suspects.force
        # Without any kind of force, as where only sensors are suspected, nothing is remembered.
        if not kinds:
            return jnp.zeros_like(self.size), memory

        def of(kind: ForceKind) -> Callable[..., tuple[Array, ...]]:
            def react(motion: PlaceMotion, shape: Array, memory: Array) -> tuple[Array, ...]:
                found = kind.unit_force(motion, shape, memory)
                return tuple(jnp.broadcast_to(x, shape.shape).astype(shape.dtype) for x in found)

            return react

        def slot(_: None, at: tuple[Array, ...]) -> tuple[None, tuple[Array, ...]]:
            which, d, v, a, moved, shape, memory = at
            own = PlaceMotion(d, v, a, moved, motion.dt)
            return None, jax.lax.switch(which, [of(kind) for kind in kinds], own, shape, memory)

        which = jnp.argmax(force != 0.0, axis=1)
        slots = (which, *motion[:4], self.shape, memory)
        unit, memory = jax.lax.scan(slot, None, slots)[1]
        return self.size * jnp.sum(force, axis=1) * unit, memory

    def _chords(self, d: Array, reaction: Reaction, at: _State) -> Array:
        """Stiffnesses from the end of the last step to d.

        Where macroslip begins a tangent jumps, and with it a whole recording by as little as
        the last digit of a parameter: a chord does not, and elsewhere differs to an order that
        does not count. What depends on the rate keeps its tangent.
        """
        n, m = self.by.joints.shape[0], self.mobility.shape[0]
        last = at.d[:n] + through(self.ends, at.g[3 * m : 3 * m + n])[:n]
        moved, risen = d - last, reaction.force - self.by.stiffness * last + at.g[:n]
        least = jnp.maximum(_STILL * jnp.abs(d), _NOTHING)
        known = (jnp.abs(moved) > least) & ~self.elements.by_rate
        chord = risen / jnp.where(known, moved, 1.0)
        # Between stuck and what it is at d: a little way back and forth tells less than that.
        ends = reaction.stiffness, self.by.stiffness
        chord = jnp.clip(chord, jnp.minimum(*ends), jnp.maximum(*ends))
        return jnp.where(known, chord, reaction.stiffness)

    def seen(self, at: _State, push: Array) -> Array:
        """What faultless sensors show."""
        m = self.mobility.shape[0]
        forces = jnp.concatenate([at.g[:m], at.g[3 * m :]])
        shown = through(self.observe, jnp.concatenate([at.z, forces]))
        return shown + self.by.at_once(push, jnp)

    def chained(self, shown: Array, chain: tuple[Any, ...]) -> tuple[Array, tuple[Any, ...]]:
        """What the sensors show of what faultless ones would, and what they then remember."""
        kept = []
        for fault, own, memory in zip(self.by.faults, self.faults, chain, strict=True):
            shown, memory = fault.show(shown, own, memory)
            kept.append(memory)
        return shown, tuple(kept)


def _set_up(predictor: Predictor, suspects: Suspects, size: Array) -> tuple[Any, ...]:
    """The sensors with the suspects' faults."""
    of_sensors = jnp.einsum("s,sfk->fk", size, suspects.chain)
    return tuple(fault.set_up(own) for fault, own in zip(predictor.faults, of_sensors, strict=True))
