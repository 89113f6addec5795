"""The force that a place lacks, recovered from recordings, beside the laws that may explain it."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.discrepancy.effects import ForceKind, shipped
from iwanjax.discrepancy.findings import RestoringForce
from iwanjax.discrepancy.histories.linearise import residuals_at
from iwanjax.discrepancy.histories.multistart import SHORT_TIME_CONSTANT, HypothesisFit
from iwanjax.discrepancy.histories.places import Followed
from iwanjax.discrepancy.histories.problem import HistoryProblem, Hypothesis
from iwanjax.discrepancy.history_settings import IllustrationSettings
from iwanjax.joints import PlaceMotion
from iwanjax.kernels import Kept


def restoring_force(
    problem: HistoryProblem,
    seen: Followed,
    best: HypothesisFit,
    slot: int,
    rivals: list[HypothesisFit],
) -> RestoringForce | None:
    """The force that the best model's joints leave unexplained at the suspect's place.

    The best model follows the recording with a short memory. What accelerometers then show
    beyond it is a force over the inertia that it meets (with other sensors, what the observer
    has to add to the modal velocities at every sample); with the suspect's own force it makes
    what the place needs: a partial residual. From velocities it bends away from the law where that
    is wrong. From accelerations it does not: their innovations hold the observer's own errors of
    state as well, and what is recovered beyond the law says nothing of what lacks.
    Samples of a pulse are left out; where a force acts throughout, what it does is in the
    prediction, and all samples count.

    Returns
    -------
    RestoringForce or None
        None where the suspect is no force.
    """
    kind = best.hypothesis.kinds[slot]
    if not isinstance(kind, ForceKind):
        return None
    kept, theta = problem.predictor.kept, best.theta
    gain = problem.gains(
        [best.hypothesis.suspects], theta.mean(axis=0)[None], SHORT_TIME_CONSTANT
    ).gain[0]
    (residual,) = residuals_at(problem, [(best.hypothesis, theta)], SHORT_TIME_CONSTANT)
    weight = np.asarray(problem.data.weight)
    e = np.where(weight > 0, residual / np.where(weight > 0, weight, 1.0), 0.0)
    row = np.asarray(best.hypothesis.suspects.row)[slot, :kept]
    d, v = seen.q @ row, seen.v @ row
    hardest = int(np.argmax(np.max(np.abs(d), axis=1)))
    dt = float(problem.predictor.dt) * problem.predictor.substeps
    if problem.predictor.quantity == "acceleration":
        felt = np.asarray(problem.predictor.sensors) @ row / problem.noise**2
        left = -(e[hardest] @ felt) / float(felt @ (np.asarray(problem.predictor.sensors) @ row))
    else:
        left = -(e[hardest] @ gain[kept:].T @ row) / (dt * float(row @ row))
    quiet = ~np.any(np.asarray(problem.data.push)[hardest] != 0, axis=(1, 2))
    used, known = weight[hardest, :, 0] > 0, problem.settings.illustration
    if np.count_nonzero(used & quiet) >= known.bins * known.fewest:
        used &= quiet
    d, v = d[hardest], v[hardest]
    a = np.gradient(v, dt)
    laws = {}
    for fit in [best, *rivals]:
        law = _law(problem, fit, row, d, v, a, dt)
        if law is not None:
            laws.setdefault(law[0], law[1][used])
    force = left[used] + laws[kind.name]
    moving = {"deflection": d[used], "rate": v[used], "acceleration": a[used]}
    over = max(moving, key=lambda name: _explained(moving[name], laws[kind.name], known.bins))
    x = moving[over]
    centre, middle, spread = _binned(x, force, known)
    medians = {name: _binned(x, law, known)[1] for name, law in laws.items()}
    where = best.hypothesis.where[slot]
    return RestoringForce(kind.name, where, over, x, force, centre, middle, spread, medians)


def _law(
    problem: HistoryProblem,
    fit: HypothesisFit,
    row: np.ndarray,
    d: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    dt: float,
) -> tuple[str, np.ndarray] | None:
    """Name and force of a fit's suspect at this very place, in this motion."""
    hypothesis: Hypothesis = fit.hypothesis
    for slot, kind in enumerate(hypothesis.kinds):
        own = np.asarray(hypothesis.suspects.row)[slot, : len(row)]
        if not isinstance(kind, ForceKind) or not np.array_equal(own, row):
            continue
        size, shape = hypothesis.physical(fit.theta.mean(axis=0), problem.map, slot)
        moving = np.stack([d, v, a, np.diff(d, prepend=0.0)])
        fixed = np.asarray(shape), moving, np.asarray(dt)
        unit = np.asarray(_forces(kind, *jax.device_put(fixed))[0])
        return kind.name, unit * size
    return None


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
