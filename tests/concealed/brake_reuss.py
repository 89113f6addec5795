"""Write brake_reuss.npz: matrices of the Brake-Reuss beam without its joints, from a mesh.

Run once (`python tests/concealed/brake_reuss.py`). The only module here that uses the package,
for mesh and reduction alone: joints, effects and integration stay the generator's own.
"""

from pathlib import Path

import jax
import numpy as np
from scipy.linalg import eigh

from iwanjax.structures.fem.brake_reuss import (
    brake_reuss_beam,
    brake_reuss_springs,
)

MATRICES = Path(__file__).with_name("brake_reuss.npz")
HIGHEST = 4000.0
"""Frequency (Hz) up to which modes are kept; what lies above acts by its flexibility."""
SUSPENSION = 2 * np.pi * 5.0
"""Frequency (rad/s) of the rigid body on its bungees, far below the first elastic one."""
DAMPING = 5e-4
SENSORS = ("a1", "a4", "a9", "a12")
INPUTS = {"tip": "a12", "mid": "a7"}
GROUND = ("a2", "a6", "a10")


def main() -> None:
    """Reduce the beam to the modes and static shapes that the places can see."""
    jax.config.update("jax_enable_x64", True)
    model = brake_reuss_beam().model(brake_reuss_springs("y")).structure
    beam = brake_reuss_beam()
    joints = {f"J{i}": beam.rows[f"J{i}.x"] for i in range(1, 6)}
    rows = {name: np.asarray(row) for name, row in joints.items()}
    rows |= {f"opening{i}": np.asarray(beam.rows[f"J{i}.y"]) for i in range(1, 6)}
    rows |= {f"{name}-ground": np.asarray(beam.sensors[name]) for name in GROUND}
    sensors = {name: np.asarray(beam.sensors[name]) for name in SENSORS}
    inputs = {name: np.asarray(beam.sensors[at]) for name, at in INPUTS.items()}
    M = np.asarray(model.M)
    K = np.asarray(model.K) + SUSPENSION**2 * M
    stuck = K + sum(
        brake_reuss_springs("x")[f"{name}.x"] * np.outer(row, row) for name, row in joints.items()
    )
    everything = np.stack([*rows.values(), *sensors.values(), *inputs.values()])
    squared, modes = eigh(stuck, M)
    seen = np.abs(everything @ modes).max(axis=1, keepdims=True)
    visible = np.any(np.abs(everything @ modes) > 1e-4 * seen, axis=0)
    low = visible & (squared < (2 * np.pi * HIGHEST) ** 2)
    static = np.linalg.solve(stuck, everything.T)
    static -= modes[:, low] @ (modes[:, low].T @ M @ static)
    size = np.sqrt(np.diag(static.T @ M @ static))
    values, vectors = eigh((static / size).T @ M @ (static / size))
    kept = values > 1e-8 * values[-1]
    T = np.hstack([modes[:, low], static / size @ vectors[:, kept] / np.sqrt(values[kept])])
    M, K, stuck = (T.T @ A @ T for A in (M, K, stuck))
    squared, modes = eigh(stuck, M)
    print(len(M), "coordinates; Hz:", np.sqrt(squared) / (2 * np.pi))
    C = M @ (modes * (2 * DAMPING * np.sqrt(squared))) @ modes.T @ M
    arrays = {"M": M, "C": C, "K": K}
    for group, named in {"row": rows, "sensor": sensors, "input": inputs}.items():
        arrays |= {f"{group}:{name}": row @ T for name, row in named.items()}
    np.savez_compressed(MATRICES, **arrays)


if __name__ == "__main__":
    main()
