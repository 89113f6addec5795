"""A free decay by its peaks: logarithmic decrement and the times of the extremes."""

import numpy as np

from iwanjax.signals.decay_slopes import Decay, DecaySlopes
from iwanjax.signals.interval_lines import fit_lines, line_slopes

# Samples between two: a parabola through three then is off by 1e-4 of what it is at ten a cycle.
_FINER = 8


def peak_slopes(decay: Decay) -> DecaySlopes:
    r"""Lines through the logarithms and the times of the extremes in each interval.

    Each half cycle has one: its height by a parabola, :math:`\psi_1`, its number times
    :math:`\pi`, :math:`\psi_2`. Between samples the band-passed record is a spline of degree 7.
    """
    from scipy.interpolate import make_interp_spline  # here, because it takes a second to import

    n = np.arange(decay.z.size)
    y = make_interp_spline(n, np.real(decay.z), k=7)(np.arange(_FINER * (n.size - 1)) / _FINER)
    rises = np.diff(y) > 0.0
    at = np.flatnonzero(rises[1:] != rises[:-1]) + 1
    before, here, after = (np.abs(y[at + k]) * np.sign(y[at] * y[at + k]) for k in (-1, 0, 1))
    bend = before - 2.0 * here + after
    shift = 0.5 * (before - after) / bend
    height = here - 0.25 * (before - after) * shift
    time = (at + shift) / (_FINER * decay.sampling_rate)
    # A ripple beside the fundamental is no extreme of its own.
    real = (height > 0.0) & (bend < 0.0)
    time, psi_1 = time[real], np.log(height[real])
    edges = np.searchsorted(time, decay.edges / decay.sampling_rate)
    psi_2 = np.pi * np.arange(time.size)
    return line_slopes(fit_lines(time, psi_1, psi_2, edges, decay.noise.at(decay.edges)))
