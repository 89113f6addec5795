"""Cases of physics that has no name: the laws of `foreign_laws.py` on chains and a beam.

`python tests/concealed/foreign.py OUT [--only NAME ...] [--number N] [--structure NAME]` writes a
study for each. Number 0 has the places below; every other number draws a place for each law, and
a structure where none is given.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from concealed.hammer import integrate
from concealed.plan import Case, blows, scattered_joints
from concealed.structures import STRUCTURES, Structure
from concealed.study import write

from iwanjax.trial.effects import Effect
from iwanjax.trial.structure import tangent_stiffness


@dataclass(frozen=True)
class Foreign:
    """A case: its structure, what is concealed where, and how large it is.

    `build` has the stiffness at the place, its largest deflection and rate without the effect.
    """

    structure: str
    kind: str
    where: str
    build: Callable[[float, float, float], tuple[float, ...]]


CASES = {
    "softening": Foreign("chain3", "softening", "m2-m3", lambda k, d, v: (0.8 * k, 0.25 * d)),
    "root": Foreign(
        "chain3", "root_damper", "m3-ground", lambda k, d, v: (0.12 * k * d / v**0.5, 1e-3 * v)
    ),
    "bouc_wen": Foreign(
        "chain3", "smooth_hysteresis", "m2-m3", lambda k, d, v: (0.8 * k, 0.15 * d, 1.7)
    ),
    "bristles": Foreign(
        "chain6",
        "bristles",
        "m3-m4",
        lambda k, d, v: (k, 0.0, 0.02 * k * d / v, 0.08 * k * d, 0.12 * k * d, 0.1 * v),
    ),
    "freeplay": Foreign(
        "chain3", "rubbing_freeplay", "m3-ground", lambda k, d, v: (0.8 * k, 0.3 * d, 0.04 * k * d)
    ),
    "squeezed": Foreign("chain6", "squeezed_damper", "m5-ground", lambda k, d, v: (k / d / v,)),
    # A seventh of the mass that vibrates there, at the largest deflection.
    "inertia": Foreign(
        "chain6", "growing_inertia", "m3-ground", lambda k, d, v: (0.15 * k / v**2,)
    ),
    "pinching": Foreign(
        "chain3", "pinched", "m2-m3", lambda k, d, v: (0.8 * k, 0.15 * d, 0.8, 0.1, 0.2)
    ),
    "fractional": Foreign(
        "chain6", "fractional_damper", "m5-ground", lambda k, d, v: (0.15 * k * (d / v) ** 0.5, 0.5)
    ),
    "attached": Foreign(
        "chain3",
        "attached_mass",
        "m3-ground",
        lambda k, d, v: (0.1 * k * (d / v) ** 2, 1.6 * v / d, 0.02),
    ),
}
DRAWN = ("chain3", "chain6", "lap_beam")
"""Structures of the other numbers."""
LARGEST_CHANGE = 0.01
"""Relative, of a recording by half the steps; errors of integration fall with their square."""
SHARES = (1.0, 0.1)
"""Of the size: an inertia that grows beyond a mesh's lightest node cannot be simulated so."""


def of_steps(case: Case) -> float:
    """The largest relative change of a recording by half the steps: what is unstable has none."""
    steps = case.structure.steps
    fine, coarse = (
        integrate(case.structure, case.true, case.effects, case.hits, n).response[::n]
        for n in (steps, steps // 2)
    )
    with np.errstate(all="ignore"):
        change = np.mean((coarse - fine) ** 2, axis=(0, 2)) / np.mean(fine**2, axis=(0, 2))
    return float(np.sqrt(np.max(change)))


def _sized(structure: Structure, each: Foreign, case: Case) -> Effect:
    """By what the place does in the hardest recording without the effect."""
    row = structure.rows[each.where]
    stiffness = 1.0 / (row @ np.linalg.solve(tangent_stiffness(structure), row))
    fine = integrate(structure, case.true, (), [case.hardest], 8, watch_rows=True)
    path = fine.rows[:, 0, list(structure.rows).index(each.where)]
    rate = np.gradient(path) * 8 * structure.rate
    sizes = each.build(float(stiffness), float(np.max(np.abs(path))), float(np.max(np.abs(rate))))
    return Effect(each.kind, each.where, sizes)


def case_of(name: str, number: int = 0, structure: str = "") -> Case:
    """A case with its effect, of joints, blows and noise drawn by a number."""
    each = CASES[name]
    if number:
        drawn = np.random.default_rng([20261126, number, list(CASES).index(name)])
        at_random = str(drawn.choice(DRAWN))
        of = STRUCTURES[structure or at_random]
        free = [place for place in of.rows if place not in of.joints]
        each = replace(each, structure=of.name, where=str(drawn.choice(free)))
    built = STRUCTURES[each.structure]
    rng = np.random.default_rng([20251125, number])
    hits = blows(built, rng)
    true, given = scattered_joints(built, rng)
    noise, seed = float(rng.uniform(0.002, 0.005)), int(rng.integers(2**31))
    case = Case(number, built, (), (), true, given, hits, noise, seed)
    full = _sized(built, each, case)
    for share in SHARES:
        values = (share * full.values[0], *full.values[1:])
        sized = replace(case, effects=(replace(full, values=values),))
        if of_steps(sized) < LARGEST_CHANGE:
            return sized
    raise ArithmeticError(
        f"{name}, number {number}: half the steps change a recording by more than "
        f"{100 * LARGEST_CHANGE:g} %, at every size; take another number"
    )


def main(arguments: list[str] | None = None) -> None:
    """Write the cases into folders OUT/NAME."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("--only", nargs="+", metavar="NAME", default=list(CASES))
    parser.add_argument("--number", type=int, default=0)
    parser.add_argument("--structure", choices=list(STRUCTURES), default="")
    chosen = parser.parse_args(arguments)
    if chosen.structure and not chosen.number:
        parser.error("--structure needs --number; number 0 has structures of its own")
    for name in chosen.only:
        write(case_of(name, chosen.number, chosen.structure), chosen.out / name)


if __name__ == "__main__":
    main()
