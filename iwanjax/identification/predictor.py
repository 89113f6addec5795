"""What predicts recordings from a sample to the next: modes, places of joints, sensors, forces."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.dynamics.coordinates import ModalCoordinates, modal_coordinates
from iwanjax.dynamics.parabolic_hold import MOST, Hold, hold, on
from iwanjax.effects.catalogue import FAULTS, sensor_faults_of
from iwanjax.effects.faults import AbstractSensorFault
from iwanjax.effects.kinds import ForceKind
from iwanjax.errors import InputError
from iwanjax.identification.ground import Ground, Pushed, ground_of
from iwanjax.identification.modes_left_out import ModesLeftOut, Quantity, modes_left_out
from iwanjax.identification.suspects import Suspects
from iwanjax.signals.comparison_band import END
from iwanjax.structures import JointedStructure, LinearTrust

# Modes beyond this share of the sampling rate act by their flexibility.
_HIGHEST = 0.6


class Data(NamedTuple):
    """Recordings, side by side.

    Attributes
    ----------
    push : (recordings, N, substeps, states) array
        What the forces do over each step that leads to a sample: to q, to v, their modal
        forces at its end, those of the modes left out, and the acceleration of the ground.
    beyond : (recordings, N, sensors) array
        What the sensors show of what the forces do to the modes left out.
    response : (recordings, N, sensors) array
        As measured; zero for a sensor that a recording lacks.
    weight : (recordings, N, sensors) array
        One over the deviation that a residual may have in the band that is compared; zero
        where nothing was measured.
    kick : (recordings, N) array
        One at the sample where the state is uncertain.
    unsure : (recordings, 2 kept, directions) array
        By how much, and along which directions.
    """

    push: Float[Array, "recordings N substeps states"]
    beyond: Float[Array, "recordings N sensors"]
    response: Float[Array, "recordings N sensors"]
    weight: Float[Array, "recordings N sensors"]
    kick: Float[Array, "recordings N"]
    unsure: Float[Array, "recordings states directions"]


class Predictor(eqx.Module):
    r"""A structure's response to measured forces, corrected by what was measured before.

    Modes are exact; forces of joints and suspects are parabolas over a step. They are
    extrapolated from their last three values, evaluated where that leads, and corrected by one
    Newton step with the joints' chords: third order, one evaluation a step.

    Attributes
    ----------
    omega2, C : arrays
        Of the modes that move.
    joints : (joints, modes) array
        Their rows on all modes.
    sensors : (sensors, kept) array
        What the sensors see of the modes that move.
    left : ModesLeftOut
        The others, by whose flexibilities joints yield at once.
    stiffness : (joints,) array
        Reference stiffness of the joints.
    within : (joints,) array
        1 where K holds a joint's own stiffness at rest, which is its reference then.
    by : Hold
        Over one step.
    dt : array
        Step, s.
    uncertain : (2, modes) array
        Prior deviations of the logarithms of the first natural frequencies and modal dampings:
        how far the linear model is trusted. No column where it is taken to be exact.
    rows : tuple of int
        Which of its two rows are fitted: not one that is zero.
    shape_error : array
        Share of a channel's root mean square that errors of the mode shapes may leave.
    faults : tuple of AbstractSensorFault
        What may be wrong with a sensor, in the order of its measurement chain.
    ground : Ground
        What moves with the ground.
    """

    omega2: Float[Array, " kept"]
    C: Float[Array, "*kept"]
    joints: Float[Array, "joints modes"]
    sensors: Float[Array, "sensors kept"]
    left: ModesLeftOut
    stiffness: Float[Array, " joints"]
    within: Float[Array, " joints"]
    by: Hold
    dt: Array
    uncertain: Float[Array, "2 modes"]
    shape_error: Array
    ground: Ground
    rows: tuple[int, ...] = eqx.field(static=True)
    kinds: tuple[ForceKind, ...] = eqx.field(static=True)
    faults: tuple[AbstractSensorFault, ...] = eqx.field(static=True)
    quantity: Quantity = eqx.field(static=True)
    substeps: int = eqx.field(static=True)

    @property
    def kept(self) -> int:
        """Number of modes that move."""
        return self.omega2.shape[0]

    @property
    def rate(self) -> float:
        """Sampling rate, Hz."""
        return 1.0 / (float(self.dt) * self.substeps)

    @property
    def errors(self) -> int:
        """Number of errors of the linear model that are fitted."""
        return len(self.rows) * self.uncertain.shape[1]

    def of_modes(self, z: Array | np.ndarray, xp: Any = np) -> Array:
        """What the first of z are for each mode's frequency and damping, (2, modes).

        Zero for what is not fitted.
        """
        own = iter(z[: self.errors].reshape(len(self.rows), -1) if self.rows else ())
        none = xp.zeros(self.uncertain.shape[1])
        return xp.stack([next(own) if row in self.rows else none for row in range(2)])

    def modes_at(self, z: Array | np.ndarray, xp: Any = np) -> tuple[Array, Array]:
        """Squared frequencies and damping with errors of so many deviations, the first of z.

        Parameters
        ----------
        z : (parameters,) array
            As in :class:`Values`.
        xp : module
            ``jax.numpy`` within a kernel.
        """
        there = xp.exp(xp.asarray(self.uncertain) * self.of_modes(z, xp))
        exact = xp.ones((2, self.kept - there.shape[1]))
        frequency, damping = xp.concatenate([there, exact], axis=1)
        omega2, C, root = xp.asarray(self.omega2), xp.asarray(self.C), xp.sqrt(damping)
        C = root[:, None] * C * root if C.ndim == 2 else C * damping
        return omega2 * frequency**2, C

    def with_errors(self, z: Float[Array, " parameters"]) -> "Predictor":
        """The same with errors of the modes; shapes are as they are."""
        if not self.errors:
            return self
        omega2, C = self.modes_at(z, jnp)
        return eqx.tree_at(
            lambda p: (p.omega2, p.C, p.by), self, (omega2, C, hold(omega2, C, self.dt, jnp))
        )

    def blank(self, slots: int = 1) -> Suspects:
        """No suspects in so many slots."""
        modes, sensors = self.joints.shape[1], self.sensors.shape[0]
        row, force = np.zeros((slots, modes)), np.zeros((slots, len(self.kinds)))
        chain, logarithmic = np.zeros((slots, len(self.faults), sensors)), np.zeros(slots)
        return Suspects(*jax.device_put((row, force, chain, logarithmic)))

    def pushed(
        self, row: Float[Array, " modes"], force: Float[Array, " steps"], ground: Array
    ) -> Float[Array, "N substeps states"]:
        """What a force at a place, known at the end of each step, does as a push of the data.

        ``ground``, (base,), is 1 where that is the acceleration of the ground.
        """
        now, last, before = force, jnp.roll(force, 1).at[0].set(0.0), jnp.roll(force, 2)
        before = before.at[:2].set(0.0)
        through = (last, 0.5 * (now - before), 0.5 * (now + before) - last)
        kept, left = row[: self.kept], row[self.kept :]
        q, v = (
            sum(jnp.outer(c, on(b, kept)) for c, b in zip(through, each, strict=True))
            for each in (self.by.q_by, self.by.v_by)
        )
        at_end = (jnp.outer(now, each) for each in (kept, left, ground))
        made = jnp.concatenate([q, v, *at_end], axis=1)
        return made.reshape(-1, self.substeps, made.shape[1])

    def parts(self, push: Array | np.ndarray) -> Pushed:
        """What a push of the data consists of."""
        r, left = self.kept, self.left.number
        a, b, c = 2 * r, 3 * r, 3 * r + left
        return Pushed(push[..., :a], push[..., a:b], push[..., b:c], push[..., c:])

    def at_once(self, push: Array | np.ndarray, xp: Any = np) -> Array:
        """What the sensors show of the forces at the end of a step before anything moves.

        Parameters
        ----------
        push : (..., states) array
            As in :class:`Data`.
        xp : module
            ``jax.numpy`` within a kernel.

        Returns
        -------
        (..., sensors) array
            Zero but for accelerations.
        """
        if self.quantity != "acceleration":
            return xp.zeros((*push.shape[:-1], self.sensors.shape[0]))
        made = self.parts(push)
        carried = made.ground @ xp.asarray(self.ground.sensors).T
        return made.modal @ xp.asarray(self.sensors).T + carried

    def observation(self, rows: Array, late: Array) -> Array:
        """What sensors see of modes, forces, and how far the last forces were off."""
        Y, none = self.sensors, jnp.zeros_like(self.sensors)
        of_forces = jnp.zeros((Y.shape[0], rows.shape[0]))
        if self.quantity == "displacement":
            of_modes = jnp.concatenate([Y, none], axis=1)
        elif self.quantity == "velocity":
            of_modes = jnp.concatenate([none, Y], axis=1)
        else:
            of_modes = jnp.concatenate([-Y * self.omega2, -on(self.C.T, Y.T).T], axis=1)
            of_forces = Y @ rows.T
        return jnp.concatenate([of_modes, of_forces, of_modes @ late], axis=1)

    def linear(
        self,
        stiffness: np.ndarray,
        suspects: Suspects,
        sizes: np.ndarray,
        z: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """State matrix and what the sensors see, about vanishing amplitude.

        Parameters
        ----------
        stiffness : (joints,) array
            Tangents of the joints.
        suspects : Suspects
            Of which those that are linear count.
        sizes : (slots,) array
            In their units.
        z : (parameters,) array, optional
            Whose errors the modes have; none without it.
        """
        r = self.kept
        P = np.asarray(self.joints)[:, :r]
        softer = np.where(np.asarray(self.within) > 0, 0.0, stiffness - np.asarray(self.stiffness))
        omega2, C = self.modes_at(np.zeros(self.errors) if z is None else z)
        lower = np.hstack(
            [
                -np.diag(omega2)
                - (P.T * softer) @ P
                - self._of("stiffness_error", suspects, sizes),
                -(C if C.ndim == 2 else np.diag(C)) - self._of("viscous_damping", suspects, sizes),
            ]
        )
        lower = np.linalg.solve(self._inertia(suspects, sizes), lower)
        A = np.vstack([np.hstack([np.zeros((r, r)), np.eye(r)]), lower])
        Y = self._shown(suspects, sizes)
        blank = np.zeros_like(Y)
        seen = {
            "displacement": np.hstack([Y, blank]),
            "velocity": np.hstack([blank, Y]),
            "acceleration": Y @ lower,
        }[self.quantity]
        return A, seen

    def opposed(
        self, row: np.ndarray, suspects: Suspects, sizes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """What a force of 1 that opposes a place's deflection does to the state and the sensors.

        Parameters
        ----------
        row : (modes,) array
            The place's.
        suspects, sizes
            As for :meth:`linear`.

        Returns
        -------
        (2 kept,), (sensors,) array
            Rate of the state, and what the sensors see at once.
        """
        rate = -np.linalg.solve(self._inertia(suspects, sizes), row[: self.kept])
        at_once = self._shown(suspects, sizes) @ rate * (self.quantity == "acceleration")
        return np.concatenate([np.zeros(self.kept), rate]), at_once

    def _of(self, name: str, suspects: Suspects, sizes: np.ndarray) -> np.ndarray:
        """Modal matrix of the suspects of one linear kind."""
        rows = np.asarray(suspects.row)[:, : self.kept]
        force = np.asarray(suspects.force)
        own = sum((force[:, i] for i, kind in enumerate(self.kinds) if kind.name == name), 0.0)
        return (rows.T * (own * sizes)) @ rows

    def _inertia(self, suspects: Suspects, sizes: np.ndarray) -> np.ndarray:
        return np.eye(self.kept) + self._of("mass_error", suspects, sizes)

    def _shown(self, suspects: Suspects, sizes: np.ndarray) -> np.ndarray:
        """What the sensors see of the modes, their gains as they are."""
        scale = [float(fault.scales) for fault in self.faults]
        gains = 1.0 + np.einsum("s,sfk,f->k", sizes, np.asarray(suspects.chain), scale)
        return np.asarray(self.sensors) * gains[:, None]


def predictor(
    structure: JointedStructure,
    inputs: Array,
    sensors: Array,
    sampling_rate: float,
    quantity: Quantity,
    kinds: tuple[ForceKind, ...],
    substeps: int,
    trust: LinearTrust | None = None,
    faults: tuple[AbstractSensorFault, ...] = sensor_faults_of(FAULTS),
    base: int | None = None,
) -> tuple[Predictor, ModalCoordinates]:
    """The predictor of a structure, and the modes it is in.

    Parameters
    ----------
    structure : JointedStructure
        With its joints at their starting values.
    inputs, sensors : (rows, n) array
        Where forces act, and sensors are.
    sampling_rate : float
        Hz.
    quantity : {"acceleration", "velocity", "displacement"}
        What the sensors measure.
    kinds : tuple of ForceKind
        What may be missing.
    substeps : int
        Steps between samples.
    trust : LinearTrust, optional
        How exact the linear model is; exact where it is not said.
    faults : tuple of AbstractSensorFault
        What may be wrong with a sensor.
    base : int, optional
        Which input is the acceleration of the ground; its row is -M r.
    """
    modal = modal_coordinates(structure, inputs, sensors, None)
    omega2, C, Y = np.asarray(modal.omega2), np.asarray(modal.C), np.asarray(modal.Y)
    kept = max(1, int(np.sum(omega2 < (2.0 * np.pi * _HIGHEST * sampling_rate) ** 2)))
    part = (slice(kept),) * C.ndim
    dt = 1.0 / (sampling_rate * substeps)
    if trust is not None and np.max(np.abs(C[part])) * dt > 0.5 * MOST:
        raise InputError(
            "trust: a mode is damped too heavily for its error to be fitted "
            f"({np.max(np.abs(C[part])):.3g} 1/s); leave trust out, or the damper to a joint"
        )
    uncertain = _uncertain(trust, omega2[:kept], sampling_rate)
    # Sliced by NumPy: every operation of JAX outside a kernel is compiled for itself.
    made = Predictor(
        jax.device_put(omega2[:kept]),
        jax.device_put(C[part]),
        modal.P,
        jax.device_put(Y[:, :kept]),
        jax.device_put(modes_left_out(modal, kept)),
        modal.stiffness,
        jax.device_put(np.zeros(len(modal.stiffness))),
        jax.device_put(hold(omega2[:kept], C[part], dt)),
        jax.device_put(np.asarray(dt)),
        jax.device_put(uncertain),
        jax.device_put(np.asarray(0.0 if trust is None else trust.shapes)),
        ground_of(modal, base),
        tuple(row for row in range(2) if np.any(uncertain[row]) or trust is None),
        kinds,
        faults,
        quantity,
        substeps,
    )
    return made, modal


def _uncertain(
    trust: LinearTrust | None, omega2: Float[np.ndarray, " kept"], sampling_rate: float
) -> np.ndarray:
    """Deviations of the modes that are compared: what lies above shows nothing of itself."""
    seen = int(np.sum(omega2 < (2.0 * np.pi * END * sampling_rate) ** 2))
    if trust is None:
        return np.zeros((2, 0))
    return trust.deviations(omega2[:seen])
