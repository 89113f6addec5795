"""Trials of a plan: made, sealed, diagnosed blind on workers, opened and counted."""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from iwanjax.cluster import LOCAL, pieces
from iwanjax.errors import InputError
from iwanjax.files import whole_file
from iwanjax.trial.files import STUDY, opened, seal, truth_of, write_study
from iwanjax.trial.outcome import TrialResult, judged
from iwanjax.trial.plan import TrialPlan, concealed
from iwanjax.trial.simulation import TrialBase

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Piece:
    """What a worker gets of a trial: the study's files by their names, and nothing of the truth."""

    name: str
    files: dict[str, bytes]


def run_trials(
    base: TrialBase,
    plan: TrialPlan,
    folder: Path,
    *,
    scheduler: str = LOCAL,
    workers: int | None = None,
    progress: Progress,
) -> TrialResult:
    """Conceal, diagnose and count.

    ``folder`` holds ``studies/``, what is diagnosed; ``truth/`` with the hashes of all truths in
    ``sealed.json``, written before the first diagnosis begins; ``verdicts/``, each kept as soon as
    it is there. Called again, a plan that was interrupted goes on.

    Parameters
    ----------
    base : TrialBase
    plan : TrialPlan
    folder : Path
    scheduler, workers : str, int, optional
        As for :func:`iwanjax.cluster.pieces`.
    progress : function
        Receives a line at every trial.

    Raises
    ------
    InputError
        For a folder that holds another plan, a truth that is not the sealed one, and as
        :func:`iwanjax.trial.plan.concealed` and :func:`iwanjax.cluster.pieces`.
    """
    names = [f"trial{number:03d}" for number in range(plan.count)]
    hashes = _sealed(base, plan, folder, scheduler, workers, progress)
    verdicts = folder / "verdicts"
    verdicts.mkdir(parents=True, exist_ok=True)
    left = [name for name in names if not (verdicts / f"{name}.json").exists()]
    if len(left) < len(names):
        progress(f"{len(names) - len(left)} of {len(names)} verdicts are there already")
    todo = [_piece(folder / "studies" / name) for name in left]
    done = len(names) - len(left)
    for i, found in pieces(diagnosed, todo, scheduler, workers) if todo else ():
        _keep(verdicts / f"{left[i]}.json", found)
        done += 1
        said = found.get("error") or found["diagnosis"]["verdict"]
        progress(f"{done} of {len(names)}: {left[i]}: {said} ({found['seconds']:.0f} s)")
    outcomes = []
    for name in names:
        truth = opened(folder / "truth" / f"{name}.json", hashes[name])
        verdict = json.loads((verdicts / f"{name}.json").read_text(encoding="utf-8"))
        outcomes.append(judged(name, truth, verdict))
    return TrialResult(base.structure.name, plan.seed, tuple(outcomes))


def _sealed(
    base: TrialBase,
    plan: TrialPlan,
    folder: Path,
    scheduler: str,
    workers: int | None,
    progress: Progress,
) -> dict[str, str]:
    """Hashes of all truths by the trials' names; studies and truths are written."""
    kept, about = folder / "sealed.json", {"study": base.structure.name, **asdict(plan)}
    if kept.exists():
        before = json.loads(kept.read_text(encoding="utf-8"))
        if before["plan"] != about:
            raise InputError(
                f"{kept}: holds the plan {before['plan']}; expected {about}: give another folder, "
                "or the same plan to go on with it"
            )
        return before["sha256"]
    progress(f"concealing in {plan.count} trials")
    (folder / "truth").mkdir(parents=True, exist_ok=True)
    hashes: dict[str, str] = {}
    for i, (piece, text, digest) in pieces(
        partial(_made, base, plan), range(plan.count), scheduler, workers
    ):
        target = folder / "studies" / piece.name
        target.mkdir(parents=True, exist_ok=True)
        for name, content in piece.files.items():
            (target / name).write_bytes(content)
        (folder / "truth" / f"{piece.name}.json").write_text(text, encoding="utf-8")
        hashes[piece.name] = digest
        progress(f"{len(hashes)} of {plan.count} made: number {i}")
    _keep(kept, {"plan": about, "sha256": dict(sorted(hashes.items()))})
    return hashes


def _made(base: TrialBase, plan: TrialPlan, number: int) -> tuple[Piece, str, str]:
    """A trial's study, its truth and the truth's hash."""
    trial = concealed(base, plan, number)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / f"trial{number:03d}"
        write_study(base, trial, folder)
        return _piece(folder), *seal(truth_of(base, trial))


def _piece(folder: Path) -> Piece:
    return Piece(folder.name, {each.name: each.read_bytes() for each in sorted(folder.iterdir())})


def diagnosed(piece: Piece) -> dict[str, Any]:
    """What the command says of a study: ``diagnosis`` or ``error``, and ``seconds``."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / piece.name
        folder.mkdir()
        for name, content in piece.files.items():
            (folder / name).write_bytes(content)
        command = [sys.executable, "-m", "iwanjax", "diagnose", str(folder / STUDY)]
        start = time.perf_counter()
        run = subprocess.run(
            [*command, "--out", str(folder / "out")], capture_output=True, text=True, check=False
        )
        seconds = time.perf_counter() - start
        if run.returncode:
            last = (run.stderr.strip().splitlines() or ["no message"])[-1]
            return {"error": last, "seconds": seconds}
        told = (folder / "out" / "diagnosis.json").read_text(encoding="utf-8")
        return {"diagnosis": json.loads(told), "seconds": seconds}


def _keep(path: Path, content: Any) -> None:
    """Whole or not at all."""
    with whole_file(path) as file:
        file.write(json.dumps(content, indent=1).encode())
