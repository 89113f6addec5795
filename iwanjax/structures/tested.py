"""A structure of modes that were measured: modal coordinates, and rows at its sensors."""

from collections.abc import Mapping
from itertools import combinations

import numpy as np
from jaxtyping import Float

from iwanjax.structures.linear import LinearStructure
from iwanjax.structures.model_file import Model


def model_of_modes(
    omega: Float[np.ndarray, " n"],
    zeta: Float[np.ndarray, " n"],
    sensors: Mapping[str, np.ndarray],
    inputs: Mapping[str, np.ndarray],
) -> Model:
    r"""The structure that has these mass-normalised modes.

    .. math::
        M = I, \qquad C = \mathrm{diag}(2\zeta_r\omega_r), \qquad
        K = \mathrm{diag}(\omega_r^2)

    Its rows are each sensor against the ground (``a1-ground``), the differences of each two
    (``a3-a2``), and those inputs that act where no sensor is.

    Parameters
    ----------
    omega, zeta : (n,) array
        rad/s, and ratios.
    sensors, inputs : mapping of str to (n,) array
        Shapes there.

    Returns
    -------
    Model
    """
    structure = LinearStructure(np.eye(len(omega)), np.diag(2.0 * zeta * omega), np.diag(omega**2))
    rows = {f"{name}-ground": row for name, row in sensors.items()}
    for (first, a), (second, b) in combinations(sensors.items(), 2):
        rows[f"{second}-{first}"] = b - a
    for name, row in inputs.items():
        if not any(np.array_equal(row, known) for known in sensors.values()):
            rows[name] = row
    return Model(structure, rows, dict(sensors), dict(inputs))
