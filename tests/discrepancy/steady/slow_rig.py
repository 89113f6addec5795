"""A rig that drives a joint slowly: sliders of its own, many finer steps than a fit takes."""

import numpy as np
from scipy.interpolate import CubicSpline

FINE = 16
"""Steps of the rig between two recorded values."""
A_CYCLE = 120
"""Recorded values of a cycle."""
NOISE, OFFSET = 0.02, 0.3
"""Deviation of the load cell, and what it shows at rest."""


def sines(amplitudes):
    """Two cycles of each amplitude from rest."""
    phase = 2.0 * np.pi * np.arange(2 * A_CYCLE) / A_CYCLE
    return np.append(np.concatenate([a * np.sin(phase) for a in amplitudes]), 0.0)


def finer(x):
    """The same motion or channel in the rig's own steps."""
    count = len(x)
    return CubicSpline(np.arange(count), x)(np.arange((count - 1) * FINE + 1) / FINE)


def slider(d, F_S, K_T):
    """Force of one slider whose strength and stiffness may change from step to step."""
    stretch, last, force = 0.0, 0.0, []
    for now, F, K in zip(d, *(np.broadcast_to(x, d.shape) for x in (F_S, K_T)), strict=True):
        stretch, last = float(np.clip(stretch + now - last, -F / K, F / K)), now
        force.append(K * stretch)
    return np.array(force)


def measured(force, random):
    """What is recorded of the rig's force."""
    kept = force[::FINE]
    return kept + OFFSET + NOISE * random.standard_normal(kept.size)
