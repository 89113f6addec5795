"""Hammer tests of a chain of two masses that conceal a force, in NumPy alone.

Semi-implicit Euler at a 32nd of the sampling interval and midpoint sliders: nothing of the
package's integrators, joints or grids is behind the recordings.
"""

from dataclasses import dataclass

import numpy as np

MASS, STIFFNESS = np.array([1.0, 1.5]), np.array([9e4, 6e4])
DAMPING = 2e-5
# The joint lies between the masses, beside the second spring.
TRUE = {"F_S": 6.0, "K_T": 3.0e4, "chi": -0.5, "beta": 1.5}
GIVEN = {"F_S": 9.0, "K_T": 3.15e4, "chi": -0.42, "beta": 1.0}
RATE, SAMPLES, FINE = 1024.0, 1024, 32
ROWS = {"m1-ground": [1.0, 0.0], "m2-ground": [0.0, 1.0], "J1": [-1.0, 1.0]}
NOISE = 0.02


def matrices():
    """M, C, K without the joint."""
    k1, k2 = STIFFNESS
    K = np.array([[k1 + k2, -k2], [-k2, k2]])
    return np.diag(MASS), DAMPING * K, K


def sliders(count=120):
    n = TRUE["chi"] + 1.0
    beta, K_T = TRUE["beta"], TRUE["K_T"]
    phi_max = TRUE["F_S"] * (1.0 + beta) / (K_T * (beta + n / (n + 1.0)))
    b = phi_max * np.concatenate([[0.0], np.geomspace(1e-4, 1.0, count)])
    k = np.append(K_T / (1.0 + beta) * np.diff((b / phi_max) ** n), K_T * beta / (1.0 + beta))
    return np.append(0.5 * (b[1:] + b[:-1]), phi_max), k


@dataclass(frozen=True)
class Hit:
    """One hammer test: where, how hard, and the noise's seed."""

    mass: int
    peak: float
    seed: int
    use: str = "fit"


HITS = (Hit(0, 10.0, 1), Hit(1, 70.0, 2), Hit(0, 60.0, 3), Hit(1, 45.0, 4, "hold_out"))


def recorded(hit, concealed):
    """Accelerations and force with noise; ``concealed`` is the hidden force (u, v) -> (2,)."""
    random = np.random.default_rng(hit.seed)
    dt = 1.0 / (RATE * FINE)
    t = np.arange(SAMPLES * FINE) * dt
    start, width = 0.04, 0.010
    pulse = hit.peak * np.sin(np.pi * (t - start) / width) * ((t > start) & (t < start + width))
    _, C, K = matrices()
    phi, k = sliders()
    stretch, d_0 = np.zeros_like(phi), 0.0
    u, v = np.zeros(2), np.zeros(2)
    response = np.zeros((SAMPLES, 2))
    for i, f in enumerate(pulse):
        d = u[1] - u[0]
        stretch = np.clip(stretch + (d - d_0), -phi, phi)
        d_0 = d
        force = -C @ v - K @ u - (k @ stretch) * np.array([-1.0, 1.0]) - concealed(u, v)
        force[hit.mass] += f
        a = force / MASS
        if i % FINE == 0:
            response[i // FINE] = a
        v = v + dt * a
        u = u + dt * v
    measured = np.zeros((SAMPLES, 2))
    measured[:, hit.mass] = pulse[::FINE] + 1e-3 * hit.peak * random.standard_normal(SAMPLES)
    return response + NOISE * random.standard_normal(response.shape), measured
