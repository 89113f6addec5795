"""A free decay followed by a Kalman filter and smoother."""

import math
from typing import NamedTuple

import numpy as np

from iwanjax.signals.decay_slopes import Decay, DecaySlopes
from iwanjax.signals.interval_lines import decay_lines

# A value and its derivatives, of which the last one wanders: with three of them deviations were a
# quarter too large for a decay as smooth as a joint's, with two three times. Decades of the wander
# that are tried, from that which is as large as the noise over the whole decay; how many values.
_STATES, _DECADES, _VALUES = 4, 20, 61
# Reciprocals of the bandwidth that are averaged: over one the noise is a quarter less than white.
_LONG = 3.0


def kalman_slopes(decay: Decay) -> DecaySlopes:
    r"""Envelope and phase as integrals of slopes that wander (Harvey 1989).

    .. math:: \psi^{(4)} = w, \qquad y_k = \psi(t_k) + v_k

    w is white with a density of q times the seventh power of the decay's own rate: slopes change
    with amplitude, by a share in each decrement. q makes the record most likely; y are means over
    as long as the band lets the noise stay alike, v their noise. The smoother's slopes and
    variances are told.
    """
    block = max(1, round(_LONG * decay.sampling_rate / (decay.band[1] - decay.band[0])))
    first, stop = int(decay.edges[0]), int(decay.edges[-1])
    count = max((stop - first) // block, _STATES + 1)
    block = (stop - first) // count
    # What does not fill a block is left at either end.
    starts = first + (stop - first - block * count) // 2 + block * np.arange(count)
    dt = block / decay.sampling_rate
    time = (starts + 0.5 * (block - 1)) / decay.sampling_rate
    lines = decay_lines(decay)
    rate = np.abs(np.interp(time, lines.middle, lines.rate))
    quick = (rate / np.median(rate)) ** (2 * _STATES - 1)
    # Slopes do not turn over in less than an interval.
    scale = (stop - first) / (decay.edges.size - 1) / decay.sampling_rate
    found = []
    for psi in decay.logarithm:
        y = np.array([np.mean(psi[a : a + block]) for a in starts])
        level = np.interp(time, np.arange(psi.size) / decay.sampling_rate, decay.logarithm[0])
        variance = decay.noise.at(starts) * np.exp(-2.0 * level) * decay.sampling_rate / block
        found.append(_smoothed(y, variance, quick, dt, scale))
    envelope, phase = found
    at = decay.middles

    beyond = at - np.clip(at, time[0], time[-1])

    def told(x: np.ndarray) -> np.ndarray:
        return np.interp(at, time, x)

    return DecaySlopes(
        time=at,
        height=told(envelope.value) + beyond * told(envelope.slope),
        height_variance=told(envelope.value_variance),
        rate=told(envelope.slope),
        rate_variance=told(envelope.slope_variance),
        omega=told(phase.slope),
        omega_variance=told(phase.slope_variance),
        omega_slope=told(np.gradient(phase.slope, dt)),
    )


class _Trend(NamedTuple):
    value: np.ndarray
    value_variance: np.ndarray
    slope: np.ndarray
    slope_variance: np.ndarray


def _smoothed(
    y: np.ndarray, variance: np.ndarray, quick: np.ndarray, dt: float, scale: float
) -> _Trend:
    """The smoother with the most likely wander, ``quick`` times as much as its usual one."""
    span = y.size * dt
    unit = float(np.median(variance)) / span ** (2 * _STATES - 1)
    q = unit * np.logspace(0.0, _DECADES, _VALUES)
    # A line through all, so that what is left is small.
    t = dt * np.arange(y.size)
    line = np.polynomial.Polynomial.fit(t, y, 1)
    residual = y - line(t)
    apart = np.ptp(residual) + math.sqrt(float(np.max(variance)))
    begin = np.diag([(apart / scale**i) ** 2 for i in range(_STATES)])
    likelihood, *_ = _filtered(residual, variance, quick, dt, q, begin)
    best = q[[int(np.argmax(likelihood))]]
    _, *states_of_best = _filtered(residual, variance, quick, dt, best, begin)
    m, P, m_ahead, P_ahead = (x[:, 0] for x in states_of_best)
    F = _step(dt)
    states, covariances = [m[-1]], [P[-1]]
    for k in range(y.size - 2, -1, -1):
        gain = P[k] @ F.T @ np.linalg.inv(P_ahead[k + 1])
        states.append(m[k] + gain @ (states[-1] - m_ahead[k + 1]))
        # As a sum of squares, which rounding leaves positive.
        left, added = np.eye(_STATES) - gain @ F, quick[k + 1] * best * _wander(dt)
        covariances.append(left @ P[k] @ left.T + gain @ (covariances[-1] + added) @ gain.T)
    x, C = np.array(states[::-1]), np.array(covariances[::-1])
    slope = float(line.deriv()(0.0))
    return _Trend(x[:, 0] + line(t), C[:, 0, 0], x[:, 1] + slope, C[:, 1, 1])


def _step(dt: float) -> np.ndarray:
    """What a value and its derivatives do in a step."""
    orders = np.subtract.outer(np.arange(_STATES), np.arange(_STATES))
    return np.array(
        [[dt**-k / math.factorial(-k) if k <= 0 else 0.0 for k in row] for row in orders.tolist()]
    )


def _wander(dt: float) -> np.ndarray:
    """Covariance of what white noise in the highest derivative adds in a step."""
    left = [_STATES - 1 - i for i in range(_STATES)]
    return np.array(
        [
            [
                dt ** (i + j + 1) / ((i + j + 1) * math.factorial(i) * math.factorial(j))
                for j in left
            ]
            for i in left
        ]
    )


def _filtered(
    y: np.ndarray,
    variance: np.ndarray,
    quick: np.ndarray,
    dt: float,
    q: np.ndarray,
    begin: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Log likelihoods, states and covariances of every q, filtered and predicted, by steps."""
    m, P = np.zeros((q.size, _STATES)), np.tile(begin, (q.size, 1, 1))
    F, Q = _step(dt), q[:, None, None] * _wander(dt)
    kept = []
    for k, (measured, noise, own) in enumerate(zip(y, variance, quick, strict=True)):
        if k:
            m, P = m @ F.T, F @ P @ F.T + own * Q
        ahead = m, P
        whole, off = P[:, 0, 0] + noise, measured - m[:, 0]
        gain = P[:, :, 0] / whole[:, None]
        m = m + gain * off[:, None]
        # As a sum of squares, which rounding leaves positive (Joseph's form).
        kept_of = np.eye(_STATES) - gain[:, :, None] * np.eye(_STATES)[0]
        P = kept_of @ P @ kept_of.transpose(0, 2, 1)
        P = P + noise * gain[:, :, None] * gain[:, None, :]
        # The first ones say where it begins.
        told = -0.5 * (off**2 / whole + np.log(whole)) * (k >= _STATES)
        kept.append((told, m, P, *ahead))
    told, m_all, P_all, m_ahead, P_ahead = (np.array(each) for each in zip(*kept, strict=True))
    return np.sum(told, axis=0), m_all, P_all, m_ahead, P_ahead
