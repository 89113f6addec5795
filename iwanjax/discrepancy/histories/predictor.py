"""What predicts recordings from a sample to the next: modes, places of joints, sensors, forces."""

from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.discrepancy.effects import ForceKind
from iwanjax.dynamics.coordinates import ModalCoordinates, modal_coordinates
from iwanjax.structures import JointedStructure


class Suspects(NamedTuple):
    """What is suspected beside the joints: a force at a place, or a sensor, in each slot.

    Attributes
    ----------
    row : (slots, modes) array
        Where a force acts, on all modes.
    force : (slots, kinds) array
        Zero but for the kind of force, where it is the unit of its size.
    chain : (slots, 3, sensors) array
        Zero but for what is wrong with a sensor: unit of its gain's error, of its delay in
        samples, and of the largest value that it shows.
    logarithmic : (slots,) array
        1 where the size is the exponential of its parameter.
    """

    row: Float[Array, "slots modes"]
    force: Float[Array, "slots kinds"]
    chain: Float[Array, "slots 3 sensors"]
    logarithmic: Float[Array, " slots"]


class Values(NamedTuple):
    """What is fitted, of one recording.

    Attributes
    ----------
    z : (parameters,) array
        Joint parameters, in prior deviations from those given.
    suspects : (slots, 2) array
        Of each slot the size in its unit, or its logarithm, and the logarithm of its shape.
    state : (directions,) array
        Errors of the state after the force, in deviations.
    """

    z: Float[Array, " parameters"]
    suspects: Float[Array, "slots 2"]
    state: Float[Array, " directions"]


def sizes_of(suspects: Suspects, values: Array) -> Array:
    """Sizes of the slots in their units."""
    size = values[:, 0]
    return jnp.where(suspects.logarithmic > 0, jnp.exp(jnp.minimum(size, 50.0)), size)


class Hold(NamedTuple):
    r"""The exact map over one step for modal forces :math:`p_0 + p_1 s + p_2 s^2`, s in (0, 1).

    Attributes
    ----------
    q, v : two (modes,) or (modes, modes) arrays each
        What displacement and velocity at the beginning make of those at the end.
    q_by, v_by : three (modes,) or (modes, modes) arrays each
        What the force's coefficients add.
    """

    q: tuple[Array, Array]
    v: tuple[Array, Array]
    q_by: tuple[Array, Array, Array]
    v_by: tuple[Array, Array, Array]

    def free(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Displacement and velocity at the end without force."""
        return on(self.q[0], q) + on(self.q[1], v), on(self.v[0], q) + on(self.v[1], v)

    def pushed(self, p: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        """What forces, (modes, ...) a coefficient, add to both."""
        return _added(self.q_by, p), _added(self.v_by, p)


def _added(by: tuple[Array, Array, Array], p: tuple[Array, Array, Array]) -> Array:
    return on(by[0], p[0]) + on(by[1], p[1]) + on(by[2], p[2])


def on(coefficient: Array, x: Array) -> Array:
    """A coefficient by mode, or a matrix of them, on (modes, ...)."""
    if coefficient.ndim == 2:
        return coefficient @ x
    return (coefficient * x.T).T


def hold(omega2: Float[np.ndarray, " modes"], C: Float[np.ndarray, "*modes"], dt: float) -> Hold:
    r"""The step of :math:`\ddot q + C\dot q + \omega^2 q = p`, by the matrix exponential.

    The force's coefficients are states too (Van Loan 1978).

    Parameters
    ----------
    omega2 : (modes,) array
        Squared natural frequencies, (rad/s)^2.
    C : (modes,) or (modes, modes) array
        Modal damping, 1/s.
    dt : float
        Step, s.
    """
    import scipy.linalg

    coupled = C.ndim == 2
    size = len(omega2) if coupled else 1
    eye, none = np.eye(size), np.zeros((size, size))
    K = np.diag(omega2)[None] if coupled else omega2[:, None, None]
    damping = C[None] if coupled else C[:, None, None]

    def rows(*blocks: np.ndarray) -> np.ndarray:
        whole = [np.broadcast_to(block, K.shape) for block in blocks]
        return np.concatenate(whole, axis=2)

    # Velocities times the step: both halves of the state are of one size then.
    F = np.concatenate(
        [
            rows(none, eye, none, none, none),
            rows(-K * dt**2, -damping * dt, eye * dt**2, none, none),
            rows(none, none, none, eye, none),
            rows(none, none, none, none, eye),
            rows(none, none, none, none, none),
        ],
        axis=1,
    )
    E = np.stack([scipy.linalg.expm(each) for each in F])

    def part(i: int, j: int, factor: float) -> Any:
        block = factor * E[:, i * size : (i + 1) * size, j * size : (j + 1) * size]
        return block[0] if coupled else block[:, 0, 0]

    # The force's second derivative is twice its last coefficient.
    return Hold(
        (part(0, 0, 1.0), part(0, 1, dt)),
        (part(1, 0, 1.0 / dt), part(1, 1, 1.0)),
        (part(0, 2, 1.0), part(0, 3, 1.0), part(0, 4, 2.0)),
        (part(1, 2, 1.0 / dt), part(1, 3, 1.0 / dt), part(1, 4, 2.0 / dt)),
    )


Quantity = Literal["acceleration", "velocity", "displacement"]
"""What the sensors measure."""

# Modes beyond this share of the sampling rate act by their flexibility.
_HIGHEST = 0.6


class Data(NamedTuple):
    """Recordings, side by side.

    Attributes
    ----------
    push : (recordings, N, substeps, states) array
        What the forces do over each step that leads to a sample: to q, to v, their modal
        forces at its end, and those of the modes left out.
    response : (recordings, N, sensors) array
        As measured.
    weight : (recordings, N, sensors) array
        One over the deviation that a residual may have in the band that is compared; zero
        where nothing was measured.
    kick : (recordings, N) array
        One at the sample where the state is uncertain.
    unsure : (recordings, 2 kept, directions) array
        By how much, and along which directions.
    """

    push: Float[Array, "recordings N substeps states"]
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
    left : (modes - kept,) array
        Flexibilities of the others.
    stiffness : (joints,) array
        Reference stiffness of the joints.
    by : Hold
        Over one step.
    dt : array
        Step, s.
    """

    omega2: Float[Array, " kept"]
    C: Float[Array, "*kept"]
    joints: Float[Array, "joints modes"]
    sensors: Float[Array, "sensors kept"]
    left: Float[Array, " left"]
    stiffness: Float[Array, " joints"]
    by: Hold
    dt: Array
    kinds: tuple[ForceKind, ...] = eqx.field(static=True)
    quantity: Quantity = eqx.field(static=True)
    substeps: int = eqx.field(static=True)

    @property
    def kept(self) -> int:
        """Number of modes that move."""
        return self.omega2.shape[0]

    def blank(self, slots: int = 1) -> Suspects:
        """No suspects in so many slots."""
        modes, sensors = self.joints.shape[1], self.sensors.shape[0]
        row, force = np.zeros((slots, modes)), np.zeros((slots, len(self.kinds)))
        chain, logarithmic = np.zeros((slots, 3, sensors)), np.zeros(slots)
        return Suspects(*jax.device_put((row, force, chain, logarithmic)))

    def pushed(
        self, row: Float[Array, " modes"], force: Float[Array, " steps"]
    ) -> Float[Array, "N substeps states"]:
        """What a force at a place, known at the end of each step, does as a push of the data."""
        now, last, before = force, jnp.roll(force, 1).at[0].set(0.0), jnp.roll(force, 2)
        before = before.at[:2].set(0.0)
        through = (last, 0.5 * (now - before), 0.5 * (now + before) - last)
        kept, left = row[: self.kept], row[self.kept :]
        q, v = (
            sum(jnp.outer(c, on(b, kept)) for c, b in zip(through, each, strict=True))
            for each in (self.by.q_by, self.by.v_by)
        )
        made = jnp.concatenate([q, v, jnp.outer(now, kept), jnp.outer(now, left)], axis=1)
        return made.reshape(-1, self.substeps, made.shape[1])

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
        self, stiffness: np.ndarray, suspects: Suspects, sizes: np.ndarray
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
        """
        r = self.kept
        P = np.asarray(self.joints)[:, :r]
        softer = stiffness - np.asarray(self.stiffness)
        C = np.asarray(self.C)
        lower = np.hstack(
            [
                -np.diag(self.omega2)
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
        gains = 1.0 + np.einsum("s,sk->k", sizes, np.asarray(suspects.chain)[:, 0])
        return np.asarray(self.sensors) * gains[:, None]


def predictor(
    structure: JointedStructure,
    inputs: Array,
    sensors: Array,
    sampling_rate: float,
    quantity: Quantity,
    kinds: tuple[ForceKind, ...],
    substeps: int,
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
    """
    modal = modal_coordinates(structure, inputs, sensors, None)
    omega2, C, Y = np.asarray(modal.omega2), np.asarray(modal.C), np.asarray(modal.Y)
    kept = max(1, int(np.sum(omega2 < (2.0 * np.pi * _HIGHEST * sampling_rate) ** 2)))
    part = (slice(kept),) * C.ndim
    dt = 1.0 / (sampling_rate * substeps)
    # Sliced by NumPy: every operation of JAX outside a kernel is compiled for itself.
    made = Predictor(
        jax.device_put(omega2[:kept]),
        jax.device_put(C[part]),
        modal.P,
        jax.device_put(Y[:, :kept]),
        jax.device_put(1.0 / omega2[kept:]),
        modal.stiffness,
        jax.device_put(hold(omega2[:kept], C[part], dt)),
        jax.device_put(np.asarray(dt)),
        kinds,
        quantity,
        substeps,
    )
    return made, modal
