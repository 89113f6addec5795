"""Cases of physics that has no name: the laws of `foreign_laws.py` on chains.

`python tests/concealed/foreign.py OUT [--only NAME ...] [--number N]` writes a study for each.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from concealed.effects import Effect
from concealed.physics import integrate
from concealed.plan import Case, blows, scattered_joints
from concealed.structures import STRUCTURES, Structure, tangent_stiffness
from concealed.study import write


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
    # A third of the mass that vibrates there, at the largest deflection.
    "inertia": Foreign("chain6", "growing_inertia", "m3-ground", lambda k, d, v: (0.3 * k / v**2,)),
}


def _sized(structure: Structure, each: Foreign, case: Case) -> Effect:
    """By what the place does in the hardest recording without the effect."""
    row = structure.rows[each.where]
    stiffness = 1.0 / (row @ np.linalg.solve(tangent_stiffness(structure), row))
    fine = integrate(structure, case.true, (), [case.hardest], 8, watch_rows=True)
    path = fine.rows[:, 0, list(structure.rows).index(each.where)]
    rate = np.gradient(path) * 8 * structure.rate
    sizes = each.build(float(stiffness), float(np.max(np.abs(path))), float(np.max(np.abs(rate))))
    return Effect(each.kind, each.where, sizes)


def case_of(name: str, number: int = 0) -> Case:
    """A case with its effect, of joints, blows and noise drawn by a number."""
    each = CASES[name]
    structure = STRUCTURES[each.structure]
    rng = np.random.default_rng([20251125, number])
    hits = blows(structure, rng)
    true, given = scattered_joints(structure, rng)
    noise, seed = float(rng.uniform(0.002, 0.005)), int(rng.integers(2**31))
    case = Case(number, structure, (), (), true, given, hits, noise, seed)
    return replace(case, effects=(_sized(structure, each, case),))


def main(arguments: list[str] | None = None) -> None:
    """Write the cases into folders OUT/NAME."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("--only", nargs="+", metavar="NAME", default=list(CASES))
    parser.add_argument("--number", type=int, default=0)
    chosen = parser.parse_args(arguments)
    for name in chosen.only:
        write(case_of(name, chosen.number), chosen.out / name)


if __name__ == "__main__":
    main()
