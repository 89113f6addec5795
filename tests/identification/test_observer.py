"""The observer against a textbook Kalman filter in physical coordinates, written here in NumPy."""

import math
from typing import NamedTuple

import numpy as np
import pytest
import scipy.linalg
from linear_pair import (
    FINE,
    RATE,
    C,
    M,
    N,
    hit,
    measured_force,
    problem,
    simulated,
    state_matrix,
    stiffness_with_joint,
)

from iwanjax.identification.likelihood import evidence, left_by_noise
from iwanjax.identification.linearise import innovations
from iwanjax.identification.multistart import multistart
from iwanjax.identification.observer import observer_gain, process_noise, stepped
from iwanjax.identification.places import followed
from iwanjax.identification.problem import HistoryProblem, Start
from iwanjax.signals.comparison_band import END

PEAK = 60.0
QUANTITIES = ("displacement", "velocity", "acceleration")


class Filtered(NamedTuple):
    """What a Kalman filter makes of a recording.

    Attributes
    ----------
    gain : (states, sensors) array
        Of the last sample.
    innovations : (N, sensors) array
        Measured less predicted.
    states : (N, states) array
        After each sample.
    log_likelihood : float
        Of all samples.
    """

    gain: np.ndarray
    innovations: np.ndarray
    states: np.ndarray
    log_likelihood: float


def sampled(stiffness: np.ndarray, quantity: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Map from sample to sample, what the sensors see of the state, and of the force itself."""
    A = state_matrix(M, C, stiffness)
    seen = {
        "displacement": np.eye(2, 4),
        "velocity": np.eye(4)[2:],
        "acceleration": A[2:],
    }[quantity]
    at_once = np.linalg.inv(M)[:, 0] if quantity == "acceleration" else np.zeros(2)
    return np.asarray(scipy.linalg.expm(A / RATE)), seen, at_once


def driven(stiffness: np.ndarray) -> np.ndarray:
    """What the hit adds to the state from one sample to the next, by fine steps, (N, 4)."""
    A, dt = state_matrix(M, C, stiffness), 1.0 / (RATE * FINE)
    b = np.concatenate([np.zeros(2), np.linalg.inv(M)[:, 0]])
    step, half = scipy.linalg.expm(A * dt), scipy.linalg.expm(0.5 * A * dt)
    found = np.zeros((N, 4))
    for n in range(1, N):
        z = np.zeros(4)
        for i in range(FINE):
            middle = (n - 1) / RATE + (i + 0.5) * dt
            # The midpoint's impulse, carried over half a step before and after.
            z = step @ z + half @ b * hit(np.array(middle), PEAK) * dt
        found[n] = z
    return found


def kalman(
    y: np.ndarray,
    noise: np.ndarray,
    size: float,
    quantity: str,
    stiffness: np.ndarray,
    steady: bool = True,
) -> Filtered:
    """Predict and correct, with Joseph's form of the covariance (Bar-Shalom et al. 2001, 5.2).

    Process noise of variance ``size`` / RATE acts on modal velocities: over the masses on those of
    the masses. ``steady`` begins with the covariance that the recursion ends with.
    """
    F, H, D = sampled(stiffness, quantity)
    Q = scipy.linalg.block_diag(np.zeros((2, 2)), size / RATE * np.linalg.inv(M))
    R, eye = np.diag(noise**2), np.eye(4)

    def corrected(P: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        S = H @ P @ H.T + R
        gain = P @ H.T @ np.linalg.inv(S)
        left = eye - gain @ H
        return left @ P @ left.T + gain @ R @ gain.T, gain, S

    # Without process noise a filter that has run for ever is sure.
    P = scipy.linalg.solve_discrete_are(F.T, H.T, Q, R) if steady and size > 0.0 else Q
    x, total, seen, states = np.zeros(4), 0.0, [], []
    force, push = hit(np.arange(N) / RATE, PEAK), driven(stiffness)
    gain = np.zeros((4, 2))
    for n in range(N):
        x = F @ x + push[n]
        e = y[n] - H @ x - D * force[n]
        after, gain, S = corrected(P)
        x = x + gain @ e
        P = F @ after @ F.T + Q
        total -= 0.5 * (e @ np.linalg.solve(S, e) + np.linalg.slogdet(2.0 * np.pi * S)[1])
        seen.append(e)
        states.append(x)
    return Filtered(gain, np.array(seen), np.array(states), total)


def recorded(quantity: str, share: float) -> tuple[np.ndarray, np.ndarray]:
    """A hit with white noise, and its deviations."""
    clean = simulated(PEAK, quantity)
    noise = share * np.std(clean, axis=0)
    return clean + noise * np.random.default_rng(7).standard_normal(clean.shape), noise


def observed(quantity: str) -> tuple[HistoryProblem, np.ndarray]:
    y, noise = recorded(quantity, 0.01)
    return problem([y], [measured_force(PEAK)], noise, quantity=quantity, joint=False)[0], y


def physical(made: HistoryProblem) -> np.ndarray:
    """Modes as displacements of the masses: there is a sensor on each."""
    shapes = np.asarray(made.predictor.sensors)
    return np.kron(np.eye(2), shapes)


@pytest.mark.parametrize("time_constant", [1.0, 8.0])
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_gain_and_innovations_are_those_of_a_kalman_filter(quantity, time_constant):
    made, y = observed(quantity)
    A, H = made.rest()
    step = stepped(A, 1.0 / RATE)
    size = process_noise(step, H / made.noise[:, None], 1.0 / RATE, time_constant)
    wanted = kalman(y, made.noise, size, quantity, stiffness_with_joint())
    gain = made.gains([made.empty()], made.map.given()[None], time_constant).gain[0]
    off = np.abs(physical(made) @ gain - wanted.gain)
    assert np.max(off) < 1e-6 * np.max(np.abs(wanted.gain))
    (e,) = innovations(made, made.nothing(), made.still(made.map.given()), time_constant)
    assert np.max(np.abs(e - wanted.innovations)) < 1e-3 * np.max(np.abs(wanted.innovations))
    # They are no innovations of a filter with another gain.
    other = kalman(y, made.noise, 4.0 * size, quantity, stiffness_with_joint())
    assert np.max(np.abs(e - other.innovations)) > 0.02 * np.max(np.abs(e))


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_states_that_follow_a_recording_are_the_filters(quantity):
    """With a time constant of one cycle, in which the places' motion is told."""
    made, y = observed(quantity)
    A, H = made.rest()
    size = process_noise(stepped(A, 1.0 / RATE), H / made.noise[:, None], 1.0 / RATE, 1.0)
    wanted = kalman(y, made.noise, size, quantity, stiffness_with_joint()).states
    seen = followed(made)
    found = np.concatenate([seen.q[0], seen.v[0]], axis=1) @ physical(made).T
    for part in (slice(2), slice(2, 4)):
        off = np.abs(found[:, part] - wanted[:, part])
        assert np.max(off) < 1e-3 * np.max(np.abs(wanted[:, part]))


def test_the_steady_gain_is_where_the_covariance_of_a_filter_from_rest_ends():
    y, noise = recorded("acceleration", 0.01)
    F, H, _ = sampled(stiffness_with_joint(), "acceleration")
    size = process_noise(F, H / noise[:, None], 1.0 / RATE, 2.0)
    from_rest = kalman(y, noise, size, "acceleration", stiffness_with_joint(), steady=False)
    # On unit masses modal and physical velocities are noisy alike; these are not of unit mass.
    modes = scipy.linalg.eigh(stiffness_with_joint(), M)[1]
    T = scipy.linalg.block_diag(modes, modes)
    modal = np.linalg.solve(T, F @ T)
    gain = T @ observer_gain(modal, H @ T / noise[:, None], 1.0 / RATE, size) / noise
    assert np.max(np.abs(gain - from_rest.gain)) < 1e-4 * np.max(np.abs(gain))


def test_evidence_differs_by_the_filters_log_likelihood():
    """In the free run, where the filter's covariance is that of the sensors.

    What is compared is in a band, and counts as much more as its noise is correlated: over the
    correlation time 1 / (2 x 0.35). The one that is estimated stops at the first negative
    correlation, and so is somewhat longer; never shorter.
    """
    y, noise = recorded("acceleration", 0.2)
    made, _ = problem([y], [measured_force(PEAK)], noise, joint=True, loose=1e-6)
    stiffer, _ = problem([y], [measured_force(PEAK)], noise, joint=True, loose=1.0)
    z = -0.4
    theta = stiffer.map.given(np.array([z]))
    fits = [
        multistart(each, [Start(each.nothing(), at)], math.inf, 0)[0]
        for each, at in ((made, made.map.given()), (stiffer, theta))
    ]
    table = evidence(made, fits)
    # The prior of the joint is no part of the likelihood.
    found = (fits[1].misfit.sum() - fits[0].misfit.sum()) / (2.0 * table.temperature)
    k = 3e4 * math.exp(0.1 * z)
    wanted = [
        kalman(y, noise, 0.0, "acceleration", stiffness).log_likelihood
        for stiffness in (stiffness_with_joint(), stiffness_with_joint(k))
    ]
    assert wanted[0] - wanted[1] > 50.0
    assert found * 2.0 * END == pytest.approx(wanted[0] - wanted[1], rel=0.1)
    assert 1.0 < table.tau * 2.0 * END < 1.3


@pytest.mark.parametrize("time_constant", [0.125, 0.25])
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_noise_that_the_observer_feeds_through_is_seen_again(quantity, time_constant):
    """At the truth, over what the same noise leaves in the free run.

    Of two modes short memories feed through 5 to 110 %.
    """
    clean, rng = simulated(PEAK, quantity), np.random.default_rng(3)
    noise = 0.2 * np.std(clean, axis=0)
    seen = [clean + noise * rng.standard_normal(clean.shape) for _ in range(24)]
    force = [measured_force(PEAK)] * len(seen)
    made, _ = problem(seen, force, noise, quantity=quantity, joint=False)
    true = Start(made.nothing(), made.map.given())
    observed, free = (
        float(multistart(made, [true], memory, 0)[0].misfit.sum())
        for memory in (time_constant, math.inf)
    )
    fed = left_by_noise(made, time_constant) / left_by_noise(made)
    assert fed > 1.05
    # A recording begins from rest, where no noise has been fed through yet.
    assert observed / free == pytest.approx(fed, rel=0.01)
    assert left_by_noise(made, math.inf) == left_by_noise(made)
