"""What a test adds to a structure, and linear models of it that are not exact."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from concealed.excitation import band, elastic
from concealed.structures import Array, Iwan, Structure
from scipy.linalg import block_diag

from iwanjax.trial.effects import Effect

BASE, DRIVE = "base", "drive"
"""Inputs: acceleration of the ground, and the force on a shaker's armature."""
ARMATURE, BACK_EMF, STINGER = 0.1, 3.0, 4.0
"""Of the first mode at the place: share of its mass, times its damper; natural frequency of the
armature on its stinger over the band's upper edge."""


def ground_motion(structure: Structure) -> Array:
    """Motion r (n,) of the coordinates when the ground moves by 1 and nothing deforms.

    Both walls of a chain; the clamp of a lapped beam, transversely.
    """
    n = len(structure.M)
    if structure.name.startswith("chain"):
        return np.ones(n)
    if structure.name == "lap_beam":
        return (np.arange(n) % 3 == 1).astype(float)
    raise ValueError(f"{structure.name} stands on no ground that could be shaken")


def on_shaken_ground(structure: Structure, M: Array | None = None) -> Structure:
    """The structure with the input `base`, the acceleration a of the ground.

    With the motion x relative to the ground, M x'' + C x' + K x + ... = -M r a: the row of the
    input is -M r, so that row * a is a force as of any other input, and r = -M^-1 row. Places
    see the motion relative to the ground; accelerometers the absolute x'' + r a. `M` is the mass
    that the ground takes along where it is not the structure's alone.
    """
    row = -(structure.M if M is None else M) @ ground_motion(structure)
    return replace(structure, inputs={**structure.inputs, BASE: row})


def _appended(rows: Mapping[str, Array]) -> dict[str, Array]:
    return {name: np.append(row, 0.0) for name, row in rows.items()}


def _with_mass(structure: Structure, m: float, c: float, k: float, row: Array) -> Structure:
    """One more coordinate: a mass on spring and damper along `row` (n + 1,)."""
    pair = np.outer(row, row)
    return replace(
        structure,
        M=block_diag(structure.M, m),
        C=np.asarray(block_diag(structure.C, 0.0)) + c * pair,
        K=np.asarray(block_diag(structure.K, 0.0)) + k * pair,
        rows=_appended(structure.rows),
        sensors=_appended(structure.sensors),
        inputs=_appended(structure.inputs),
    )


def with_oscillator(structure: Structure, effect: Effect) -> Structure:
    """The structure with a mass m on a spring k and a damper c at a place."""
    m, c, k = (float(value) for value in effect.values)  # type: ignore[arg-type]
    return _with_mass(structure, m, c, k, np.append(structure.rows[effect.where], -1.0))


def with_shaker(structure: Structure, place: str) -> tuple[Structure, Array]:
    """The structure with a shaker at one of its inputs, and the row of the stinger's force.

    The armature is a mass that the force `drive` moves, a damper (back-EMF of a voltage amplifier)
    and a soft spring to the ground; the stinger, a stiff spring, joins it to the place. The load
    cell measures row @ u, the stinger's force on the structure, which drops at resonance.
    """
    omega, shapes = elastic(structure)
    at = structure.inputs[place]
    modal = 1.0 / float(at @ shapes[:, 0]) ** 2
    m = ARMATURE * modal
    damper = modal * float(shapes[:, 0] @ structure.C @ shapes[:, 0])
    stiff = m * (2 * np.pi * STINGER * band(structure)[1]) ** 2
    joined = np.append(-at, 1.0)
    rig = _with_mass(structure, m, 0.0, stiff, joined)
    own = np.zeros(len(rig.M))
    own[-1] = 1.0
    pair = np.outer(own, own)
    return (
        replace(
            rig,
            C=rig.C + BACK_EMF * damper * pair,
            K=rig.K + m * (0.5 * omega[0]) ** 2 * pair,
            inputs={**rig.inputs, DRIVE: own},
        ),
        stiff * joined,
    )


def welded(structure: Structure, joints: Mapping[str, Iwan]) -> Structure:
    """The linear structure whose joints never slip: their tangent stiffness is in K."""
    K = structure.K.copy()
    for name, (_, K_T, _, _) in joints.items():
        K += K_T * np.outer(structure.rows[name], structure.rows[name])
    return replace(structure, K=K, joints={})
