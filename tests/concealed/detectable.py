"""Conceal effects of the sizes that a plan is said to find: half, once and twice as large.

`python tests/concealed/detectable.py DETECTABILITY.json NUMBER FOLDER --only KIND@WHERE ...`

DETECTABILITY.json is what `iwanjax detectability` writes of the study of case NUMBER, which holds
no effect (`study.py`). Each effect is added to it at 0.5, 1 and 2 times the size found, with noise
anew; `frozen.py record FOLDER OUT.json` then tells what is found, to be held against nine of ten.
"""

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from concealed.cases import CASES
from concealed.plan import Case
from concealed.study import write

from iwanjax.trial.effects import Effect

TIMES = (0.5, 1.0, 2.0)


def effect_of(found: dict, times: float, rate: float) -> Effect:
    """The effect of so many times the size found, as the generator's parameters."""
    kind, where, size = found["kind"], found["where"], times * found["found"]
    shape = (found["shape"],) if found["shape_name"] else ()
    values: dict[str, tuple[float, ...]] = {
        "gap_contact": (size, *shape, 2.0),
        "sensor_gain": (1.0 + size,),
        "sensor_delay": (size * rate,),
        "force_gain": (1.0 + size,),
        "force_delay": (size * rate,),
    }
    return Effect(kind, where, values.get(kind, (size, *shape)))


def concealed(plan: dict, case: Case, only: list[str], repeats: int) -> dict[str, Case]:
    """Cases by their names."""
    if case.effects:
        raise ValueError(f"case {case.number} holds {case.effects[0].kind} already")
    cases = {}
    for found in plan["smallest"]:
        label = f"{found['kind']}@{found['where']}"
        # The generator has the plain form of each kind.
        if label not in only or found["variant"]:
            continue
        for times in TIMES:
            effect = effect_of(found, times, case.structure.rate)
            for repeat in range(repeats):
                name = f"{label}_{times:g}_{repeat}"
                cases[name] = replace(case, effects=(effect,), seed=case.seed + 1 + repeat)
    return cases


def main(arguments: list[str] | None = None) -> None:
    """Write the cases into folders FOLDER/KIND@WHERE_TIMES_REPEAT."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("plan", type=Path, metavar="DETECTABILITY.json")
    parser.add_argument("number", type=int)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="+", required=True, metavar="KIND@WHERE")
    parser.add_argument("--repeats", type=int, default=3)
    chosen = parser.parse_args(arguments)
    plan = json.loads(chosen.plan.read_text())
    case = next(case for case in CASES if case.number == chosen.number)
    for name, each in concealed(plan, case, chosen.only, chosen.repeats).items():
        write(each, chosen.folder / name)
        print(name, flush=True)


if __name__ == "__main__":
    main()
