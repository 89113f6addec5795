"""Fitting joints and suspects to recordings, many hypotheses side by side."""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from iwanjax.discrepancy.catalogue import Kind
from iwanjax.discrepancy.measured import DIRECTIONS
from iwanjax.discrepancy.observer import observer_gain, process_noise, stepped
from iwanjax.discrepancy.prediction import Data, Predictor, Suspects
from iwanjax.discrepancy.sensitivity import Joint, reduced, tangents

SHORT = 2.0
"""The observer's shortest memory, cycles: residuals are nearly linear in the parameters."""
# Hypotheses that a kernel takes at once, and kernels that run at once.
_LANES, _THREADS = 2, 2
# Rows of one call for the joints' tangents, and the step of a gain's derivatives.
_ROWS, _NEAR = 64, 1e-4
# Prior deviations beyond which no joint is looked for.
_FARTHEST = 8.0
# The largest change of a logarithm in one step.
_LEAP = 2.0
# Steps before a search may be given up.
_HEAD_START = 3
# Steps in a row that gain little before a search ends.
_PATIENCE = 2
_DAMPING, _EASED, _RAISED, _MOST_DAMPING = 1e-2, 0.2, 5.0, 1e7
# Deviation of the change of a joint's parameters between recordings, in prior deviations.
_DRIFT = 2.0
_DRIFTING = ("F_S", "K_T")


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """What might be missing: one suspect in each slot, or a joint that drifts.

    Attributes
    ----------
    kinds : tuple of Kind
        Of the suspects; none is the model as it is.
    where : tuple of str
        Labels of their places, sensors or joints.
    suspects : Suspects
        As arrays.
    sizes, shapes : tuple of bool
        Which of the slots' sizes and shapes are fitted.
    drifting : int or None
        Joint whose strength changes between recordings.
    scales : tuple of float
        Units of the slots' sizes.
    """

    kinds: tuple[Kind, ...]
    where: tuple[str, ...]
    suspects: Suspects
    sizes: tuple[bool, ...] = (False,)
    shapes: tuple[bool, ...] = (False,)
    drifting: int | None = None
    scales: tuple[float, ...] = (1.0,)

    @property
    def label(self) -> str:
        """kind@where of all suspects."""
        pairs = zip(self.kinds, self.where, strict=True)
        return " + ".join(f"{kind.name}@{where}" for kind, where in pairs) or "nothing"

    @property
    def variant(self) -> tuple[str, ...]:
        """Label and form: what tells one hypothesis from all others."""
        return (self.label, *(getattr(kind, "variant", "") for kind in self.kinds))


class Start(NamedTuple):
    """A hypothesis and where to begin.

    Attributes
    ----------
    hypothesis : Hypothesis
        Which.
    theta : (values,) or (recordings, values) array
        Joint parameters, sizes and shapes; by recording where a joint drifts.
    """

    hypothesis: Hypothesis
    theta: np.ndarray

    @property
    def common(self) -> np.ndarray:
        """What the recordings have in common, (values,)."""
        return self.theta if self.theta.ndim == 1 else self.theta.mean(axis=0)


@dataclass(frozen=True, eq=False)
class Fitted:
    """A hypothesis fitted to the recordings.

    Attributes
    ----------
    hypothesis : Hypothesis
        Which.
    theta : (recordings, values) array
        Joint parameters, sizes, shapes and errors of the state.
    x : (free,) array
        What was free, of which theta is made.
    misfit : (recordings,) array
        Sums of squared weighted innovations.
    cost : float
        Their sum and the prior's.
    normal : (free, free) array
        Second derivatives of half the cost.
    residual : (recordings, N, sensors) array
        Weighted innovations.
    cycles : float
        Memory of the observer; infinity for the free run.
    converged : bool
        Whether the search ended by itself.
    values : int
        Length of theta without errors of the state.
    """

    hypothesis: Hypothesis
    theta: np.ndarray
    x: np.ndarray
    misfit: np.ndarray
    cost: float
    normal: np.ndarray
    residual: np.ndarray = field(repr=False)
    cycles: float
    converged: bool
    values: int

    @property
    def start(self) -> Start:
        """Where another search may go on."""
        return Start(self.hypothesis, self.theta[:, : self.values])


class _Layout(NamedTuple):
    """theta of each recording is base + T x, x with a Gaussian prior."""

    base: np.ndarray
    T: np.ndarray
    precision: np.ndarray


@dataclass(frozen=True, eq=False)
class Search:
    """What fits need: predictor, joints, data, and the sensors' noise for the observer.

    Attributes
    ----------
    predictor : Predictor
        Of the structure.
    joints : tuple of Joint
        About their given values.
    data : Data
        To be fitted.
    noise : (sensors,) array
        Deviations.
    """

    predictor: Predictor
    joints: tuple[Joint, ...]
    data: Data
    noise: np.ndarray
    _process: dict[float, float] = field(default_factory=dict, repr=False)

    @cached_property
    def parameters(self) -> int:
        """Number of joint parameters."""
        return sum(len(joint.given.parameters) for joint in self.joints)

    @property
    def recordings(self) -> int:
        """Number of recordings."""
        return self.data.response.shape[0]

    def nothing(self, slots: int = 1) -> Hypothesis:
        """The model as it is."""
        return Hypothesis(
            (), (), self.empty(slots), (False,) * slots, (False,) * slots, None, (1.0,) * slots
        )

    def empty(self, slots: int = 1) -> Suspects:
        """No suspects in so many slots."""
        modes, sensors = self.predictor.joints.shape[1], self.predictor.sensors.shape[0]
        return Suspects(
            jnp.zeros((slots, modes)),
            jnp.zeros((slots, len(self.predictor.kinds))),
            jnp.zeros((slots, 3, sensors)),
            jnp.zeros(slots),
        )

    def still(self, theta: np.ndarray) -> np.ndarray:
        """The same values for all recordings, or those of each, with no error of the state."""
        rows = np.broadcast_to(theta, (self.recordings, theta.shape[-1]))
        return np.hstack([rows, np.zeros((self.recordings, DIRECTIONS))])

    def gains(
        self, suspects: Sequence[Suspects], theta: np.ndarray, cycles: float, slopes: bool = True
    ) -> "Gains":
        """Observers designed for these very parameters, and how they change with them."""
        dt = float(self.predictor.dt) * self.predictor.substeps
        lanes, values = theta.shape
        if cycles not in self._process:
            A, H = self.rest()
            self._process[cycles] = process_noise(
                stepped(A, dt), H / self.noise[:, None], dt, cycles
            )
        size = self._process[cycles]
        states, sensors = 2 * self.predictor.kept, len(self.noise)
        found = Gains(
            np.zeros((lanes, states, sensors)), np.zeros((lanes, values, states, sensors))
        )
        if size == 0.0:
            return found
        moved, owners = _neighbours(self, suspects, theta) if slopes else (theta[:0], [])
        rows = np.concatenate([theta, moved])
        which = [*range(lanes), *(lane for lane, _ in owners)]
        systems = self._systems([suspects[i] for i in which], rows)
        A, H = (np.stack(x) for x in zip(*systems, strict=True))
        broken = ~np.all(np.isfinite(A), axis=(1, 2))
        A[broken] = 0.0
        gains = observer_gain(stepped(A, dt), H / self.noise[:, None], dt, size) / self.noise
        found.gain[:] = gains[:lanes]
        for (lane, value), gain in zip(owners, gains[lanes:], strict=True):
            found.slope[lane, value] = (gain - gains[lane]) / _NEAR
        return found

    def rest(self) -> tuple[np.ndarray, np.ndarray]:
        """State matrix and what the sensors see, of the model as given."""
        return self._systems([self.empty()], np.zeros((1, self.parameters + 2)))[0]

    def _systems(
        self, suspects: Sequence[Suspects], theta: np.ndarray
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """State matrices and what the sensors see, one for each row of values."""
        p = self.parameters
        stiffness = []
        for first in range(0, len(theta), _ROWS):
            part = theta[first : first + _ROWS, :p]
            padded = np.vstack([part, np.zeros((_ROWS - len(part), p))])
            stiffness.append(np.asarray(tangents(self.joints, jnp.asarray(padded)))[: len(part)])
        found = []
        for own, row, k in zip(suspects, theta, np.concatenate(stiffness), strict=True):
            size = row[p : p + 2 * own.row.shape[0] : 2]
            logarithmic = np.asarray(own.logarithmic) > 0
            size = np.where(logarithmic, np.exp(np.minimum(size, 50.0)), size)
            found.append(self.predictor.linear(k, own, size))
        return found


class Gains(NamedTuple):
    """Observers of some lanes.

    Attributes
    ----------
    gain : (lanes, states, sensors) array
        Of the correction after each sample.
    slope : (lanes, values, states, sensors) array
        Their derivatives.
    """

    gain: np.ndarray
    slope: np.ndarray


def _neighbours(
    search: Search, suspects: Sequence[Suspects], theta: np.ndarray
) -> tuple[np.ndarray, list[tuple[int, int]]]:
    """Values beside those of each lane, along all that a linear system depends on."""
    rows, owners = [], []
    stiff = [
        i
        for i, info in enumerate(info for joint in search.joints for info in joint.given.parameters)
        if info.dimension == "force/length"
    ]
    for lane, own in enumerate(suspects):
        sizes = [search.parameters + 2 * slot for slot in range(own.row.shape[0])]
        active = np.any(np.asarray(own.force) != 0, axis=1) | np.any(
            np.asarray(own.chain)[:, 0] != 0, axis=1
        )
        for value in [*stiff, *(i for i, on in zip(sizes, active, strict=True) if on)]:
            beside = theta[lane].copy()
            beside[value] += _NEAR
            rows.append(beside)
            owners.append((lane, value))
    return np.array(rows).reshape(-1, theta.shape[1]), owners


def _layout(search: Search, start: Start) -> tuple[_Layout, np.ndarray]:
    """Which values are free, and where they begin."""
    hypothesis, R, p = start.hypothesis, search.recordings, search.parameters
    slots = len(hypothesis.sizes)
    fixed = p + 2 * slots
    given = np.atleast_2d(start.theta)
    if hypothesis.drifting is None:
        given = given.mean(axis=0, keepdims=True)
    base = np.concatenate([given[0, :fixed], np.zeros(DIRECTIONS)])
    eye = np.eye(len(base))
    shared = free_values(search, hypothesis)
    columns = [np.tile(eye[i], (R, 1)) for i in shared]
    precision = [1.0 if i < p else 0.0 for i in shared]
    x = [base[i] for i in shared]
    for r in range(R):
        for i in range(fixed, len(base)):
            one = np.zeros((R, len(base)))
            one[r, i] = 1.0
            columns.append(one)
            precision.append(1.0)
            x.append(0.0)
    if hypothesis.drifting is not None:
        for i in drifting_values(search, hypothesis.drifting):
            for r in range(1, R):
                one = np.zeros((R, len(base)))
                one[r, i] = 1.0
                columns.append(one)
                precision.append(_DRIFT**-2)
                x.append(given[r, i] - given[0, i] if len(given) > 1 else 0.0)
    base[shared] = 0.0
    T = np.stack(columns, axis=-1)
    return _Layout(np.tile(base, (R, 1)), T, np.array(precision)), np.array(x)


def free_values(search: Search, hypothesis: Hypothesis) -> list[int]:
    """Places in theta of what is fitted and the same in all recordings."""
    p = search.parameters
    found = list(range(p))
    for slot, (size, shape) in enumerate(zip(hypothesis.sizes, hypothesis.shapes, strict=True)):
        found += [p + 2 * slot] * size + [p + 2 * slot + 1] * shape
    return found


def drifting_values(search: Search, joint: int) -> list[int]:
    """Places in theta of what drifts in a joint."""
    first = sum(len(each.given.parameters) for each in search.joints[:joint])
    names = [info.name for info in search.joints[joint].given.parameters]
    return [first + names.index(name) for name in _DRIFTING if name in names]


class _Seen(NamedTuple):
    misfit: np.ndarray
    moment: np.ndarray
    normal: np.ndarray
    residual: np.ndarray


def evaluate(
    search: Search, lanes: Sequence[tuple[Hypothesis, np.ndarray]], cycles: float
) -> list[_Seen]:
    """Residuals and their reduced derivatives, for (hypothesis, theta of each recording)."""
    means = np.stack([theta.mean(axis=0) for _, theta in lanes])
    gains = search.gains([h.suspects for h, _ in lanes], means, cycles)

    def run(first: int) -> list[_Seen]:
        own = range(first, min(first + _LANES, len(lanes)))
        padded = [*own, *[own[-1]] * (_LANES - len(own))]
        suspects = jax.tree.map(lambda *x: jnp.stack(x), *(lanes[i][0].suspects for i in padded))
        theta = jnp.asarray(np.stack([lanes[i][1] for i in padded]))
        found = reduced(
            search.predictor,
            search.joints,
            suspects,
            theta,
            jnp.asarray(gains.gain[padded]),
            jnp.asarray(gains.slope[padded]),
            search.data,
        )
        e, cost, moment, normal = (np.asarray(x) for x in found)
        return [_Seen(cost[i], moment[i], normal[i], e[i]) for i in range(len(own))]

    firsts = range(0, len(lanes), _LANES)
    if len(firsts) == 1:
        return run(0)
    with ThreadPoolExecutor(_THREADS) as pool:
        return [each for batch in pool.map(run, firsts) for each in batch]


@dataclass
class _Lane:
    """A search on its way."""

    hypothesis: Hypothesis
    layout: _Layout
    joints: int
    x: np.ndarray
    seen: _Seen
    cost: float
    normal: np.ndarray
    moment: np.ndarray
    damping: float = _DAMPING
    active: bool = True
    converged: bool = False
    slow: int = 0

    def take(self, x: np.ndarray, seen: _Seen) -> None:
        """Stand at x."""
        T, precision = self.layout.T, self.layout.precision
        self.x, self.seen = x, seen
        self.cost = float(seen.misfit.sum() + x @ (precision * x))
        self.normal = np.einsum("rik,rij,rjl->kl", T, seen.normal, T) + np.diag(precision)
        self.moment = np.einsum("rik,ri->k", T, seen.moment) + precision * x

    def proposed(self) -> np.ndarray | None:
        """The next x; None when none is left to try."""
        logs = _leaping(self.hypothesis, self.layout)
        diagonal = np.diag(self.normal)
        while self.damping < _MOST_DAMPING:
            scaled = self.normal + self.damping * np.diag(diagonal + 1e-12 * diagonal.max())
            try:
                move = -np.linalg.solve(scaled, self.moment)
            except np.linalg.LinAlgError:
                move = np.full_like(self.x, np.inf)
            x = self.x + move
            small = np.all(np.abs(move[logs]) <= _LEAP) and np.all(np.isfinite(move))
            if small and np.all(np.abs(x[: self.joints]) <= _FARTHEST):
                return x
            self.damping *= _RAISED
        return None

    def theta(self, x: np.ndarray) -> np.ndarray:
        """Values of each recording."""
        return self.layout.base + self.layout.T @ x


def _leaping(hypothesis: Hypothesis, layout: _Layout) -> np.ndarray:
    """Which of x are logarithms of sizes and shapes."""
    logs = np.zeros(len(layout.precision), bool)
    free = np.flatnonzero(layout.precision == 0)
    at = 0
    for slot, (size, shape) in enumerate(zip(hypothesis.sizes, hypothesis.shapes, strict=True)):
        if size:
            logs[free[at]] = bool(hypothesis.suspects.logarithmic[slot] > 0)
            at += 1
        if shape:
            logs[free[at]] = True
            at += 1
    return logs


def fit_all(
    search: Search,
    starts: Sequence[Start],
    cycles: float,
    steps: int,
    *,
    tolerance: float = 1e-3,
    race: float = math.inf,
    in_time: Callable[[], bool] = lambda: True,
) -> list[Fitted]:
    """Levenberg-Marquardt from many starts, in step.

    The state after each pulse is free within what the force's noise allows.

    Parameters
    ----------
    search : Search
        Predictor and data.
    starts : sequence of Start
        Hypotheses and where to begin.
    cycles : float
        Memory of the observer.
    steps : int
        At most.
    tolerance : float
        Relative gain below which, twice in a row, a search ends.
    race : float
        Times the best one's cost from which on a search is given up.
    in_time : function
        False when it is time to stop.

    Returns
    -------
    list of Fitted
        One for each start.
    """
    if not starts:
        return []
    begun = [_layout(search, start) for start in starts]
    hypotheses = [start.hypothesis for start in starts]
    lanes = []
    thetas = [
        (h, layout.base + layout.T @ x) for h, (layout, x) in zip(hypotheses, begun, strict=True)
    ]
    for h, (layout, x), seen in zip(
        hypotheses, begun, evaluate(search, thetas, cycles), strict=True
    ):
        empty = np.zeros((0, 0))
        lane = _Lane(h, layout, search.parameters, x, seen, math.inf, empty, empty)
        lane.take(x, seen)
        lanes.append(lane)
    for step in range(steps):
        if not in_time():
            break
        if step >= _HEAD_START:
            best = min(lane.cost for lane in lanes)
            for lane in lanes:
                lane.active = lane.active and lane.cost < race * best
        tried = []
        for lane in lanes:
            x = lane.proposed() if lane.active else None
            if x is None:
                lane.converged = lane.converged or lane.active
                lane.active = False
            else:
                tried.append((lane, x))
        if not tried:
            break
        found = evaluate(search, [(lane.hypothesis, lane.theta(x)) for lane, x in tried], cycles)
        for (lane, x), seen in zip(tried, found, strict=True):
            before = lane.cost
            cost = float(seen.misfit.sum() + x @ (lane.layout.precision * x))
            if not cost < before:
                lane.damping *= _RAISED
                continue
            lane.take(x, seen)
            lane.damping = max(lane.damping * _EASED, 1e-9)
            lane.slow = lane.slow + 1 if before - cost < tolerance * cost else 0
            if lane.slow == _PATIENCE:
                lane.converged, lane.active = True, False
    return [
        Fitted(
            lane.hypothesis,
            lane.theta(lane.x),
            lane.x,
            lane.seen.misfit,
            lane.cost,
            lane.normal,
            lane.seen.residual,
            cycles,
            lane.converged,
            search.parameters + 2 * len(lane.hypothesis.sizes),
        )
        for lane in lanes
    ]
