"""Which effects a plan of recordings finds, from what size on, and what should be added to it."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from iwanjax.compiler import on_the_processor
from iwanjax.discrepancy.histories.prepared import PreparedStudy
from iwanjax.discrepancy.histories.ranking import TIME_CONSTANT
from iwanjax.effects.faults import AbstractFault
from iwanjax.effects.kinds import ForceKind
from iwanjax.identification.columns import UnitEffect, force_faults, sensor_faults, unit_effects
from iwanjax.identification.free_values import values_measured
from iwanjax.identification.likelihood import LEAST_TEMPERATURE, left_by_noise
from iwanjax.identification.multistart import HypothesisFit
from iwanjax.identification.problem import HistoryProblem
from iwanjax.identification.recordings import StudyRecording
from iwanjax.joints import ParameterInfo
from iwanjax.planning.information import RecordingInformation, fisher, seen
from iwanjax.planning.power import POWER, found_from, told_apart_from
from iwanjax.planning.recordings import PlanBase
from iwanjax.planning.result import AddedMeasurement, AlikePair, Detectability, SmallestSize
from iwanjax.signals.comparison_band import CORRELATION
from iwanjax.threads import one_thread
from iwanjax.types import require_double_precision

# A recording, and the sensors that count in it.
_Part: TypeAlias = "tuple[_Shown, Sequence[int]]"
_ALIKE = 2.0
"""Times the smallest size found at which two effects should be told apart."""
_HELPS = 1.1
"""Times by which a measurement has to bring a size down to be told."""


@on_the_processor()
@one_thread()
def detectability(
    study: PreparedStudy,
    name: str,
    *,
    seed: int = 0,
    progress: Callable[[str], None] = lambda line: None,
) -> Detectability:
    """What the recordings of a study would show of each effect at each place.

    The joints are refitted to the recordings; where these lack something already, joints are
    taken as given. About that model's predictions every effect is linearised at size zero, with
    joints, errors of the linear model and states refitted (:mod:`iwanjax.planning.information`),
    and judged as a diagnosis does (:mod:`iwanjax.planning.power`): an estimate, for a search may
    miss what there is, and joints bend less than their slopes say. The same with one recording
    more, the hardest force at each input and at half, once and twice its peak; and with one sensor
    more, at each place, as noisy as those there are.

    Parameters
    ----------
    study : PreparedStudy
        Recordings as measured, or simulated ones of a plan. Those held out do not count.
    name : str
        Of the study.
    seed : int
        Of the joints' starts.
    progress : function
        Receives a line at every stage.

    Returns
    -------
    Detectability

    Raises
    ------
    PrecisionError
        When JAX computes in float32.
    """
    require_double_precision("detectability")
    progress("refitting the joints")
    base = PlanBase.of(study, seed)
    plan: list[_Shown] = []
    effects: list[_Effect] = []
    for recording in base.planned():
        progress(f"what {recording.name} shows of every effect")
        own, shown = _shown(base, recording)
        effects = [a.louder(b) for a, b in zip(effects or own, own, strict=True)]
        plan.append(shown)
    present = list(range(base.present))
    parts = [(each, present) for each in plan]
    judge = _Judge.of(base.problem, effects)
    now = judge.of_plan(parts)
    best = _shown_best(effects, now)
    kept = sorted({*best, *(int(now.rival[i]) for i in best)})
    among = judge.among(kept)
    parts = [(each.among(kept), present) for each in plan]
    before = among.of_plan(parts)
    # With one sensor more in all recordings, then with one recording more.
    options: list[tuple[str, str, _Sizes]] = [
        (f"sensor {label}", "sensor", before.improved(among.of_plan(_with(parts, at))))
        for at, label in enumerate(base.more_sensors, start=base.present)
    ]
    chosen = [effects[i] for i in kept]
    for label, recording in base.added():
        progress(f"what {label} would add")
        _, more = _shown(base, recording, kept)
        options.append((label, "hit", among.of_plan([*parts, (more, present)])))
    places = [kept.index(i) for i in best]
    return Detectability(
        name,
        tuple(_smallest(effects, now, i) for i in best),
        _alike(chosen, before, options, places),
        _added(before, options, places),
        tuple(sorted({kind.name for kind in study.kinds} - {e.kind.name for e in effects})),
        POWER,
        _warnings(base, options),
    )


class _Effect(NamedTuple):
    """A suspect of one shape.

    ``value`` is its size in physical units, ``force`` the largest root-mean-square of its force
    in any recording, for a size of 1.
    """

    kind: ForceKind | AbstractFault
    where: str
    value: float
    shape: float
    force: float

    @classmethod
    def of(cls, unit: UnitEffect, problem: HistoryProblem) -> "_Effect":
        kind, start = unit.kind, unit.sized(1.0)
        if isinstance(kind, ForceKind):
            force = float(np.sqrt(np.mean(unit.force**2)))
            _, shape = start.hypothesis.physical(start.common, problem.map, 0)
            return cls(kind, unit.where, 1.0, shape, force)
        dt = float(problem.predictor.dt) * problem.predictor.substeps
        return cls(kind, unit.where, kind.unit(dt), math.nan, math.nan)

    def louder(self, other: "_Effect") -> "_Effect":
        """With the force of the recording in which it is the larger."""
        return self._replace(force=max(self.force, other.force))

    @property
    def label(self) -> str:
        return f"{self.kind.name}@{self.where}"

    @property
    def variant(self) -> str:
        """Which form of the kind: a slider whose stiffness K holds already is told by its slip."""
        return getattr(self.kind, "variant", "")

    @property
    def told(self) -> str:
        """kind@where, and which form of it."""
        return f"{self.label}, {self.variant}" if self.variant else self.label

    def holds(self, other: "_Effect") -> bool:
        """Whether the other one is what this becomes at an end of its range."""
        names = {limit.name for limit in self.kind.limits}
        return self.where == other.where and other.kind.name in names

    @property
    def shape_info(self) -> ParameterInfo | None:
        return self.kind.shape if isinstance(self.kind, ForceKind) else None


class _Sizes(NamedTuple):
    """Sizes from which effects are found, (effects,), and told from rivals, (effects, effects).

    ``late`` are those from which the free run alone finds them.
    """

    found: np.ndarray
    late: np.ndarray
    apart: np.ndarray

    def improved(self, more: "_Sizes") -> "_Sizes":
        """With sensors more, which bring sizes down as much as they do in the free run."""
        known = np.isfinite(self.late) & np.isfinite(more.late)
        ratio = np.divide(more.late, self.late, out=np.ones_like(self.late), where=known)
        return more._replace(found=np.minimum(self.found * ratio, more.late))

    @property
    def rival(self) -> np.ndarray:
        """Which is hardest to tell from each."""
        return np.argmax(self.apart, axis=1)

    @property
    def named(self) -> np.ndarray:
        """From which they are found and told from all others."""
        return np.maximum(self.found, self.apart.max(axis=1, initial=0.0))


class _Judge(NamedTuple):
    """What sizes are judged by.

    Names and unknowns of effects, whether another one is a limit of each, a unit of squared
    residual, its correlation time, and what the free run has to leave, over the noise, for anything
    new to be looked for.
    """

    labels: np.ndarray
    unknowns: np.ndarray
    simpler: np.ndarray
    unit: float
    tau: float
    left: float

    @classmethod
    def of(cls, problem: HistoryProblem, effects: Sequence[_Effect]) -> "_Judge":
        # Of white noise, as far as it is in the band that is compared.
        correlation = CORRELATION / CORRELATION[0]
        until = int(np.argmax(correlation <= 0.0))
        tau = 1.0 + 2.0 * float(correlation[1:until].sum())
        temperature = max(LEAST_TEMPERATURE, left_by_noise(problem) / values_measured(problem))
        unknowns = np.array([1.0 + (e.shape_info is not None) for e in effects])
        simpler = np.array([[one.holds(other) for other in effects] for one in effects])
        labels = np.array([e.label for e in effects])
        left = problem.settings.slow_effects.left
        return cls(labels, unknowns, simpler, temperature * tau, tau, left)

    def among(self, which: Sequence[int]) -> "_Judge":
        """Of some of the effects."""
        at = list(which)
        return self._replace(
            labels=self.labels[at],
            unknowns=self.unknowns[at],
            simpler=self.simpler[np.ix_(at, at)],
        )

    def of_plan(self, parts: Sequence[_Part]) -> _Sizes:
        """By recordings, each with the sensors that count in it."""
        shared = parts[0][0].free.shared
        usual = fisher((part.usual.of() for part, _ in parts), shared)
        free = fisher((part.free.of(at) for part, at in parts), shared)
        count = sum(float(part.free.samples[list(at)].sum()) for part, at in parts) / self.tau
        known = self.unknowns, self.unit, count
        apart = told_apart_from(free, *known, self.simpler)
        apart[self.labels[:, None] == self.labels] = 0.0
        # Where eight cycles show nothing, the free run has to leave so much more.
        late = found_from(np.diag(free), *known, self.left - 1.0)
        return _Sizes(np.minimum(found_from(np.diag(usual), *known), late), late, apart)


class _Shown(NamedTuple):
    """What a recording shows to the sensors there are with a memory of eight cycles, and to all.

    The latter in the free run.
    """

    usual: RecordingInformation
    free: RecordingInformation

    def among(self, effects: Sequence[int]) -> "_Shown":
        """Of some of the effects."""
        return _Shown(self.usual.among(effects), self.free.among(effects))


def _shown(
    base: PlanBase, recording: StudyRecording, kept: Sequence[int] | None = None
) -> tuple[list["_Effect"], _Shown]:
    """What a recording shows of all effects, or of some of them."""
    shown, effects = [], []
    present = base.with_present_sensors()
    for plan, time_constant in ((present, TIME_CONSTANT), (base, math.inf)):
        problem, at = plan.alone(recording, time_constant)
        units = _units(present.study, problem, at, plan)
        units = units if kept is None else [units[i] for i in kept]
        effects = [_Effect.of(unit, problem) for unit in units]
        shown.append(seen(problem, at, units))
    return effects, _Shown(*shown)


def _with(parts: Sequence[_Part], sensor: int) -> list[_Part]:
    """The same recordings with a sensor more."""
    return [(part, [*at, sensor]) for part, at in parts]


def _units(
    study: PreparedStudy, problem: HistoryProblem, at: HypothesisFit, base: PlanBase
) -> list[UnitEffect]:
    """Of size 1: every kind at every place, and faults of the channels that there are."""
    z = at.theta.mean(axis=0)[: problem.parameters]
    sensors, inputs = tuple(base.study.sensors), tuple(study.inputs)
    faults = sensor_faults(problem, study.kinds, sensors, z)
    return [
        *unit_effects(problem, at, study.kinds, base.places),
        *(fault for fault in faults if fault.where in study.sensors),
        *force_faults(problem, study.kinds, inputs, z),
    ]


def _shown_best(effects: Sequence[_Effect], sizes: _Sizes) -> list[int]:
    """For each form of a kind and place the shape that needs the smallest force to be found."""
    found: dict[tuple[str, str], int] = {}
    for i, effect in enumerate(effects):
        key = effect.label, effect.variant
        force = np.nan_to_num(effect.force, nan=1.0) * sizes.found
        if key not in found or force[i] < force[found[key]]:
            found[key] = i
    return list(found.values())


def _smallest(effects: Sequence[_Effect], sizes: _Sizes, i: int) -> SmallestSize:
    effect, shape = effects[i], effects[i].shape_info
    found, named = float(sizes.found[i]), float(sizes.named[i])
    if isinstance(effect.kind, AbstractFault):
        found, named = (x if x <= effect.kind.most else math.inf for x in (found, named))
    rival = effects[sizes.rival[i]].told if sizes.apart[i].any() else ""
    return SmallestSize(
        effect.kind.name,
        effect.where,
        effect.kind.size.name,
        effect.kind.size.dimension,
        effect.value * found,
        effect.value * named,
        shape.name if shape else "",
        shape.dimension if shape else "",
        effect.shape,
        effect.force * found,
        rival,
        effect.variant,
    )


def _alike(
    effects: Sequence[_Effect],
    before: _Sizes,
    options: Sequence[tuple[str, str, _Sizes]],
    places: Sequence[int],
) -> tuple[AlikePair, ...]:
    """Effects that are not told from their nearest rival, each pair once, the hardest first."""
    pairs: dict[frozenset[str], tuple[float, AlikePair]] = {}
    for i in places:
        j, found = int(before.rival[i]), float(before.found[i])
        apart = float(before.apart[i, j])
        if not math.isfinite(found) or apart <= _ALIKE * found:
            continue
        after = [float(sizes.apart[i, j]) for _, _, sizes in options]
        at = int(np.argmin(after)) if after else -1
        factor = apart / after[at] if after and math.isfinite(after[at]) else 1.0
        helps = factor > _HELPS
        one, other = effects[i], effects[j]
        sizes = one.value * found, one.value * apart
        helped = (options[at][0], factor) if helps else ("", 1.0)
        pair = AlikePair(one.told, other.told, *sizes, *helped)
        both = frozenset((pair.first, pair.second))
        if both not in pairs or apart / found > pairs[both][0]:
            pairs[both] = apart / found, pair
    return tuple(pair for _, pair in sorted(pairs.values(), key=lambda each: -each[0]))


def _added(
    before: _Sizes, options: Sequence[tuple[str, str, _Sizes]], places: Sequence[int]
) -> tuple[AddedMeasurement, ...]:
    """What brings sizes down, and by how much on average, the most useful first."""
    found = [
        AddedMeasurement(
            label,
            kind,
            _mean_ratio(after.found, before.found, places),
            _mean_ratio(after.named, before.named, places),
        )
        for label, kind, after in options
    ]
    return tuple(sorted(found, key=lambda each: each.named))


def _mean_ratio(after: np.ndarray, before: np.ndarray, places: Sequence[int]) -> float:
    """Geometric mean, over what is finite with and without."""
    at = [i for i in places if math.isfinite(after[i]) and math.isfinite(before[i])]
    return float(np.exp(np.mean(np.log(after[at] / before[at])))) if at else 1.0


def _warnings(base: PlanBase, options: Sequence[tuple[str, str, _Sizes]]) -> tuple[str, ...]:
    told = []
    if not base.explained:
        told.append(
            "The model does not explain these recordings, so that joints were taken as given: "
            "diagnose them first; what is missing already hides what is smaller"
        )
    if not any(kind == "hit" for _, kind, _ in options):
        told.append("No recording with a force begins at rest, so that no other hit was tried")
    return tuple(told)
