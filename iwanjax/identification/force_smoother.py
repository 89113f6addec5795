r"""A force that nobody measured, with the state it moves: a Kalman filter and its smoother.

The state is augmented by the force (Lourens et al. 2012). As a random walk the force drifts where
only accelerations are seen, and deflections with it (Naets et al. 2015); here it is a stationary
Gaussian process instead (Nayek et al. 2019), of Matérn's smoothness 3/2,

.. math:: \ddot g + 2 \dot g / \tau + g / \tau^2 = w,

whose spectrum falls as that of a force does whose slope jumps: where friction turns, a gap closes.
Its deviation and correlation time are those that make what was measured most likely.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from iwanjax.identification.observer import stepped


class ForcedModel(NamedTuple):
    """A linear model with a place where an unknown force acts.

    Attributes
    ----------
    A : (states, states) array
        Rate of the state by the state.
    B : (states,) array
        The same by the force.
    H : (sensors, states) array
        What the sensors see of the state.
    D : (sensors,) array
        What they see of the force at once.
    """

    A: np.ndarray
    B: np.ndarray
    H: np.ndarray
    D: np.ndarray


class Seen(NamedTuple):
    """What is known of the model's state in a recording, which begins at zero.

    Attributes
    ----------
    y : (N, sensors) array
        Measured.
    weight : (N, sensors) array
        One over the deviation of its noise; zero where nothing was measured.
    known : (N, states) array
        What is added to the state after each sample.
    unsure : (N,) array of bool
        At which samples the state is uncertain.
    jump : (states,), (states, states) array
        By how much it is expected to change there, and the covariance of that.
    """

    y: np.ndarray
    weight: np.ndarray
    known: np.ndarray
    unsure: np.ndarray
    jump: tuple[np.ndarray, np.ndarray]


class Augmented(NamedTuple):
    """State, force and the force's rate from sample to sample, for a prior or a batch of them.

    Attributes
    ----------
    F, Q : (n, n), (..., n, n) array
        Map, and covariance of what is added.
    H : (sensors, n) array
        What is seen.
    P : (..., n, n) array
        Covariance at the beginning.
    """

    F: np.ndarray
    Q: np.ndarray
    H: np.ndarray
    P: np.ndarray


class ForcePrior(NamedTuple):
    """The unknown force before anything is measured, the likeliest first in order.

    Attributes
    ----------
    likelihood : float
        Logarithm, but for a constant.
    scale : float
        Variance of the sensors' noise, over the stated one.
    deviation : float
        Of the force, for the stated noise.
    tau : float
        Correlation time, s.
    """

    likelihood: float
    scale: float
    deviation: float
    tau: float


def augmented(model: ForcedModel, tau: float, deviation: np.ndarray, dt: float) -> Augmented:
    """A model with its force as states (Van Loan 1978).

    Parameters
    ----------
    model : ForcedModel
        In continuous time.
    tau : float
        The force's correlation time, s.
    deviation : (...) array
        Of the force, of one prior or a batch of them.
    dt : float
        Between samples, s.
    """
    states = len(model.A)
    n = states + 2
    A, start, noise = (np.zeros((n, n)) for _ in range(3))
    A[:states, :states], A[:states, states] = model.A, model.B
    A[states:, states:] = [[0.0, 1.0], [-(tau**-2), -2.0 / tau]]
    start[states:, states:] = np.diag([1.0, tau**-2])
    noise[-1, -1] = 4.0 * tau**-3
    E = stepped(np.block([[-A, noise], [np.zeros((n, n)), A.T]]), dt)
    F = E[n:, n:].T
    Q = F @ E[:n, n:]
    square = deviation[..., None, None] ** 2
    H = np.hstack([model.H, model.D[:, None], np.zeros((len(model.D), 1))])
    return Augmented(F, 0.5 * (Q + Q.T) * square, H, start * square)


class _Step(NamedTuple):
    """A sample: state and covariance before it, what it shows of them, and what it leaves."""

    x: np.ndarray
    P: np.ndarray
    H: np.ndarray
    v: np.ndarray
    inverse: np.ndarray
    left: np.ndarray


def _filtered(system: Augmented, seen: Seen) -> Iterator[_Step]:
    """Kalman's filter of one prior or a batch of them, sample by sample."""
    n = system.F.shape[0]
    eye, noise, missing = np.eye(n), np.eye(len(system.H)), (0, n - seen.known.shape[1])
    known = np.pad(seen.known, [(0, 0), missing])
    change, spread = np.pad(seen.jump[0], missing), np.pad(seen.jump[1], [missing, missing])
    P, x = system.P, np.zeros(system.P.shape[:-1])
    for k, (y, weight) in enumerate(zip(seen.y, seen.weight, strict=True)):
        if k:
            x, P = x @ system.F.T, system.F @ P @ system.F.T + system.Q
        if seen.unsure[k]:
            x, P = x + change, P + spread
        H = system.H * weight[:, None]
        v = y * weight - x @ H.T
        across = P @ H.T
        inverse = np.linalg.inv(H @ across + noise)
        gain = across @ inverse
        left = eye - gain @ H
        yield _Step(x, P, H, v, inverse, left)
        x = x + (gain @ v[..., None])[..., 0] + known[k]
        P = left @ P
        P = 0.5 * (P + np.swapaxes(P, -1, -2))


def likelihoods(system: Augmented, seen: Seen) -> tuple[np.ndarray, np.ndarray]:
    r"""Logarithms of a batch of priors, and the noise's likeliest variance over the stated one.

    That variance scales all covariances, and so drops out of the prediction errors' likelihood
    (Schweppe 1965):

    .. math:: s = \tfrac{1}{n} \sum_k v_k^T S_k^{-1} v_k, \quad
        \ell = -\tfrac{1}{2} \sum_k \ln \det S_k - \tfrac{n}{2} \ln s
    """
    steps = [(step.v, step.inverse) for step in _filtered(system, seen)]
    v, inverse = (np.stack(x) for x in zip(*steps, strict=True))
    squares = np.einsum("k...i,k...ij,k...j->...", v, inverse, v)
    logs = np.sum(np.linalg.slogdet(inverse)[1], axis=0)
    count = np.count_nonzero(seen.weight)
    return 0.5 * logs - 0.5 * count * np.log(squares / count), squares / count


def smoothed(system: Augmented, seen: Seen, watched: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means and covariances by all samples, of one prior.

    Bryson and Frazier's form of the smoother of Rauch, Tung and Striebel (Bierman 1973): it
    inverts no covariance of the state, which at rest has no inverse.

    Parameters
    ----------
    system, seen : Augmented, Seen
        Model with its force, and recording.
    watched : (rows, n) array
        What is asked for.

    Returns
    -------
    (N, rows), (N, rows, rows) array
    """
    steps = list(_filtered(system, seen))
    n = system.F.shape[0]
    slope, curve = np.zeros(n), np.zeros((n, n))
    means, covariances = [], []
    for x, P, H, v, inverse, left in reversed(steps):
        slope = H.T @ inverse @ v + left.T @ slope
        curve = H.T @ inverse @ H + left.T @ curve @ left
        means.append(watched @ (x + P @ slope))
        covariances.append(watched @ (P - P @ curve @ P) @ watched.T)
        slope, curve = system.F.T @ slope, system.F.T @ curve @ system.F
    return np.stack(means[::-1]), np.stack(covariances[::-1])


def likeliest(model: ForcedModel, seen: Seen, dt: float, longest: float) -> ForcePrior:
    """The prior of the force that makes what was measured most likely.

    To a decade of its deviation, from none that data can tell to one that explains all of them,
    and a factor of two of its correlation time; :func:`closer` goes on from there.

    Parameters
    ----------
    model : ForcedModel
        With its place.
    seen : Seen
        The recording.
    dt : float
        Between samples, s.
    longest : float
        Correlation time to begin with, s: of a force that follows the slowest mode. Of what is
        slower still the data say little, and with accelerations alone the force would drift.

    Raises
    ------
    ValueError
        For what is not finite.
    """
    if not np.all(np.isfinite(seen.y)):
        raise ValueError("the model's run beside the recording is not finite")

    def of_time(tau: float) -> ForcePrior:
        least, most = _range(model, seen, tau, dt)
        deviations = np.geomspace(least, most, 2 + int(math.log10(most / least)))
        return _best(model, seen, dt, tau, deviations)

    found = of_time(longest)
    while found.tau > dt:
        shorter = of_time(0.5 * found.tau)
        if shorter <= found:
            break
        found = shorter
    return found


def closer(model: ForcedModel, seen: Seen, dt: float, prior: ForcePrior) -> ForcePrior:
    """The same with its deviation to a quarter, between the neighbours of what was found."""
    deviations = prior.deviation * np.geomspace(0.1, 10.0, 11)
    return max(prior, _best(model, seen, dt, prior.tau, deviations))


def _best(
    model: ForcedModel, seen: Seen, dt: float, tau: float, deviations: np.ndarray
) -> ForcePrior:
    values, scales = likelihoods(augmented(model, tau, deviations, dt), seen)
    at = int(np.argmax(values))
    return ForcePrior(float(values[at]), float(scales[at]), float(deviations[at]), tau)


def _range(model: ForcedModel, seen: Seen, tau: float, dt: float) -> tuple[float, float]:
    """Deviations of a force that no data can tell from none, and that explains all of them.

    With the least, all that it does to all samples is one deviation of the noise; with the
    most, what it does within one sample is as large as what was measured.
    """
    system = augmented(model, tau, np.ones(()), dt)
    H = system.H * np.max(seen.weight, axis=0)[:, None]
    at = system.F[:, -2]
    once, total = float(np.linalg.norm(H @ at)), 0.0
    for _ in seen.y:
        total += float(np.sum((H @ at) ** 2))
        at = system.F @ at
    measured = math.sqrt(float(np.mean(np.sum((seen.weight * seen.y) ** 2, axis=1))))
    least = 1.0 / math.sqrt(total * len(seen.y))
    return least, max(measured / once, 10.0 * least)
