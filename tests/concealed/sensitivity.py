"""What each tuned number of the diagnosis decides: every one of them halved and doubled.

`python tests/concealed/sensitivity.py run FOLDER OUT.json --only CASE ... [--stages STAGE ...]`
`python tests/concealed/sensitivity.py table OUT.json`

FOLDER holds concealed cases as for `frozen.py`; STAGE is the beginning of a field's path (`steady`,
`judgement`, `histories.selection`, `histories.steps.same`). All values are tried in one process
(`tests/sensitivity_worker.py`, which imports the package), so that compiled kernels stay. OUT.json
is written after every case, and what it holds is not tried again: a run may be stopped and gone on
with. The table has a row for each number: cases right with it halved, as it is and doubled; the
largest change of the first probability, and of a parameter that is named, in its deviations; and
seconds, all cases together.
"""

import argparse
import json
import math
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

AS_IS = "as is"
FACTORS = {"halved": 0.5, "doubled": 2.0}

Kept = dict[str, dict[str, dict[str, Any]]]


def numbers(settings: Any, path: str = "") -> Iterator[tuple[str, Any, str]]:
    """Path, value and unit of every field of settings that are dataclasses within one another."""
    for each in fields(settings):
        name, value = f"{path}{each.name}", getattr(settings, each.name)
        if is_dataclass(value):
            yield from numbers(value, f"{name}.")
        else:
            yield name, value, unit(type(settings).__doc__ or "", each.name)


def unit(docstring: str, name: str) -> str:
    """Of a field, where its docstring has `name : type, unit`; 1 otherwise."""
    found = re.search(rf"^ *(?:\w+, )*{name}(?:, \w+)* : [^,\n]*, (.+)$", docstring, re.MULTILINE)
    return found[1] if found else "1"


def scaled(value: Any, factor: float) -> Any:
    """A number times a factor, whole numbers rounded up and at least 1; each of several."""
    if isinstance(value, tuple):
        return tuple(scaled(each, factor) for each in value)
    if isinstance(value, int):
        return max(1, math.ceil(factor * value))
    return factor * value


def replaced(settings: Any, path: str, value: Any) -> Any:
    """Settings with another value at a path."""
    name, _, rest = path.partition(".")
    inner = replaced(getattr(settings, name), rest, value) if rest else value
    return replace(settings, **{name: inner})


def trials(settings: Any, stages: list[str] | None) -> Iterator[tuple[str, str, Any]]:
    """Path, name of the change, and settings with it; those as they are first."""
    yield "", AS_IS, settings
    for path, value, _ in numbers(settings):
        if stages and not any(f"{path}.".startswith(f"{stage}.") for stage in stages):
            continue
        for name, factor in FACTORS.items():
            other = scaled(value, factor)
            if other != value:
                yield path, name, replaced(settings, path, other)


def _score(found: dict[str, dict[str, Any]]) -> str:
    return f"{sum(each['right'] for each in found.values())}/{len(found)}"


def _seconds(found: dict[str, dict[str, Any]]) -> str:
    return f"{sum(each['seconds'] for each in found.values()):.0f}"


def _probability(found: dict[str, Any]) -> float:
    """Of what leads: the first suspect, or nothing."""
    if "error" in found:
        return math.nan
    named = [each["probability"] for each in found["what"][:1]]
    return max([found["probability_nothing_missing"], *named])


def _moved(before: dict[str, Any], after: dict[str, Any]) -> float:
    """Largest change of a parameter of the first suspect, in deviations; NaN for another one."""
    if "error" in after or before["said"] != after["said"] or not before["what"]:
        return math.nan
    first, other = (each["what"][0]["parameters"] for each in (before, after))
    moved = [
        abs(other[name]["value"] - one["value"]) / one["std"]
        for name, one in first.items()
        if name in other and one["std"]
    ]
    return max(moved, default=math.nan)


def _largest(values: Iterator[float]) -> str:
    known = [each for each in values if not math.isnan(each)]
    return f"{max(known):.2g}" if known else ""


def table(record: dict[str, Any]) -> str:
    """The record in Markdown, a row for each number that was tried."""
    header = ("field", "value", "unit", "right: halved", AS_IS, "doubled")
    header += ("change of probability", "of parameter, deviations", "seconds: halved", AS_IS)
    header += ("doubled",)
    lines = [header, ("---",) * len(header)]
    kept: Kept = record["kept"]
    usual = kept[""][AS_IS]
    for path, (value, of) in record["fields"].items():
        tried = kept.get(path)
        if not tried:
            continue
        pairs = [(usual[case], each) for own in tried.values() for case, each in own.items()]
        cases = {case for own in tried.values() for case in own}
        same = {case: each for case, each in usual.items() if case in cases}
        columns = [tried.get("halved", {}), same, tried.get("doubled", {})]
        row = [path, f"{value}", of, *map(_score, columns)]
        row.append(_largest(abs(_probability(a) - _probability(b)) for a, b in pairs))
        row.append(_largest(_moved(a, b) for a, b in pairs))
        lines.append((*row, *map(_seconds, columns)))
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main(arguments: list[str] | None = None) -> int:
    """Try values, or print what came of it."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    running = verbs.add_parser("run")
    running.add_argument("folder", type=Path)
    running.add_argument("out", type=Path)
    running.add_argument("--only", nargs="+", metavar="CASE", required=True)
    running.add_argument("--stages", nargs="+", metavar="STAGE")
    verbs.add_parser("table").add_argument("out", type=Path)
    chosen = parser.parse_args(arguments)
    if chosen.verb == "table":
        print(table(json.loads(chosen.out.read_text())))
        return 0
    worker = Path(__file__).resolve().parents[1] / "sensitivity_worker.py"
    task = {
        "folder": str(chosen.folder),
        "out": str(chosen.out),
        "only": chosen.only,
        "stages": chosen.stages,
    }
    # As the command has it, before anything is imported.
    environment = {**os.environ, "EQX_ON_ERROR": "nan"}
    command = [sys.executable, str(worker), json.dumps(task)]
    return subprocess.run(command, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
