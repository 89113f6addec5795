r"""What sensors see of the modes that no predictor moves: those far above the compared band.

In the band they follow the forces on them without resonating,

.. math:: y = \sum_r Y_r H_r(\omega) f_r, \qquad
          H_r = \frac{(i\omega)^n}{\omega_r^2 - \omega^2 + i c_r\omega},

with n = 2 for accelerations, which grows with the square of the frequency: a mode at 0.65 of the
sampling rate adds a third of a mass of its own at 0.33 of it. What they do beyond half the sampling
rate a recorder filters off before it samples.
"""

from typing import Any, Literal, NamedTuple, get_args

import jax
import numpy as np
from jaxtyping import Array, Float

from iwanjax.dynamics.coordinates import ModalCoordinates

Quantity = Literal["displacement", "velocity", "acceleration"]
"""What the sensors measure: each is the derivative of the one before."""


class ModesLeftOut(NamedTuple):
    """Modes that act, but are not moved.

    Attributes
    ----------
    omega2, c : (left,) array
        Squared circular frequencies and modal dampings.
    inputs : (inputs, left) array
        Where measured forces act on them.
    sensors : (sensors, left) array
        What the sensors see of them.
    """

    omega2: Float[Array, " left"]
    c: Float[Array, " left"]
    inputs: Float[Array, "inputs left"]
    sensors: Float[Array, "sensors left"]

    @property
    def number(self) -> int:
        """How many."""
        return self.omega2.shape[0]

    @property
    def flexibility(self) -> Float[Array, " left"]:
        """How far each yields at once to a modal force of one."""
        return 1.0 / self.omega2

    def driven(self, force: np.ndarray, rate: float, quantity: Quantity) -> np.ndarray:
        """What the sensors show of measured forces, (N, inputs), on them: (N, sensors)."""
        if not self.number:
            return np.zeros((len(force), self.sensors.shape[0]))
        return np.asarray(self.shown(np.asarray(self.inputs), force[:, None], rate, quantity, np))

    def shown(
        self,
        rows: Array | np.ndarray,
        force: Array | np.ndarray,
        rate: Array | float,
        quantity: Quantity,
        xp: Any,
    ) -> Float[Array, "N sensors"]:
        """What the sensors show of forces on them, sampled through a recorder's filter.

        Parameters
        ----------
        rows : (forces, left) array
            Where the forces act.
        force : (N, substeps, forces) array
            At the end of each step; the last one before each sample ends there.
        rate : float
            Sampling rate, Hz.
        quantity : {"acceleration", "velocity", "displacement"}
            What the sensors measure.
        xp : module
            ``jax.numpy`` within a kernel.

        Returns
        -------
        (N, sensors) array
        """
        # Here, because few need it and it is slow to import.
        from scipy.fft import next_fast_len

        N, substeps, _ = force.shape
        size = next_fast_len(N + 1, real=True)
        assert size is not None
        # From the sample before the first on: of that none is known.
        early = xp.concatenate([xp.zeros((1, len(rows))), force.reshape(N * substeps, -1)])
        spectrum = xp.fft.rfft(early, size * substeps, axis=0)[: size // 2 + 1]
        s = 2j * xp.pi * xp.fft.rfftfreq(size, 1.0 / rate)[:, None]
        omega2, c, _, sensors = (xp.asarray(each) for each in self)
        gain = s ** get_args(Quantity).index(quantity) / (omega2 + s * (c + s))
        paths = (sensors.T[:, :, None] * rows.T[:, None]).reshape(self.number, -1)
        transfer = (gain @ paths).reshape(-1, len(sensors), len(rows))
        seen = xp.fft.irfft(xp.einsum("fsg,fg->fs", transfer, spectrum), size, axis=0)
        return seen[1 : N + 1] / substeps


def modes_left_out(modal: ModalCoordinates, kept: int) -> ModesLeftOut:
    """Those beyond the first so many of all modes."""
    C = np.asarray(modal.C)
    c = np.diagonal(C) if C.ndim == 2 else C
    omega2, W, Y = (np.asarray(each) for each in (modal.omega2, modal.W, modal.Y))
    return ModesLeftOut(*jax.device_put((omega2[kept:], c[kept:], W[kept:].T, Y[:, kept:])))
