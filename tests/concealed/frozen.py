"""Keep the verdicts on a folder of concealed cases, and hold two such records side by side.

`python tests/concealed/frozen.py record FOLDER OUT.json [--jobs 2] [--only NAME ...]`
`python tests/concealed/frozen.py summary RECORD.json FOLDER`
`python tests/concealed/frozen.py compare BEFORE.json AFTER.json [--exact 1e-9]`

FOLDER holds a folder for each case (`study.py`, `modal.py`, `steady.py`, `laboratory.py`), each
with `study.yaml` and the truth beside it; `frozen.json` beside this file is the last record, of 48
cases. Steps that move and rename code leave every number as it is: `--exact` fails where one does
not. Others may change numbers, not the score. A summary is of the laboratory's cases.
"""

import argparse
import json
import math
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

WITHIN = 1.5
"""Times the noise floor that a held-out error may be (acceptance of the laboratory's cases)."""


def _truth(folder: Path) -> list[str]:
    """kind@where of all that is concealed, in order."""
    truth = json.loads((folder / "truth.json").read_text())
    if "modes" in truth:
        pairs = [(kind, mode) for mode, kind in truth["modes"].items()]
    elif isinstance(truth["kind"], list):
        pairs = list(zip(truth["kind"], truth["where"], strict=True))
    else:
        pairs = [(truth["kind"], truth["where"])]
    return sorted(f"{kind}@{where}" for kind, where in pairs if kind != "none")


def graded(said: list[str], verdict: str, folder: Path) -> tuple[bool, bool]:
    """Whether a verdict is right, and whether it is a false alarm.

    A mild nuisance that is in the recordings indeed may be named besides.
    """
    truth = _truth(folder)
    tolerated = json.loads((folder / "truth.json").read_text()).get("tolerated", [])
    wrong = [label for label in said if label not in tolerated]
    nothing = verdict == "nothing_missing" or bool(said)
    return wrong == truth and (bool(truth) or nothing), bool(wrong) and not truth


def _said(found: dict[str, Any]) -> list[str]:
    """kind@where of what the verdict names."""
    if found["verdict"] != "something_missing":
        return []
    if "modes" in found:
        each = [_said(mode) for mode in found["modes"].values()]
        return sorted(label for labels in each for label in labels)
    first = found["what"][0]
    return sorted([f"{first['kind']}@{first['where']}", *first["joint_with"]])


def _diagnosed(folder: Path) -> dict[str, Any]:
    """What the command says of a case, and how long it took."""
    with tempfile.TemporaryDirectory() as out:
        start = time.perf_counter()
        command = [sys.executable, "-m", "iwanjax", "diagnose", str(folder / "study.yaml")]
        run = subprocess.run(
            [*command, "--out", f"{out}/out"], capture_output=True, text=True, check=False
        )
        seconds = time.perf_counter() - start
        if run.returncode:
            last = (run.stderr.strip().splitlines() or ["no message"])[-1]
            return failed(folder, last, seconds)
        found = json.loads(Path(out, "out", "diagnosis.json").read_text())
    return judged(folder, found, seconds)


def failed(folder: Path, error: str, seconds: float) -> dict[str, Any]:
    """What a record keeps of a case that ended with an error."""
    return {"truth": _truth(folder), "error": error, "seconds": seconds, "right": False}


def judged(folder: Path, found: dict[str, Any], seconds: float) -> dict[str, Any]:
    """What a record keeps of a case's diagnosis.json, beside the truth."""
    truth, said = _truth(folder), _said(found)
    kept = {
        key: found[key]
        for key in (
            "verdict",
            "probability_nothing_missing",
            "probability_something_else",
            "what",
            "fit",
            "joints",
            "failures",
        )
        if key in found
    }
    right, alarm = graded(said, found["verdict"], folder)
    return {
        "truth": truth,
        "said": said,
        "right": right,
        "alarm": alarm,
        "seconds": seconds,
        **kept,
    }


def record(folder: Path, out: Path, jobs: int, only: list[str] | None) -> None:
    """Diagnose every case of a folder that is not in the record yet."""
    kept = json.loads(out.read_text()) if out.exists() else {}
    cases = sorted(each.parent for each in folder.glob("*/study.yaml"))
    left = [case for case in cases if case.name not in kept and (not only or case.name in only)]
    with ThreadPoolExecutor(jobs) as pool:
        for case, found in zip(left, pool.map(_diagnosed, left), strict=True):
            kept[case.name] = found
            beside = out.with_suffix(".part")
            beside.write_text(json.dumps(kept, indent=1, sort_keys=True))
            beside.replace(out)
            print(_line(case.name, found), flush=True)
    print(_score(kept))


def _ratio(found: dict[str, Any]) -> float:
    """Held-out error over the noise's; NaN without held-out recordings."""
    if "fit" not in found:
        return math.nan
    after, floor = (found["fit"][key]["hold_out"] for key in ("after", "noise_floor"))
    return math.nan if after is None or not floor else after / floor


def _line(name: str, found: dict[str, Any]) -> str:
    truth = " + ".join(found["truth"]) or "nothing"
    if "error" in found:
        return f"{name} | {truth} | error | {found['error']}"
    said = " + ".join(found["said"]) or found["verdict"]
    right = "right" if found["right"] else "WRONG"
    figures = f"{_ratio(found):.2f} floors | {found['seconds']:.0f} s"
    return f"{name} | {truth} | {right} {said} | {figures}"


def _alarm(found: dict[str, Any]) -> bool:
    """Whether an empty case is said to lack something; older records do not hold it."""
    return found.get("alarm", found.get("verdict") == "something_missing")


def _score(kept: dict[str, Any]) -> str:
    effects = [each for each in kept.values() if each["truth"]]
    empty = [each for each in kept.values() if not each["truth"]]
    alarms = sum(_alarm(each) for each in empty)
    seconds = statistics.median(each["seconds"] for each in kept.values())
    return (
        f"{sum(each['right'] for each in effects)} of {len(effects)} effects right, "
        f"{alarms} alarms in {len(empty)} empty, median {seconds:.0f} s"
    )


def _share(hits: list[bool]) -> str:
    return f"{100 * sum(hits) / len(hits):4.0f} % of {len(hits):2d}" if hits else "      none"


def _figures(name: str, some: list[dict[str, Any]]) -> str:
    """Shares of a group: kind and place first, false alarms, held-out error within the floors."""
    effects = [each["right"] for each in some if each["truth"]]
    empty = [_alarm(each) for each in some if not each["truth"]]
    near = [_ratio(each) <= WITHIN for each in some]  # no held-out figure is not near
    return f"{name:22} | {_share(effects)} | {_share(empty)} | {_share(near)}"


def summary(record_of: Path, folder: Path) -> str:
    """A table of a record of `laboratory.py`: all cases, by excitation, by effect."""
    kept = json.loads(record_of.read_text())
    groups: dict[str, list[dict[str, Any]]] = {"all": list(kept.values())}
    for key in ("excitation", "kind"):
        truths = {name: json.loads((folder / name / "truth.json").read_text()) for name in kept}
        for value in sorted({truth[key] for truth in truths.values()}):
            groups[value] = [each for name, each in kept.items() if truths[name][key] == value]
    head = f"{'':22} | right          | false alarms   | held out <= {WITHIN} floors"
    failed = [name for name, each in kept.items() if "error" in each]
    lines = [head, *(_figures(name, some) for name, some in groups.items())]
    return "\n".join([*lines, f"stopped with an error: {', '.join(failed) or 'none'}"])


def _numbers(found: Any, path: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(found, dict):
        for key, value in found.items():
            if key != "seconds":
                yield from _numbers(value, f"{path}.{key}")
    elif isinstance(found, list):
        for i, value in enumerate(found):
            yield from _numbers(value, f"{path}[{i}]")
    elif isinstance(found, int | float) and not isinstance(found, bool):
        yield path, float(found)


def _farthest(before: Any, after: Any) -> tuple[float, str]:
    """Largest relative difference of any number, and which; infinite where one is missing."""
    a, b = dict(_numbers(before)), dict(_numbers(after))
    if a.keys() != b.keys():
        return math.inf, min(a.keys() ^ b.keys())
    apart = [(_apart(a[key], b[key]), key) for key in a]
    return max(apart, default=(0.0, ""))


def _apart(a: float, b: float) -> float:
    if a == b or (math.isnan(a) and math.isnan(b)):
        return 0.0
    return abs(a - b) / max(abs(a), abs(b), 1e-300)


def compare(before: Path, after: Path, exact: float | None) -> int:
    """A line for each case of both records; 1 where the score fell or a number moved too far."""
    a, b = (json.loads(path.read_text()) for path in (before, after))
    both = sorted(a.keys() & b.keys())
    moved = []
    for name in both:
        apart, where = _farthest(a[name], b[name])
        if exact is not None and apart > exact:
            moved.append(name)
        print(f"{_line(name, a[name])} -> {_line(name, b[name])} | {apart:.1g} {where}")
    first, then = ({name: kept[name] for name in both} for kept in (a, b))
    print(f"before: {_score(first)}\nafter:  {_score(then)}")
    if moved:
        print(f"beyond {exact}: {', '.join(moved)}")
    lost = [name for name in both if a[name]["right"] and not b[name]["right"]]
    if lost:
        print(f"right before, wrong now: {', '.join(lost)}")
    return int(bool(moved or lost))


def main(arguments: list[str] | None = None) -> int:
    """Record, sum up or compare."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    recording = verbs.add_parser("record")
    recording.add_argument("folder", type=Path)
    recording.add_argument("out", type=Path)
    recording.add_argument("--jobs", type=int, default=2)
    recording.add_argument("--only", nargs="+", metavar="NAME")
    summing = verbs.add_parser("summary")
    summing.add_argument("record", type=Path)
    summing.add_argument("folder", type=Path)
    comparing = verbs.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    comparing.add_argument("--exact", type=float)
    chosen = parser.parse_args(arguments)
    if chosen.verb == "record":
        record(chosen.folder, chosen.out, chosen.jobs, chosen.only)
        return 0
    if chosen.verb == "summary":
        print(summary(chosen.record, chosen.folder))
        return 0
    return compare(chosen.before, chosen.after, chosen.exact)


if __name__ == "__main__":
    sys.exit(main())
