"""Curves of one bolted mode from a bank of discrete sliders: NumPy alone makes the data.

Each slider is driven round its steady cycle, so that none of the closed forms that a fit uses
is behind the curves that it is given.
"""

from functools import cache

import numpy as np
from modal_ringdown import make_hits

import iwanjax as ij

Oscillator = make_hits.Oscillator
TRUTH = make_hits.TRUTH
NAMES = ("f_0", "zeta_0", "F_S", "K_T", "chi", "beta")
# One number of levels for all fits: those of one shape share their compiled kernels.
LEVELS = 40
FREQUENCY_STD, DAMPING_SHARE = 2e-3, 0.01
_HALF_CYCLE = 1500
_STEP = 0.015


def steady_cycle(phi, k, amplitude):
    """In-phase first harmonic's stiffness and loss of cycles A cos(t), one for each A.

    From the upper tip, where each slider is at its threshold or stretched by A, once down.
    """
    t = np.linspace(0.0, np.pi, _HALF_CYCLE + 1)
    stretch = np.minimum(amplitude[:, None], phi)
    force = [stretch @ k]
    for a, b in zip(np.cos(t[:-1]), np.cos(t[1:]), strict=True):
        stretch = np.maximum(stretch + (amplitude * (b - a))[:, None], -phi)
        force.append(stretch @ k)
    force = np.array(force)
    x = np.cos(t)[:, None] * amplitude
    harmonic = 2.0 / np.pi * np.trapezoid(force * np.cos(t)[:, None], t, axis=0) / amplitude
    # Masing: the way up is the way down turned round, and holds the other half of the area.
    return harmonic, 2.0 * np.trapezoid(force, x, axis=0)


def ringdown_of(o, amplitude):
    """Frequency, Hz, and damping that the envelope of a free decay shows (thesis Sec. 2.3).

    A cycle's loss comes off the energy at its tip, whose slope has the tangent stiffness there;
    the envelope is that of the acceleration.
    """
    phi, k = make_hits.sliders(o)
    rest = o.omega_0**2 - o.K_T
    grid = amplitude[:, None] * np.exp([-_STEP, 0.0, _STEP])
    harmonic, loss = (each.reshape(grid.shape) for each in steady_cycle(phi, k, grid.ravel()))
    omega = np.sqrt(rest + harmonic)
    slope = (np.log(omega[:, 2]) - np.log(omega[:, 0])) / (2.0 * _STEP)
    tip = np.minimum(grid[..., None], phi) @ k
    tangent = (tip[:, 2] - tip[:, 0]) / (grid[:, 2] - grid[:, 0])
    omega, loss = omega[:, 1], loss[:, 1]
    lost = loss + 2.0 * np.pi * o.zeta_0 * o.omega_0 * omega * amplitude**2
    damping = lost / (2.0 * np.pi * amplitude**2 * (rest + tangent)) * (1.0 + 2.0 * slope)
    return omega / (2.0 * np.pi), damping


@cache
def clean(o=TRUTH, low=0.02, high=2.0, levels=LEVELS):
    """Amplitudes between two shares of phi_max, and what the decay shows there."""
    amplitude = o.phi_max * np.geomspace(low, high, levels)
    return (amplitude, *ringdown_of(o, amplitude))


def noisy(seed, o=TRUTH, low=0.02, high=2.0, noise=1.0, levels=LEVELS):
    """Such curves as they may be measured; ``noise`` scales the errors, not what is stated."""
    amplitude, f, zeta = clean(o, low, high, levels)
    error = noise * np.random.default_rng(seed).standard_normal((2, levels))
    f_std, zeta_std = np.full(levels, FREQUENCY_STD), DAMPING_SHARE * zeta
    return ij.ModalCurves(
        amplitude,
        f + f_std * error[0],
        zeta + zeta_std * error[1],
        frequency_std=f_std,
        damping_std=zeta_std,
        quantity="displacement",
    )
