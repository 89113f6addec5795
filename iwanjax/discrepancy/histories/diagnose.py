"""Is anything missing from a model, where, of which kind, and how much better it is with it."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from iwanjax.compiler import on_the_processor
from iwanjax.discrepancy.diagnosis import Diagnosis
from iwanjax.discrepancy.findings import (
    Errors,
    Observable,
    Suspect,
    alike,
    force_noise,
    sensor_noise,
)
from iwanjax.discrepancy.histories import selection
from iwanjax.discrepancy.histories.observables import observables
from iwanjax.discrepancy.histories.place_test import with_verdict
from iwanjax.discrepancy.histories.prepared import prepared
from iwanjax.discrepancy.histories.ranking import Scope, containing
from iwanjax.discrepancy.histories.refitted import (
    beyond_trust,
    corrected_model,
    joints_refitted,
    modes_refitted,
)
from iwanjax.discrepancy.histories.restarts import FAR
from iwanjax.discrepancy.histories.restoring import restoring_force
from iwanjax.discrepancy.histories.search import searched
from iwanjax.discrepancy.histories.time_steps import Refined, StepRefinement
from iwanjax.discrepancy.histories.unnamed import Ended, beside_linear, beyond_names
from iwanjax.discrepancy.histories.validation import (
    FreeRun,
    compared,
    joined,
    left_over,
    misfit,
    unforeseen,
)
from iwanjax.discrepancy.judgement import cut_short, judged, stopped
from iwanjax.errors import attempted
from iwanjax.estimation.evidence import LEAST_GAIN
from iwanjax.identification.estimates import estimates
from iwanjax.identification.likelihood import left_by_noise
from iwanjax.identification.predictor import Quantity
from iwanjax.identification.recordings import StudyRecording
from iwanjax.settings.stages import settings
from iwanjax.structures import JointedStructure, LinearTrust
from iwanjax.threads import one_thread
from iwanjax.types import ArrayLike, require_double_precision


@on_the_processor()
@one_thread()
def diagnose_histories(
    structure: JointedStructure,
    recordings: Sequence[StudyRecording],
    sampling_rate: float,
    *,
    rows: Mapping[str, ArrayLike],
    sensors: Mapping[str, ArrayLike],
    inputs: Mapping[str, ArrayLike],
    quantity: Quantity = "acceleration",
    hypotheses: tuple[str, ...] = (),
    noise: Mapping[str, float] | None = None,
    trust: LinearTrust | None = None,
    budget: float = math.inf,
    seed: int = 0,
    progress: Callable[[str], None] = lambda line: None,
) -> Diagnosis:
    r"""Compare a model with recordings: what remains, where it acts, and what it is.

    Predictions are innovations: an observer corrects the state after every sample, and its
    gain is designed anew for every set of parameters. First the joints are refitted, from
    several starts, with a memory of two, then eight cycles, and errors of the linear model are
    referred to the modes in which these joints stick. Then every kind at every place is
    judged at size zero by what it would take off the residual beyond what the joints can; the
    best are refitted with the joints, and the best of these with longer and longer memory up to
    the free run. A free decay's state at its beginning is estimated with everything else. Constant
    offsets of channels are taken off first (:mod:`iwanjax.identification.offsets`). Where
    the residual stays above the noise a second suspect is looked for beside
    the first; where nothing shows with a memory of eight cycles but in the free run, as with a
    joint that drifts, suspects are looked for there. Noise that a recording only bounds is told by
    what the best model leaves (:func:`~iwanjax.signals.sensor_noise.beside_model`).

    Parameters
    ----------
    structure : JointedStructure
        Joints at their starting values.
    recordings : sequence of StudyRecording
        At least one to fit; those held out are only looked at in the end.
    sampling_rate : float
        Hz.
    rows : mapping of str to (n,) array_like
        Where a force may be missing.
    sensors : mapping of str to (n,) array_like
        What the sensors see, in the order of the responses' columns.
    inputs : mapping of str to (n,) array_like
        Where forces act, in the order of the forces' columns. One called ``base`` is the
        acceleration of the ground: with r the motion of the coordinates when the ground moves by
        1 and nothing deforms, its row is -M r.
    quantity : {"acceleration", "velocity", "displacement"}
        What the sensors measure: absolute accelerations, displacements and velocities relative
        to the ground.
    hypotheses : tuple of str
        Kinds to try; all of the catalogue by default.
    noise : mapping of str to float, optional
        Standard deviation of a sensor's or an input's noise, in its unit, where that is known.
    trust : LinearTrust, optional
        How exact the linear model is: its frequencies and damping are fitted with the joints,
        within that prior. Exact where it is not said.
    budget : float
        Time to spend, s. Most of it goes to the search, the rest to what it has found by then.
    seed : int
        Of the starts.
    progress : function
        Receives a line at every stage.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputError
        For recordings whose force is zero or that do not fit the model, unknown hypotheses.
    PrecisionError
        When JAX computes in float32.
    """
    require_double_precision("diagnose")
    started = time.perf_counter()
    study = prepared(
        structure,
        recordings,
        sampling_rate,
        rows=rows,
        sensors=sensors,
        inputs=inputs,
        quantity=quantity,
        hypotheses=hypotheses,
        noise=noise,
        trust=trust,
    )
    known = settings().histories.selection

    def in_time(share: float = 1.0) -> bool:
        return time.perf_counter() - started < share * budget

    scope = Scope(
        study.kinds,
        (),
        tuple(sensors),
        tuple(structure.labels),
        lambda: in_time(known.searched),
        progress,
        in_time,
        tuple(inputs),
        outside=study.outside,
    )
    (study, resolution, now, _), scope, table = searched(study, scope, seed)
    recordings, places = study.recordings, study.rows
    complete, scope = scope.in_time(), replace(scope, in_time=in_time)
    if not complete and scope.in_time():
        progress("the time for the search is over: what it has found so far is polished")
    failures = list(table.failures)
    now, table = attempted(
        "the polish to the free run",
        lambda: _polished(resolution, now, table, scope),
        (now, table),
        failures,
    )
    sides, problem, _ = now
    table = attempted(
        "looking for more than linear errors",
        lambda: beside_linear(table, scope),
        table,
        failures,
    )
    progress("predicting the held-out recordings")
    table, before, after, refused = compared(
        # How unsure macroslip leaves a prediction takes runs of its own.
        table,
        lambda entry, replaced: sides.free(
            entry, failures, replaced=replaced or not scope.in_time()
        ),
    )
    table = table.by_evidence()
    allowed = math.hypot(
        problem.settings.conditioning.model_error, 0.0 if trust is None else trust.shapes
    )
    verdict = judged(
        table.nominal.behind + LEAST_GAIN,
        [entry.behind for entry in table.entries],
        # Noise is of the recordings: the model that fits them best knows what it leaves.
        misfit(before, min(before, after, key=lambda run: run[0].relative), allowed),
        misfit(after, after, allowed),
    )
    fitted = complete or bool(table.entries) or table.nominal.fitted.converged
    verdict = stopped(verdict, fitted)
    if not (complete and scope.in_time()):
        verdict = cut_short(verdict, misfit(after, after, allowed))
    what = _suspects(table, verdict.named) if table.detected and verdict.detected else []
    after = after if what else before
    shown = table.best if what else table.nominal
    beyond = attempted(
        "looking for a law that has no name",
        lambda: beyond_names(
            table, problem, scope, Ended(verdict, before, after, allowed), sides.free
        ),
        None,
        failures,
    )
    if beyond is not None:
        verdict, after, shown = beyond.verdict, beyond.after, beyond.entry
        what = beyond.among(what)
    if beyond is not None or sides.left_by_steps > 0.0:
        sides = attempted(
            "comparing numbers of steps",
            lambda: resolution.of_verdict(sides, shown),
            sides,
            failures,
        )
    differing: tuple[Observable, ...] = ()
    restoring = None
    if verdict.detected and scope.in_time():
        progress("recovering the force and the modes' differences")
        differing = attempted(
            "comparing the modes",
            lambda: observables(
                problem,
                _joined(before),
                sampling_rate,
                {each.name: each.released for each in recordings},
            ),
            (),
            failures,
        )
        comparable = [entry for entry in table.entries if entry.problem is problem]
        if beyond is not None:
            # Whatever law is suspected there, the force is that of the place.
            there = beyond.force.where
            comparable = [e for e in comparable if e.fitted.hypothesis.where[0] == there]
        if what and comparable and (beyond is not None or comparable[0] is shown):
            others = [entry.fitted for entry in comparable[1:]]
            restoring = attempted(
                "recovering the restoring force",
                lambda: restoring_force(problem, comparable[0].fitted, 0, others),
                None,
                failures,
            )
    model = attempted(
        "building the corrected model",
        lambda: corrected_model(
            structure, shown if verdict.found or beyond else table.nominal, places, now.modal
        ),
        None,
        failures,
    )
    warnings = [*sides.fitted.warnings, *sides.warnings(), *study.warnings]
    looked_at = {place.label for place in scope.places}
    if verdict.found:
        warnings += [
            f"{each.label} is not among the hypotheses: one of those becomes it at an end of its "
            "range, where it explains the recordings"
            for each in what[:1]
            if any(each.kind == kind for kind in study.outside)
        ]
    warnings += [
        f"Row {name} is zero on every mode, so nothing could be looked for there"
        for name in places
        if name not in looked_at
    ]
    rigid = int(np.sum(np.asarray(problem.predictor.omega2) == 0.0))
    modes = [f"mode {i - rigid + 1}" for i in range(problem.predictor.kept)]
    warnings += beyond_trust(shown.problem, shown.fitted, modes)
    unknown = 1.0 - beyond.probability if beyond else verdict.something_else
    if fitted:
        warnings += left_over(after[0], bool(what), unknown, tuple(sensors))
        warnings += unforeseen(after[1]) if after[1] else []
    indistinguishable = alike(what) if what else ()
    if what and beyond is None:
        indistinguishable += containing(table.best, table.entries)
    return Diagnosis(
        verdict=verdict,
        what=tuple(what),
        before=Errors(*(_relative(x) for x in before)),
        after=Errors(*(_relative(x) for x in after)),
        noise_floor=Errors(*(x.floor if x else math.nan for x in after)),
        noise_floor_95=Errors(*(x.floor_95 if x else math.nan for x in after)),
        parameter_spread=Errors(*(x.spread if x else math.nan for x in after)),
        refused=refused,
        indistinguishable=tuple(dict.fromkeys(indistinguishable)),
        observables=differing,
        scores=table.scores,
        places=with_verdict(
            table.places,
            [
                (entry.fitted.hypothesis.where, probability)
                for entry, probability in zip(table.entries, verdict.named, strict=True)
            ],
            verdict.something_else,
        ),
        joints=joints_refitted(shown.problem, shown.fitted, tuple(structure.labels)),
        modes=modes_refitted(shown.problem, shown.fitted, modes),
        runs=(_joined(before), _joined(after)),
        sampling_rate=sampling_rate,
        restoring=restoring,
        warnings=tuple(warnings),
        complete=complete and scope.in_time(),
        seconds=time.perf_counter() - started,
        failures=tuple(dict.fromkeys(failures)),
        model=model,
        noise=sensor_noise(recordings, tuple(sensors)),
        force_noise=force_noise(recordings, tuple(inputs)),
        unnamed=beyond.force if beyond else None,
    )


def _polished(
    resolution: StepRefinement, now: Refined, table: selection.ModelSelection, scope: Scope
) -> tuple[Refined, selection.ModelSelection]:
    """The last few in the free run, with steps between samples that are fine enough for it."""
    if scope.in_time():
        now = resolution.of_free_run(now, table.best)
    table = selection.concluded(table, now.problem, scope)
    finer, law, most = now, table.general, now.problem.settings.steps.most
    if table.detected and scope.in_time():
        finer = resolution.of_fit(now, table.best)
    far = table.best.fitted.cost > FAR * left_by_noise(now.problem)
    if law and law.coarse and far and law.fit.problem.predictor.substeps < most:
        # Of a law whose steps are too long a search finds neither the place nor how many it takes.
        table = table._replace(general=None)
        if finer.problem.predictor.substeps < most and scope.in_time():
            finer = resolution.with_substeps(most)
    if finer.problem is now.problem:
        return finer, table
    scope.progress("polishing again, with finer steps")
    return finer, selection.concluded(table, finer.problem, scope)


def _relative(run: FreeRun | None) -> float:
    return run.relative if run else math.nan


def _joined(runs: tuple[FreeRun, FreeRun | None]) -> FreeRun:
    """Fitted and held-out recordings one after the other."""
    return joined([run for run in runs if run is not None])


def _suspects(table: selection.ModelSelection, probabilities: Sequence[float]) -> list[Suspect]:
    """One row for every suspect of the best entry, then those of its rivals.

    Each with the probability of its entry.
    """
    rows = []
    for entry, probability in zip(table.entries, probabilities, strict=True):
        labels = [
            f"{kind.name}@{where}"
            for kind, where in zip(
                entry.fitted.hypothesis.kinds, entry.fitted.hypothesis.where, strict=True
            )
        ]
        for slot, (kind, where) in enumerate(
            zip(entry.fitted.hypothesis.kinds, entry.fitted.hypothesis.where, strict=True)
        ):
            rows.append(
                Suspect(
                    kind,
                    where,
                    probability,
                    entry.behind,
                    estimates(entry.problem, entry.fitted, slot),
                    tuple(label for label in labels if label != labels[slot]),
                )
            )
    first: dict[str, Suspect] = {}
    for row in rows:
        first.setdefault(row.label, row)
    return list(first.values())
