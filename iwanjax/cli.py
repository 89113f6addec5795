"""The command line: thin verbs over the library.

Heavy modules are imported inside the verbs, so that ``--help`` and bad usage answer at once.
"""

import contextlib
import gc
import importlib
import logging
import os
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from iwanjax.compiler import compile_quickly
from iwanjax.errors import IwanjaxError

_HELP = """Differentiable model updating for structures with bolted joints.

Every verb reads a study file (YAML) and writes numbers (.json, .npz) and pictures (.png)
into a folder. Exit status: 0, or 2 with one line on stderr that says what to change.

\b
From hammer hits to joint parameters:
  iwanjax inspect   hit1.npz
  iwanjax curves    configs/modal_ringdown.yaml --out results/modal_ringdown
  iwanjax fit       configs/modal_ringdown.yaml --out results/modal_ringdown
  iwanjax posterior configs/modal_ringdown.yaml --out results/modal_ringdown
From a fitted structure to recordings that it was not fitted to:
  iwanjax predict   study.yaml                  --out results/study
From a model and recordings to what the model lacks:
  iwanjax diagnose  study.yaml                  --out results/study
  iwanjax detectability study.yaml              --out results/study
  iwanjax trial     study.yaml                  --out results/study_trial
  iwanjax laws
From low-level recordings to a linear model:
  iwanjax modal     configs/f16.yaml            --out results/f16
From a model to its curves:
  iwanjax qsma      configs/three_mass.yaml     --out results/three_mass
From a model to its response in time:
  iwanjax simulate  configs/three_mass.yaml     --out results/three_mass
"""
_QSMA_HELP = """Frequency and damping of each mode against amplitude, from a model.

Quasi-static modal analysis of the study's structure, at the modes and load levels of its
qsma section. Writes qsma.json, qsma.npz, qsma.png and a picture of each joint.
"""
_SIMULATE_HELP = """The response in time to impacts, sines, sweeps or recorded forces, from a model.

Integrates the study's structure, or drives a joint on its own, for each case of its simulate
section. Writes simulate.json (peaks, energies), simulate.npz and a picture of each case.
"""
_MODAL_HELP = """Natural frequencies, damping and mode shapes from low-level recordings.

The modal test of a study's model.test: frequency response functions, poles, and a fit of real
modes with deviations. Writes modal.json, modal.npz, modal.png and model.npz, the linear model.
"""
_CURVES_HELP = """Frequency and damping of each mode against amplitude, from recordings.

Hilbert analysis of the study's free decays. Writes curves.json, curves.npz, for each mode
curves_MODE.npz and pictures of the curves and of a ring-down.
"""
_FIT_HELP = """Joint parameters from recordings, with deviations.

Takes the curves of the recordings with use: fit and predicts those with use: hold_out.
Writes report.html, fit.json, fit.npz and a picture of each fit.
"""
_POSTERIOR_HELP = """Joint parameters from recordings, as a sampled posterior (emcee).

Fits first. Shows a progress bar; interrupted, even killed, the same command goes on where
it was. Writes report.html, posterior.json, posterior.npz, the chains (.h5) and pictures.
"""
_PREDICT_HELP = """How a fitted structure responds to forces that it was not fitted to.

Fits, then drives the structure from rest by the measured forces of the recordings with use:
hold_out. Compares in time, by mode, and by frequency and damping against amplitude; bands are of
what the fit (or, with --posterior, the sampled posterior) leaves open of the parameters, the noise
of the sensors is told apart. Writes predict.json, predict.npz and a picture of each recording.
"""
_DIAGNOSE_HELP = """What a model is missing, by its recordings.

Refits the joints, then looks for what they cannot explain: a force at a row of the model, a
fault of a sensor or of a joint, alone or two together; where, of which kind, and how much better
held-out recordings are predicted with it. A structure is judged by recordings with force, free
decays or curves of its modes, a joint on its own by its loops and the channels that they name,
such as a temperature, single modes by their frequency and damping. Takes some seconds to some
minutes. Writes report.html, diagnosis.json and pictures.
"""
_DETECTABILITY_HELP = """Which effects recordings would show, from what size on.

Of every effect at every place the smallest size that a diagnosis of these recordings finds, and
tells from all others, in nine of ten repetitions; pairs that it cannot tell apart; and the hit or
the sensor that would help most. Recordings may be measured, or simulated ones of a plan. Takes a
minute or two. Writes detectability.txt, detectability.json, detectability.npz and a picture.
"""
_TRIAL_HELP = """How often a diagnosis of a study's recordings would be right.

Makes the recordings anew by the study's structure, joints, forces and noise, with an effect
concealed in each trial or none, seals what is true, has them diagnosed blind by processes of their
own, and counts: right verdicts, false alarms, and whether probabilities can be trusted, also for
laws that the diagnosis is not told of. Shares no code with the diagnosis. Takes about a minute for
each trial; interrupted, the same command goes on. Writes trial.txt, trial.json, trial.npz and a
picture.
"""
_INSPECT_HELP = """What files hold: recordings and what is wrong with them, or matrices.

Of recordings it tells levels, noise, clipping, hum, offsets, drift, dropouts, double hits, wrong
signs and bands, and writes down a study to begin with: one of all the files, the last held out.
Of mass and stiffness matrices it tells supports, mass, lowest frequencies and mixed-up units.
"""
_LAWS_HELP = """The laws that joints may have, with their parameters.

A table of all types that a study's joints may name; as what a diagnosis finds each missing, in
brackets where only its key hypotheses makes it look for that; and what it is.
"""

# Plain text everywhere: an error is one line, not a box.
app = typer.Typer(
    help=_HELP,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

_Study = Annotated[Path, typer.Argument(metavar="STUDY", help="The study file.")]
_Out = Annotated[Path, typer.Option(metavar="DIR", help="Folder for the results.")]


def main() -> None:
    """Run the command line; the entry point of the ``iwanjax`` script."""
    # What is imported by now stays: never looked through for garbage again.
    gc.freeze()
    app(prog_name="iwanjax")


def _print_version(wanted: bool) -> None:
    if wanted:
        # Importing the package from within would be a cycle; it is loaded before this module is.
        typer.echo(f"iwanjax {sys.modules['iwanjax'].__version__}")
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


@app.command("inspect", help=_INSPECT_HELP)
def inspect_verb(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE", help="Recordings, their folder, or a file of matrices."),
    ],
    out: Annotated[
        Path | None, typer.Option(help="A folder for the same as JSON, figures and the study.")
    ] = None,
    variable: Annotated[str | None, typer.Option(help="The struct, group or cell to read.")] = None,
    sampling_rate: Annotated[
        float | None, typer.Option(help="Hz, of a file that does not say.")
    ] = None,
) -> None:
    """Tell what files hold."""
    with _one_line_errors():
        from iwanjax.verbs.inspect import run

        typer.echo(run(files, out, variable=variable, sampling_rate=sampling_rate))


@app.command("laws", help=_LAWS_HELP)
def laws_verb() -> None:
    """Tell which laws there are."""
    with _one_line_errors():
        from iwanjax.verbs.laws import run

        typer.echo(run())


@app.command("modal", help=_MODAL_HELP)
def modal_verb(study: _Study, out: _Out) -> None:
    """The modal test of a study, written into a folder."""
    _run("modal", study, out)


@app.command("curves", help=_CURVES_HELP)
def curves_verb(study: _Study, out: _Out) -> None:
    """Measured curves of a study's modes, written into a folder."""
    _run("curves", study, out)


@app.command("fit", help=_FIT_HELP)
def fit_verb(study: _Study, out: _Out) -> None:
    """A study's joints fitted to its recordings, written into a folder."""
    _run("fit", study, out)


@app.command("posterior", help=_POSTERIOR_HELP)
def posterior_verb(study: _Study, out: _Out) -> None:
    """The posterior of a study's joints, written into a folder."""
    _run("posterior", study, out)


@app.command("predict", help=_PREDICT_HELP)
def predict_verb(
    study: _Study,
    out: _Out,
    posterior: Annotated[
        bool, typer.Option("--posterior", help="Bands by a posterior, which is sampled first.")
    ] = False,
    draws: Annotated[
        int, typer.Option(metavar="COUNT", min=1, help="Parameter sets that bands are made of.")
    ] = 100,
) -> None:
    """Recordings held out, predicted by a study's fitted structure, written into a folder."""
    _run("predict", study, out, posterior=posterior, draws=draws)


@app.command("diagnose", help=_DIAGNOSE_HELP)
def diagnose_verb(
    study: _Study,
    out: _Out,
    budget: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", min=1.0, help="Time to spend; the best verdict so far."),
    ] = None,
) -> None:
    """What a study's model is missing, written into a folder."""
    _run("diagnose", study, out, budget=budget)


@app.command("detectability", help=_DETECTABILITY_HELP)
def detectability_verb(study: _Study, out: _Out) -> None:
    """What a study's recordings would show of each effect, written into a folder."""
    _run("detectability", study, out)


@app.command("trial", help=_TRIAL_HELP)
def trial_verb(
    study: _Study,
    out: _Out,
    count: Annotated[int, typer.Option(min=1, help="How many trials.")] = 12,
    seed: Annotated[int, typer.Option(min=0, help="Of what is drawn.")] = 0,
    empty: Annotated[
        float, typer.Option(metavar="SHARE", help="Of trials with nothing concealed.")
    ] = 1.0 / 3.0,
    left_out: Annotated[
        float,
        typer.Option(
            metavar="SHARE", help="Of the others, whose law the diagnosis is not told of."
        ),
    ] = 1.0 / 3.0,
    scheduler: Annotated[
        str, typer.Option(metavar="ADDRESS", help="local, or a dask scheduler such as tcp://...")
    ] = "local",
    workers: Annotated[
        int | None, typer.Option(min=1, help="Local processes; by default one a processor.")
    ] = None,
) -> None:
    """How often a diagnosis of a study's recordings would be right, written into a folder."""
    plan = {"count": count, "seed": seed, "empty": empty, "left_out": left_out}
    _run("trial", study, out, **plan, scheduler=scheduler, workers=workers)


@app.command("qsma", help=_QSMA_HELP)
def qsma_verb(study: _Study, out: _Out) -> None:
    """Quasi-static modal analysis of a study, written into a folder."""
    _run("qsma", study, out)


@app.command("simulate", help=_SIMULATE_HELP)
def simulate_verb(study: _Study, out: _Out) -> None:
    """The cases of a study integrated in time, written into a folder."""
    _run("simulate", study, out)


def _run(verb: str, study: Path, out: Path, **options: Any) -> None:
    """Load the study, do the verb, say what came of it."""
    with _one_line_errors():
        with _nothing_collected():
            _set_up()
            from iwanjax.studies import load_study
            from iwanjax.verbs.output import writable

            loaded = load_study(study)
            module = importlib.import_module(f"iwanjax.verbs.{verb}")
        writable(out)
        for line in module.run(loaded, out, **options):
            typer.echo(line)


def _set_up() -> None:
    """Double precision on the processor, compiled kernels kept, pictures without a screen."""
    # Optimistix's kernels can be kept on disk only without calls back into Python.
    os.environ.setdefault("EQX_ON_ERROR", "nan")
    compile_quickly()
    import jax

    jax.config.update("jax_enable_x64", True)
    # One structure's steps in time are too small for an accelerator: 31 s on 16 cores were more
    # than 100 s on one of NVIDIA's H200. Who wants it nevertheless sets JAX_PLATFORMS.
    if not os.environ.get("JAX_PLATFORMS"):
        jax.config.update("jax_platforms", "cpu")
    # That an accelerator stays unused is no news for a run of seconds.
    logging.getLogger("jax").setLevel(logging.ERROR)
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    cache = Path(os.environ.get("IWANJAX_CACHE") or Path(home) / "iwanjax")
    with contextlib.suppress(OSError):  # without a place for it kernels are compiled anew
        cache.mkdir(parents=True, exist_ok=True)
        jax.config.update("jax_compilation_cache_dir", str(cache))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.05)
    import matplotlib as mpl

    mpl.use("Agg")


@contextlib.contextmanager
def _nothing_collected() -> Iterator[None]:
    """For imports: a search for garbage, which they do not leave, is a seventh of their time."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


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
        except KeyboardInterrupt:
            typer.echo("interrupted; the same command starts again, a posterior goes on", err=True)
            raise typer.Exit(130) from None
    for warning in caught:
        typer.echo(f"warning: {' '.join(str(warning.message).split())}", err=True)
