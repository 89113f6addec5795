"""A free decay by damped sines, one fitted to each short interval."""

from dataclasses import replace

import numpy as np

from iwanjax.signals.decay_slopes import Decay, DecaySlopes
from iwanjax.signals.interval_lines import decay_lines, line_slopes

# From lines through its logarithm a damped sine is this many Gauss-Newton steps away.
_STEPS = 3


def short_time_slopes(decay: Decay) -> DecaySlopes:
    r"""Least squares of :math:`\exp(c + \lambda t)` against the analytic signal in each interval.

    Both are complex: :math:`\lambda = \alpha + i\omega`. Noise counts alike at all times, so that
    an interval's beginning, where the amplitude is largest, says more than its end. A slope is an
    average of the derivative: with :math:`\mu_k` the weights' central moments it is told for where
    that has its middle, :math:`\mu_3/2\mu_2` beside theirs, of the width of a line through as much.
    """
    psi_1, psi_2 = decay.logarithm
    time = np.arange(decay.z.size) / decay.sampling_rate
    density = decay.noise.at(decay.edges)
    lines = decay_lines(decay)
    rows = []
    for i, (a, b) in enumerate(zip(decay.edges[:-1], decay.edges[1:], strict=True)):
        z, weight = decay.z[a:b], np.exp(2.0 * psi_1[a:b])
        middle = weight @ time[a:b] / weight.sum()
        t = time[a:b] - middle
        second = weight @ t**2
        # About the weights' middle height and slope do not depend on one another.
        c = complex(weight @ psi_1[a:b], weight @ psi_2[a:b]) / weight.sum()
        slope = complex(weight * t @ psi_1[a:b], weight * t @ psi_2[a:b]) / second
        for _ in range(_STEPS):
            model = np.exp(c + slope * t)
            off = model.conj() * (z - model)
            c, slope = c + off.sum() / weight.sum(), slope + t @ off / second
        white = 0.5 * (density[i] + density[i + 1]) * decay.sampling_rate
        variance = white / weight.sum(), white / second
        mu = [weight @ t**k / weight.sum() for k in range(5)]
        shift = 0.5 * mu[3] / mu[2]
        width = np.sqrt(20.0 * (mu[4] / (3.0 * mu[2]) - shift**2))
        height = c.real + shift * slope.real
        of_height = variance[0] + shift**2 * variance[1]
        rows.append((middle + shift, width, height, of_height, slope.real, slope.imag, variance[1]))
    middle, width, height, height_variance, rate, omega, slope_variance = np.array(rows).T
    return line_slopes(
        replace(
            lines,
            middle=middle,
            width=width,
            height=height,
            height_variance=height_variance,
            rate=rate,
            omega=omega,
            slope_variance=slope_variance,
        )
    )
