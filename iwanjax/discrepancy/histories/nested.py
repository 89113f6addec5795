"""Simpler kinds in place of those that have them for limits."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import jax
import numpy as np

from iwanjax.discrepancy.effects import ForceKind, JointKind, Kind, SensorKind
from iwanjax.discrepancy.histories import hypotheses as hypotheses
from iwanjax.discrepancy.histories.kernels import joints_of
from iwanjax.discrepancy.histories.multistart import SHORT_TIME_CONSTANT, multistart
from iwanjax.discrepancy.histories.problem import HistoryProblem, Start
from iwanjax.discrepancy.histories.ranking import (
    STEPS,
    TIME_CONSTANT,
    RankedFit,
    Scope,
    cost_of,
    distinct,
)
from iwanjax.joints import Iwan4

# Times the cost of what they are limits of from which on they are given up.
_GIVE_UP = 1.5


class _Law(NamedTuple):
    """Size and shape of a force."""

    size: float
    shape: float


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
                give_up=_GIVE_UP,
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
        names = getattr(kind, "limits", ())
        # Without the joint that was left out its parameters, the last ones, go.
        own = problem if isinstance(kind, JointKind) else entry.problem
        z, others = start.common[: own.parameters], start.common[entry.problem.parameters :]
        there = start._replace(theta=np.concatenate([z, others]))
        parts = [hypotheses.alone(own, there, i) for i in range(len(hypothesis.kinds))]
        for limit in scope.kinds:
            if limit.name in names:
                for one in _starts(own, entry, slot, limit, scope, z):
                    yield own, hypotheses.joined(own, [*parts[:slot], one, *parts[slot + 1 :]])


def _starts(
    own: HistoryProblem, entry: RankedFit, slot: int, limit: Kind, scope: Scope, z: np.ndarray
) -> list[Start]:
    """Where to begin with a limit alone, the joints at z."""
    where = entry.fitted.hypothesis.where[slot]
    if isinstance(limit, SensorKind):
        which = scope.sensors.index(where)
        return [hypotheses.sensor(own, limit, which, where, z, 0.0)]
    if isinstance(limit, ForceKind):
        row = next(place.row for place in scope.places if place.label == where)
        laws = _laws(entry, slot, limit)
        return [hypotheses.force(own, limit, where, row, z, *law) for law in laws]
    return []


def _laws(entry: RankedFit, slot: int, limit: ForceKind) -> list[_Law]:
    """What a limit may be to begin with, by what the whole has become."""
    kind, problem = entry.fitted.hypothesis.kinds[slot], entry.problem
    theta = entry.fitted.start.common
    if isinstance(kind, JointKind):
        joint = joints_of(problem.joints, jax.device_put(theta[: problem.parameters]))[-1]
        assert isinstance(joint, Iwan4)
        F_S, K_T = float(joint.F_S), float(joint.K_T)
        slips = (F_S / K_T, float(joint.phi_max)) if limit.shape else (1.0,)
        return [_Law(K_T, slip) for slip in slips]
    size, shape = theta[problem.parameters + 2 * slot : problem.parameters + 2 * slot + 2]
    assert isinstance(kind, ForceKind)
    value = entry.fitted.hypothesis.scales[slot] * (math.exp(size) if kind.positive else size)
    # A spring and damper in series that hardly relaxes is a spring; one that does, a damper.
    damper = limit.size.dimension == "force*time/length"
    return [_Law(value * (math.exp(shape) if damper else 1.0), 1.0)]
