"""The force that a place lacks, recovered from recordings, beside the laws that may explain it."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.discrepancy.findings import RestoringForce
from iwanjax.effects.catalogue import shipped
from iwanjax.effects.kinds import ForceKind
from iwanjax.identification.force_smoother import (
    ForcedModel,
    ForcePrior,
    Seen,
    augmented,
    closer,
    likeliest,
    smoothed,
)
from iwanjax.identification.innovations import AtSamples
from iwanjax.identification.kernels import observed
from iwanjax.identification.multistart import SHORT_TIME_CONSTANT, HypothesisFit
from iwanjax.identification.problem import HistoryProblem, Hypothesis
from iwanjax.joints import PlaceMotion
from iwanjax.kernels import Kept
from iwanjax.settings.histories import IllustrationSettings
from iwanjax.signals.comparison_band import OF_NOISE


def restoring_force(
    problem: HistoryProblem, best: HypothesisFit, slot: int, rivals: list[HypothesisFit]
) -> RestoringForce | None:
    """The force that acts at the suspect's place, whatever law is suspected there.

    An observer of the best model follows the recording of the largest deflection. What acts at
    the place is the force that the model applies there, and an unknown one that explains, with
    the errors of the state, what the innovations show; it is smoothed from all of them
    (:mod:`~iwanjax.identification.force_smoother`), joints and other suspects at their
    tangents. Where the law is wrong the force bends away from it, whatever the sensors measure;
    its deviation allows for noise, not for errors of the model at other places.
    Samples of a pulse are left out; where a force acts throughout, what it does is in the
    prediction, and all samples count.

    Returns
    -------
    RestoringForce or None
        None where the suspect is no force.
    """
    if not isinstance(best.hypothesis.kinds[slot], ForceKind):
        return None
    run, prior = _closest(problem, best, slot)
    found = _recovered(problem, best, slot, run, prior)
    hardest, end = run.recording, len(found.force)
    used = np.any(np.asarray(problem.data.weight)[hardest] > 0, axis=1)
    quiet = ~np.any(np.asarray(problem.data.push)[hardest] != 0, axis=(1, 2))
    known = problem.settings.illustration
    if np.count_nonzero(used & quiet) >= known.bins * known.fewest:
        used &= quiet
    used = used[:end]
    row, laws = np.asarray(best.hypothesis.suspects.row)[slot], {}
    for fit in [best, *rivals]:
        name, law = _law(problem, fit, row, found.motion, run.dt)
        if name:
            laws.setdefault(name, law[used])
    chosen = next(iter(laws))
    moving = found.motion[:, used]
    axis = int(np.argmax([_explained(x, laws[chosen], known.bins) for x in moving]))
    x, force = moving[axis], found.force[used]
    centre, middle, spread = _binned(x, force, known)
    both = found.covariance[used][:, [axis, -1]][..., [axis, -1]]
    deviation = _off_the_curve(both, x, force, known)
    return RestoringForce(
        chosen,
        best.hypothesis.where[slot],
        ("deflection", "rate", "acceleration")[axis],
        x,
        force,
        centre,
        middle,
        spread,
        _binned(x, deviation, known)[1],
        {name: _binned(x, law, known)[1] for name, law in laws.items()},
    )


class _ObservedRun(NamedTuple):
    """An observer's run through one recording, and the linear model of what it is off by.

    ``there`` is what the place does and is given, (4, N): deflection, rate, acceleration, force.
    ``jump`` is what the run's state was changed by where it is uncertain.
    """

    recording: int
    there: np.ndarray
    jump: np.ndarray
    model: ForcedModel
    seen: Seen
    dt: float
    longest: float


def _closest(
    problem: HistoryProblem, fit: HypothesisFit, slot: int
) -> tuple[_ObservedRun, ForcePrior]:
    """The run whose linear model explains its innovations best, of shorter and shorter memories.

    Were the model linear, all memories would tell the same. The closer a run keeps to the
    recording, the less joints are off their tangents; too close, it follows the noise.
    """
    memory = SHORT_TIME_CONSTANT
    best = _run(problem, fit, slot, memory)
    prior = likeliest(best.model, best.seen, best.dt, best.longest)
    while True:
        memory *= 0.25
        try:
            run = _run(problem, fit, slot, memory, best.recording)
            now = likeliest(run.model, run.seen, run.dt, prior.tau)
        # No observer of so short a memory, or none that is stable.
        except (np.linalg.LinAlgError, ValueError):
            break
        # Less than a factor of e is rounding, or no matter.
        if now.likelihood < prior.likelihood + 1.0:
            break
        best, prior = run, now
    return best, closer(best.model, best.seen, best.dt, prior)


def _run(
    problem: HistoryProblem,
    fit: HypothesisFit,
    slot: int,
    memory: float,
    recording: int | None = None,
) -> _ObservedRun:
    """Of one memory, through a recording, or that of the largest deflection."""
    predictor, suspects = problem.predictor, fit.hypothesis.suspects
    mean = fit.theta.mean(axis=0)[None]
    gain = problem.gains([suspects], mean, memory, slopes=False).gain[0]
    varied = jax.device_put((fit.theta, gain))
    # A kernel that was kept gives a plain tuple.
    data = problem.data_with(fit.hypothesis, fit.theta)
    whole = AtSamples(*observed(predictor, problem.joints, suspects, *varied, data))
    d, v, a, force = (np.asarray(x) for x in whole[1:])
    on = np.any(np.asarray(problem.data.weight) > 0, axis=2)
    on[:, problem.settings.illustration.longest :] = False
    if recording is None:
        largest = np.max(np.where(on, np.abs(d[..., slot]), 0.0), axis=1)
        recording = int(np.argmax(largest))
    end = int(np.flatnonzero(on[recording])[-1]) + 1
    theta, row = fit.theta[recording], np.asarray(suspects.row)[slot]
    # What is suspected here is known as it acts: what it is off by is in the unknown force.
    here = _suspected(fit.hypothesis, row)
    others = np.array(suspects.force)
    others[here] = 0.0
    others = suspects._replace(force=jax.device_put(others))
    A, H = problem.system(others, theta)
    B, D = problem.opposed(row, others, theta)
    kick, unsure = (np.asarray(x)[recording] for x in (problem.data.kick, problem.data.unsure))
    jump = unsure @ theta[problem.map.end(len(suspects.row)) :]
    e, precision = np.asarray(whole.e)[recording, :end], _precision(problem, recording)[:end]
    seen = Seen(e, precision, -e @ gain.T, kick[:end] > 0, (-jump, unsure @ unsure.T))
    dt = float(predictor.dt) * predictor.substeps
    there = np.stack([*(x[..., slot] for x in (d, v, a)), np.sum(force[..., here], axis=-1)])
    model, longest = ForcedModel(A, B, H, D), 1.0 / _slowest(A, end * dt)
    return _ObservedRun(recording, there[:, recording, :end], jump, model, seen, dt, longest)


class _Recovered(NamedTuple):
    """Of a place: deflection, rate and acceleration (3, N); force (N,); covariance (N, 4, 4)."""

    motion: np.ndarray
    force: np.ndarray
    covariance: np.ndarray


def _recovered(
    problem: HistoryProblem, fit: HypothesisFit, slot: int, run: _ObservedRun, prior: ForcePrior
) -> _Recovered:
    """What a run is off by, smoothed from its innovations, and added to it."""
    kept, (A, B, _, _) = problem.predictor.kept, run.model
    own, left = np.split(np.asarray(fit.hypothesis.suspects.row)[slot], [kept])
    watched = np.zeros((4, 2 * kept + 2))
    watched[0, :kept] = own
    watched[0, -2] = -(left * np.asarray(problem.predictor.left.flexibility)) @ left
    watched[1, kept:-2] = own
    watched[2, :-2], watched[2, -2] = own @ A[kept:], own @ B[kept:]
    watched[3, -2] = 1.0
    system = augmented(run.model, prior.tau, np.asarray(prior.deviation), run.dt)
    off, covariance = smoothed(system, run.seen, watched)
    there = run.there + off.T
    # A run knows of an uncertain state's error only after it is at that sample.
    there[:3] += np.outer(watched[:3, :-2] @ run.jump, run.seen.unsure)
    return _Recovered(there[:3], there[3], prior.scale * covariance)


def _precision(problem: HistoryProblem, recording: int) -> np.ndarray:
    """One over the deviations of noise and of what a force's errors add to it, (N, sensors).

    The allowance for the model's own errors, the same at all samples, is left out: that of the
    noise is estimated.
    """
    weight = np.asarray(problem.data.weight)[recording] * OF_NOISE
    # Of a sensor that this recording lacks any would do.
    usual = np.where(np.any(weight, axis=0), np.max(weight, axis=0), 1.0)
    on = weight > 0
    more = 1.0 / np.where(on, weight, usual) ** 2 - 1.0 / usual**2
    return on / np.sqrt(problem.noise**2 + more)


def _slowest(A: np.ndarray, duration: float) -> float:
    """Angular frequency of the slowest mode that turns once in a recording, rad/s."""
    least = 2.0 * np.pi / duration
    turns = np.abs(np.linalg.eigvals(A))
    return float(np.min(turns[turns >= least], initial=np.max(turns, initial=least)))


def _off_the_curve(
    covariance: np.ndarray, x: np.ndarray, force: np.ndarray, known: IllustrationSettings
) -> np.ndarray:
    """Deviations of a force over x from its own curve, (N,), where x is uncertain as well.

    Along a curve of slope k the force is off it by as much as its error less k times that of x.
    """
    centre, middle, _ = _binned(x, force, known)
    if len(centre) < 2:
        return np.sqrt(covariance[:, 1, 1])
    slope = np.interp(x, centre, np.gradient(middle, centre))
    ways = np.stack([-slope, np.ones_like(slope)], axis=1)
    return np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", ways, covariance, ways), 0.0))


def _law(
    problem: HistoryProblem, fit: HypothesisFit, row: np.ndarray, motion: np.ndarray, dt: float
) -> tuple[str, np.ndarray]:
    """Names and force of a fit's suspects at this very place, in this motion."""
    names, whole = [], np.zeros(motion.shape[1])
    moving = np.concatenate([motion, np.diff(motion[:1], prepend=0.0)])
    for slot in _suspected(fit.hypothesis, row):
        kind = fit.hypothesis.kinds[slot]
        size, shape = fit.hypothesis.physical(fit.theta.mean(axis=0), problem.map, slot)
        fixed = np.asarray(shape), moving, np.asarray(dt)
        whole = whole + size * np.asarray(_forces(kind, *jax.device_put(fixed))[0])
        names.append(kind.name)
    return " + ".join(names), whole


def _suspected(hypothesis: Hypothesis, row: np.ndarray) -> list[int]:
    """Slots of the forces at a place."""
    rows = np.asarray(hypothesis.suspects.row)
    return [
        slot
        for slot, kind in enumerate(hypothesis.kinds)
        if isinstance(kind, ForceKind) and np.array_equal(rows[slot], row)
    ]


def _unit_force(kind: ForceKind, shape: Array, moving: Array, dt: Array) -> tuple[Array]:
    """Force of size 1 along a motion, (4, N): d, v, a and the steps of d."""

    def step(memory: Array, at: Array) -> tuple[Array, Array]:
        unit, memory = kind.unit_force(PlaceMotion(at[0], at[1], at[2], at[3], dt), shape, memory)
        return memory, unit

    return (jax.lax.scan(step, jnp.zeros(()), moving.T)[1],)


_forces = Kept(_unit_force, lambda kind, *_: kind.name if shipped(kind) else None)


def _explained(x: np.ndarray, law: np.ndarray, bins: int) -> float:
    """Share of a law's variance that is a function of x."""
    which = _bins(x, bins)[1]
    sums, counts = (np.bincount(which, w, bins) for w in (law, None))
    mean = sums / np.maximum(counts, 1)
    return float(np.sum(counts * (mean - law.mean()) ** 2))


def _bins(x: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    edges = np.linspace(x.min(), x.max(), count + 1)
    return edges, np.clip(np.digitize(x, edges) - 1, 0, count - 1)


def _binned(
    x: np.ndarray, force: np.ndarray, known: IllustrationSettings
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Medians and deviations over bins of x that hold enough samples."""
    edges, which = _bins(x, known.bins)
    rows = [
        (0.5 * (edges[i] + edges[i + 1]), np.median(force[which == i]), _spread(force[which == i]))
        for i in range(known.bins)
        if np.sum(which == i) >= known.fewest
    ]
    found = np.array(rows).reshape(-1, 3)
    return found[:, 0], found[:, 1], found[:, 2]


def _spread(x: np.ndarray) -> float:
    """Deviation by the median of absolute deviations."""
    return 1.4826 * float(np.median(np.abs(x - np.median(x))))
