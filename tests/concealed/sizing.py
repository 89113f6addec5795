"""Find how large an effect must be to change the hardest recording as much as it is meant to.

Run once (`python tests/concealed/sizing.py [--only N ...]`): the values go to sizes.json, from
which the cases are read, so that later runs depend on no search.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from concealed.hammer import integrate, measure
from concealed.plan import Case, Wanted, plan

from iwanjax.trial.acquisition import decimate, saturate
from iwanjax.trial.effects import LINEAR, Effect
from iwanjax.trial.sizes import (
    BANDS,
    REACHED,
    Search,
    fault_values,
    relative_change,
    scaled,
    size_for,
)
from iwanjax.trial.structure import Array

SIZES = Path(__file__).with_name("sizes.json")
OVERSAMPLING = 8
Found = tuple[tuple[float, ...], float]
"""Values of an effect and the relative change of the hardest recording."""


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


def _largest(case: Case, where: str) -> float:
    """Peak that a sensor sees in any recording that may be fitted.

    What is cut in a held-out one only shows nowhere.
    """
    at = list(case.structure.sensors).index(where)
    fitted = [hit for hit in case.hits if hit.use == "fit"]
    response, _ = measure(case.structure, case.true, (), fitted, OVERSAMPLING)
    return float(np.abs(response[..., at]).max())


def find(case: Case, wanted: Wanted) -> Found:
    """Return an effect's values and the relative change of the hardest recording."""
    kind, where, strength = wanted
    rng = np.random.default_rng([case.seed, len(kind), ord(kind[0])])
    without = _responses(case, (), 1)
    if kind.startswith("sensor"):
        values = fault_values(kind, strength, rng, lambda: _largest(case, where))
        effect = Effect(kind, where, values)
        return values, float(relative_change(_responses(case, (effect,), 1), without)[0])
    search = _search(case, wanted, rng)
    # Drag that changes the responses more than this holds its mass fast.
    band = (0.5, 0.55) if wanted[0::2] == ("quadratic_damping", "plain") else BANDS[strength]
    target = float(np.exp(rng.uniform(*np.log(band))))
    reached = size_for(search, lambda s: _changes(case, wanted, search, s, without), target)
    size = np.array([reached])
    change = float(_changes(case, wanted, search, size, without)[0])
    values = tuple(float(np.ravel(value)[0]) for value in search.build(size[0]))
    return values, change


def refusal(case: Case, found: list[Found]) -> str | None:
    """Why effects are no concealed case, or None.

    A size may not reach its band (stiction in a joint that hardly slips), and a softening spring
    may let go in a recording that no size was judged on.
    """
    for (kind, where, strength), (_, change) in zip(case.wanted, found, strict=True):
        if not kind.startswith("sensor") and change < REACHED * BANDS[strength][0]:
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
