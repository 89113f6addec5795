"""Simpler kinds in place of those that have them for limits, and these in place of the simpler."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TypeAlias

import jax
import numpy as np

from iwanjax.discrepancy.histories.ranking import (
    STEPS,
    TIME_CONSTANT,
    RankedFit,
    Scope,
    cost_of,
    distinct,
    refitted,
    tolerance_of,
)
from iwanjax.effects.faults import AbstractForceFault, AbstractSensorFault
from iwanjax.effects.kinds import ForceKind, JointKind, Kind
from iwanjax.effects.nested import Nested
from iwanjax.identification import hypotheses
from iwanjax.identification.joint_priors import joints_of
from iwanjax.identification.likelihood import unknowns
from iwanjax.identification.linearise import residuals_at
from iwanjax.identification.multistart import SHORT_TIME_CONSTANT, multistart
from iwanjax.identification.places import Place
from iwanjax.identification.problem import HistoryProblem, Hypothesis, Start
from iwanjax.identification.suspects import ParameterMap
from iwanjax.joints import AbstractJoint
from iwanjax.joints.force_law import Scales, Values

# What a sensor has seen, for no limit of a sensor's depends on it.
_NO_PLACE = Scales(1.0, 1.0)
# Share of the way from a law to what it becomes at which it is begun, besides those near its end.
_HALF_WAY = 0.5
# Of slots alone, without joints before them.
_SLOTS = ParameterMap(0)


def with_nested_laws(
    problem: HistoryProblem, entries: list[RankedFit], scope: Scope
) -> list[RankedFit]:
    """Of the best entry's kinds each with its limits in its place, refitted from there.

    On its own a slider may end in a local minimum where a joint, which has it for a limit, does
    not; and beside another suspect only the kinds that were screened first have been tried.

    Parameters
    ----------
    problem : HistoryProblem
        Without a joint left out.
    entries : list of RankedFit
        The best first.
    scope : Scope
        What may be suspected.

    Returns
    -------
    list of Entry
        The same and what was found, the one that fits best first.
    """
    starts = list(_simpler(problem, entries[0], scope)) if entries else []
    if not starts or not scope.in_time():
        return entries
    scope.progress("refitting simpler kinds")
    found = list(entries)
    for own in dict.fromkeys([problem, entries[0].problem]):
        some = [start for each, start in starts if each is own]
        for time_constant in (SHORT_TIME_CONSTANT, TIME_CONSTANT):
            fits = multistart(
                own,
                some,
                time_constant,
                STEPS,
                give_up=problem.settings.selection.nested_give_up,
                best=cost_of(entries[0]),
                in_time=scope.in_time,
            )
            best_of_each = distinct([RankedFit(own, each) for each in fits])
            some = [entry.fitted.start for entry in best_of_each]
        found += best_of_each
    return distinct(found)


def _simpler(
    problem: HistoryProblem, entry: RankedFit, scope: Scope
) -> Iterator[tuple[HistoryProblem, Start]]:
    """The entry with one kind's limit in its place, and the search that takes it."""
    hypothesis, start = entry.fitted.hypothesis, entry.fitted.start
    for slot, kind in enumerate(hypothesis.kinds):
        # Without the joint that was left out its parameters, the last ones, go.
        own = problem if isinstance(kind, JointKind) else entry.problem
        z, others = start.common[: own.parameters], start.common[entry.problem.parameters :]
        there = start._replace(theta=np.concatenate([z, others]))
        parts = [hypotheses.alone(own, there, i) for i in range(len(hypothesis.kinds))]
        for limit in (*scope.kinds, *scope.outside):
            for nested in [each for each in getattr(kind, "limits", ()) if each.means(limit)]:
                for one in _starts(own, entry, slot, nested, limit, scope, z):
                    yield own, hypotheses.joined(own, [*parts[:slot], one, *parts[slot + 1 :]])


def _starts(
    own: HistoryProblem,
    entry: RankedFit,
    slot: int,
    nested: Nested,
    limit: Kind,
    scope: Scope,
    z: np.ndarray,
) -> list[Start]:
    """Where to begin with a limit alone, the joints at z."""
    where = entry.fitted.hypothesis.where[slot]
    if isinstance(limit, AbstractSensorFault):
        which = scope.sensors.index(where)
        return [hypotheses.sensor(own, limit, which, where, z, 0.0)]
    if isinstance(limit, AbstractForceFault):
        return [hypotheses.channel(own, limit, scope.inputs.index(where), where, z, 0.0)]
    if isinstance(limit, ForceKind):
        row = next(place.row for place in scope.places if place.label == where)
        found = nested.narrowed(_values(entry, slot))
        return [hypotheses.force(own, limit, where, row, z, *_whole(values)) for values in found]
    return []


def _whole(values: Values) -> tuple[float, float]:
    """Size and shape of a force, which has none where only a size is known."""
    return values[0], values[1] if len(values) > 1 else 1.0


def _values(entry: RankedFit, slot: int) -> Values:
    """What a suspect has become, a force, a sensor or a joint left out."""
    hypothesis, problem = entry.fitted.hypothesis, entry.problem
    kind, theta = hypothesis.kinds[slot], entry.fitted.start.common
    if isinstance(kind, JointKind):
        return tuple(float(getattr(_joint(entry), info.name)) for info in kind.parameters)
    size, shape = hypothesis.physical(theta, problem.map, slot)
    return (size, shape) if hypothesis.shapes[slot] else (size,)


def _joint(entry: RankedFit) -> AbstractJoint:
    """The last joint of a fit, which the model had too few."""
    own = entry.problem
    z = entry.fitted.start.common[: own.parameters]
    return joints_of(own.joints, jax.device_put(z))[-1]


def begun_from(
    kind: JointKind, place: Place, known: Sequence[RankedFit], problem: HistoryProblem
) -> Iterator[hypotheses.LawStart]:
    """A law that does what known suspects at a place do, or what both become, beside their joints.

    By what a place has seen without it alone a strong law may not be found.

    Parameters
    ----------
    kind : JointKind
        Of the law, all of whose parameters are fitted.
    place : Place
        Where.
    known : sequence of RankedFit
        With suspects at any places.
    problem : HistoryProblem
        Of the model without any suspect.
    """
    if kind.law is None:
        return
    like = kind.law.begun(place.scales, **dict(kind.held))[-1]
    shares = (_HALF_WAY, *problem.settings.selection.nested_shares)
    for entry in known:
        hypothesis, z = entry.fitted.hypothesis, entry.fitted.start.common[: problem.parameters]
        if not all(each.more for each in hypothesis.kinds if isinstance(each, JointKind)):
            continue  # its joints are of other kinds
        slots = zip(hypothesis.kinds, hypothesis.where, strict=True)
        for slot, (other, where) in enumerate(slots):
            for nested in kind.limits if where == place.label else ():
                own = _values(entry, slot)
                limits: tuple[Nested, ...] = getattr(other, "limits", ())
                shared = [each for each in limits if each.same_as(nested)]
                both = [values for each in shared for values in each.narrowed(own)]
                same = [own] if nested.means(other) else both
                for values, share in itertools.product(same, shares):
                    wide = nested.widened(values, place.scales, share)
                    if _allowed(like, wide):
                        yield hypotheses.LawStart(type(like)(*wide), z)


def none_worse(base: RankedFit, entries: Sequence[RankedFit], scope: Scope) -> list[RankedFit]:
    """Entries, each refitted from the end of what it contains where that fits better.

    A law fits at least as well as a simpler one that it becomes, and with a size of zero as well
    as nothing: a search of it that ended higher ended in a local minimum, whose evidence is not
    the law's. From the simplest to the largest, so that what is found is handed on.

    Parameters
    ----------
    base : RankedFit
        The nominal model.
    entries : sequence of RankedFit
        Suspects. One that was given up with a shorter memory than the nominal model's gets as
        long a one, where what it contains leaves less even so.
    scope : Scope
        What may be suspected.

    Returns
    -------
    list of Entry
        As many, in any order.
    """
    known, others = [base], []
    for entry in sorted(entries, key=lambda each: unknowns(each.fitted)):
        found = _from_within(entry, known, scope)
        (known if found.fitted.time_constant == base.fitted.time_constant else others).append(found)
    return [*known[1:], *others]


def _from_within(entry: RankedFit, known: Sequence[RankedFit], scope: Scope) -> RankedFit:
    """An entry from the end of the best that it contains, if that is better than its own."""
    time_constant = known[0].fitted.time_constant
    once = 1.0 + tolerance_of(known[0].problem, time_constant)
    for simpler in sorted(known, key=cost_of):
        if once * cost_of(simpler) >= cost_of(entry) or not scope.in_time():
            break
        starts = widened(entry, simpler, scope, known[0].problem)
        if not starts:
            continue
        costs = [_cost(own, start, time_constant) for own, start in starts]
        # As far from the simpler law as costs nothing: at the very end of its range nothing is
        # left of a slope that a search could follow.
        same = [i for i, cost in enumerate(costs) if cost < once * cost_of(simpler)]
        best = same[0] if same else int(np.argmin(costs))
        if not costs[best] < cost_of(entry):
            break
        scope.progress(f"refitting {entry.fitted.hypothesis.label} from what it contains")
        own, start = starts[best]
        (fitted,) = refitted(
            own,
            [start],
            time_constant,
            min(map(cost_of, known)),
            scope,
            own.settings.selection.nested_give_up,
        )
        return distinct([entry, replace(entry, problem=own, fitted=fitted)])[0]
    return entry


def _cost(problem: HistoryProblem, start: Start, time_constant: float) -> float:
    """Squares of residuals, and what the priors of joints and states add."""
    (residual,) = residuals_at(problem, [(start.hypothesis, start.theta)], time_constant)
    p, fixed = problem.parameters, problem.map.end(len(start.hypothesis.sizes))
    z, states = start.common[:p], start.theta[:, fixed:]
    return float(np.sum(residual**2) + np.sum(z**2) + np.sum(states**2))


def widened(
    entry: RankedFit, simpler: RankedFit, scope: Scope, base: HistoryProblem
) -> list[tuple[HistoryProblem, Start]]:
    """An entry's hypothesis where it does what one that it contains does, each with its search.

    Parameters
    ----------
    entry, simpler : RankedFit
        Of which the second may be the nominal model.
    scope : Scope
        What may be suspected.
    base : HistoryProblem
        Without a joint left out, or one that sticks.

    Returns
    -------
    list of (Search, Start)
        With the errors of the state, the most nearly equal last; none where it is not contained.
    """
    held = holding(entry.fitted.hypothesis, simpler.fitted.hypothesis)
    if held is None:
        return []
    known = base.settings.selection
    # A joint's own fault has no size that was guessed.
    joint = any(isinstance(kind, JointKind) for kind in entry.fitted.hypothesis.kinds)
    guessed = not (simpler.fitted.hypothesis.kinds or joint)
    shares = known.nested_shares + known.nothing_shares * guessed
    made = (_start(entry, simpler, held, share, scope, base) for share in shares)
    return [each for each in made if each is not None]


_Held: TypeAlias = dict[int, tuple[int, Nested | None]]


def holding(whole: Hypothesis, part: Hypothesis) -> _Held | None:
    """Which of a hypothesis's suspects does what each of another's does, and by which limit.

    None where one of the other's is nowhere among them, or one too many cannot be of no size.
    """
    found: _Held = {}
    slots = list(enumerate(zip(whole.kinds, whole.where, strict=True)))
    parts = list(enumerate(zip(part.kinds, part.where, strict=True)))
    for i, pair in parts:
        same = [slot for slot, own in slots if own == pair and slot not in found]
        found |= dict.fromkeys(same[:1], (i, None))
    for i, (kind, where) in parts:
        if any(i == known for known, _ in found.values()):
            continue
        limits = [
            (slot, nested)
            for slot, own in slots
            if own[1] == where and slot not in found
            for nested in getattr(own[0], "limits", ())
            if nested.means(kind)
        ]
        if not limits:
            return None
        found |= {slot: (i, nested) for slot, nested in limits[:1]}
    left = [kind for slot, (kind, _) in slots if slot not in found]
    return None if any(getattr(kind, "fixed", None) is not None for kind in left) else found


def _start(
    entry: RankedFit,
    simpler: RankedFit,
    held: _Held,
    share: float,
    scope: Scope,
    base: HistoryProblem,
) -> tuple[HistoryProblem, Start] | None:
    """Where a hypothesis does what a simpler one does but for a share; None if it cannot."""
    hypothesis, part, own = entry.fitted.hypothesis, simpler.fitted, simpler.problem
    z, states = part.theta[:, : own.parameters], part.theta[:, part.values :]
    slots = entry.fitted.start.common[entry.problem.parameters :].copy()
    places = {place.label: place for place in scope.places}
    for slot, (kind, where) in enumerate(zip(hypothesis.kinds, hypothesis.where, strict=True)):
        i, nested = held.get(slot, (None, None))
        values: Values | None = None
        if i is not None and not isinstance(part.hypothesis.kinds[i], JointKind):
            values = _values(simpler, i)
            if nested is not None:
                seen = places[where].scales if where in places else _NO_PLACE
                values = nested.widened(values, seen, share)
        if not isinstance(kind, JointKind):
            there = _parameters(hypothesis, slot, slots, values, share)
            if there is None:
                return None
            slots[_SLOTS.slot(slot)] = there
        elif own is base and entry.problem is not base:
            common = z.mean(axis=0)
            if kind.name == "stiction":
                j = scope.joints.index(where)
                own, made = hypotheses.with_stiction(base, kind, j, where, (1.0 - share,), common)
            elif kind.law is not None:
                joint = _joint(entry)
                if values and not _allowed(joint, values):
                    return None
                guess = type(joint)(*values) if values else hypotheses.weakened(joint, share)
                alone = hypotheses.LawStart(guess, common)
                own, made = hypotheses.with_law(base, kind, places[where], [alone])
            else:
                F_S, K_T, _, beta = values or _values(entry, slot)
                if K_T <= 0.0:
                    return None
                weak = 1.0 if values else share
                guess = hypotheses.JointStart(weak * K_T, F_S / K_T, common, beta)
                own, made = hypotheses.with_joint(base, kind, places[where], [guess])
            z = np.tile(made[0].theta[: own.parameters], (len(z), 1))
    return own, Start(hypothesis, np.hstack([z, np.tile(slots, (len(z), 1)), states]))


def _allowed(joint: AbstractJoint, values: Values) -> bool:
    """Whether a law's formulas hold for these parameters: no mass is negative."""
    bounds = zip(joint.parameters, values, strict=True)
    return all(info.contains(np.asarray(value)) for info, value in bounds)


def _parameters(
    hypothesis: Hypothesis, slot: int, slots: np.ndarray, values: Values | None, share: float
) -> tuple[float, float] | None:
    """Size and shape of a suspect as a search has them; of a share of its own size without values.

    None for a size of a sign that the kind cannot have.
    """
    size, shape = slots[_SLOTS.slot(slot)]
    logarithmic = hypothesis.logarithmic(slot)
    if values is None:
        away = hypothesis.toward_none(slot) * math.log(1.0 / share)
        return (size + away if logarithmic else share * size), shape
    if hypothesis.shapes[slot]:
        shape = math.log(values[-1])
    value = values[0] / hypothesis.scales[slot]
    if logarithmic and value <= 0.0:
        return None
    return (math.log(value) if logarithmic else value), shape
