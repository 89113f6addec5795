"""Find how large an effect must be to change the hardest recording as much as it is meant to.

Run once (`python tests/concealed/sizing.py [--only N ...]`): the values go to sizes.json, from
which the cases are read, so that later runs depend on no search.
"""

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from concealed.acquisition import decimate, measure, saturate
from concealed.effects import LINEAR, Effect
from concealed.physics import integrate
from concealed.plan import Case, Wanted, plan
from concealed.structures import Array, Structure, tangent_stiffness

SIZES = Path(__file__).with_name("sizes.json")
BANDS = {"plain": (0.6, 1.1), "medium": (0.18, 0.36), "weak": (0.05, 0.09)}
OVERSAMPLING = 8
_REACHED = 0.8
"""Of the lower end of its band: an effect that changes less at its largest size is refused."""
Found = tuple[tuple[float, ...], float]
"""Values of an effect and the relative change of the hardest recording."""
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


def _responses(case: Case, effects: tuple[Effect, ...], count: int) -> Array:
    response, _ = measure(
        case.structure, case.true, effects, [case.hardest] * count, oversampling=OVERSAMPLING
    )
    return saturate("sensor", list(case.structure.sensors), effects, response)


def _search(case: Case, wanted: Wanted, rng: np.random.Generator) -> Search:
    """Scale an effect by the structure's stiffness at its place and the deflections there."""
    kind, where, _ = wanted
    if kind == "stiction":
        return Search(lambda s: (1 - s,), 0.005, 0.7)
    if kind == "joint_drift":
        return Search(lambda s: (1 - s, 1 - 0.25 * s), 0.005, 0.35)
    structure = case.structure
    fine = integrate(structure, case.true, (), [case.hardest], OVERSAMPLING, watch_rows=True)
    path = fine.rows[:, 0, list(structure.rows).index(where)]
    path = decimate(path[:, None], structure.samples, OVERSAMPLING)[:, 0]
    return scaled(structure, kind, where, path, rng)


def scaled(
    structure: Structure, kind: str, where: str, path: Array, rng: np.random.Generator
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
    }
    return Search(*builds[kind])


def _changes(case: Case, wanted: Wanted, search: Search, sizes: Array, without: Array) -> Array:
    """Relative change at each size; all at once where the sizes leave the linear part alone."""
    kind, where, _ = wanted
    if kind not in LINEAR:
        effect = Effect(kind, where, search.build(sizes))
        with np.errstate(all="ignore"):
            return relative_change(_responses(case, (effect,), len(sizes)), without)
    changes = []
    for size in sizes:
        effect = Effect(kind, where, search.build(size))
        changes.append(relative_change(_responses(case, (effect,), 1), without)[0])
    return np.array(changes)


def crossing(sizes: Array, changes: Array, target: float) -> tuple[float, float]:
    """Neighbouring sizes between which the change first passes the target (or the largest)."""
    for i in range(1, len(sizes)):
        if not np.isfinite(changes[i]):
            break
        if changes[i] >= target:
            return float(sizes[i - 1]), float(sizes[i])
    best = int(np.nanargmax(np.where(np.isfinite(changes), changes, np.nan)))
    return float(sizes[max(best - 1, 0)]), float(sizes[best])


def _sensor_values(case: Case, wanted: Wanted, rng: np.random.Generator) -> tuple[float, ...]:
    """Physical sizes of faults of the measurement chain."""
    kind, where, strength = wanted
    grade = ["plain", "medium", "weak"].index(strength)
    if kind == "sensor_gain":
        low, high = [(0.2, 0.3), (0.1, 0.15), (0.03, 0.08)][grade]
        return (float(1 + rng.uniform(low, high) * rng.choice([-1.0, 1.0])),)
    if kind == "sensor_delay":
        low, high = [(2.0, 3.0), (0.8, 1.5), (0.3, 0.5)][grade]
        return (round(float(rng.uniform(low, high)) * 8) / 8,)  # whole steps at any step used
    if kind == "sensor_saturation":
        low, high = [(0.5, 0.6), (0.65, 0.75), (0.8, 0.9)][grade]
        at = list(case.structure.sensors).index(where)
        # Of the largest peak that this sensor sees in any recording that may be fitted: what is
        # cut in a held-out one only shows nowhere.
        fitted = [hit for hit in case.hits if hit.use == "fit"]
        response, _ = measure(case.structure, case.true, (), fitted, OVERSAMPLING)
        return (float(rng.uniform(low, high) * np.abs(response[..., at]).max()),)
    return ()


def find(case: Case, wanted: Wanted) -> Found:
    """Return an effect's values and the relative change of the hardest recording."""
    kind, where, strength = wanted
    rng = np.random.default_rng([case.seed, len(kind), ord(kind[0])])
    without = _responses(case, (), 1)
    if kind.startswith("sensor"):
        values = _sensor_values(case, wanted, rng)
        effect = Effect(kind, where, values)
        return values, float(relative_change(_responses(case, (effect,), 1), without)[0])
    search = _search(case, wanted, rng)
    low, high = search.low, search.high
    # Drag that changes the responses more than this holds its mass fast.
    band = (0.5, 0.55) if wanted[0::2] == ("quadratic_damping", "plain") else BANDS[strength]
    target = float(np.exp(rng.uniform(*np.log(band))))
    for count in (9, 7, 5):
        sizes = np.geomspace(low, high, count)
        low, high = crossing(sizes, _changes(case, wanted, search, sizes, without), target)
    size = np.array([np.sqrt(low * high)])
    change = float(_changes(case, wanted, search, size, without)[0])
    values = tuple(float(np.ravel(value)[0]) for value in search.build(size[0]))
    return values, change


def refusal(case: Case, found: list[Found]) -> str | None:
    """Why effects are no concealed case, or None.

    A size may not reach its band (stiction in a joint that hardly slips), and a softening spring
    may let go in a recording that no size was judged on.
    """
    for (kind, where, strength), (_, change) in zip(case.wanted, found, strict=True):
        if not kind.startswith("sensor") and change < _REACHED * BANDS[strength][0]:
            return f"{kind} at {where} changes the hardest recording by {change:.3f} at most"
    effects = tuple(Effect(w[0], w[1], f[0]) for w, f in zip(case.wanted, found, strict=True))
    with np.errstate(all="ignore"):
        response, _ = measure(case.structure, case.true, effects, case.hits, OVERSAMPLING)
    return None if np.isfinite(response).all() else "a recording runs away"


def main(arguments: list[str] | None = None) -> None:
    """Fill sizes.json for all cases or for the named ones."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--only", type=int, nargs="+", metavar="N")
    only = parser.parse_args(arguments).only
    table = json.loads(SIZES.read_text()) if SIZES.exists() else {}
    for case in plan():
        if not case.wanted or (only and case.number not in only):
            continue
        found = [find(case, wanted) for wanted in case.wanted]
        why = refusal(case, found)
        table[str(case.number)] = why or [
            {"kind": kind, "where": where, "values": values, "change": change}
            for (kind, where, _), (values, change) in zip(case.wanted, found, strict=True)
        ]
        print(case.number, case.structure.name, *case.wanted, why or found, flush=True)
        SIZES.write_text(json.dumps(dict(sorted(table.items(), key=lambda i: int(i[0]))), indent=1))


if __name__ == "__main__":
    main()
