"""The observer: its gain for a time constant, and the state in which a recording begins."""

import math

import numpy as np
from jaxtyping import Float

from iwanjax.identification.predictor import Predictor
from iwanjax.settings.conditioning import CONDITIONING, ConditioningSettings
from iwanjax.signals.comparison_band import passed

# Exponents of ten between which the size of the process noise is looked for, and bisections.
_SIZES, _ROUNDS = (-14.0, 14.0), 40
# Doublings of the horizon until the equation's solution stands still.
_DOUBLINGS, _STILL = 60, 1e-10


def stepped(A: np.ndarray, dt: float) -> np.ndarray:
    """The state's map over dt, of one state matrix or a stack of them."""
    import scipy.linalg

    return scipy.linalg.expm(A * dt)


def observer_gain(step: np.ndarray, H: np.ndarray, dt: float, size: float) -> np.ndarray:
    """Steady Kalman gain for process noise of a size on the modal velocities.

    The discrete Riccati equation is solved by doubling the horizon (Anderson 1978), a whole
    stack of systems at once.

    Parameters
    ----------
    step : (..., 2 m, 2 m) array
        Map of the state from a sample to the next.
    H : (..., sensors, 2 m) array
        What the sensors see of it, in deviations of their noise.
    dt : float
        Between samples, s.
    size : float
        Variance of the process noise over dt; zero gives no gain, the free run.

    Returns
    -------
    (..., 2 m, sensors) array
        Of the correction after each sample, NaN where no solution was found.
    """
    states = step.shape[-1]
    turned = np.swapaxes(H, -1, -2)
    if size == 0.0:
        return np.zeros_like(turned)
    eye = np.eye(states)
    F = np.swapaxes(step, -1, -2)
    G = turned @ H
    P = np.zeros_like(F) + size * np.diag(np.repeat([0.0, dt], states // 2))
    broken = np.zeros(step.shape[:-2], bool)
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(_DOUBLINGS):
            inner = _solved(eye + G @ P, np.concatenate([F, G], axis=-1))
            mapped, weighed = inner[..., :states], inner[..., states:]
            back = np.swapaxes(F, -1, -2)
            # Symmetric by theory, and kept so.
            more = back @ P @ mapped
            more = 0.5 * (more + np.swapaxes(more, -1, -2))
            G, F, P = G + F @ weighed @ back, F @ mapped, P + more
            # One system without a solution is no reason to stop, or to go on, with the others.
            broken |= ~np.all(np.isfinite(P), axis=(-2, -1))
            G, F, P = (np.where(broken[..., None, None], 0.0, x) for x in (G, F, P))
            change, size_now = (np.max(np.abs(x), axis=(-2, -1)) for x in (more, P))
            if np.all(broken | (change <= _STILL * size_now)):
                break
        seen = P @ turned
        gain = _solved(H @ seen + np.eye(H.shape[-2]), np.swapaxes(seen, -1, -2))
    return np.swapaxes(np.where(broken[..., None, None], np.nan, gain), -1, -2)


def _solved(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Solutions of a stack of systems, NaN for those that have none."""
    try:
        return np.linalg.solve(A, B)
    except np.linalg.LinAlgError:
        if A.ndim == 2:
            return np.full_like(B, np.nan)
        return np.stack([_solved(a, b) for a, b in zip(A, B, strict=True)])


def noise_in_innovations(
    step: np.ndarray, H: np.ndarray, gain: np.ndarray, size: int
) -> Float[np.ndarray, " sensors"]:
    r"""Squares that noise leaves in the innovations' band over those that it has there itself.

    An observer takes some of it for motion, and that is seen again in what comes after:

    .. math:: S(z) = I - H\,(z I - A (I - L H))^{-1} A L

    It is one in the free run, and the more above it the shorter the memory is (in no observer
    less over all frequencies, by Bode's integral).

    Parameters
    ----------
    step, H
        As for :func:`observer_gain`, of one system: A and H.
    gain : (2 m, sensors) array
        L, of sensors in deviations of their noise.
    size : int
        Samples, by which frequencies are spaced.
    """
    poles, V = np.linalg.eig(step @ (np.eye(len(step)) - gain @ H))
    seen, fed = H @ V, np.linalg.solve(V, step @ gain)
    z = np.exp(2j * np.pi * np.fft.rfftfreq(size))
    S = np.eye(len(H)) - np.einsum("sp,fp,pn->fsn", seen, 1.0 / (z[:, None] - poles), fed)
    share = passed(size) ** 2
    return np.einsum("f,fsn->s", share, np.abs(S) ** 2) / np.sum(share)


def process_noise(step: np.ndarray, H: np.ndarray, dt: float, time_constant: float) -> float:
    """Size of the process noise for which the observer's median pole decays by 1/cycles a cycle.

    A long memory (infinity: none at all, the free run) accumulates phase and has countless
    minima in the parameters; with a short one residuals are nearly linear in them.

    Parameters
    ----------
    step, H, dt
        As for :func:`observer_gain`, of one system.
    time_constant : float
        Memory.
    """
    if math.isinf(time_constant):
        return 0.0
    eye = np.eye(step.shape[-1])
    low, high = _SIZES
    for _ in range(_ROUNDS):
        middle = 0.5 * (low + high)
        gain = observer_gain(step, H, dt, 10.0**middle)
        poles = np.linalg.eigvals((eye - gain @ H) @ step)
        turns = np.maximum(np.abs(np.angle(poles)), 1e-9) / (2.0 * np.pi)
        decay = float(np.median(-np.log(np.maximum(np.abs(poles), 1e-300)) / turns))
        if decay > 1.0 / time_constant:
            high = middle
        else:
            low = middle
    return 10.0 ** (0.5 * (low + high))


def state_at_beginning(
    made: Predictor,
    response: Float[np.ndarray, "N sensors"],
    noise: Float[np.ndarray, " sensors"],
    push: Float[np.ndarray, "N substeps states"],
    settings: ConditioningSettings = CONDITIONING,
) -> tuple[np.ndarray, np.ndarray]:
    """State at the first sample, and by how much it may be off.

    An observer with a short memory goes back in time from some cycles later, so that it is
    least wrong where it ends, whatever the joints are.

    Parameters
    ----------
    made : Predictor
        Of the structure, its joints at their given stiffness.
    response : (N, sensors) array
        As measured; NaN throughout for a sensor that is missing.
    noise : (sensors,) array
        Deviations.
    push : (N, substeps, states) array
        What forces do meanwhile, as in :class:`~.predictor.Data`; zeros in a free decay.
    settings : ConditioningSettings
        Of the stage.

    Returns
    -------
    (2 modes,) array, (2 modes, 2 modes) array
        Displacements and velocities of the modes that move; deviations, one to a column.
    """
    dt = float(made.dt) * made.substeps
    A, H = made.linear(np.asarray(made.stiffness), made.blank(), np.zeros(1))
    there = ~np.all(np.isnan(response), axis=0)
    H, noise = H[there], noise[there]
    back = stepped(-A, dt)
    size = process_noise(back, H / noise[:, None], dt, settings.back_time_constant)
    gain = observer_gain(back, H / noise[:, None], dt, size) / noise
    omega = np.sqrt(np.maximum(np.asarray(made.omega2), 1.0))
    count = min(len(response), int(settings.back_cycles * 2.0 * np.pi / (omega.min() * dt)) + 1)
    forced, seen = np.zeros((count + 1, len(A))), response[:count, there].astype(float)
    forced[:count] = _over_a_sample(made, push[:count, :, : len(A)])
    seen = seen - made.at_once(push[:count, -1])[:, there]
    z = np.zeros(len(A))
    for y, more in zip(seen[::-1], forced[:0:-1], strict=True):
        z = back @ (z - more)
        z = z + gain @ (y - H @ z)
    q, v = np.split(z, 2)
    amplitude = np.hypot(q, v / omega)
    least = settings.least_state_error * np.max(amplitude * omega) / omega
    off = np.maximum(settings.state_error * amplitude, least)
    return z, np.diag(np.concatenate([off, off * omega]))


def _over_a_sample(made: Predictor, push: np.ndarray) -> np.ndarray:
    """What forces do to the state from one sample to the next, (N, states)."""
    A, _ = made.linear(np.asarray(made.stiffness), made.blank(), np.zeros(1))
    short = stepped(A, float(made.dt))
    total = np.zeros((len(push), len(A)))
    for k in range(made.substeps):
        total = total @ short.T + push[:, k]
    return total
