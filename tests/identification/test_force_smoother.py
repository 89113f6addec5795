"""The smoothed force against the normal equations of all samples at once, and in a chain."""

import numpy as np
import pytest
import scipy.linalg

from iwanjax.identification.force_smoother import (
    Augmented,
    ForcedModel,
    Seen,
    augmented,
    closer,
    likeliest,
    likelihoods,
    smoothed,
)

DT, N = 1e-3, 60
OMEGA = 2.0 * np.pi * np.array([20.0, 90.0])


def forced(quantity: str) -> ForcedModel:
    """Two modes, a sensor, a force."""
    lower = np.hstack([-np.diag(OMEGA**2), -np.diag(0.02 * OMEGA)])
    A = np.vstack([np.hstack([np.zeros((2, 2)), np.eye(2)]), lower])
    B, Y = np.array([0.0, 0.0, -1.0, -0.7]), np.array([[0.8, -0.5]])
    H = {"displacement": np.hstack([Y, 0.0 * Y]), "velocity": np.hstack([0.0 * Y, Y])}
    if quantity == "acceleration":
        return ForcedModel(A, B, Y @ lower, Y @ B[2:])
    return ForcedModel(A, B, H[quantity], np.zeros(1))


def recording(model: ForcedModel, seed: int = 0) -> Seen:
    """Gaps, a pulse during which sensors are noisier, corrections, an uncertain state."""
    random = np.random.default_rng(seed)
    weight = np.full((N, 1), 50.0)
    weight[:4] = weight[30] = 0.0
    weight[10:14] = 5.0
    spread = random.standard_normal((4, 2)) * np.array([1e-4, 1e-4, 1e-2, 1e-2])[:, None]
    return Seen(
        random.standard_normal((N, 1)),
        weight,
        1e-3 * random.standard_normal((N, 4)) * np.array([1e-2, 1e-2, 1.0, 1.0]),
        np.arange(N) == 14,
        (spread @ np.ones(2), spread @ spread.T),
    )


def matern(t: np.ndarray, tau: float) -> np.ndarray:
    """Covariance of the force at two times, of deviation 1."""
    return (1.0 + np.abs(t) / tau) * np.exp(-np.abs(t) / tau)


def all_at_once(system: Augmented, seen: Seen) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean and covariance of the states of all samples, and log-likelihood, by dense algebra.

    States are a linear map of what is random: the first, what is added at each sample, the jump.
    """
    n = len(system.F)
    known = np.pad(seen.known, [(0, 0), (0, n - seen.known.shape[1])])
    change, spread = np.zeros(n), np.zeros((n, n))
    change[:4], spread[:4, :4] = seen.jump
    parts, mean = [], np.zeros((N, n))
    additions = [system.P, *[system.Q] * (N - 1)]
    for k, Q in enumerate(additions):
        Q = Q + spread * seen.unsure[k]
        mean[k] += change * seen.unsure[k]
        if k:
            mean[k] += system.F @ (mean[k - 1] + known[k - 1])
        parts.append(Q)
    to = np.zeros((N * n, N * n))
    for k in range(N):
        for j in range(k + 1):
            power = np.linalg.matrix_power(system.F, k - j)
            to[k * n : (k + 1) * n, j * n : (j + 1) * n] = power
    P = to @ np.asarray(scipy.linalg.block_diag(*parts)) @ to.T
    H = np.asarray(scipy.linalg.block_diag(*[system.H * w[:, None] for w in seen.weight]))
    v = np.ravel(seen.y * seen.weight) - H @ mean.ravel()
    S = H @ P @ H.T + np.eye(len(v))
    gain = np.linalg.solve(S, H @ P).T
    count = np.count_nonzero(seen.weight)
    scale = v @ np.linalg.solve(S, v) / count
    log = -0.5 * np.linalg.slogdet(S)[1] - 0.5 * count * np.log(scale)
    return (mean.ravel() + gain @ v).reshape(N, n), P - gain @ H @ P, float(log)


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
def test_smoother_and_likelihood_are_those_of_all_samples_at_once(quantity):
    model = forced(quantity)
    seen, system = recording(model), augmented(model, 4.0 * DT, np.asarray(30.0), DT)
    mean, covariance, log = all_at_once(system, seen)
    found, spread = smoothed(system, seen, np.eye(6))
    size = np.max(np.abs(mean), axis=0)
    np.testing.assert_allclose(found / size, mean / size, atol=1e-8)
    own = np.stack([covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] for k in range(N)])
    size = np.sqrt(np.max(np.diagonal(own, axis1=1, axis2=2), axis=0))
    size = np.outer(size, size)
    np.testing.assert_allclose(spread / size, own / size, atol=1e-8)
    deviations = np.array([3.0, 30.0])
    values, _ = likelihoods(augmented(model, 4.0 * DT, deviations, DT), seen)
    assert values[1] == pytest.approx(log, rel=1e-9)


def test_the_force_has_the_covariance_of_a_matern_process():
    """By hand, against the map and what it adds over several samples."""
    tau = 5.0 * DT
    system = augmented(forced("velocity"), tau, np.asarray(2.0), DT)
    P = system.P[4:, 4:]
    for steps in range(6):
        later = np.linalg.matrix_power(system.F[4:, 4:], steps)
        assert (later @ P)[0, 0] == pytest.approx(4.0 * matern(np.asarray(steps * DT), tau))
    F, Q = system.F[4:, 4:], system.Q[4:, 4:]
    np.testing.assert_allclose(F @ P @ F.T + Q, P, rtol=1e-9, atol=1e-9 * P[1, 1])


def test_the_prior_of_a_simulated_force_is_found():
    """Its deviation within a third, its correlation time within the factor that is looked for."""
    random = np.random.default_rng(3)
    model, noise = forced("acceleration"), 0.2
    system = augmented(model, 8.0 * DT, np.asarray(5.0), DT)
    root, x = np.linalg.cholesky(system.Q + 1e-12 * np.diag(np.diag(system.Q))), np.zeros(6)
    y = np.zeros((1500, 1))
    for k in range(len(y)):
        x = system.F @ x + root @ random.standard_normal(6)
        y[k] = system.H @ x + noise * random.standard_normal()
    # Noise that is four times what is said, in variance.
    seen = Seen(
        y,
        np.full(y.shape, 2.0 / noise),
        np.zeros((len(y), 4)),
        np.zeros(len(y), bool),
        (np.zeros(4), np.zeros((4, 4))),
    )
    found = closer(model, seen, DT, likeliest(model, seen, DT, 1.0 / OMEGA[0]))
    assert found.scale == pytest.approx(4.0, rel=0.2)
    assert np.sqrt(found.scale) * found.deviation == pytest.approx(5.0, rel=0.33)
    assert found.tau == pytest.approx(8.0 * DT, rel=0.5)
