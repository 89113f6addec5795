"""The gain of an observer that forgets: how far back a prediction is made from."""

import math

import numpy as np

# Exponents of ten between which the size of the process noise is looked for.
_SIZES = (-14.0, 14.0)
_ROUNDS = 40


def observer_gain(
    A: np.ndarray, H: np.ndarray, noise: np.ndarray, dt: float, cycles: float
) -> np.ndarray:
    """Steady Kalman gain that lets errors of the state die within some cycles.

    Process noise acts on the modal velocities only; its size is bisected so that the median
    pole of the observer decays by 1/cycles per cycle. A long memory (infinity: none at all,
    the free run) accumulates phase and has countless minima in the parameters; with a short
    one residuals are nearly linear in them.

    Parameters
    ----------
    A : (2 m, 2 m) array
        Continuous state matrix of displacements and velocities.
    H : (sensors, 2 m) array
        What the sensors see of the state.
    noise : (sensors,) array
        Standard deviations.
    dt : float
        Between samples, s.
    cycles : float
        Memory.

    Returns
    -------
    (2 m, sensors) array
        Of the correction after each sample.
    """
    import scipy.linalg

    states, sensors = A.shape[0], H.shape[0]
    if math.isinf(cycles):
        return np.zeros((states, sensors))
    step = scipy.linalg.expm(A * dt)
    pushed = np.diag(np.repeat([0.0, dt], states // 2))
    # Sensors of different size are weighed by their noise.
    scaled = H / noise[:, None]
    eye = np.eye(sensors)

    def gain(exponent: float) -> np.ndarray:
        P = scipy.linalg.solve_discrete_are(step.T, scaled.T, 10.0**exponent * pushed, eye)
        return P @ scaled.T @ np.linalg.inv(scaled @ P @ scaled.T + eye)

    def decay(L: np.ndarray) -> float:
        poles = np.linalg.eigvals((np.eye(states) - L @ scaled) @ step)
        turns = np.maximum(np.abs(np.angle(poles)), 1e-9) / (2.0 * np.pi)
        return float(np.median(-np.log(np.maximum(np.abs(poles), 1e-300)) / turns))

    low, high = _SIZES
    found = None
    for _ in range(_ROUNDS):
        middle = 0.5 * (low + high)
        try:
            tried = gain(middle)
        except np.linalg.LinAlgError:
            # Too little noise for the equation to be solved in floating point.
            low = middle
            continue
        found = tried
        if decay(tried) > 1.0 / cycles:
            high = middle
        else:
            low = middle
    assert found is not None, "no process noise gives a gain"
    return found / noise
