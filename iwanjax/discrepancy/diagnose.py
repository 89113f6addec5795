"""Is anything missing from a model, where, of which kind, and how much better it is with it."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import jax
import numpy as np

from iwanjax.discrepancy import competition
from iwanjax.discrepancy.catalogue import ForceKind, kinds_of
from iwanjax.discrepancy.evidence import untried
from iwanjax.discrepancy.held_out import Free, free_run, joined
from iwanjax.discrepancy.measured import Prepared, Transient, common_noise, prepared
from iwanjax.discrepancy.observables import Observable, observables
from iwanjax.discrepancy.places import followed, places_of
from iwanjax.discrepancy.prediction import Predictor, Quantity, predictor
from iwanjax.discrepancy.ranking import containing
from iwanjax.discrepancy.residuals import glance, innovations
from iwanjax.discrepancy.restoring import restoring_force
from iwanjax.discrepancy.rounds import MIDDLE, Entry, Grounds
from iwanjax.discrepancy.search import Hypothesis, Search
from iwanjax.discrepancy.sensitivity import Joint
from iwanjax.discrepancy.suspicion import estimates
from iwanjax.discrepancy.verdict import Diagnosis, Errors, Suspect, alike
from iwanjax.dynamics.coordinates import ModalCoordinates
from iwanjax.errors import InputError
from iwanjax.structures import JointedStructure
from iwanjax.structures.checks import finite_array
from iwanjax.threads import one_thread
from iwanjax.types import ArrayLike, require_double_precision

# Steps between samples: the fewest, and the most that are tried.
_SUBSTEPS, _MOST_SUBSTEPS = 2, 4
# Angle by which the fastest mode may turn in a step before more steps are compared with it, and
# their difference that is none beside the noise: with the memory that fits are compared with, and
# in the free run, where errors add up.
_TURN, _SAME_AS = 0.7, {MIDDLE: 0.3, math.inf: 0.7}
# Error over the noise's from which on something is left unexplained.
_UNEXPLAINED = 1.25
# The same over held-out recordings, where parameters count with so many deviations.
_UNFORESEEN, _DEVIATIONS = 1.5, 2.0
# Measured over predicted amplitude from which on units are in doubt: nothing of the catalogue is
# worth that much.
_OTHER_UNITS = 100.0
# Evidences closer than this cannot be told apart.
_ALIKE = 3.0


@one_thread()
def diagnose(
    structure: JointedStructure,
    recordings: Sequence[Transient],
    sampling_rate: float,
    *,
    places: Mapping[str, ArrayLike],
    inputs: ArrayLike,
    sensors: Mapping[str, ArrayLike],
    quantity: Quantity = "acceleration",
    hypotheses: tuple[str, ...] = (),
    noise: ArrayLike | None = None,
    budget: float = math.inf,
    seed: int = 0,
    progress: Callable[[str], None] = lambda line: None,
) -> Diagnosis:
    r"""Compare a model with recordings: what remains, where it acts, and what it is.

    Predictions are innovations: an observer corrects the state after every sample, and its
    gain is designed anew for every set of parameters. First the joints are refitted, from
    several starts, with a memory of two, then eight cycles. Then every kind at every place is
    judged at size zero by what it would take off the residual beyond what the joints can; the
    best are refitted with the joints, and the best of these with longer and longer memory up to
    the free run. Where the residual stays above the noise a second suspect is looked for beside
    the first; where nothing shows with a memory of eight cycles but in the free run, as with a
    joint that drifts, suspects are looked for there.

    Parameters
    ----------
    structure : JointedStructure
        Joints at their starting values.
    recordings : sequence of Transient
        At least one to fit; those held out are only looked at in the end.
    sampling_rate : float
        Hz.
    places : mapping of str to (n,) array_like
        Rows where a force may be missing.
    inputs : (inputs, n) array_like
        Where forces act.
    sensors : mapping of str to (n,) array_like
        What the sensors see.
    quantity : {"acceleration", "velocity", "displacement"}
        What they measure.
    hypotheses : tuple of str
        Kinds to try; all of the catalogue by default.
    noise : (sensors,) array_like, optional
        Standard deviations of the sensors' noise where they are known (NaN where not).
    budget : float
        Time to spend, s.
    seed : int
        Of the starts.
    progress : function
        Told of every stage.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputError
        For recordings without force or that do not fit the model, unknown hypotheses.
    PrecisionError
        When JAX computes in float32.
    """
    require_double_precision("diagnose")
    started = time.perf_counter()
    kinds = kinds_of(hypotheses)
    rows = {name: finite_array(row, name) for name, row in places.items()}
    rows_in = np.atleast_2d(finite_array(inputs, "inputs"))
    rows_out = np.stack([finite_array(row, name) for name, row in sensors.items()])
    known = np.full(len(rows_out), np.nan) if noise is None else np.asarray(noise, float)
    _check(recordings, len(rows_in), len(rows_out))
    known = np.where(np.isnan(known), common_noise(recordings), known)
    joints = tuple(Joint(j, jax.device_put(np.ones(len(j.parameters)))) for j in structure.elements)
    forces = tuple(kind for kind in kinds if isinstance(kind, ForceKind))
    made = partial(
        predictor,
        structure,
        jax.device_put(rows_in),
        jax.device_put(rows_out),
        sampling_rate,
        quantity,
        forces,
    )
    sides, search, modal = _resolved(made, joints, recordings, known)
    seen = sides.fitted
    shapes = np.asarray(modal.Phi)
    moving = {name: row @ shapes for name, row in rows.items() if np.any(row @ shapes)}
    states = followed(search)
    grounds = Grounds(
        kinds,
        places_of(search, states, moving),
        tuple(sensors),
        tuple(structure.labels),
        lambda: time.perf_counter() - started < budget,
        progress,
    )
    table = competition.run(search, grounds, seed)
    progress("predicting the held-out recordings")
    before = sides.free(table.nominal)
    after = sides.free(table.best) if table.detected else before
    fitted = after[0]
    unknown = untried(fitted.relative / fitted.floor)
    what = _suspects(table, 1.0 - unknown) if table.detected else []
    differing: tuple[Observable, ...] = ()
    restoring = None
    if table.detected and grounds.in_time():
        progress("recovering the force and the modes' differences")
        differing = observables(search, _joined(before), sampling_rate)
        own = [entry for entry in table.entries if entry.search is search]
        if own and own[0] is table.best:
            others = [entry.fitted for entry in own[1:]]
            restoring = restoring_force(search, states, own[0].fitted, 0, others)
    warnings = [*seen.warnings, *sides.warnings()]
    warnings += [
        f"Row {name} is zero on every mode, so nothing could be looked for there"
        for name in rows
        if name not in moving
    ]
    if table.detected and not _better(before, after):
        warnings.append(
            "What was added does not predict the held-out recordings better: take it as a hint"
        )
    warnings += _left(fitted, table.detected, unknown)
    warnings += _unforeseen(after[1]) if after[1] else []
    indistinguishable = alike(what, _ALIKE) if what else ()
    if table.detected:
        indistinguishable += containing(table.best, table.entries)
    return Diagnosis(
        detected=table.detected,
        probability_nothing_missing=(1.0 - unknown) * table.probability_of_nothing,
        probability_something_else=unknown,
        what=tuple(what),
        before=Errors(*(_relative(x) for x in before)),
        after=Errors(*(_relative(x) for x in after)),
        noise_floor=Errors(*(x.floor if x else math.nan for x in after)),
        noise_floor_95=Errors(*(x.floor_95 if x else math.nan for x in after)),
        parameter_spread=Errors(*(x.spread if x else math.nan for x in after)),
        indistinguishable=tuple(dict.fromkeys(indistinguishable)),
        observables=differing,
        scores=table.scores,
        runs=(_joined(before), _joined(after)),
        sampling_rate=sampling_rate,
        restoring=restoring,
        warnings=tuple(warnings),
        complete=grounds.in_time(),
        seconds=time.perf_counter() - started,
    )


def _left(fitted: Free, detected: bool, unknown: float) -> list[str]:
    """What to think of a residual that stays well above the noise."""
    ratio = fitted.relative / fitted.floor
    if ratio < _UNEXPLAINED:
        return []
    if detected:
        advice = "so something else is missing as well, or what is missing is only like this"
    else:
        advice = "but nothing that was tried explains it"
    return [
        f"The fitted recordings are still {ratio:.2g} times the noise off, {advice} "
        f"(probability {unknown:.2f})"
    ]


def _unforeseen(held_out: Free) -> list[str]:
    """What to think of held-out recordings that are off by more than anything accounts for."""
    ratio = held_out.relative / math.hypot(held_out.floor_95, _DEVIATIONS * held_out.spread)
    if ratio < _UNFORESEEN:
        return []
    return [
        f"The held-out recordings are off by {ratio:.2g} times what noise and uncertain parameters "
        "account for: either something acts only there, or the joints were fitted to the wrong "
        "end; hold out others and compare"
    ]


def _resolved(
    made: Callable[[int], tuple[Predictor, ModalCoordinates]],
    joints: tuple[Joint, ...],
    recordings: Sequence[Transient],
    known: np.ndarray,
) -> tuple["_Sides", Search, ModalCoordinates]:
    """What is to be fitted, with as many steps between samples as change no residual any more."""

    def of(substeps: int) -> tuple[_Sides, Search, ModalCoordinates]:
        by, modal = made(substeps)
        sides = _Sides.of(recordings, by, modal, known)
        noise = np.median(sides.fitted.noise, axis=0)
        return sides, Search(by, joints, sides.fitted.data, noise, sides.order), modal

    coarse = of(_SUBSTEPS)
    search = coarse[1]
    _require_same_units(search)
    by = search.predictor
    if math.sqrt(float(np.max(by.omega2))) * float(by.dt) > _TURN:
        finer = of(_MOST_SUBSTEPS)
        changed = max(_change(search, finer[1], *each) for each in _SAME_AS.items())
        # Errors of fourth order in the step, of which the finer ones have next to nothing.
        enough = math.ceil(_SUBSTEPS * changed**0.25)
        if enough >= _MOST_SUBSTEPS:
            return finer
        if enough > _SUBSTEPS:
            return of(enough)
    return coarse


def _change(search: Search, finer: Search, cycles: float, unit: float) -> float:
    """What finer steps change in the residuals of the recording that changes most."""
    off = glance(finer, [_given(finer)], cycles)[0] - glance(search, [_given(search)], cycles)[0]
    return float(np.max(np.sqrt(np.mean(off**2, axis=(1, 2))))) / unit


def _given(search: Search) -> tuple[Hypothesis, np.ndarray]:
    """The model with its joints as given."""
    return search.nothing(), search.still(np.zeros(search.parameters + 2))


def _require_same_units(search: Search) -> None:
    """Refuse recordings that are of quite another size than the forces can have caused."""
    quantity = search.predictor.quantity
    seen = np.asarray(search.data.weight) > 0
    measured = np.asarray(search.data.response)[seen]
    predicted = measured - innovations(search, *_given(search), math.inf)[seen]
    ratio = math.sqrt(float(np.mean(measured**2) / np.mean(predicted**2)))
    if math.isfinite(ratio) and not 1.0 / _OTHER_UNITS < ratio < _OTHER_UNITS:
        raise InputError(
            f"recordings: the measured {quantity} is {ratio:.2g} times what the model predicts "
            "from the forces; are forces, responses and matrices in one system of units?"
        )


@dataclass(frozen=True, eq=False)
class _Sides:
    """Recordings to fit, and those held out in batches of the same size."""

    fitted: Prepared
    order: tuple[int, ...]
    held: tuple[tuple[Prepared, tuple[int, ...]], ...]

    @classmethod
    def of(
        cls,
        recordings: Sequence[Transient],
        made: Predictor,
        modal: ModalCoordinates,
        known: np.ndarray,
    ) -> "_Sides":
        length = max(len(each.response) for each in recordings)
        order = tuple(i for i, each in enumerate(recordings) if each.use == "fit")
        rest = [i for i, each in enumerate(recordings) if each.use == "hold_out"]
        count = len(order)

        def taken(those: Sequence[int]) -> Prepared:
            return prepared([recordings[i] for i in those], made, modal, known, length, count)

        held = [tuple(rest[i : i + count]) for i in range(0, len(rest), count)]
        return cls(taken(order), order, tuple((taken(those), those) for those in held))

    def free(self, entry: Entry) -> tuple[Free, Free | None]:
        """Free runs against both."""
        found = [
            free_run(entry.search, entry.fitted, batches) if batches else None
            for batches in ([(self.fitted, self.order)], self.held)
        ]
        assert found[0] is not None
        return found[0], found[1]

    def warnings(self) -> list[str]:
        """What a verdict on so little may miss."""
        told = []
        if not self.held:
            told.append("No recording was held out, so nothing shows that the verdict holds")
        if len(self.order) == 1:
            told.append("One recording alone tells little of amplitude, and nothing of repetition")
        return told


def _check(recordings: Sequence[Transient], inputs: int, sensors: int) -> None:
    if not any(each.use == "fit" for each in recordings):
        raise InputError("diagnose: no recording to fit; give at least one use: fit")
    for each in recordings:
        if each.response.ndim != 2 or each.response.shape[1] != sensors:
            raise InputError(
                f"{each.name}: response has shape {each.response.shape}; expected (N, {sensors}), "
                "a column for each sensor"
            )
        if each.force.shape != (len(each.response), inputs):
            raise InputError(
                f"{each.name}: force has shape {each.force.shape}; expected "
                f"({len(each.response)}, {inputs})"
            )


def _relative(run: Free | None) -> float:
    return run.relative if run else math.nan


def _better(before: tuple[Free, Free | None], after: tuple[Free, Free | None]) -> bool:
    if before[1] is None or after[1] is None:
        return True
    return after[1].relative < before[1].relative


def _joined(runs: tuple[Free, Free | None]) -> Free:
    """Fitted and held-out recordings one after the other."""
    return joined([run for run in runs if run is not None])


def _suspects(table: competition.Table, tried: float) -> list[Suspect]:
    """One row for every suspect of the best entry, then those of its rivals.

    ``tried`` is the probability that the truth is among them.
    """
    rows = []
    for entry in table.entries:
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
                    tried * table.probability(entry),
                    entry.behind,
                    estimates(entry.search, entry.fitted, slot),
                    tuple(label for label in labels if label != labels[slot]),
                )
            )
    found, known = [], set()
    for row in rows:
        if row.label not in known:
            known.add(row.label)
            found.append(row)
    return found
