"""Which suspects would explain what the joints cannot."""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from iwanjax.discrepancy.findings import PlaceEvidence
from iwanjax.discrepancy.histories.place_test import (
    Block,
    Columns,
    Remaining,
    free_columns,
    places_by_evidence,
)
from iwanjax.effects.catalogue import sensor_faults_of
from iwanjax.effects.faults import AbstractAddedFault, AbstractForceFault
from iwanjax.effects.kinds import JointKind, Kind
from iwanjax.estimation.evidence import LEAST_GAIN
from iwanjax.identification import hypotheses
from iwanjax.identification.columns import (
    UnitEffect,
    by_memory,
    columns,
    columns_at_rest,
    force_faults,
    sensor_faults,
    unit_effects,
)
from iwanjax.identification.free_values import drifting_values
from iwanjax.identification.likelihood import scale
from iwanjax.identification.linearise import innovations, squares_at
from iwanjax.identification.multistart import HypothesisFit
from iwanjax.identification.places import Place
from iwanjax.identification.problem import HistoryProblem, Start

# Share of a column's square below which the joints explain all of it.
_EXPLAINED = 1e-12


class Candidate(NamedTuple):
    """A suspect, judged at size zero.

    Attributes
    ----------
    start : Start
        At the size that the linearised residuals ask for.
    drop : float
        Share of the squared residual that it would take away, the joints refitted.
    place : PlaceEvidence
        Of all that may act where it does.
    """

    start: Start
    drop: float
    place: PlaceEvidence


def score_test(
    problem: HistoryProblem,
    base: HypothesisFit,
    kinds: Sequence[Kind],
    places: Sequence[Place],
    sensors: Sequence[str],
    joints: Sequence[str],
    in_time: Callable[[], bool] = lambda: True,
    inputs: Sequence[str] = (),
) -> list[Candidate]:
    r"""Score every kind at every place by what it would take off the residual.

    With the column h of a suspect's size at zero and the residual e, both less what the joints'
    parameters explain, the squared residual falls by :math:`(h^Te)^2/(h^Th)`. Shapes are
    tried on the small grids of the catalogue; limits of sensors as they are, for they have no
    derivative at infinity; a drift by the joint's own columns, cut by recordings. Forces that
    promise little with the joints at rest are judged by that alone.

    Parameters
    ----------
    problem : HistoryProblem
        Predictor and data.
    base : HypothesisFit
        The model with its joints refitted, and the suspects found so far.
    kinds : sequence of Kind
        To be tried.
    places : sequence of Place
        Where forces may act.
    sensors, joints, inputs : sequence of str
        Labels.
    in_time : function
        False when it is time to stop.

    Returns
    -------
    list of Candidate
        For each kind and place the best shape, the largest drop first; none where there was no
        time to judge them all.
    """
    z = base.theta.mean(axis=0)[: problem.parameters]
    others = [base.start] if base.hypothesis.kinds else []
    explained, shared = free_columns(problem, base)
    remaining = Remaining.of(problem, base, np.linalg.qr(explained)[0])
    total = remaining.square
    best: dict[tuple[str, str, str], tuple[float, Callable[[], Start]]] = {}
    alone: dict[str, list[float]] = {}
    blocks: dict[str, list[Block]] = {}

    def propose(kind: Kind, where: str, drop: float, start: Callable[[], Start]) -> None:
        # Two forms of one name stand side by side.
        key = (where, kind.name, getattr(kind, "variant", ""))
        if key not in best or drop > best[key][0]:
            best[key] = (drop, start)
        alone.setdefault(where, []).append(drop * total)

    if not in_time():
        return []
    of_channels = [
        *sensor_faults(problem, kinds, sensors, z),
        *force_faults(problem, kinds, inputs, z),
    ]
    for unit, size, drop in _judged(
        problem, base, kinds, places, of_channels, remaining, blocks, in_time
    ):
        if size != 0 and not (unit.kind.positive and size < 0):
            propose(unit.kind, unit.where, drop, partial(unit.sized, size))
    if not in_time():
        return []
    ready = _as_they_are(problem, base, others, kinds, sensors, inputs, z)
    if base.hypothesis.drifting is None:
        known = explained[: base.residual.size, :shared]
        ready += _drifts(problem, kinds, joints, known, remaining, blocks, z)
    for start, drop in ready:
        (kind,), (where,) = start.hypothesis.kinds, start.hypothesis.where
        propose(kind, where, drop, lambda start=start: start)
    most = max((each.reduction for own in blocks.values() for each in own), default=0.0)
    unit = scale(problem, base, left=max(total - most, 0.0))
    tested = {each.where: each for each in places_by_evidence(blocks, alone, total, unit)}
    return [
        Candidate(hypotheses.joined(problem, [*others, start()]), drop, tested[where])
        for (where, *_), (drop, start) in sorted(best.items(), key=lambda each: -each[1][0])
    ]


def places_of(candidates: Sequence[Candidate]) -> tuple[PlaceEvidence, ...]:
    """Places of candidates, that of the largest evidence first."""
    found = {each.place.where: each.place for each in candidates}
    return tuple(sorted(found.values(), key=lambda each: -each.log_evidence))


def most_telling(tests: Sequence[Sequence[Candidate]]) -> tuple[PlaceEvidence, ...]:
    """Places by the test about the joints with which any of its suspects explains most."""
    tested = [places_of(each) for each in tests if each]
    return max(tested, key=lambda each: each[0].reduction, default=())


def by_evidence(tested: Sequence[PlaceEvidence], places: Sequence[Place]) -> list[Place]:
    """Places by the evidence that something acts there; those that were not tested come last."""
    known = {each.where: each.log_evidence for each in tested}
    return sorted(places, key=lambda place: -known.get(place.label, -math.inf))


def left_likely(tested: Sequence[PlaceEvidence], places: Sequence[Place]) -> list[Place]:
    """The same without those that the likeliest of them excludes."""
    known = {each.where: each.log_evidence for each in tested}
    ordered = by_evidence(tested, places)
    best = max((known[p.label] for p in ordered if p.label in known), default=0.0)
    return [p for p in ordered if known.get(p.label, best) > best - LEAST_GAIN]


def where_something_acts(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Those at places that the likeliest one does not exclude, whatever acts there."""
    best = max((c.place.log_evidence for c in candidates), default=0.0)
    return [c for c in candidates if c.place.log_evidence > best - LEAST_GAIN]


def excluded(tests: Sequence[Sequence[Candidate]]) -> frozenset[str]:
    """Places that no score test leaves as one where something acts."""
    tested = {c.place.where for each in tests for c in each}
    return frozenset(tested - {c.place.where for each in tests for c in where_something_acts(each)})


def _judged(
    problem: HistoryProblem,
    base: HypothesisFit,
    kinds: Sequence[Kind],
    places: Sequence[Place],
    of_channels: Sequence[UnitEffect],
    remaining: Remaining,
    blocks: dict[str, list[Block]],
    in_time: Callable[[], bool],
) -> Iterator[tuple[UnitEffect, float, float]]:
    """All with size and drop: about the motion itself, but for forces that promise little.

    Adds the blocks of places, by columns at rest where there are many forces, and of channels.
    """
    found, most = np.zeros((2, 0)), problem.settings.selection.moving
    forces: list[UnitEffect] = []
    groups = by_memory(problem, kinds, places)
    at_rest = False
    for group in groups:
        more = unit_effects(problem, base, kinds, group)
        own = np.zeros((2, len(more)))
        if len(groups) > 1 or len(more) > most:
            at_rest = True
            for which, made in columns_at_rest(problem, base, more):
                seen = remaining.seen(made)
                own[:, which] = _rated(seen, remaining.square)
                blocks[more[which[0]].where] = [seen.block()]
        found, forces = np.hstack([found, own]), [*forces, *more]
        forces = _remembered(forces, np.argsort(-found[1], kind="stable")[:most])
    if not in_time():
        return
    best = np.argsort(-found[1], kind="stable")[:most]
    judged = [*(forces[i] for i in best), *of_channels]
    moving = columns(problem, base, judged)
    moving = moving.reshape(len(moving), base.residual.size)
    by_place: dict[str, list[int]] = {}
    for i, unit in enumerate(judged):
        by_place.setdefault(unit.where, []).append(i)
    exact = np.zeros((2, len(judged)))
    for where, these in by_place.items():
        seen = remaining.seen(moving[these])
        exact[:, these] = _rated(seen, remaining.square)
        if not (at_rest and where in blocks):
            blocks[where] = [seen.block()]
    found[:, best] = exact[:, : len(best)]
    found = np.hstack([found, exact[:, len(best) :]])
    for unit, (size, drop) in zip([*forces, *of_channels], found.T.tolist(), strict=True):
        yield unit, size, drop


def _rated(seen: Columns, total: float) -> tuple[np.ndarray, np.ndarray]:
    """Sizes that columns ask for, and their drops; none where the model broke down."""
    with np.errstate(over="ignore", invalid="ignore"):
        square = np.diag(seen.products)
        usable = np.isfinite(square) & (square > _EXPLAINED * seen.alone)
    toward = np.where(usable, seen.toward, 0.0)
    size = toward / np.where(usable, square, 1.0)
    return size, size * toward / total


def _remembered(forces: Sequence[UnitEffect], best: np.ndarray) -> list[UnitEffect]:
    """The same, the histories of all but the best forgotten."""
    kept = set(best.tolist())
    if len(kept) == len(forces):
        return list(forces)
    return [
        unit._replace(force=unit.force.copy() if i in kept else unit.force[:0].copy())
        for i, unit in enumerate(forces)
    ]


def _drifts(
    problem: HistoryProblem,
    kinds: Sequence[Kind],
    joints: Sequence[str],
    known: np.ndarray,
    remaining: Remaining,
    blocks: dict[str, list[Block]],
    z: np.ndarray,
) -> list[tuple[Start, float]]:
    """Drops by the columns of a joint's strength in each recording on its own.

    ``known``, (values, shared), are the columns of what all recordings share.
    """
    R, size = problem.recordings, math.prod(problem.data.response.shape[1:])
    found = []
    for kind in kinds:
        if not (isinstance(kind, JointKind) and kind.name == "joint_drift") or R < 2:
            continue
        for j, label in enumerate(joints):
            own = drifting_values(problem, j)
            cut = np.zeros((len(own), R - 1, R, size))
            for i, value in enumerate(own):
                for r in range(1, R):
                    cut[i, r - 1, r] = known[r * size : (r + 1) * size, value]
            block = remaining.seen(cut.reshape(-1, R * size)).block()
            blocks.setdefault(label, []).append(block)
            start = hypotheses.drift(problem, kind, j, label, z)
            found.append((start, block.reduction / remaining.square))
    return found


def _as_they_are(
    problem: HistoryProblem,
    base: HypothesisFit,
    others: Sequence[Start],
    kinds: Sequence[Kind],
    sensors: Sequence[str],
    inputs: Sequence[str],
    z: np.ndarray,
) -> list[tuple[Start, float]]:
    """Drops of faults that are tried as they are, beside the others: limits and wrong signs."""
    largest = np.max(np.abs(np.asarray(problem.data.response)), axis=(0, 1))
    # Of some sensors only recordings that are held out may have any.
    there = [(i, label) for i, label in enumerate(sensors) if largest[i] > 0.0]
    largest *= problem.settings.selection.cut
    starts = [
        hypotheses.sensor(problem, kind, i, label, z, size)
        for kind in sensor_faults_of(kinds)
        for i, label in there
        for size in kind.tried(float(largest[i]))
    ]
    if problem.forces is not None:
        peaks = np.max(np.abs(problem.forces.clean), axis=(0, 1))
        starts += [
            hypotheses.channel(problem, kind, i, label, z, size)
            for kind in kinds
            if isinstance(kind, AbstractForceFault)
            for i, label in enumerate(inputs)
            if peaks[i] > 0.0
            for size in kind.tried(float(peaks[i]))
        ]
    added = [kind for kind in kinds if isinstance(kind, AbstractAddedFault)]
    if added:
        left = innovations(problem, base.hypothesis, base.theta, base.time_constant)
        left = np.where(np.asarray(problem.data.weight) > 0, left, 0.0)
        dt = float(problem.predictor.dt) * problem.predictor.substeps
        starts += [
            hypotheses.added(problem, tuned, i, label, z)
            for kind in added
            for i, label in there
            if (tuned := kind.tuned(left[..., i], dt)) is not None
        ]
    if not starts:
        return []
    states = base.theta[:, base.values :]
    whole = [hypotheses.joined(problem, [*others, start]) for start in starts]
    points = [
        (s.hypothesis, np.hstack([np.tile(s.theta, (problem.recordings, 1)), states]))
        for s in whole
    ]
    seen = squares_at(problem, points, base.time_constant)
    before = float(base.misfit.sum())
    return [(start, 1.0 - each / before) for start, each in zip(starts, seen, strict=True)]
