"""One bolted mode that rings down with a further force beside its joint, by discrete sliders.

NumPy only: the sliders of the script behind configs/modal_ringdown, and a force of its own.
"""

from collections.abc import Callable

import numpy as np
from modal_ringdown import make_hits

import iwanjax as ij
from iwanjax.signals import ringdown

TRUTH = make_hits.TRUTH
RATE, SECONDS, STEPS = 2048.0, 4.0, 8
LEVELS = (2.5, 1.2, 0.4, 1.6)
"""Velocities after the hits over omega_0 phi_max; the last is held out."""

COUNTS = (16, 21, 25, 21)
"""Levels of each hit's curve, the loudest: as many whatever acts, for one compiled search."""

COLUMNS = ("amplitude", "frequency", "damping", "frequency_std", "damping_std")

CyclicForce = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(displacement, velocity) -> force per unit modal mass."""


def decays(force: CyclicForce) -> np.ndarray:
    """Velocities (N, hits) of free decays, by kicks of everything that is not linear."""
    omega, zeta = TRUTH.omega_0, TRUTH.zeta_0
    slip, k = make_hits.sliders(TRUTH, 120, 1.09)
    dt = 1.0 / (RATE * STEPS)
    damped = omega * np.sqrt(1.0 - zeta**2)
    e, cos, sin = np.exp(-zeta * omega * dt), np.cos(damped * dt), np.sin(damped * dt)
    step = e * np.array(
        [
            [cos + zeta * omega / damped * sin, sin / damped],
            [-(omega**2) / damped * sin, cos - zeta * omega / damped * sin],
        ]
    )
    v = np.array(LEVELS) * omega * TRUTH.phi_max
    x = np.zeros_like(v)
    stretch = np.zeros((x.size, slip.size))
    seen = []
    for i in range(round(RATE * SECONDS) * STEPS):
        if i % STEPS == 0:
            seen.append(v)
        # Half a kick before and after: second order.
        kick = 0.5 * dt * (TRUTH.K_T * x - stretch @ k - force(x, v))
        moved, v = step @ np.stack([x, v + kick])
        stretch = np.clip(stretch + (moved - x)[:, None], -slip, slip)
        x = moved
        v = v + 0.5 * dt * (TRUTH.K_T * x - stretch @ k - force(x, v))
    return np.array(seen)


def measured(
    force: CyclicForce, noise_db: float, seed: int, decayed: np.ndarray | None = None
) -> list[ij.ModalCurves]:
    """Curves of all hits, noise so far below each one's peak."""
    v = decays(force) if decayed is None else decayed
    noise = np.random.default_rng(seed).standard_normal(v.shape)
    v = v + 10.0 ** (noise_db / 20.0) * np.abs(v).max(axis=0) * noise
    return [
        _loudest(ringdown(hit, RATE, (90.0, 150.0), "velocity", unit="m/s").curves, count, i)
        for i, (hit, count) in enumerate(zip(v.T, COUNTS, strict=True), 1)
    ]


def _loudest(curves: ij.ModalCurves, count: int, hit: int) -> ij.ModalCurves:
    """The first levels of a decay."""
    first = {name: np.asarray(getattr(curves, name))[:count] for name in COLUMNS}
    return ij.ModalCurves(
        **first,
        quantity=curves.quantity,
        unit=curves.unit,
        name=f"hit{hit}",
        largest=curves.largest,
    )
