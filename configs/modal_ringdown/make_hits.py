"""Four hammer hits on one bolted mode with known parameters: the data of this study.

One oscillator of unit modal mass with a four-parameter Iwan joint, here a bank of discrete
sliders, and a second mode beside it, which is linear. What the sensor sees of both, with
noise, is written to ``hit1.npz`` ... ``hit4.npz`` as ``time`` (N,), s, and ``response``
(N, 1), velocity in m/s; the parameters go to ``truth.json``. NumPy only, nothing of iwanjax,
so that the joint's closed forms are not tested against themselves.

    python configs/modal_ringdown/make_hits.py --out DIR
"""

import argparse
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

HERE = Path(__file__).resolve().parent

SEED = 20240118
# A power of two, so that the sampling times are exact and pack well. Of the slip's harmonics
# the ninth is the first beyond the Nyquist frequency, and it is far below the noise.
SAMPLING_RATE = 2048.0
STEPS_PER_SAMPLE = 12
DURATION, PRE_TRIGGER = 5.5, 0.02
# Below each hit's own peak, as with an input range that is set to the hit.
NOISE_DB = -62.0


@dataclass(frozen=True)
class Oscillator:
    """Unit modal mass with an Iwan joint between it and the ground.

    Attributes
    ----------
    f_0 : float
        Frequency at low amplitude, joint included, Hz.
    zeta_0 : float
        Viscous damping 2 zeta_0 omega_0, as ratio at low amplitude, 1.
    F_S, K_T, chi, beta : float
        The joint's: m/s^2 and 1/s^2 for unit mass, and 1.
    """

    f_0: float
    zeta_0: float
    F_S: float
    K_T: float
    chi: float
    beta: float

    @property
    def omega_0(self) -> float:
        """Angular frequency at low amplitude, rad/s."""
        return 2.0 * np.pi * self.f_0

    @property
    def phi_max(self) -> float:
        """Displacement at macroslip, m."""
        shape = self.beta + (self.chi + 1.0) / (self.chi + 2.0)
        return self.F_S * (1.0 + self.beta) / (self.K_T * shape)


class Hit(NamedTuple):
    """One hit.

    Attributes
    ----------
    name : str
        Of its file.
    use : str
        ``"fit"`` or ``"hold_out"``.
    level : float
        Velocity of the first mode after the hit over omega_0 phi_max.
    other : float
        Velocity of the second mode after the hit, over that of the first.
    """

    name: str
    use: str
    level: float
    other: float


class Motion(NamedTuple):
    """Displacement, velocity and acceleration, (samples, hits)."""

    displacement: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


TRUTH = Oscillator(f_0=118.0, zeta_0=4e-4, F_S=1.8, K_T=2.75e4, chi=-0.45, beta=0.8)
# The second mode: as it decays faster, it leaves the smaller amplitudes to the first.
OTHER_FREQUENCY, OTHER_DAMPING = 2.7 * TRUTH.f_0, 4e-3
HITS = (
    Hit("hit1", "fit", 2.50, 0.30),
    Hit("hit2", "fit", 1.20, 0.22),
    Hit("hit3", "fit", 0.40, 0.35),
    Hit("hit4", "hold_out", 1.60, 0.25),
)


def sliders(
    oscillator: Oscillator, count: int = 400, ratio: float = 1.03
) -> tuple[np.ndarray, np.ndarray]:
    """Thresholds, m, and stiffnesses, 1/s^2, of a bank that stands for the joint.

    The thresholds' intervals grow by ``ratio``; in each the slider has the interval's exact
    stiffness and slip force. The last slider is the Dirac share at phi_max.
    """
    o, n = oscillator, oscillator.chi + 1.0
    edges = np.append(0.0, o.phi_max * ratio ** -np.arange(count - 1.0, -1.0, -1.0))
    R = o.K_T / (1.0 + o.beta) * n / o.phi_max**n
    stiffness = R / n * np.diff(edges**n)
    force = R / (n + 1.0) * np.diff(edges ** (n + 1.0))
    return (
        np.append(force / stiffness, o.phi_max),
        np.append(stiffness, o.K_T * o.beta / (1.0 + o.beta)),
    )


def ring_down(
    oscillator: Oscillator,
    velocity: np.ndarray,
    sampling_rate: float,
    samples: int,
    steps_per_sample: int,
) -> Motion:
    """Free motion from rest with given velocities, several hits side by side.

    What the joint's sliders hold less than when all of them stick drives the linear
    oscillator, which is propagated exactly, by a kick in the middle of each step.

    Parameters
    ----------
    oscillator : Oscillator
        What moves.
    velocity : (hits,) array
        Just after each hit, m/s.
    sampling_rate : float
        Of the result, Hz.
    samples : int
        Number of samples, the first just after the hit.
    steps_per_sample : int
        Steps of the simulation from one sample to the next.
    """
    omega, zeta, K_T = oscillator.omega_0, oscillator.zeta_0, oscillator.K_T
    phi, k = sliders(oscillator)
    dt = 1.0 / (sampling_rate * steps_per_sample)
    decay, damped = zeta * omega, omega * np.sqrt(1.0 - zeta**2)
    # Half a step: (x, v) -> (a x + b v, c x + d v).
    e, cos, sin = np.exp(-decay * dt / 2), np.cos(damped * dt / 2), np.sin(damped * dt / 2)
    a, b = e * (cos + decay / damped * sin), e * sin / damped
    c, d = -e * omega**2 / damped * sin, e * (cos - decay / damped * sin)

    x, v = np.zeros_like(velocity), np.array(velocity, float)
    stretch, last = np.zeros((x.size, phi.size)), np.zeros_like(x)
    rows = []
    for i in range(samples):
        if i:
            for _ in range(steps_per_sample):
                x, v = a * x + b * v, c * x + d * v
                stretch += (x - last)[:, None]
                np.minimum(stretch, phi, out=stretch)
                np.maximum(stretch, -phi, out=stretch)
                last = x
                v = v + dt * (K_T * x - stretch @ k)
                x, v = a * x + b * v, c * x + d * v
        force = np.clip(stretch + (x - last)[:, None], -phi, phi) @ k
        rows.append((x, v, K_T * x - force - omega**2 * x - 2.0 * zeta * omega * v))
    return Motion(*np.moveaxis(np.array(rows), 1, 0))


def simulate(duration: float = DURATION) -> tuple[np.ndarray, np.ndarray, Motion]:
    """What the sensor records of all hits, and the first mode on its own.

    Parameters
    ----------
    duration : float
        Of the recording, s. A shorter one holds the first samples of a longer one.

    Returns
    -------
    time : (N,) array
        s; the hit is at ``PRE_TRIGGER``.
    response : (N, hits) array
        m/s, as float32.
    motion : Motion
        Of the first mode, from the hit on, without noise.
    """
    count, before = round(duration * SAMPLING_RATE), round(PRE_TRIGGER * SAMPLING_RATE)
    first = np.array([hit.level for hit in HITS]) * TRUTH.omega_0 * TRUTH.phi_max
    second = first * np.array([hit.other for hit in HITS])
    motion = ring_down(TRUTH, first, SAMPLING_RATE, count - before, STEPS_PER_SAMPLE)

    omega = 2.0 * np.pi * OTHER_FREQUENCY
    decay, damped = OTHER_DAMPING * omega, omega * np.sqrt(1.0 - OTHER_DAMPING**2)
    t = np.arange(count - before)[:, None] / SAMPLING_RATE
    other = np.exp(-decay * t) * (np.cos(damped * t) - decay / damped * np.sin(damped * t))

    noise = np.column_stack(
        [np.random.default_rng([SEED, i]).standard_normal(count) for i in range(len(HITS))]
    )
    response = noise * noise_deviation()
    response[before:] += motion.velocity + second * other
    return np.arange(count) / SAMPLING_RATE, response.astype(np.float32), motion


def noise_deviation() -> np.ndarray:
    """Standard deviation of each hit's sensor noise, m/s."""
    peak = [hit.level * (1.0 + hit.other) for hit in HITS]
    return 10.0 ** (NOISE_DB / 20.0) * TRUTH.omega_0 * TRUTH.phi_max * np.array(peak)


def truth(motion: Motion) -> dict:
    """What a fit should find, and what each hit was."""
    last = motion.displacement[-round(2.0 * SAMPLING_RATE / TRUTH.f_0) :]
    return {
        "parameters": {**asdict(TRUTH), "phi_max": TRUTH.phi_max},
        "units": {"f_0": "Hz", "F_S": "m/s^2", "K_T": "1/s^2", "phi_max": "m"},
        "quantity": "velocity",
        "unit": "m/s",
        "sampling_rate": SAMPLING_RATE,
        "hit_at": round(PRE_TRIGGER * SAMPLING_RATE) / SAMPLING_RATE,
        "second_mode": {"frequency": OTHER_FREQUENCY, "damping": OTHER_DAMPING},
        "hits": {
            hit.name: {
                "use": hit.use,
                "velocity": hit.level * TRUTH.omega_0 * TRUTH.phi_max,
                "second_mode_velocity": hit.other * hit.level * TRUTH.omega_0 * TRUTH.phi_max,
                "largest_displacement": float(np.abs(motion.displacement[:, i]).max()),
                "smallest_amplitude": float(np.abs(last[:, i]).max()),
                "noise_std": float(noise_deviation()[i]),
            }
            for i, hit in enumerate(HITS)
        },
    }


def main() -> None:
    """Write the hits and their truth."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=HERE, help="folder to write to")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    time, response, motion = simulate()
    for i, hit in enumerate(HITS):
        np.savez_compressed(folder / f"{hit.name}.npz", time=time, response=response[:, i : i + 1])
    (folder / "truth.json").write_text(json.dumps(truth(motion), indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
