"""Hammer hits on a chain of three masses with one bolted joint, and a spring its model lacks.

The chain has a four-parameter Iwan joint, here a bank of discrete sliders, between its first two
masses. A cubic spring between the third mass and ground acts in the recordings, and is not
in ``model.npz``. What three accelerometers and the hammer show, with noise, is written to
``hit1.npz`` ... ``hit4.npz``; ``truth.json`` tells what is concealed. NumPy and SciPy only,
nothing of iwanjax.

    python configs/concealed_spring/make_hits.py --out DIR
"""

import argparse
import json
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.linalg

HERE = Path(__file__).resolve().parent

sys.path.insert(0, str(HERE.parent))
from modal_ringdown.make_hits import Oscillator, sliders  # noqa: E402

SEED = 20241125
SAMPLING_RATE, SAMPLES, STEPS_PER_SAMPLE, PRE_TRIGGER = 2048, 1536, 16, 64
# Standard deviations: of the sensors over the hardest hit's rms, of the hammer over its peak.
NOISE, FORCE_NOISE = 0.002, 0.001
M = np.diag([2.0, 1.5, 1.0])
K = np.array([[9.0, -4.0, 0.0], [-4.0, 7.5, -3.5], [0.0, -3.5, 3.5]]) * 1e5
ZETA = 3e-3
ROWS = {
    "J1": np.array([-1.0, 1.0, 0.0]),
    "m2-m3": np.array([0.0, -1.0, 1.0]),
    "m1-ground": np.array([1.0, 0.0, 0.0]),
    "m2-ground": np.array([0.0, 1.0, 0.0]),
    "m3-ground": np.array([0.0, 0.0, 1.0]),
}
JOINT = {"F_S": 40.0, "K_T": 2.0e5, "chi": -0.4, "beta": 1.5}
PLACE, K3 = "m3-ground", 4.0e9


class Hit(NamedTuple):
    """One hit: file, use, mass that is hit, N at the peak, s that it lasts."""

    name: str
    use: str
    place: str
    peak: float
    duration: float


HITS = (
    Hit("hit1", "fit", "m3", 150.0, 5e-3),
    Hit("hit2", "fit", "m1", 400.0, 5e-3),
    Hit("hit3", "fit", "m3", 400.0, 4.5e-3),
    Hit("hit4", "hold_out", "m2", 300.0, 5e-3),
)


def damping() -> np.ndarray:
    """C of one damping ratio in all modes, the joint stuck, N s/m."""
    row = ROWS["J1"]
    omega2, shapes = scipy.linalg.eigh(K + JOINT["K_T"] * np.outer(row, row), M)
    return M @ shapes @ np.diag(2.0 * ZETA * np.sqrt(omega2)) @ shapes.T @ M


def measured(hit: Hit) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations (N, 3), m/s^2, and force (N,), N, without noise.

    Half a kick of all that is not linear, a step of the linear chain, half a kick: second order.
    """
    slips, stiffness = sliders(Oscillator(f_0=1.0, zeta_0=0.0, **JOINT), 200, 1.06)
    J, row, inverse = ROWS["J1"], ROWS[PLACE], np.linalg.inv(M)
    push = np.eye(3)[int(hit.place[1]) - 1]
    dt = 1.0 / (SAMPLING_RATE * STEPS_PER_SAMPLE)
    C, stuck = damping(), K + JOINT["K_T"] * np.outer(J, J)
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-inverse @ stuck, -inverse @ C]])
    step = scipy.linalg.expm(A * dt)
    x, v, stretch = np.zeros(3), np.zeros(3), np.zeros(slips.size)
    start = PRE_TRIGGER / SAMPLING_RATE

    def hammer(t: float) -> float:
        s = (t - start) / hit.duration
        return hit.peak * np.sin(np.pi * s) ** 2 if 0.0 < s < 1.0 else 0.0

    def beyond(t: float) -> np.ndarray:
        """Forces that the linear chain with its joint stuck does not know."""
        slack = JOINT["K_T"] * (J @ x) - stretch @ stiffness
        return push * hammer(t) + J * slack - row * K3 * (row @ x) ** 3

    accelerations, forces = [], []
    for i in range(SAMPLES * STEPS_PER_SAMPLE):
        t = i * dt
        if i % STEPS_PER_SAMPLE == 0:
            accelerations.append(inverse @ (beyond(t) - stuck @ x - C @ v))
            forces.append(hammer(t))
        v = v + 0.5 * dt * inverse @ beyond(t)
        moved, v = np.split(step @ np.concatenate([x, v]), 2)
        stretch = np.clip(stretch + J @ (moved - x), -slips, slips)
        x = moved
        v = v + 0.5 * dt * inverse @ beyond(t + dt)
    return np.array(accelerations), np.array(forces)


def main(arguments: list[str] | None = None) -> None:
    """Write the model, the recordings and the truth."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--out", type=Path, default=HERE)
    out = parser.parse_args(arguments).out
    out.mkdir(parents=True, exist_ok=True)
    sensors = {f"a{i + 1}": row for i, row in enumerate(np.eye(3))}
    inputs = {f"m{i + 1}": row for i, row in enumerate(np.eye(3))}
    np.savez_compressed(
        out / "model.npz",
        M=M,
        C=damping(),
        K=K,
        row_labels=list(ROWS),
        rows=np.stack(list(ROWS.values())),
        sensor_labels=list(sensors),
        sensor_rows=np.stack(list(sensors.values())),
        input_labels=list(inputs),
        input_rows=np.stack(list(inputs.values())),
    )
    random = np.random.default_rng(SEED)
    several = [measured(hit) for hit in HITS]
    noise = NOISE * max(float(np.sqrt(np.mean(a**2))) for a, _ in several)
    for hit, (response, force) in zip(HITS, several, strict=True):
        seen = response + noise * random.standard_normal(response.shape)
        felt = force + FORCE_NOISE * hit.peak * random.standard_normal(force.shape)
        np.savez_compressed(
            out / f"{hit.name}.npz",
            time=np.arange(SAMPLES) / SAMPLING_RATE,
            response=seen.astype(np.float32),
            force=felt[:, None].astype(np.float32),
        )
    truth = {
        "concealed": {"kind": "cubic_stiffness", "where": PLACE, "k3": K3, "unit": "N/m^3"},
        "joints": {"J1": JOINT},
        "noise": {"acceleration": noise, "unit": "m/s^2", "force_over_peak": FORCE_NOISE},
    }
    (out / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")


if __name__ == "__main__":
    main()
