"""How far residuals are correlated: of how many independent values a series consists."""

import math

import numpy as np

# Steps of an autocorrelation time that tell it. With all 15 000 of a walk over the Brake-Reuss beam
# (17 variables, 48 walkers) telling it took 4.8 s, as long as 600 of them.
_TELLING = 20


def correlation_time(residual: np.ndarray) -> float:
    """Of (recordings, N, sensors) in samples: one plus twice the sum of what is positive."""
    largest = float(np.max(np.abs(residual)))
    if not 0.0 < largest < math.inf:
        return 1.0
    # In units of the largest: a run that broke down would overflow.
    flat = residual / largest
    flat = flat - flat.mean(axis=1, keepdims=True)
    size = 2 * flat.shape[1]
    power = np.abs(np.fft.rfft(flat, size, axis=1)) ** 2
    correlation = np.fft.irfft(power.sum(axis=(0, 2)))[: flat.shape[1] // 4]
    # Of fewer than four values none is told.
    if correlation.size == 0 or correlation[0] <= 0:
        return 1.0
    correlation = correlation / correlation[0]
    negative = np.flatnonzero(correlation <= 0)
    until = negative[0] if negative.size else correlation.size
    return float(1.0 + 2.0 * np.sum(correlation[1:until]))


def autocorrelation_times(chain: np.ndarray) -> np.ndarray:
    """Of each variable of a chain (steps, walkers, variables), in steps.

    By some of the steps where the times are long: first by a thousand, then by as many as tell the
    shortest of the times that these have shown.
    """
    import emcee  # here, because few need it and it takes a second to import

    def by(every: int) -> np.ndarray:
        return every * emcee.autocorr.integrated_time(chain[::every], tol=0, quiet=True)

    few = max(1, len(chain) // 1000)
    tau = by(few)
    shortest = float(np.min(tau)) if np.all(np.isfinite(tau)) else 1.0
    enough = max(1, int(shortest / _TELLING))
    return tau if few <= enough else by(enough)
