"""How often the beam's 90 % intervals hold the truth, over draws of the noise on taps and hits.

The cells of notebook 15 in full, from the modal test to the table against the truth, again for each
draw; only what the noise is added to is simulated once. A draw takes a minute or so::

    python tests/updating/beam_coverage.py draws.jsonl 0 50

runs draws 0 to 49, leaves out what the file has already, and ends with the counts of all in it.
"""

import itertools
import json
import os
import sys
import time
from collections import Counter
from pathlib import Path

import matplotlib as mpl

NOTEBOOK = Path(__file__).parents[2] / "notebooks" / "15_from_hammer_to_prediction.ipynb"
SEED, LAST = "default_rng(1)", "sure = ["
# Deviations from the middle of a 90 % interval to its ends.
NINETY = 1.645


def cells() -> list[str]:
    """Code up to the table against the truth."""
    whole = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in whole if cell["cell_type"] == "code"]
    return code[: 1 + next(i for i, text in enumerate(code) if LAST in text)]


def draw(number: int, simulated: list) -> dict:
    """How many deviations each number that is called determined lies off the truth."""
    import iwanjax as ij

    began, simulate, calls, names = time.monotonic(), ij.simulate, itertools.count(), {}

    def once(*args, **options):
        """Of each draw the same calls in the same order."""
        call = next(calls)
        if call == len(simulated):
            simulated.append(simulate(*args, **options))
        return simulated[call]

    ij.simulate = once
    try:
        for text in cells():
            exec(text.replace(SEED, f"default_rng({1000 + number})"), names)
    finally:
        ij.simulate = simulate
    off = {name: float(names["off"][name]) for name in names["sure"]}
    return {"draw": number, "off": off, "seconds": time.monotonic() - began}


def counts(lines: list[dict]) -> str:
    """A line for each number: held, determined, of so many draws."""
    held, determined = Counter(), Counter()
    for line in lines:
        determined.update(list(line["off"]))
        held.update(name for name, off in line["off"].items() if off < NINETY)
    return "\n".join(
        f"{name:14s} {held[name]:3d} of {count:3d} ({held[name] / count:.0%}), {len(lines)} draws"
        for name, count in sorted(determined.items())
    )


def main() -> None:
    """Draws from the command line."""
    file, first, end = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    os.environ["IWANJAX_LONG"] = "1"
    mpl.use("Agg")
    simulated: list = []
    file.touch()
    for number in range(first, end):
        if number in [json.loads(line)["draw"] for line in file.read_text().splitlines()]:
            continue
        line = json.dumps(draw(number, simulated))
        with file.open("a") as out:
            out.write(line + "\n")
    print(counts([json.loads(line) for line in file.read_text().splitlines()]))


if __name__ == "__main__":
    main()
