"""Predicting recordings from a sample to the next, with suspected forces at every place."""

from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.discrepancy.catalogue import Kind, Motion
from iwanjax.discrepancy.observer import observer_gain
from iwanjax.dynamics.balance import Joints, StepEnd, balance
from iwanjax.dynamics.coordinates import ModalCoordinates, modal_coordinates
from iwanjax.dynamics.propagator import Propagator, propagator
from iwanjax.joints import AbstractJoint
from iwanjax.structures import JointedStructure

Quantity = Literal["acceleration", "velocity", "displacement"]
"""What the sensors measure."""


class Suspects(NamedTuple):
    """Sizes and shapes of every kind of force at every place; sizes of zero are no force.

    Attributes
    ----------
    size, shape : (kinds, places) array
        As the catalogue's kinds define them.
    """

    size: Float[Array, "kinds places"]
    shape: Float[Array, "kinds places"]


class _State(NamedTuple):
    q: Array
    v: Array
    f: Array
    g: Array
    g_before: Array
    joints: tuple[Any, ...]
    extra: Array
    d: Array
    memory: Array


class Predictor(eqx.Module):
    """A structure's response to measured forces, corrected by what was measured before.

    All kinds of forces act at all places, with sizes that are zero unless told otherwise: one
    compiled kernel serves every hypothesis, and derivatives with respect to a size at zero are
    what a hypothesis would change.

    Attributes
    ----------
    modal : ModalCoordinates
        Modes about the starting joints.
    by : Propagator
        Of one of ``substeps`` steps between samples.
    places : (places, modes) array
        Rows where forces may be missing.
    push : two (modes, places) arrays
        What a unit of them at the end of a step does.
    dt : array
        Step, s.
    kinds : tuple of Kind
        Of the suspects.
    """

    modal: ModalCoordinates
    by: Propagator
    places: Float[Array, "places modes"]
    push: tuple[Array, Array]
    dt: Array
    kinds: tuple[Kind, ...] = eqx.field(static=True)
    quantity: Quantity = eqx.field(static=True)
    substeps: int = eqx.field(static=True)

    def innovations(
        self,
        joints: tuple[AbstractJoint, ...],
        suspects: Suspects,
        gain: Float[Array, "states sensors"],
        force: Float[Array, "N substeps inputs"],
        response: Float[Array, "N sensors"],
    ) -> Float[Array, "N sensors"]:
        """Measured less predicted at each sample, from rest; the first one is zero.

        ``force`` is given at the ends of the steps that lead to each sample; ``gain`` of zeros
        is the free run.
        """
        modal, by = self.modal, self.by
        discrete = Joints.of(tuple(joint.discrete(None) for joint in joints))
        q_g, v_g = by.last(modal.P.T)
        G, H = modal.P @ q_g, modal.P @ v_g
        half = modal.omega2.shape[0]

        def step(at: _State, f: Array) -> _State:
            p = modal.W @ at.f + modal.P.T @ at.g - self.places.T @ at.extra
            q, v = by.free(at.q, at.v, p, modal.W @ f)
            # Suspected forces by their last value: a step changes little of them.
            motion = self._motion(q, v, f, at)
            extra, memory = self._forces(suspects, motion, at.memory)
            q, v = q - self.push[0] @ extra, v - self.push[1] @ extra
            end = StepEnd(
                discrete, at.joints, modal.P @ q, modal.P @ v, G, H, modal.stiffness, self.dt
            )
            g = balance(2.0 * at.g - at.g_before, end)
            reaction = end.react(g)
            q, v = q + q_g @ g, v + v_g @ g
            return _State(q, v, f, g, at.g, reaction.state, extra, self.places @ q, memory)

        def sample(at: _State, measured: tuple[Array, Array]) -> tuple[_State, Array]:
            f, y = measured
            for k in range(self.substeps):
                at = step(at, f[k])
            e = y - self._seen(at)
            return at._replace(q=at.q + gain[:half] @ e, v=at.v + gain[half:] @ e), e

        rest = jnp.zeros(half)
        none, places = jnp.zeros(discrete.count), jnp.zeros(self.places.shape[0])
        memory = jnp.zeros((len(self.kinds), self.places.shape[0]))
        start = _State(
            rest, rest, force[0, -1], none, none, discrete.init(), places, places, memory
        )
        e = jax.lax.scan(sample, start, (force[1:], response[1:]))[1]
        return jnp.concatenate([jnp.zeros_like(e[:1]), e])

    def gain(
        self,
        joints: tuple[AbstractJoint, ...],
        suspects: Suspects,
        noise: np.ndarray,
        cycles: float,
    ) -> np.ndarray:
        """Observer gain for these joints and linear suspects, about vanishing amplitude."""
        modal = self.modal
        P, rows = np.asarray(modal.P), np.asarray(self.places)
        softer = np.array([float(j.initial_stiffness) for j in joints]) - np.asarray(
            modal.stiffness
        )
        size = {kind.name: np.asarray(suspects.size)[i] for i, kind in enumerate(self.kinds)}
        zero = np.zeros(rows.shape[0])
        r = rows.shape[1]
        K = np.diag(modal.omega2) + (P.T * softer) @ P
        K = K + (rows.T * size.get("stiffness_error", zero)) @ rows
        C = np.asarray(modal.C) if modal.C.ndim == 2 else np.diag(modal.C)
        C = C + (rows.T * size.get("viscous_damping", zero)) @ rows
        M = np.eye(r) + (rows.T * size.get("mass_error", zero)) @ rows
        lower = np.linalg.solve(M, np.hstack([-K, -C]))
        A = np.vstack([np.hstack([np.zeros((r, r)), np.eye(r)]), lower])
        Y = np.asarray(modal.Y)
        blank = np.zeros_like(Y)
        seen = {
            "displacement": np.hstack([Y, blank]),
            "velocity": np.hstack([blank, Y]),
            "acceleration": Y @ lower,
        }[self.quantity]
        return observer_gain(A, seen, noise, float(self.dt) * self.substeps, cycles)

    def _motion(self, q: Array, v: Array, f: Array, at: _State) -> Motion:
        modal = self.modal
        p = modal.W @ f + modal.P.T @ at.g - self.places.T @ at.extra
        d = self.places @ q
        return Motion(
            d, self.places @ v, self.places @ self._acceleration(q, v, p), d - at.d, self.dt
        )

    def _forces(self, suspects: Suspects, motion: Motion, memory: Array) -> tuple[Array, Array]:
        """Sum of all suspected forces at each place, and what they remember."""
        total, kept = jnp.zeros(self.places.shape[0]), []
        for i, kind in enumerate(self.kinds):
            unit, after = kind.unit_force(motion, suspects.shape[i], memory[i])
            total = total + suspects.size[i] * unit
            kept.append(after)
        return total, jnp.stack(kept)

    def _acceleration(self, q: Array, v: Array, p: Array) -> Array:
        modal = self.modal
        lost = modal.C @ v if modal.C.ndim == 2 else modal.C * v
        return p - lost - modal.omega2 * q

    def _seen(self, at: _State) -> Array:
        modal = self.modal
        if self.quantity == "displacement":
            return modal.Y @ at.q
        if self.quantity == "velocity":
            return modal.Y @ at.v
        p = modal.W @ at.f + modal.P.T @ at.g - self.places.T @ at.extra
        return modal.Y @ self._acceleration(at.q, at.v, p)


def predictor(
    structure: JointedStructure,
    places: Array,
    inputs: Array,
    sensors: Array,
    sampling_rate: float,
    quantity: Quantity,
    kinds: tuple[Kind, ...],
    substeps: int,
) -> Predictor:
    """The predictor of a structure.

    Parameters
    ----------
    structure : JointedStructure
        With its joints at their starting values.
    places, inputs, sensors : (rows, n) array
        Where forces may be missing, forces act, and sensors are.
    sampling_rate : float
        Hz.
    quantity : {"acceleration", "velocity", "displacement"}
        What the sensors measure.
    kinds : tuple of Kind
        What may be missing.
    substeps : int
        Steps between samples.
    """
    modal = modal_coordinates(structure, inputs, sensors, None)
    dt = jnp.asarray(1.0 / (sampling_rate * substeps))
    by = propagator(modal.omega2, modal.C, dt, "exact")
    rows = places @ modal.Phi
    return Predictor(
        modal,
        by,
        rows,
        by.last(rows.T),
        dt,
        kinds,
        quantity,
        substeps,
    )
