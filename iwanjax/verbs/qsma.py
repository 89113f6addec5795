"""The verb ``qsma``: frequency and damping of a study's structure from its model."""

import math
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Array

from iwanjax.plotting import plot_joint, plot_qsma
from iwanjax.quasistatic import QsmaSolution
from iwanjax.results import Result
from iwanjax.structures import JointedStructure
from iwanjax.studies import Study
from iwanjax.verbs.output import file_names, results, save, version, write_json


def run(study: Study, out: Path) -> list[str]:
    """Write qsma.json, qsma.npz, qsma.png and a picture of each joint; lines for the screen."""
    start = time.perf_counter()
    solution = study.qsma()
    jax.block_until_ready(solution.q)
    seconds = time.perf_counter() - start
    structure = solution.structure
    with results(out) as folder:
        summary = _summary(study.name, structure, solution, seconds)
        write_json(folder / "qsma.json", summary)
        _write_arrays(folder / "qsma.npz", solution)
        save(plot_qsma(solution), folder / "qsma.png")
        labels = structure.labels
        for name, label in zip(file_names(labels), labels, strict=True):
            save(plot_joint(structure.joints[label]), folder / f"joint_{name}.png")
    return [*(_line(mode) for mode in summary["modes"]), f"wrote {out / 'qsma.png'}"]


def _summary(
    name: str, structure: JointedStructure, solution: QsmaSolution, seconds: float
) -> dict[str, Any]:
    """What qsma.json holds."""
    omega_0 = structure.basis.omega2**0.5
    return {
        "study": name,
        "iwanjax": version(),
        "compile_and_run_seconds": round(seconds, 3),
        "joints": list(structure.labels),
        "modes": [
            _mode_summary(mode, float(omega_0[mode]) / (2.0 * math.pi), solution, i)
            for i, mode in enumerate(solution.modes)
        ],
    }


def _mode_summary(mode: int, natural: float, solution: QsmaSolution, i: int) -> dict[str, Any]:
    """One mode at the lowest and at the highest level that converged."""
    converged = np.flatnonzero(solution.converged[i])

    def ends(values: Array) -> dict[str, float | None]:
        if not converged.size:
            return {"low": None, "high": None}
        return {"low": float(values[i, converged[0]]), "high": float(values[i, converged[-1]])}

    codes, counts = np.unique(solution.result[i], return_counts=True)
    return {
        "mode": mode,
        "omega_0_hz": natural,
        "levels": int(solution.result.shape[1]),
        "converged": int(converged.size),
        "amplitude": ends(solution.curves.amplitude),
        "frequency_hz": ends(solution.curves.frequency),
        "damping": ends(solution.curves.damping),
        "messages": [
            f"{count} level(s): {Result(code).message}"
            for code, count in zip(codes, counts, strict=True)
            if code != Result.CONVERGED
        ],
    }


def _line(mode: dict[str, Any]) -> str:
    """A mode of the summary in one line."""
    head = f"mode {mode['mode']}: {mode['converged']} of {mode['levels']} levels"
    if not mode["converged"]:
        return head
    low, high = mode["frequency_hz"].values()
    damped = [100.0 * value for value in mode["damping"].values()]
    return f"{head}, {low:.6g} to {high:.6g} Hz, damping {damped[0]:.4g} to {damped[1]:.4g} %"


def _write_arrays(path: Path, solution: QsmaSolution) -> None:
    """Arrays with the modes on the first axis and the levels on the second."""
    np.savez(
        path,
        modes=np.array(solution.modes),
        joints=np.array(solution.structure.labels),
        alpha=np.asarray(solution.alpha),
        amplitude=np.asarray(solution.curves.amplitude),
        frequency=np.asarray(solution.curves.frequency),
        damping=np.asarray(solution.curves.damping),
        deflection=np.asarray(solution.deflection),
        result=np.asarray(solution.result),
    )
