"""Seconds of `iwanjax diagnose` as a whole command, first and again, with and without an effect.

Run by ``make bench``. Figures land in ``extra_info`` and are printed; nothing is asserted of
time. The first run compiles, the second has the compiled kernels on disk.
"""

import json
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from concealed.plan import Case, blows, scattered_joints
from concealed.structures import Structure, chain, large_lap_beam, oscillator
from concealed.study import write

from iwanjax.trial.effects import Effect


def concealed(structure: Structure, effects: tuple[Effect, ...], recordings: int) -> Case:
    """A case of five hits, or of a sixth to fit at the place of the fourth."""
    rng = np.random.default_rng(20261130)
    hits = blows(structure, rng)
    if recordings > len(hits):
        hits = (*hits, replace(hits[3], peak=0.7 * hits[3].peak, use="fit", order=len(hits)))
    true, given = scattered_joints(structure, rng)
    return Case(0, structure, (), effects, true, given, hits, noise=0.003, seed=1)


def diagnosed(study: Path, out: Path, cache: Path) -> tuple[float, str]:
    """Seconds of the command, and its verdict."""
    command = [sys.executable, "-m", "iwanjax", "diagnose", str(study), "--out", str(out)]
    start = time.perf_counter()
    subprocess.run(
        command, check=True, capture_output=True, env={**os.environ, "XDG_CACHE_HOME": str(cache)}
    )
    seconds = time.perf_counter() - start
    return seconds, json.loads((out / "diagnosis.json").read_text())["verdict"]


DAMPER = Effect("viscous_damping", "w10-ground", (4.0,))


@pytest.mark.parametrize(
    ("structure", "effects", "recordings", "verdict"),
    [
        (oscillator(), (), 5, "nothing_missing"),
        (chain(6), (), 5, "nothing_missing"),
        (large_lap_beam(), (), 6, "nothing_missing"),
        (large_lap_beam(), (DAMPER,), 6, "something_missing"),
    ],
    ids=["oscillator", "chain of six", "lap beam", "lap beam with a damper"],
)
def test_diagnosis(benchmark, tmp_path, structure, effects, recordings, verdict):
    write(concealed(structure, effects, recordings), tmp_path / "case")
    first, said = diagnosed(tmp_path / "case/study.yaml", tmp_path / "first", tmp_path / "cache")
    again, _ = benchmark.pedantic(
        diagnosed,
        (tmp_path / "case/study.yaml", tmp_path / "again", tmp_path / "cache"),
        rounds=1,
    )
    benchmark.extra_info |= {"first_s": first, "again_s": again}
    print(f"\n{structure.name}, {len(effects)} effects: {first:.1f} s first, {again:.1f} s again")
    assert said == verdict
