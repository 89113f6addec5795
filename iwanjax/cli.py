"""The command line: thin verbs over the library.

Heavy modules are imported inside the verbs, so that ``--help`` and bad usage answer at once.
"""

import contextlib
import json
import logging
import math
import re
import sys
import tempfile
import time
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from iwanjax.errors import InputError, IwanjaxError

if TYPE_CHECKING:
    from jaxtyping import Array
    from matplotlib.figure import Figure

    from iwanjax.config import QsmaSettings, Study
    from iwanjax.quasistatic import QsmaSolution
    from iwanjax.structures import JointedStructure

_HELP = """Differentiable model updating for structures with bolted joints.

Every verb reads a study file (YAML) and writes numbers (.json, .npz) and pictures (.png)
into a folder. Exit status: 0, or 2 with one line on stderr that says what to change.

\b
Example:
  iwanjax qsma configs/three_mass.yaml --out results/three_mass
"""
_QSMA_HELP = """Frequency and damping of each mode against amplitude.

Quasi-static modal analysis of the study's structure, at the modes and load levels of its
qsma section. Writes qsma.json, qsma.npz, qsma.png and a picture of each joint.
"""
_HOW_TO_QSMA = (
    "there is no qsma section; add for instance "
    "qsma: {modes: [0], alpha: {from: 1e-2, to: 1e+2, count: 50}}"
)

# Plain text everywhere: an error is one line, not a box.
app = typer.Typer(
    help=_HELP,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def main() -> None:
    """Run the command line; the entry point of the ``iwanjax`` script."""
    app(prog_name="iwanjax")


def _version() -> str:
    # Importing the package from within would be a cycle; it is loaded before this module is.
    return sys.modules["iwanjax"].__version__


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"iwanjax {_version()}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    """Options that stand before the verb."""


@app.command("qsma", help=_QSMA_HELP)
def qsma_verb(
    study: Annotated[Path, typer.Argument(metavar="STUDY", help="The study file.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the results.")],
) -> None:
    """Quasi-static modal analysis of a study, written into a folder."""
    with _one_line_errors():
        import jax

        jax.config.update("jax_enable_x64", True)
        # That an accelerator stays unused is no news for a run of seconds.
        logging.getLogger("jax").setLevel(logging.ERROR)
        import matplotlib as mpl

        mpl.use("Agg")
        from iwanjax.config import load_study
        from iwanjax.plotting import plot_joint, plot_qsma

        loaded = load_study(study)
        if loaded.qsma is None:
            raise InputError(f"{study}: {_HOW_TO_QSMA}")
        with _results(out) as folder:
            solution, seconds = _solve(loaded.structure, loaded.qsma)
            summary = _summary(loaded, solution, seconds)
            (folder / "qsma.json").write_text(json.dumps(summary, indent=2) + "\n")
            _write_arrays(folder / "qsma.npz", solution)
            _save(plot_qsma(solution), folder / "qsma.png")
            labels = loaded.structure.labels
            for name, label in zip(_file_names(labels), labels, strict=True):
                joint = loaded.structure.joints[label]
                _save(plot_joint(joint), folder / f"joint_{name}.png")
        for mode in summary["modes"]:
            typer.echo(_line(mode))
        typer.echo(f"wrote {out / 'qsma.png'}")


@contextlib.contextmanager
def _one_line_errors() -> Iterator[None]:
    """Turn the library's errors into one line and status 2; its warnings into lines too."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        try:
            yield
        except IwanjaxError as error:
            typer.echo(" ".join(str(error).split()), err=True)
            raise typer.Exit(2) from None
    for warning in caught:
        typer.echo(f"warning: {' '.join(str(warning.message).split())}", err=True)


@contextlib.contextmanager
def _results(folder: Path) -> Iterator[Path]:
    """A folder to write into, whose files move to ``folder`` once all of them are written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".writing-", dir=folder) as temporary:
            yield Path(temporary)
            for file in sorted(Path(temporary).iterdir()):
                file.replace(folder / file.name)
    except OSError as error:
        raise InputError(
            f"--out {folder}: cannot be written ({error.strerror or error}); expected a folder, "
            "existing or new, with room and permission"
        ) from None


def _solve(structure: "JointedStructure", settings: "QsmaSettings") -> tuple["QsmaSolution", float]:
    """The analysis a study asks for, and the seconds that compiling and running took."""
    import jax

    from iwanjax.quasistatic import qsma

    start = time.perf_counter()
    solution = qsma(
        structure,
        list(settings.modes),
        settings.levels,
        settings.damping,
        frequency=settings.frequency,
        shape=settings.shape,
    )
    jax.block_until_ready(solution.q)
    return solution, time.perf_counter() - start


def _summary(study: "Study", solution: "QsmaSolution", seconds: float) -> dict[str, Any]:
    """What qsma.json holds."""
    omega_0 = study.structure.basis.omega2**0.5
    return {
        "study": study.name,
        "iwanjax": _version(),
        "compile_and_run_seconds": round(seconds, 3),
        "joints": list(study.structure.labels),
        "modes": [
            _mode_summary(mode, float(omega_0[mode]) / (2.0 * math.pi), solution, i)
            for i, mode in enumerate(solution.modes)
        ],
    }


def _mode_summary(mode: int, natural: float, solution: "QsmaSolution", i: int) -> dict[str, Any]:
    """One mode at the lowest and at the highest level that converged."""
    import numpy as np

    from iwanjax.results import Result

    converged = np.flatnonzero(solution.converged[i])

    def ends(values: "Array") -> dict[str, float | None]:
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


def _write_arrays(path: Path, solution: "QsmaSolution") -> None:
    """Arrays with the modes on the first axis and the levels on the second."""
    import numpy as np

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


def _save(figure: "Figure", path: Path) -> None:
    import matplotlib.pyplot as plt

    figure.savefig(path, dpi=150)
    plt.close(figure)


def _file_names(labels: Iterable[str]) -> list[str]:
    """Labels as parts of file names: safe characters only, and still different."""
    names: list[str] = []
    for label in labels:
        safe = re.sub(r"[^\w.-]+", "_", label)
        while safe in names:
            safe += "_"
        names.append(safe)
    return names
