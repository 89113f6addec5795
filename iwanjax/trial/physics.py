"""Time histories of a jointed structure with concealed effects, all recordings at once.

The linear structure (with the joints stuck and the linear concealed changes) is carried
exactly over a step in its own modes, and every other force acts linearly within the step: the
deflections are predicted with the forces extrapolated, and the forces taken there once. (Kicks
of velocity between exact steps fail on the beam: its highest modes turn several times within
a step, and a kick does not leave them the static deflection that they should have.)
Joints are banks of Jenkins sliders, exact for any path of their deflection.
Nothing here is shared with the package under test.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, expm

from iwanjax.trial.effects import LINEAR, Effect, Force, element
from iwanjax.trial.foreign_laws import Law, foreign
from iwanjax.trial.structure import Array, Iwan, TrialStructure

SLIDERS = 160
"""Of each joint; a geometric grid of them dissipates as the closed form within 2 %."""
# Squared frequency over the highest one's below which a mode is a rigid body's, and over the lowest
# elastic one's that it then gets.
_RIGID, _SOFT = 1e-12, 1e-8
FILTER_SPAN = 13
"""Half length of the anti-alias filter, in sampling intervals."""


def slider_bank(F_S: Array, K_T: Array, chi: Array, beta: Array) -> tuple[Array, Array]:
    """Slip deflections and stiffnesses of Segalman's joint, sliders along a new last axis.

    Every cell of a geometric grid from 1e-4 phi_max (and the one below it) holds one slider at
    its middle with the exact stiffness of the cell; the last slider is the Dirac one.
    """
    F_S, K_T, chi, beta = (np.asarray(v, float)[..., None] for v in (F_S, K_T, chi, beta))
    phi_max = F_S * (1 + beta) / (K_T * (beta + (chi + 1) / (chi + 2)))
    edges = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, SLIDERS)])
    middle = 0.5 * (edges[1:] + edges[:-1])
    share = np.diff(edges ** (chi + 1), axis=-1)
    stiffness = np.concatenate([K_T / (1 + beta) * share, K_T * beta / (1 + beta)], axis=-1)
    slip = np.concatenate([phi_max * middle, phi_max], axis=-1)
    return slip, stiffness


class JointBank:
    """The joints of all recordings: arrays of shape (recording, joint, slider)."""

    def __init__(self, slip: Array, stiffness: Array, theta: Array) -> None:
        self.slip, self.stiffness = slip, stiffness
        self.negative = -slip
        self.kinetic = theta[..., None] * slip
        self.sticks = bool(np.all(theta == 1.0))
        self.stretch = np.zeros_like(slip)
        self.sliding = np.zeros_like(slip)
        self.last = np.zeros(slip.shape[:-1])

    def force(self, deflection: Array) -> Array:
        """Advance to the next deflections (recording, joint) and return the joints' forces."""
        step = (deflection - self.last)[..., None]
        self.last = deflection.copy()
        self.stretch += step
        if self.sticks:
            np.maximum(self.stretch, self.negative, out=self.stretch)
            np.minimum(self.stretch, self.slip, out=self.stretch)
        else:
            self._break_away(step)
        return np.einsum("rjn,rjn->rj", self.stretch, self.stiffness)

    def _break_away(self, step: Array) -> None:
        """A slider at its slip deflection drops to the kinetic one until the motion reverses."""
        limit = np.where(self.sliding * step > 0, self.kinetic, self.slip)
        direction = np.sign(self.stretch)
        over = np.abs(self.stretch) > limit
        self.stretch = np.where(over, self.kinetic * direction, self.stretch)
        self.sliding = np.where(over, direction, 0.0)


def _bank(
    joints: Mapping[str, Iwan], effects: Sequence[Effect], order: Array
) -> tuple[list[str], JointBank, Array]:
    """Return the places of all Iwan joints, their bank, and the stiffness of each when stuck."""
    count = len(order)
    places = list(joints)
    values = np.tile(np.reshape(list(joints.values()), (1, len(places), 4)), (count, 1, 1))
    theta = np.ones((count, len(places)))
    for effect in effects:
        if effect.kind == "stiction":
            theta[:, places.index(effect.where)] = effect.each(count)[0]
        elif effect.kind == "joint_drift":
            strength, stiffness = effect.each(count)
            values[:, places.index(effect.where), 0] *= strength**order
            values[:, places.index(effect.where), 1] *= stiffness**order
    for effect in effects:
        if effect.kind == "iwan_joint":
            places.append(effect.where)
            values = np.concatenate([values, np.stack(effect.each(count), -1)[:, None]], axis=1)
            theta = np.concatenate([theta, np.ones((count, 1))], axis=1)
    slip, stiffness = slider_bank(*np.moveaxis(values, -1, 0))
    return places, JointBank(slip, stiffness, theta), values[0, :, 1]


@dataclass(frozen=True)
class FineHistories:
    """Fine time histories: (step, recording, channel)."""

    response: Array
    force: Array
    deflection: Array
    """Of every Iwan joint, in the order of the structure's joints."""
    rows: Array
    """Deflection of every row that is watched."""


def _exact_step(
    omega: Array, damping: Array, acting: Array, dt: float
) -> tuple[Array, Array, Array]:
    """Carry (omega q, v) over dt, and the forces at the step's beginning and end into it.

    Returned transposed, for states along the last axis; forces are linear within the step.
    """
    n, f = len(omega), len(acting)
    turn, zero = np.diag(omega), np.zeros((n, n))
    generator = np.zeros((2 * n + 2 * f, 2 * n + 2 * f))
    generator[: 2 * n, : 2 * n] = np.block([[zero, turn], [-turn, -damping]])
    generator[n : 2 * n, 2 * n : 2 * n + f] = acting.T
    generator[2 * n : 2 * n + f, 2 * n + f :] = np.eye(f) / dt
    carried = np.asarray(expm(dt * generator)[: 2 * n].T, float)
    held, ramp = carried[2 * n : 2 * n + f], carried[2 * n + f :]
    return carried[: 2 * n], held - ramp, ramp


def march(
    structure: TrialStructure,
    joints: Mapping[str, Iwan],
    effects: Sequence[Effect],
    inputs: Array,
    dt: float,
    order: Array,
    watched: Sequence[Array] = (),
    thrown: Array | None = None,
) -> FineHistories:
    """Responses to the forces `inputs` (step, recording, input) at the structure's inputs.

    From rest, or from modal velocities (recording, mode) of the structure with its joints stuck.
    `order` (recording,) is the position in the study, on which a drifting joint depends.
    """
    steps, count, _ = inputs.shape
    M, C, K = structure.M.copy(), structure.C.copy(), structure.K.copy()
    for effect in effects:
        if effect.kind in LINEAR:
            changed = {"stiffness_error": K, "mass_error": M, "viscous_damping": C}[effect.kind]
            row = structure.rows[effect.where]
            changed += float(effect.values[0]) * np.outer(row, row)  # type: ignore[arg-type]
    places, bank, stuck = _bank(joints, effects, order)
    for place, K_T in zip(places, stuck, strict=True):
        K += K_T * np.outer(structure.rows[place], structure.rows[place])

    elements: list[tuple[int, Force]] = []
    drags: list[tuple[int, Array]] = []
    others: list[tuple[int, Law]] = []
    for effect in effects:
        law = element(effect, count, dt)
        if law is not None:
            elements.append((len(places), law))
            places.append(effect.where)
        elif effect.kind == "quadratic_damping":
            drags.append((len(places), effect.each(count)[0]))
            places.append(effect.where)
        elif (unnamed := foreign(effect, count, dt)) is not None:
            others.append((len(places), unnamed))
            places.append(effect.where)

    squared, modes = eigh(K, M)
    # A rigid body on springs so soft that none of them is felt within a recording.
    elastic = np.min(squared[squared > _RIGID * squared[-1]])
    omega = np.sqrt(np.maximum(squared, _SOFT * elastic))
    n, local, joined = len(omega), len(places), len(stuck)
    damping = modes.T @ C @ modes
    rows = np.reshape([structure.rows[place] for place in places], (local, n)) @ modes
    sensors = np.stack(list(structure.sensors.values())) @ modes
    acting = np.vstack([rows, np.stack(list(structure.inputs.values())) @ modes])
    # What is seen of a state (omega q, v): deflections, their rates, accelerations without forces.
    deflection = np.vstack([(rows / omega).T, np.zeros((n, local))])
    rate = np.vstack([np.zeros((n, local)), rows.T])
    free = np.vstack([-omega[:, None] * sensors.T, -damping @ sensors.T])
    seen = np.hstack([deflection, rate, free])
    if len(watched):
        every = np.stack(list(watched)) @ modes
        seen = np.hstack([seen, np.vstack([(every / omega).T, np.zeros_like(every.T)])])
    advance, old, new = _exact_step(omega, damping, acting, dt)
    step = np.vstack([advance, old]) @ np.hstack([np.eye(2 * n), seen])
    arrival = new @ np.hstack([np.eye(2 * n), seen])
    felt = arrival[:, 2 * n : 2 * n + 2 * local]

    forces = np.concatenate([np.zeros((steps, count, local)), inputs], axis=2)
    views = np.zeros((steps, count, seen.shape[1]))
    now = np.zeros((count, 2 * n + len(acting)))
    if thrown is not None:
        now[:, n : 2 * n] = thrown
    for k in range(1, steps):
        now[:, 2 * n :] = forces[k - 1]
        base = now @ step
        force = forces[k]
        force[:, :local] = 2 * forces[k - 1, :, :local] - forces[k - 2, :, :local]
        ahead = base[:, 2 * n : 2 * n + 2 * local] + force @ felt
        d = ahead[:, :joined]
        force[:, :joined] = stuck * d - bank.force(d)
        for at, law in elements:
            force[:, at] = -law(ahead[:, at])
        for at, c in drags:
            v = ahead[:, local + at]
            force[:, at] = -c * v * np.abs(v)
        for at, unnamed in others:
            force[:, at] = -unnamed(ahead[:, at], ahead[:, local + at])
        base += force @ arrival
        now[:, : 2 * n] = base[:, : 2 * n]
        views[k] = base[:, 2 * n :]

    return FineHistories(
        response=views[..., 2 * local : 2 * local + len(sensors)] + forces @ (acting @ sensors.T),
        force=inputs,
        deflection=views[..., : len(joints)],
        rows=views[..., 2 * local + len(sensors) :],
    )
