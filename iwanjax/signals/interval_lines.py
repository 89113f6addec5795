"""Lines fitted to envelope and phase in intervals of a decay, and the slopes that follow."""

from dataclasses import dataclass

import numpy as np

from iwanjax.signals.decay_checks import NORMAL, SURE
from iwanjax.signals.decay_slopes import Decay, DecaySlopes

# Multiple of the correction to the midpoint that is taken as its deviation: beside a kink it is
# wrong by up to twice itself.
_DOUBT = 2.0


@dataclass(frozen=True)
class Lines:
    """Lines fitted to psi_1 and psi_2 in each interval, with variances."""

    middle: np.ndarray
    width: np.ndarray
    height: np.ndarray
    height_variance: np.ndarray
    rate: np.ndarray
    omega: np.ndarray
    slope_variance: np.ndarray
    rate_bend: np.ndarray
    omega_bend: np.ndarray


def fit_lines(
    time: np.ndarray,
    psi_1: np.ndarray,
    psi_2: np.ndarray,
    edges: np.ndarray,
    density: np.ndarray,
) -> Lines:
    """Least-squares lines through samples in each interval.

    Parameters
    ----------
    time, psi_1, psi_2 : (samples,) array
        s; logarithm of the envelope, phase.
    edges : (intervals + 1,) array
        The first sample of each interval, and one past the last.
    density : (intervals + 1,) array
        Of noise that is white near the carrier, at each edge.
    """
    rows = []
    for i in range(edges.size - 1):
        a, b = edges[i], edges[i + 1]
        t = time[a:b]
        middle = np.mean(t)
        lever = (t - middle) / np.sum((t - middle) ** 2)
        bend = _bend(t)
        mean = np.full(t.size, 1.0 / t.size)
        # In-phase noise of the envelope and of the phase, relative to the amplitude.
        width = np.ptp(t) * t.size / (t.size - 1)
        white = 0.5 * (density[i] + density[i + 1]) * t.size / width
        variance = white * np.exp(-2.0 * psi_1[a:b])
        rows.append(
            (
                middle,
                width,
                mean @ psi_1[a:b],
                mean**2 @ variance,
                lever @ psi_1[a:b],
                lever @ psi_2[a:b],
                lever**2 @ variance,
                bend @ psi_1[a:b],
                bend @ psi_2[a:b],
            )
        )
    return Lines(*np.array(rows).T)


def _bend(t: np.ndarray) -> np.ndarray:
    """Weights for the slope over the second half of an interval less that over the first."""
    halves = np.array_split(t, 2)
    levers = [(part - part.mean()) / np.sum((part - part.mean()) ** 2) for part in halves]
    return np.concatenate([-levers[0], levers[1]])


def decay_lines(decay: Decay) -> Lines:
    """Lines through all samples of a decay, in its intervals."""
    time = np.arange(decay.z.size) / decay.sampling_rate
    return fit_lines(time, *decay.logarithm, decay.edges, decay.noise.at(decay.edges))


def line_slopes(lines: Lines, steps: bool = True) -> DecaySlopes:
    """Values at the midpoints from the lines' averages."""
    to_middle, to_slope = _midpoint_operators(lines.middle, lines.width)
    noise = to_middle**2 @ lines.slope_variance
    correction = to_middle - np.eye(lines.middle.size)
    # What the noise does to a correction is in its variance already.
    own = SURE * (correction**2 @ lines.slope_variance)

    # A slope over half an interval has eight times the variance.
    bend_variance = 16.0 * lines.slope_variance

    def left(slopes: np.ndarray, bend: np.ndarray) -> np.ndarray:
        # A step within an interval bends its line more than the neighbours' slopes do, and the
        # value at the middle is that of either side: they alone would not tell.
        step = bend - 0.5 * (to_slope @ slopes) * lines.width
        # What bends all lines, such as a beat, is none.
        common = NORMAL * np.median(np.abs(step))
        own_bend = SURE**2 * np.maximum(bend_variance, common**2)
        more = np.maximum(step**2 - own_bend, 0.0) if steps else 0.0
        return _DOUBT**2 * np.maximum((correction @ slopes) ** 2 - own, 0.0) + more

    return DecaySlopes(
        time=lines.middle,
        # A line at its middle is the mean, which lies off the curve by its curvature.
        height=lines.height - to_slope @ lines.rate * lines.width**2 / 24.0,
        height_variance=lines.height_variance,
        rate=to_middle @ lines.rate,
        rate_variance=noise + left(lines.rate, lines.rate_bend),
        omega=to_middle @ lines.omega,
        omega_variance=noise + left(lines.omega, lines.omega_bend),
        omega_slope=to_slope @ lines.omega,
    )


def _midpoint_operators(middle: np.ndarray, width: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrices from the lines' slopes to the derivative and its slope at the midpoints.

    The slope of a line of width h is the derivative's average with a parabola as weight,
    whose variance is h^2/20. A quadratic through the averages of three neighbours gives
    the value at the middle.
    """
    count = middle.size
    value, slope = np.zeros((count, count)), np.zeros((count, count))
    for i in range(count):
        first = min(max(i - 1, 0), count - 3)
        near = slice(first, first + 3)
        dt = (middle[near] - middle[i]) / width[i]
        spread = (width[near] / width[i]) ** 2 / 20.0
        averages = np.column_stack([np.ones(3), dt, dt**2 + spread])
        inverse = np.linalg.inv(averages)
        value[i, near], slope[i, near] = inverse[0], inverse[1] / width[i]
    return value, slope
