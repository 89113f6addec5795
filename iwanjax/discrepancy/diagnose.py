"""Is anything missing from a model, where, of which kind, and how much better it is with it."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from iwanjax.discrepancy.catalogue import Kind, Scales, kinds_of
from iwanjax.discrepancy.measured import Prepared, Transient, prepared
from iwanjax.discrepancy.prediction import Quantity, predictor
from iwanjax.discrepancy.refit import (
    Free,
    Joint,
    Refit,
    Search,
    beginning,
    joints_at,
    refit,
)
from iwanjax.discrepancy.screen import Candidate, screen, suspects_of
from iwanjax.dynamics.transient import simulate
from iwanjax.errors import InputError
from iwanjax.structures import JointedStructure
from iwanjax.structures.checks import finite_array
from iwanjax.types import ArrayLike, require_double_precision

# Steps between samples.
_SUBSTEPS = 2
# Memories of the observer, cycles: the first two find the joints, the others polish.
_SHORT, _MIDDLE, _LONG = 2.0, 8.0, (30.0, 120.0, math.inf)
# Starts of the joints; two that end within this share of each other's cost are enough.
_STARTS, _SAME = 5, 0.01
# Candidates that are refitted, and sizes they begin with, of the one that is asked for.
_FINALISTS, _SHARES = 6, (1.0, 0.3, 3.0)
# A force is there when the evidence for it exceeds that for nothing by this. The model's own
# errors, of integration for instance, may be worth this share of the squared residual.
_LEAST_GAIN, _INDULGENCE = 12.0, 0.06
# Evidences closer than this cannot be told apart.
_ALIKE = 3.0
# No model is trusted to explain its residual better than this share of their variance.
_LEAST_TEMPERATURE = 0.3
_DRAWS = 6


class Suspect(NamedTuple):
    """A force that may be missing: one row of a verdict.

    Attributes
    ----------
    kind : Kind
        Of the catalogue.
    where : str
        Label of the place.
    probability : float
        Among all that were tried, and nothing; by evidence at a memory of eight cycles.
    log_evidence : float
        Of the data with it.
    size, size_std : float
        Its size in the free run, and its deviation: of the sensors' and the forces' noise at a
        memory of eight cycles, and of what a longer memory made of it, which shows the model's
        own errors.
    shape : float or None
        Its shape, for kinds that have one.
    """

    kind: Kind
    where: str
    probability: float
    log_evidence: float
    size: float
    size_std: float
    shape: float | None


class Errors(NamedTuple):
    """Root mean square of predicted less measured over that of measured."""

    fit: float
    hold_out: float


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Result of :func:`iwanjax.diagnose`.

    Attributes
    ----------
    detected : bool
        Whether something is missing.
    probability_nothing_missing : float
        By evidence.
    what : tuple of Suspect
        By probability; the first is the verdict. Empty when nothing is missing.
    before, after, noise_floor : Errors
        Free-run errors of the model with its joints refitted, with the first suspect added, and
        what sensor and force noise alone leave.
    indistinguishable : tuple of (str, str)
        Pairs kind@where that these data cannot tell apart.
    by_recording : dict of str to (float, float)
        Errors before and after for each recording.
    complete : bool
        Whether the budget of time sufficed.
    seconds : float
        What it took.
    """

    detected: bool
    probability_nothing_missing: float
    what: tuple[Suspect, ...]
    before: Errors
    after: Errors
    noise_floor: Errors
    indistinguishable: tuple[tuple[str, str], ...]
    by_recording: Mapping[str, tuple[float, float]] = field(repr=False)
    complete: bool
    seconds: float

    def statement(self) -> str:
        """The verdict in plain sentences."""
        tail = f" Noise alone would leave {self.noise_floor.hold_out:.2g}."
        if not self.detected:
            text = (
                f"Nothing is missing that these recordings show: with its joints refitted the "
                f"model predicts the held-out ones within {self.before.hold_out:.2g} of their "
                f"root mean square (probability {self.probability_nothing_missing:.2f})."
            )
            return text + tail + self._hurried()
        first = self.what[0]
        size = f"{first.kind.size.name} = {first.size:.4g} ± {first.size_std:.2g}"
        text = (
            f"The model lacks {first.kind.usual} at {first.where} ({first.kind.name}, {size}; "
            f"probability {first.probability:.2f}): its sign is {first.kind.signs}. "
            f"Held-out error falls from {self.before.hold_out:.2g} to {self.after.hold_out:.2g}."
        )
        rivals = [b if a == _label(first) else a for a, b in self.indistinguishable]
        if rivals:
            text += f" These data cannot tell it from {', '.join(rivals)}."
        return text + tail + self._hurried()

    def _hurried(self) -> str:
        return "" if self.complete else " The time given was too short to finish; this is so far."


def _alike(what: Sequence[Suspect]) -> tuple[tuple[str, str], ...]:
    """The first suspect with each whose evidence is as good."""
    return tuple(
        (_label(what[0]), _label(other))
        for other in what[1:]
        if what[0].log_evidence - other.log_evidence < _ALIKE
    )


def _label(suspect: Suspect) -> str:
    return f"{suspect.kind.name}@{suspect.where}"


class _Tried(NamedTuple):
    candidate: Candidate
    found: Refit
    free: tuple[Free, ...]


def diagnose(
    structure: JointedStructure,
    recordings: Sequence[Transient],
    sampling_rate: float,
    *,
    places: Mapping[str, ArrayLike],
    inputs: ArrayLike,
    sensors: ArrayLike,
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
    several starts, with a memory of two, then eight cycles. Then every kind of force at every
    place is judged at size zero by what it would take off the residual beyond what the joints
    can; the best are refitted with the joints, and the best of these with longer and longer
    memory up to the free run. Evidence is
    :math:`-S/(2T\tau) - \frac{k}{2}\ln(N/\tau)` with the squared residual S of N values, of
    correlation time :math:`\tau` and temperature T; for nothing S is taken 6 per cent less,
    which the model's own errors may be worth.

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
    inputs, sensors : (rows, n) array_like
        Where forces act and what the sensors see.
    quantity : {"acceleration", "velocity", "displacement"}
        What the sensors measure.
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
    rows, labels = np.stack([finite_array(r, n) for n, r in places.items()]), list(places)
    rows_in, rows_out = (np.atleast_2d(finite_array(x, "rows")) for x in (inputs, sensors))
    known = np.full(len(rows_out), np.nan) if noise is None else np.asarray(noise, float)
    fitted = [each for each in recordings if each.use == "fit"]
    held = [each for each in recordings if each.use == "hold_out"]
    _check(recordings, fitted, len(rows_in), len(rows_out))
    length = max(len(each.response) for each in recordings)
    seen = prepared(fitted, known, length, len(fitted), _SUBSTEPS)
    joints = tuple(Joint(joint) for joint in structure.elements)
    made = predictor(
        structure,
        jnp.asarray(rows),
        jnp.asarray(rows_in),
        jnp.asarray(rows_out),
        sampling_rate,
        quantity,
        kinds,
        _SUBSTEPS,
    )
    search = Search(made, joints, seen.data, np.median(seen.noise, axis=0))

    def in_time() -> bool:
        return time.perf_counter() - started < budget

    progress("refitting the joints")
    nominal = _nominal(search, seed, in_time)
    progress("screening kinds and places")
    scales = _scales(structure, search, nominal, rows, rows_in, sampling_rate)
    tried = _refitted(search, nominal, screen(search, nominal, scales), in_time, progress)
    evidence = _Evidence.of(search, nominal, tried)
    best = max(range(len(tried)), key=lambda i: evidence.of_tried[i], default=None)
    detected = best is not None and evidence.of_tried[best] - evidence.of_nominal > _LEAST_GAIN
    progress("polishing to the free run")
    polished = _polished(search, nominal, (), in_time)
    final = polished
    if detected and best is not None:
        final = _polished(search, tried[best].found, tried[best].free, in_time)
    before, each_before = _errors(search, polished, seen, held, known, length)
    after, each_after = _errors(search, final, seen, held, known, length)
    floor = _floor(search, final, seen, held, known, length, seed)
    what: list[Suspect] = []
    if detected:
        what += _suspects(search, seen, tried, evidence, labels, final, best, seed)
    return Diagnosis(
        detected=detected,
        probability_nothing_missing=evidence.probability_of_nothing,
        what=tuple(what),
        before=before,
        after=after,
        noise_floor=floor,
        indistinguishable=_alike(what),
        by_recording={name: (each_before[name], each_after[name]) for name in each_before},
        complete=in_time(),
        seconds=time.perf_counter() - started,
    )


def _check(
    recordings: Sequence[Transient], fitted: Sequence[Transient], inputs: int, sensors: int
) -> None:
    if not fitted:
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


def _nominal(search: Search, seed: int, in_time: Callable[[], bool]) -> Refit:
    """Joints refitted until two starts agree: a local minimum here would be a false alarm."""
    random = np.random.default_rng(seed)
    best: Refit | None = None
    for i in range(_STARTS):
        if best is not None and not in_time():
            break
        z = np.zeros(search.parameters) if i == 0 else random.standard_normal(search.parameters)
        found = refit(search, refit(search, beginning(search, z), _SHORT), _MIDDLE)
        agreed = best is not None and abs(found.cost / best.cost - 1.0) < _SAME
        if best is None or found.cost < best.cost:
            best = found
        if agreed:
            break
    assert best is not None
    return best


def _scales(
    structure: JointedStructure,
    search: Search,
    nominal: Refit,
    rows: np.ndarray,
    inputs: np.ndarray,
    sampling_rate: float,
) -> list[Scales]:
    """Largest deflection of each place in the refitted model, and its slowest period."""
    elements = joints_at(search.joints, nominal.z)
    moved = structure.with_joints(dict(zip(structure.labels, elements, strict=True)))
    found = simulate(
        moved,
        search.data.force[:, :, -1],
        1.0 / sampling_rate,
        inputs=inputs,
        sensors=rows,
        keep=("displacement",),
        sliders=None,
    )
    largest = np.max(np.abs(np.asarray(found.displacement)), axis=(0, 1))
    omega2 = np.asarray(search.predictor.modal.omega2)
    period = 2.0 * math.pi / math.sqrt(float(omega2[omega2 > 0][0]))
    return [Scales(float(d), period) for d in largest]


def _refitted(
    search: Search,
    nominal: Refit,
    candidates: Sequence[Candidate],
    in_time: Callable[[], bool],
    progress: Callable[[str], None],
) -> list[_Tried]:
    """The best candidates with the joints refitted, each from several sizes."""
    found = []
    for each in candidates[:_FINALISTS]:
        if found and not in_time():
            break
        kind = search.predictor.kinds[each.kind]
        progress(f"refitting with {kind.name}")
        free = (Free(each.kind, each.place, abs(each.size), kind.shape is not None),)
        best: Refit | None = None
        for share in _SHARES:
            start = Refit(nominal.z, suspects_of(search, each, share), math.inf, _MIDDLE, False)
            tried = refit(search, start, _MIDDLE, free)
            if best is None or tried.cost < best.cost:
                best = tried
            if best.cost < (1.0 - each.drop) * nominal.cost:
                break
        if best is not None:
            found.append(_Tried(each, best, free))
    return found


class _Evidence(NamedTuple):
    of_nominal: float
    of_tried: tuple[float, ...]
    temperature: float
    tau: float

    @classmethod
    def of(cls, search: Search, nominal: Refit, tried: Sequence[_Tried]) -> "_Evidence":
        """Log evidences, all with the temperature and correlation of the best."""
        best = min([nominal, *(each.found for each in tried)], key=lambda refit: refit.cost)
        gain = search.gain(best.z, best.suspects, best.cycles)
        r = search.residuals(best.z, best.suspects, gain)
        count = int(np.count_nonzero(np.asarray(search.data.weight)))
        temperature = max(_LEAST_TEMPERATURE, float(r @ r) / count)
        tau = _correlation(r.reshape(search.data.response.shape))

        def evidence(cost: float, parameters: int) -> float:
            return -cost / (2.0 * temperature * tau) - 0.5 * parameters * math.log(count / tau)

        return cls(
            evidence((1.0 - _INDULGENCE) * nominal.cost, search.parameters),
            tuple(
                evidence(each.found.cost, search.parameters + 1 + each.free[0].shape)
                for each in tried
            ),
            temperature,
            tau,
        )

    @property
    def probability_of_nothing(self) -> float:
        return self._share(self.of_nominal)

    def probability(self, i: int) -> float:
        return self._share(self.of_tried[i])

    def _share(self, value: float) -> float:
        every = np.array([self.of_nominal, *self.of_tried])
        return float(np.exp(value - every.max()) / np.sum(np.exp(every - every.max())))


def _correlation(residual: np.ndarray) -> float:
    """Correlation time of residuals in samples: one plus twice the sum of what is positive."""
    flat = residual - residual.mean(axis=1, keepdims=True)
    size = 2 * flat.shape[1]
    power = np.abs(np.fft.rfft(flat, size, axis=1)) ** 2
    correlation = np.fft.irfft(power.sum(axis=(0, 2)))[: flat.shape[1] // 4]
    correlation = correlation / correlation[0]
    negative = np.flatnonzero(correlation <= 0)
    until = negative[0] if negative.size else correlation.size
    return float(1.0 + 2.0 * np.sum(correlation[1:until]))


def _polished(
    search: Search, found: Refit, free: Sequence[Free], in_time: Callable[[], bool]
) -> Refit:
    """The same with longer and longer memory, up to the free run."""
    for cycles in _LONG:
        if not in_time():
            break
        found = refit(search, found, cycles, free, steps=25)
    return found


def _errors(
    search: Search,
    found: Refit,
    seen: Prepared,
    held: Sequence[Transient],
    known: np.ndarray,
    length: int,
) -> tuple[Errors, dict[str, float]]:
    """Free-run errors over all that was fitted, and over what was held out."""
    fit, by_name = _free_errors(search, found, seen)
    if not held:
        return Errors(fit, math.nan), by_name
    unseen = prepared(held, known, length, max(len(held), len(seen.names)), _SUBSTEPS)
    out, others = _free_errors(search._replace(data=unseen.data), found, unseen)
    return Errors(fit, out), by_name | others


def _free_errors(search: Search, found: Refit, those: Prepared) -> tuple[float, dict[str, float]]:
    gain = search.gain(found.z, found.suspects, math.inf)
    r = search.residuals(found.z, found.suspects, gain).reshape(those.data.response.shape)
    count = len(those.names)
    weight, y = (np.asarray(x)[:count] for x in (those.data.weight, those.data.response))
    e = np.where(weight > 0, r[:count] / np.where(weight > 0, weight, 1.0), 0.0)
    each = np.sqrt(np.sum(e**2, axis=(1, 2)) / np.sum(y**2, axis=(1, 2)))
    whole = float(np.sqrt(np.sum(e**2) / np.sum(y**2)))
    return whole, dict(zip(those.names, each.tolist(), strict=True))


def _floor(
    search: Search,
    found: Refit,
    seen: Prepared,
    held: Sequence[Transient],
    known: np.ndarray,
    length: int,
    seed: int,
) -> Errors:
    """What a perfect model leaves: sensors' noise, and the forces' noise carried through."""
    random = np.random.default_rng(seed)
    gain = search.gain(found.z, found.suspects, math.inf)

    def of(those: Prepared) -> float:
        count = len(those.names)
        here = search._replace(data=those.data)
        r_0 = here.residuals(found.z, found.suspects, gain).reshape(those.data.response.shape)
        carried = 0.0
        weight, y = (np.asarray(x)[:count] for x in (those.data.weight, those.data.response))
        safe = np.where(weight > 0, weight, np.inf)
        for _ in range(_DRAWS):
            moved = here._replace(data=those.drawn(random))
            r = moved.residuals(found.z, found.suspects, gain).reshape(r_0.shape)
            carried += float(np.sum(((r - r_0)[:count] / safe) ** 2)) / _DRAWS
        own = float(np.sum(np.where(weight > 0, those.noise[:, None, :] ** 2, 0.0)))
        return math.sqrt((own + carried) / float(np.sum(y**2)))

    fit = of(seen)
    if not held:
        return Errors(fit, math.nan)
    return Errors(
        fit, of(prepared(held, known, length, max(len(held), len(seen.names)), _SUBSTEPS))
    )


def _suspects(
    search: Search,
    seen: Prepared,
    tried: Sequence[_Tried],
    evidence: _Evidence,
    labels: Sequence[str],
    final: Refit,
    best: int | None,
    seed: int,
) -> list[Suspect]:
    rows = []
    for i, each in enumerate(tried):
        kind = search.predictor.kinds[each.candidate.kind]
        place = each.candidate.place
        found = final if i == best else each.found
        size = float(found.suspects.size[each.candidate.kind, place])
        shift = size - float(each.found.suspects.size[each.candidate.kind, place])
        std = _deviation(search, seen, each.found, each.free[0], evidence, seed)
        rows.append(
            Suspect(
                kind,
                labels[place],
                evidence.probability(i),
                evidence.of_tried[i],
                size,
                math.hypot(std, shift),
                float(found.suspects.shape[each.candidate.kind, place]) if kind.shape else None,
            )
        )
    return sorted(rows, key=lambda row: -row.log_evidence)


def _deviation(
    search: Search, seen: Prepared, found: Refit, free: Free, evidence: _Evidence, seed: int
) -> float:
    """Of the size: the sensors' noise linearised, the forces' by draws through the same."""
    gain = search.gain(found.z, found.suspects, found.cycles)
    blank = np.zeros(found.suspects.size.shape)
    one = blank.copy()
    one[free.kind, free.place] = free.size
    along = [(row, blank, blank) for row in np.eye(search.parameters)]
    J = search.slopes(
        found.z, found.suspects, gain, [*along, (np.zeros(search.parameters), one, blank)]
    )
    normal = J.T @ J
    normal[: search.parameters, : search.parameters] += np.eye(search.parameters)
    inverse = np.linalg.pinv(normal)
    sensors = evidence.temperature * evidence.tau * float(inverse[-1, -1])
    random = np.random.default_rng(seed)
    r_0 = search.residuals(found.z, found.suspects, gain)
    moved = [
        search._replace(data=seen.drawn(random)).residuals(found.z, found.suspects, gain) - r_0
        for _ in range(_DRAWS)
    ]
    forces = float(np.mean([(inverse @ (J.T @ each))[-1] ** 2 for each in moved]))
    return free.size * math.sqrt(sensors + forces)
