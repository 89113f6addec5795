"""The state in which a free decay begins, of which nothing was measured but what follows."""

import numpy as np
from jaxtyping import Float

from iwanjax.discrepancy.observer import observer_gain, process_noise, stepped
from iwanjax.discrepancy.prediction import Predictor

# Memory of the observer that looks back, cycles, and cycles of the slowest mode that it sees.
_MEMORY, _SEEN = 1.0, 6.0
# Share of its amplitude that each mode's state may be off by, and of the fastest one's rate.
_OFF, _LEAST = 0.3, 0.02


def released(
    made: Predictor, response: Float[np.ndarray, "N sensors"], noise: Float[np.ndarray, " sensors"]
) -> tuple[np.ndarray, np.ndarray]:
    """State at the first sample, and by how much it may be off.

    An observer with a short memory goes back in time from some cycles later, so that it is
    least wrong where it ends, whatever the joints are.

    Parameters
    ----------
    made : Predictor
        Of the structure, its joints at their given stiffness.
    response : (N, sensors) array
        From when nothing touches the structure any more.
    noise : (sensors,) array
        Deviations.

    Returns
    -------
    (2 modes,) array, (2 modes, 2 modes) array
        Displacements and velocities of the modes that move; deviations, one to a column.
    """
    dt = float(made.dt) * made.substeps
    A, H = made.linear(np.asarray(made.stiffness), made.blank(), np.zeros(1))
    back = stepped(-A, dt)
    size = process_noise(back, H / noise[:, None], dt, _MEMORY)
    gain = observer_gain(back, H / noise[:, None], dt, size) / noise
    omega = np.sqrt(np.maximum(np.asarray(made.omega2), 1.0))
    count = min(len(response), int(_SEEN * 2.0 * np.pi / (omega.min() * dt)) + 1)
    z = np.zeros(len(A))
    for y in response[count - 1 :: -1]:
        z = back @ z
        z = z + gain @ (y - H @ z)
    q, v = np.split(z, 2)
    amplitude = np.hypot(q, v / omega)
    off = np.maximum(_OFF * amplitude, _LEAST * np.max(amplitude * omega) / omega)
    return z, np.diag(np.concatenate([off, off * omega]))
