"""How far a linear model is trusted: what its frequencies and damping may be off by."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class LinearTrust:
    """Relative standard deviations of a linear model's modes, elastic ones, the lowest first.

    Parameters
    ----------
    frequencies : float or sequence of float
        Of natural frequencies: one for all modes, or one for each; beyond those given the last.
    damping : float or sequence of float
        Of modal damping, likewise.
    shapes : float
        Of mode shapes at the sensors.

    Examples
    --------
    >>> import numpy as np
    >>> trust = LinearTrust(frequencies=0.005, damping=(0.1, 0.3))
    >>> trust.deviations(np.array([0.0, 4.0, 9.0]))
    array([[0.   , 0.005, 0.005],
           [0.   , 0.1  , 0.3  ]])
    """

    frequencies: float | Sequence[float] = 0.005
    damping: float | Sequence[float] = 0.3
    shapes: float = 0.0

    def deviations(self, omega2: Float[np.ndarray, " modes"]) -> Float[np.ndarray, "2 modes"]:
        """Deviations of frequencies and of damping; none of a rigid body's."""
        elastic = np.cumsum(omega2 > 0.0) - 1
        rows = [
            np.asarray(each, float)[np.clip(elastic, 0, np.size(each) - 1)]
            if np.ndim(each)
            else np.full(len(omega2), each, float)
            for each in (self.frequencies, self.damping)
        ]
        return np.where(omega2 > 0.0, np.stack(rows), 0.0)
