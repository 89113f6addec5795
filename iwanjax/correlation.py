"""How far residuals are correlated: of how many independent values a series consists."""

import math

import numpy as np


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
