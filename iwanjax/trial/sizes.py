"""How large an effect must be to change a recording as much as it is meant to."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from iwanjax.trial.structure import Array, TrialStructure, tangent_stiffness

BANDS: Mapping[str, tuple[float, float]] = {
    "plain": (0.6, 1.1),
    "medium": (0.18, 0.36),
    "weak": (0.05, 0.09),
}
"""Relative change of the hardest recording, by strength."""
# Sizes of sensors' faults by strength.
_FAULTS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "sensor_gain": {"plain": (0.2, 0.3), "medium": (0.1, 0.15), "weak": (0.03, 0.08)},
    # Sampling intervals.
    "sensor_delay": {"plain": (2.0, 3.0), "medium": (0.8, 1.5), "weak": (0.3, 0.5)},
    # Of the largest peak.
    "sensor_saturation": {"plain": (0.5, 0.6), "medium": (0.65, 0.75), "weak": (0.8, 0.9)},
}
REACHED = 0.8
"""Of the lower end of its band: an effect that changes less at its largest size is refused."""
# Sizes tried at once in each round; every round lies between two of the one before.
_ROUNDS = (9, 7, 5)
Build = Callable[[Array], tuple[float | Array, ...]]
"""Values of an effect from its dimensionless size."""


@dataclass(frozen=True)
class Search:
    """How an effect's values follow from one dimensionless size, and where to look for it."""

    build: Build
    low: float
    high: float


def relative_change(response: Array, without: Array) -> Array:
    """Rms of the change over the rms without the effect, per recording, over all sensors."""
    change = np.sqrt(np.mean((response - without) ** 2, axis=(0, 2)))
    return change / np.sqrt(np.mean(without**2, axis=(0, 2)))


def scaled(
    structure: TrialStructure, kind: str, where: str, path: Array, rng: np.random.Generator
) -> Search:
    """An effect by the structure's stiffness at its place and the deflections (sample,) there."""
    row = structure.rows[where]
    stuck = tangent_stiffness(structure)
    stiffness = 1 / (row @ np.linalg.solve(stuck, row))
    mobility = row @ np.linalg.solve(structure.M, row)
    omega = np.sqrt(stiffness * mobility)
    deflection = float(np.abs(path).max())
    velocity = float(np.abs(np.gradient(path)).max() * structure.rate)
    share = float(rng.uniform(0.25, 0.5))
    sides = float(rng.choice([1.0, 2.0]))
    sign = float(rng.choice([-1.0, 1.0]))
    chi, beta = float(rng.uniform(-0.6, -0.3)), float(rng.uniform(1.0, 3.0))
    softer = sign if kind in ("stiffness_error", "quadratic_stiffness") else 1.0
    first = np.sqrt(np.min(np.linalg.eigvals(np.linalg.solve(structure.M, stuck)).real))
    tau = float(rng.uniform(0.5, 1.5) / first)
    reach = (chi + 1) / (chi + 2)
    builds: dict[str, tuple[Build, float, float]] = {
        "stiffness_error": (lambda s: (softer * stiffness * s,), 1e-4, 0.9),
        "mass_error": (lambda s: (s / mobility,), 1e-4, 1.0),
        "viscous_damping": (lambda s: (s * stiffness / omega,), 1e-4, 3.0),
        "cubic_stiffness": (lambda s: (s * stiffness / deflection**2,), 1e-3, 30.0),
        "quadratic_stiffness": (lambda s: (softer * s * stiffness / deflection,), 1e-3, 0.8),
        "gap_contact": (lambda s: (s * stiffness, share * deflection, sides), 1e-3, 30.0),
        "bilinear_stiffness": (lambda s: (s * stiffness,), 1e-3, 10.0),
        "coulomb_friction": (lambda s: (s * stiffness, 0.2 * share * deflection), 1e-3, 30.0),
        # The joint itself holds the deflection back, so it slips at a smaller one when stiff.
        "iwan_joint": (
            lambda s: (
                s * stiffness * 2 * deflection / (1 + s) * (beta + reach) / (1 + beta),
                s * stiffness,
                chi,
                beta,
            ),
            1e-3,
            10.0,
        ),
        "quadratic_damping": (lambda s: (s * stiffness / (omega * velocity),), 1e-3, 10.0),
        "viscoelastic": (lambda s: (s * stiffness, tau), 1e-3, 10.0),
        "softening": (lambda s: (s * stiffness, share * deflection), 1e-3, 10.0),
        "root_damper": (
            lambda s: (s * stiffness * deflection / velocity**0.5, 1e-3 * velocity),
            1e-3,
            10.0,
        ),
        "squeezed_damper": (lambda s: (s * stiffness / (deflection * velocity),), 1e-3, 30.0),
        "growing_inertia": (lambda s: (s * stiffness / velocity**2,), 1e-3, 3.0),
        "smooth_hysteresis": (
            lambda s: (s * stiffness, 0.5 * share * deflection, 1.0 + share),
            1e-3,
            10.0,
        ),
        "pinched": (
            lambda s: (s * stiffness, 0.5 * share * deflection, 0.8, 0.1, 0.2),
            1e-3,
            10.0,
        ),
        "bristles": (
            lambda s: (
                10.0 * s * stiffness,
                0.0,
                0.2 * s * stiffness * deflection / velocity,
                0.8 * s * stiffness * deflection,
                1.2 * s * stiffness * deflection,
                0.1 * velocity,
            ),
            1e-3,
            1.0,
        ),
        "rubbing_freeplay": (
            lambda s: (s * stiffness, share * deflection, 0.05 * s * stiffness * deflection),
            1e-3,
            30.0,
        ),
        "fractional_damper": (
            lambda s: (s * stiffness * (deflection / velocity) ** 0.5, 0.5),
            1e-3,
            10.0,
        ),
        "attached_mass": (
            lambda s: (s * stiffness / omega**2, (1.0 + share) * omega, 0.02),
            1e-3,
            1.0,
        ),
    }
    return Search(*builds[kind])


def crossing(sizes: Array, changes: Array, target: float) -> tuple[float, float]:
    """Neighbouring sizes between which the change first passes the target (or the largest)."""
    for i in range(1, len(sizes)):
        if not np.isfinite(changes[i]):
            break
        if changes[i] >= target:
            return float(sizes[i - 1]), float(sizes[i])
    best = int(np.nanargmax(np.where(np.isfinite(changes), changes, np.nan)))
    return float(sizes[max(best - 1, 0)]), float(sizes[best])


def size_for(search: Search, changes: Callable[[Array], Array], target: float) -> float:
    """The size whose change is the target; where none is, the one that changes most.

    NaN where none can be simulated: a law may be too stiff for its steps.

    `changes` gives the relative change of the hardest recording at each of several sizes.
    """
    low, high = search.low, search.high
    for count in _ROUNDS:
        sizes = np.geomspace(low, high, count)
        found = changes(sizes)
        if not np.any(np.isfinite(found)):
            return math.nan
        low, high = crossing(sizes, found, target)
    return float(np.sqrt(low * high))


def fault_values(
    kind: str, strength: str, rng: np.random.Generator, largest: Callable[[], float]
) -> tuple[float, ...]:
    """Physical sizes of a sensor's fault; `largest` gives its peak in what is fitted."""
    ranges = _FAULTS.get(kind)
    if ranges is None:
        return ()
    low, high = ranges[strength]
    drawn = float(rng.uniform(low, high))
    match kind:
        case "sensor_gain":
            return (float(1 + drawn * rng.choice([-1.0, 1.0])),)
        case "sensor_delay":
            return (round(drawn * 8) / 8,)  # whole steps at any step used
    return (drawn * largest(),)
