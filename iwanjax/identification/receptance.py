r"""Oscillators attached to a place: what an observer would leave with each of them.

An element of dynamic stiffness K(s) opposes the deflection d of its place by :math:`F = K d`. With
the receptance R of the place and the innovations' response G to such a force, both of the model as
its observer corrects it, the innovations e become

.. math:: e' = e + G\,\frac{K}{1 - R K}\, d

(receptance coupling: Bishop and Johnson, The Mechanics of Vibration, 1960, Ch. 1). One run of the
model gives e and d for elements without number; joints that slip are taken at their tangents, which
is good enough to tell where a search begins.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Complex, Float

from iwanjax.identification import kernels
from iwanjax.identification.hypotheses import LawStart
from iwanjax.identification.innovations import AtSamples
from iwanjax.identification.observer import stepped
from iwanjax.identification.places import Place
from iwanjax.identification.problem import HistoryProblem
from iwanjax.joints import AttachedOscillator
from iwanjax.signals.comparison_band import HALF, in_band

# What comes round again from beyond the end of a transform, as a share of itself: as much as
# rounding is of what that makes smaller.
_ROUND = np.sqrt(np.finfo(float).eps)


class _Responses(NamedTuple):
    """To a force that opposes a place's deflection, by frequency.

    Attributes
    ----------
    place : (F,) array
        R: of the deflection.
    sensors : (F, sensors) array
        G: of the innovations.
    """

    place: Complex[np.ndarray, " F"]
    sensors: Complex[np.ndarray, "F sensors"]


def nearest_oscillators(
    problem: HistoryProblem, place: Place, beside: Sequence[np.ndarray], time_constant: float
) -> list[LawStart[AttachedOscillator]]:
    """Attached oscillators that leave least as they are: where a search for one begins.

    Parameters
    ----------
    problem : HistoryProblem
        Of the model without it.
    place : Place
        Where.
    beside : sequence of (parameters,) array
        Values of the joints to begin beside.
    time_constant : float
        Memory of the observer, cycles.

    Returns
    -------
    list of LawStart
        The nearest first, no more than ``joint_faults.near``.
    """
    laws = AttachedOscillator.begun(place.scales)
    left = np.concatenate([left_with(problem, place, z, laws, time_constant) for z in beside])
    guesses = [LawStart(law, z) for z in beside for law in laws]
    nearest = np.argsort(left, kind="stable")[: problem.settings.joint_faults.near]
    return [guesses[i] for i in nearest]


def left_with(
    problem: HistoryProblem,
    place: Place,
    z: Float[np.ndarray, " parameters"],
    laws: Sequence[AttachedOscillator],
    time_constant: float,
) -> Float[np.ndarray, " laws"]:
    r"""Sums of the squared residuals with each of some oscillators at a place.

    Signals are transformed times :math:`\epsilon^{t/2T}`: what rings on beyond the end T
    and comes round again is :math:`\epsilon` of itself then.

    Parameters
    ----------
    problem, place, time_constant
        As for :func:`nearest_oscillators`.
    z : (parameters,) array
        Values of the joints.
    laws : sequence of AttachedOscillator
        Any number of them.

    Returns
    -------
    (laws,) array
        In squared deviations; infinite where no observer is found, not a number where the run
        without them breaks down.
    """
    data, none, dt = problem.data, problem.nothing(), 1.0 / problem.predictor.rate
    theta = problem.still(np.append(z, problem.map.given()[len(z) :]))
    here = none.suspects._replace(row=jax.device_put(place.row[None]))
    gain = problem.gains([here], theta[:1], time_constant, slopes=False).gain[0]
    if not np.all(np.isfinite(gain)):
        return np.full(len(laws), np.inf)
    varied = jax.device_put((theta, gain))
    seen = AtSamples(*kernels.observed(problem.predictor, problem.joints, here, *varied, data))
    N = data.response.shape[1] + 2 * HALF
    fading = _ROUND ** (0.5 * np.arange(N) / N)[:, None]
    turn = _ROUND ** (-0.5 / N) * np.exp(2j * np.pi * np.fft.rfftfreq(2 * N))
    stiffness = [_dynamic_stiffness(law, np.log(turn) / dt) for law in laws]
    left = np.zeros(len(laws))
    for e, d, weight in zip(seen.e, seen.d, np.asarray(data.weight), strict=True):
        by = _responses(problem, place, theta[0], gain * np.any(weight > 0.0, axis=0), turn)
        e, d = (np.fft.rfft(fading * _compared(x), 2 * N, axis=0) for x in (e, d))
        scale = weight / fading[HALF:-HALF]
        with np.errstate(over="ignore", invalid="ignore"):
            for i, K in enumerate(stiffness):
                force = (K / (1.0 - by.place * K))[:, None] * d
                after = np.fft.irfft(e + by.sensors * force, 2 * N, axis=0)[HALF : N - HALF]
                left[i] += np.sum((after * scale) ** 2)
    return left


def _compared(x: Array) -> np.ndarray:
    """What of a signal is in the band, with where the filter spreads it to."""
    return np.asarray(in_band(jax.device_put(np.pad(np.asarray(x), [(HALF, HALF), (0, 0)]))))


def _responses(
    problem: HistoryProblem,
    place: Place,
    values: Float[np.ndarray, " values"],
    gain: Float[np.ndarray, "states sensors"],
    turn: Complex[np.ndarray, " F"],
) -> _Responses:
    """At some values of z, of a force that is linear from one sample to the next."""
    none, kept, dt = problem.empty(), problem.predictor.kept, 1.0 / problem.predictor.rate
    A, H = problem.system(none, values)
    B, D = problem.opposed(place.row, none, values)
    states = len(A)
    # The state, with a force and its rise over a sample.
    forced = np.zeros((states + 2, states + 2))
    forced[:states, :states], forced[:states, states], forced[states, -1] = A, B, 1.0 / dt
    onward = stepped(forced, dt)[:states]
    step, held, risen = onward[:, :states], onward[:, states], onward[:, -1]
    poles, V = np.linalg.eig(step @ (np.eye(states) - gain @ H))
    # Each of its own directions follows by itself.
    before, after = np.linalg.solve(V, np.stack([held - risen - step @ gain @ D, risen], axis=1)).T
    along = (before + turn[:, None] * after) / (turn[:, None] - poles)
    at_once = place.row[kept:] ** 2 @ np.asarray(problem.predictor.left.flexibility)
    return _Responses(along @ (place.row[:kept] @ V[:kept]) - at_once, -(along @ (H @ V).T + D))


def _dynamic_stiffness(
    law: AttachedOscillator, s: Complex[np.ndarray, " F"]
) -> Complex[np.ndarray, " F"]:
    """Force over the deflection of its foot, both times exp(s t)."""
    m, k, c = (float(value) for value in (law.m, law.k, law.c))
    carried = k + c * s
    return m * s**2 * carried / (m * s**2 + carried)
