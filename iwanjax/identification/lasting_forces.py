"""Noise of forces that act throughout a recording."""

import numpy as np
from jaxtyping import Float

from iwanjax.settings.conditioning import CONDITIONING, ConditioningSettings
from iwanjax.signals.noise import in_quiet_bands


def noise_of_lasting(
    force: Float[np.ndarray, "N inputs"], settings: ConditioningSettings = CONDITIONING
) -> Float[np.ndarray, " inputs"]:
    """Standard deviation of the noise of forces that act throughout, where they excite nothing.

    White noise shows in the bands beyond those that a shaker is driven in. A force that fills all
    of them does not tell its noise: more than a measured force may be off by is no noise, and
    counts as none.

    Parameters
    ----------
    force : (N, inputs) array
        As measured.
    settings : ConditioningSettings
        Of the stage.
    """
    found = np.zeros(force.shape[1])
    acting = np.any(force != 0.0, axis=0)
    level = in_quiet_bands(
        force[:, acting],
        None,
        bands=settings.noise_bands,
        values=settings.noise_values,
        flat=settings.flat,
    )
    found[acting] = level.deviation
    most = settings.force_error * np.max(np.abs(force), axis=0)
    return np.where(found < most, found, 0.0)
