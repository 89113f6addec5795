"""A chain with a bolted joint that rings down in one mode, with a force at some place.

NumPy only: the sliders of the script behind configs/modal_ringdown, kicks of everything that is
not linear, and a modal filter.
"""

from collections.abc import Callable

import numpy as np
import scipy.linalg
from modal_ringdown import make_hits

import iwanjax as ij
from iwanjax.signals import ringdown

M = np.diag([2.0, 1.5, 1.0])
K = np.array([[9.0, -4.0, 0.0], [-4.0, 7.5, -3.5], [0.0, -3.5, 3.5]]) * 1e5
# A joint between the first two masses; rows of it and of all other places.
ROWS = {
    "J1": np.array([-1.0, 1.0, 0.0]),
    "m2-m3": np.array([0.0, -1.0, 1.0]),
    "m1-ground": np.array([1.0, 0.0, 0.0]),
    "m3-ground": np.array([0.0, 0.0, 1.0]),
}
TRUTH = {"F_S": 40.0, "K_T": 2.0e5, "chi": -0.4, "beta": 1.5}
ZETA = 4e-4
RATE, SECONDS, STEPS = 4096.0, 3.0, 4
LEVELS = {"fit": 0.3, "hold_out": 0.2}
"""Largest modal displacements over that at which the joint would slip altogether."""

Force = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(deflection, its rate) of a place -> force there."""


def stuck() -> tuple[np.ndarray, np.ndarray]:
    """Circular frequencies and mass-normalised shapes with the joint stuck."""
    row = ROWS["J1"]
    omega2, shapes = scipy.linalg.eigh(K + TRUTH["K_T"] * np.outer(row, row), M)
    return np.sqrt(omega2), shapes


def damping() -> np.ndarray:
    """C of one damping ratio in all modes."""
    omega, shapes = stuck()
    return M @ shapes @ np.diag(2.0 * ZETA * omega) @ shapes.T @ M


def slip() -> float:
    """Deflection of the joint from which on all of it slips."""
    chi, beta = TRUTH["chi"], TRUTH["beta"]
    return TRUTH["F_S"] * (1 + beta) / (TRUTH["K_T"] * (beta + (chi + 1) / (chi + 2)))


def released(strokes: np.ndarray, place: str, force: Force) -> np.ndarray:
    """Modal velocities (N, modes, hits) after the chain was let go in its modes' shapes.

    ``strokes`` (modes, hits): largest deflection of the joint by each mode on its own, over that
    at which it would slip altogether.
    """
    omega, shapes = stuck()
    oscillator = make_hits.Oscillator(f_0=1.0, zeta_0=0.0, **TRUTH)
    slips, k = make_hits.sliders(oscillator, 160, 1.07)
    J, row = ROWS["J1"], ROWS[place]
    dt = 1.0 / (RATE * STEPS)
    stuck_K = K + TRUTH["K_T"] * np.outer(J, J)
    A = np.block(
        [
            [np.zeros((3, 3)), np.eye(3)],
            [-np.linalg.solve(M, stuck_K), -np.linalg.solve(M, damping())],
        ]
    )
    step, inverse = scipy.linalg.expm(A * dt), np.linalg.inv(M)
    q = strokes * slip() / np.abs(J @ shapes)[:, None]
    x, v = np.zeros(q.shape), shapes @ (omega[:, None] * q)
    stretch = np.zeros((q.shape[1], slips.size))

    def kick() -> np.ndarray:
        slack = TRUTH["K_T"] * (J @ x) - stretch @ k
        push = np.outer(J, slack) - np.outer(row, force(row @ x, row @ v))
        return 0.5 * dt * (inverse @ push)

    seen = []
    for i in range(round(RATE * SECONDS) * STEPS):
        if i % STEPS == 0:
            seen.append(v)
        # Half a kick before and after: second order.
        v = v + kick()
        moved, v = np.split(step @ np.concatenate([x, v]), 2)
        stretch = np.clip(stretch + (J @ (moved - x))[:, None], -slips, slips)
        x = moved
        v = v + kick()
    return shapes.T @ M @ np.array(seen)


def decays(place: str, force: Force) -> np.ndarray:
    """The same after one mode at a time, its own velocity alone, (N, modes, hits)."""
    levels = np.array(list(LEVELS.values()))
    modal = released(np.kron(np.eye(3), levels), place, force)
    return np.einsum("nmmh->nmh", modal.reshape(len(modal), 3, 3, levels.size))


def measured(place: str, force: Force, noise_db: float = -60.0) -> dict[int, list[ij.ModalCurves]]:
    """Curves of all hits against modal displacement, noise so far below each one's peak."""
    random, found = np.random.default_rng(0), {}
    for mode, hits in enumerate(np.moveaxis(decays(place, force), 1, 0)):
        noise = 10.0 ** (noise_db / 20.0) * np.abs(hits).max(axis=0)
        hits = hits + noise * random.standard_normal(hits.shape)
        f, found[mode] = stuck()[0][mode] / (2.0 * np.pi), []
        for name, signal in zip(LEVELS, hits.T, strict=True):
            curves = ringdown(signal, RATE, (0.85 * f, 1.1 * f), "velocity", name=name).curves
            there = curves.as_quantity("displacement")
            found[mode].append(there.scaled(1.0, "modal displacement"))
    return found
