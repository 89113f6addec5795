"""Which suspects would explain what the joints cannot."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from iwanjax.discrepancy import suspicion
from iwanjax.discrepancy.catalogue import ForceKind, JointKind, Kind, SensorKind
from iwanjax.discrepancy.fitting import Fitted, evaluate
from iwanjax.discrepancy.places import Place
from iwanjax.discrepancy.prediction import LONGEST_DELAY, Suspects
from iwanjax.discrepancy.search import Search, Start, drifting_values, free_values
from iwanjax.discrepancy.sensitivity import columns

# Suspects that a kernel takes at once, and kernels that run at once.
_LANES, _THREADS = 8, 2
# Shares of the largest value a sensor showed, where it may have been cut.
_LIMITS = (0.98, 0.7)


class Candidate(NamedTuple):
    """A suspect, judged at size zero.

    Attributes
    ----------
    start : Start
        At the size that the linearised residuals ask for.
    drop : float
        Share of the squared residual that it would take away, the joints refitted.
    """

    start: Start
    drop: float


def screen(
    search: Search,
    base: Fitted,
    kinds: Sequence[Kind],
    places: Sequence[Place],
    sensors: Sequence[str],
    joints: Sequence[str],
) -> list[Candidate]:
    r"""Score every kind at every place by what it would take off the residual.

    With the column h of a suspect's size at zero and the residual e, both less what the joints'
    parameters explain, the squared residual falls by :math:`(h^Te)^2/(h^Th)`. Shapes are
    tried on the small grids of the catalogue; limits of sensors as they are, for they have no
    derivative at infinity; a drift by the joint's own columns, cut by recordings.

    Parameters
    ----------
    search : Search
        Predictor and data.
    base : Fitted
        The model with its joints refitted, and the suspects found so far.
    kinds : sequence of Kind
        To be tried.
    places : sequence of Place
        Where forces may act.
    sensors, joints : sequence of str
        Labels.

    Returns
    -------
    list of Candidate
        For each kind and place the best shape, the largest drop first.
    """
    p, R = search.parameters, search.recordings
    z = base.theta.mean(axis=0)[:p]
    single = _forces(search, kinds, places, z) + _sensors(search, kinds, sensors, z)
    others = [base.start] if base.hypothesis.kinds else []
    trials = [suspicion.joined(search, [*others, trial]) for trial in single]
    blank = suspicion.joined(search, [*others, Start(search.nothing(), np.append(z, [0.0, 0.0]))])
    gain = search.gains([blank.hypothesis.suspects], blank.theta[None], base.cycles).gain[0]
    states = base.theta[:, base.values :]
    eye = np.eye(len(blank.theta) + states.shape[1])
    shared = free_values(search, base.hypothesis)
    own = [*shared, *range(len(blank.theta), len(eye))]
    # A size's derivative at zero, whatever its parameter: the new ones are as they are here.
    suspects = [blank.hypothesis.suspects] * len(own) + [_plain(trial) for trial in trials]
    values = [blank.theta] * len(own) + [_at_zero(trial) for trial in trials]
    thetas = [np.hstack([np.tile(each, (R, 1)), states]) for each in values]
    size = len(blank.theta) - 2
    made = _columns(search, suspects, thetas, [*eye[own], *(eye[size] for _ in trials)], gain)
    f = len(shared)
    known = made[:f].reshape(f, R, -1)
    explained = _explained(search, made[: len(own)].reshape(len(own), R, -1), f)
    basis, _ = np.linalg.qr(explained)
    whole = np.concatenate([base.residual.ravel(), z, states.ravel()])
    rest = len(whole) - base.residual.size
    left = whole - basis @ (basis.T @ whole)
    total = float(left @ left)
    best: dict[tuple[str, ...], Candidate] = {}

    def propose(start: Start, drop: float) -> None:
        key = start.hypothesis.variant
        if key not in best or drop > best[key].drop:
            best[key] = Candidate(suspicion.joined(search, [*others, start]), drop)

    for trial, column in zip(single, made[len(own) :].reshape(len(single), -1), strict=True):
        h = np.concatenate([column, np.zeros(rest)])
        h = h - basis @ (basis.T @ h)
        square = float(h @ h)
        if not math.isfinite(square) or square <= 0:
            continue
        size = -float(h @ left) / square
        proposed = _sized(search, trial, size, sensors)
        if proposed is not None:
            propose(proposed, float(h @ left) ** 2 / square / total)
    if not others:
        for each in _drifts(search, kinds, joints, known, explained, whole, total, z):
            propose(*each)
        for each in _limits(search, base, kinds, sensors, z):
            propose(*each)
    return sorted(best.values(), key=lambda each: -each.drop)


def _explained(search: Search, made: np.ndarray, shared: int) -> np.ndarray:
    """Columns of what is fitted: shared values, then the state of each recording; and priors."""
    f, R, size = made.shape
    p, k = search.parameters, f - shared
    columns = np.zeros((R * size, shared + R * k))
    columns[:, :shared] = made[:shared].reshape(shared, -1).T
    for r in range(R):
        at = slice(shared + r * k, shared + (r + 1) * k)
        columns[r * size : (r + 1) * size, at] = made[shared:, r].T
    prior = np.zeros((p + R * k, shared + R * k))
    prior[:p, :p] = np.eye(p)
    prior[p:, shared:] = np.eye(R * k)
    return np.vstack([columns, prior])


def _forces(
    search: Search, kinds: Sequence[Kind], places: Sequence[Place], z: np.ndarray
) -> list[Start]:
    return [
        suspicion.force(search, kind, place.label, place.row, z, 1.0, shape)
        for kind in kinds
        if isinstance(kind, ForceKind)
        for place in places
        for shape in (kind.shapes(place.scales) if kind.shape else (1.0,))
    ]


def _sensors(
    search: Search, kinds: Sequence[Kind], sensors: Sequence[str], z: np.ndarray
) -> list[Start]:
    return [
        suspicion.sensor(search, kind, i, label, z, 1.0)
        for kind in kinds
        if isinstance(kind, SensorKind) and kind.acts != "limit" and kind.fixed is None
        for i, label in enumerate(sensors)
    ]


def _at_zero(trial: Start) -> np.ndarray:
    """Values with no size of the last suspect; its shape as it is."""
    theta = trial.theta.copy()
    theta[-2] = 0.0
    return theta


def _plain(trial: Start) -> Suspects:
    """Suspects, the size of the last one as it is."""
    suspects = trial.hypothesis.suspects
    return suspects._replace(logarithmic=suspects.logarithmic.at[-1].set(0.0))


def _columns(
    search: Search,
    suspects: Sequence[Suspects],
    values: Sequence[np.ndarray],
    along: Sequence[np.ndarray],
    gain: np.ndarray,
) -> np.ndarray:
    """Derivatives of the residuals, (lanes, recordings x N x sensors)."""

    def run(first: int) -> np.ndarray:
        own = range(first, min(first + _LANES, len(suspects)))
        padded = [*own, *[own[-1]] * (_LANES - len(own))]
        some = [suspects[i] for i in padded]
        found = columns(
            search.predictor,
            search.joints,
            jax.tree.map(lambda *x: jnp.stack(x), *some),
            jnp.asarray(np.stack([values[i] for i in padded])),
            jnp.asarray(np.stack([along[i] for i in padded])),
            jnp.asarray(gain),
            search.data,
        )
        return np.asarray(found)[: len(own)].reshape(len(own), -1)

    first = run(0)
    with ThreadPoolExecutor(_THREADS) as pool:
        rest = list(pool.map(run, range(_LANES, len(suspects), _LANES)))
    return np.concatenate([first, *rest])


def _sized(search: Search, trial: Start, size: float, sensors: Sequence[str]) -> Start | None:
    """The trial at the size asked for; None where that means nothing."""
    (kind,), (where,) = trial.hypothesis.kinds, trial.hypothesis.where
    z, shape = trial.theta[:-2], math.exp(trial.theta[-1])
    if isinstance(kind, SensorKind):
        if kind.positive and size <= 0:
            return None
        size = min(size, 0.5 * LONGEST_DELAY) if kind.acts == "delay" else size
        return suspicion.sensor(search, kind, sensors.index(where), where, z, size)
    assert isinstance(kind, ForceKind)
    if size == 0 or (kind.positive and size < 0):
        return None
    row = np.asarray(trial.hypothesis.suspects.row[0])
    return suspicion.force(search, kind, where, row, z, size, shape)


def _drifts(
    search: Search,
    kinds: Sequence[Kind],
    joints: Sequence[str],
    known: np.ndarray,
    explained: np.ndarray,
    whole: np.ndarray,
    total: float,
    z: np.ndarray,
) -> list[tuple[Start, float]]:
    """Drops by the columns of a joint's strength in each recording on its own."""
    _, R, size = known.shape
    found = []
    for kind in kinds:
        if not (isinstance(kind, JointKind) and kind.name == "joint_drift") or R < 2:
            continue
        for j, label in enumerate(joints):
            own = drifting_values(search, j)
            cut = np.zeros((len(own), R - 1, R, size))
            for i, value in enumerate(own):
                for r in range(1, R):
                    cut[i, r - 1, r] = known[value, r]
            more = cut.reshape(-1, R * size).T
            blank = np.zeros((len(whole) - R * size, more.shape[1]))
            basis, _ = np.linalg.qr(np.hstack([explained, np.vstack([more, blank])]))
            rest = whole - basis @ (basis.T @ whole)
            start = suspicion.drift(search, kind, j, label, z)
            found.append((start, 1.0 - float(rest @ rest) / total))
    return found


def _limits(
    search: Search, base: Fitted, kinds: Sequence[Kind], sensors: Sequence[str], z: np.ndarray
) -> list[tuple[Start, float]]:
    """Drops of faults that are tried as they are: limits and wrong signs."""
    largest = np.max(np.abs(np.asarray(search.data.response)), axis=(0, 1))
    starts = []
    for kind in kinds:
        if not isinstance(kind, SensorKind):
            continue
        for i, label in enumerate(sensors):
            if kind.acts == "limit":
                starts += [
                    suspicion.sensor(search, kind, i, label, z, share * float(largest[i]))
                    for share in _LIMITS
                ]
            elif kind.fixed is not None:
                starts.append(suspicion.sensor(search, kind, i, label, z, 0.0))
    if not starts:
        return []
    states = base.theta[:, base.values :]
    lanes = [
        (s.hypothesis, np.hstack([np.tile(s.theta, (search.recordings, 1)), states]))
        for s in starts
    ]
    seen = evaluate(search, lanes, base.cycles)
    before = float(base.misfit.sum())
    return [
        (start, 1.0 - float(each.misfit.sum()) / before)
        for start, each in zip(starts, seen, strict=True)
    ]
