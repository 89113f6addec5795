"""What each place of a structure did in the recordings, by an observer that follows them."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from iwanjax.identification.observer import observer_gain, process_noise, stepped
from iwanjax.identification.problem import HistoryProblem
from iwanjax.joints import Scales
from iwanjax.types import ArrayLike


class Followed(NamedTuple):
    """States that follow the recordings.

    Attributes
    ----------
    q, v : (recordings, N, modes) array
        Modal displacements and velocities.
    """

    q: np.ndarray
    v: np.ndarray


def followed(problem: HistoryProblem) -> Followed:
    """Modal states by a linear observer with a short memory, the joints at their tangents.

    What the model lacks is small over one cycle, so that deflections and rates come out nearly
    right whatever is missing.
    """
    predictor = problem.predictor
    A, H = problem.rest()
    dt = float(predictor.dt) * predictor.substeps
    step, scaled = stepped(A, dt), H / problem.noise[:, None]
    time_constant = problem.settings.conditioning.back_time_constant
    gain = observer_gain(step, scaled, dt, process_noise(step, scaled, dt, time_constant))
    gain = gain / problem.noise
    kept, substeps = predictor.kept, predictor.substeps
    short = stepped(A, float(predictor.dt))
    push, y = np.asarray(problem.data.push), np.asarray(problem.data.response)
    # A sensor that a recording lacks corrects nothing in it.
    there = np.any(np.asarray(problem.data.weight) > 0, axis=1)
    direct = predictor.at_once(push[:, :, -1])
    z = np.zeros((y.shape[0], 2 * kept))
    states = np.zeros((*y.shape[:2], 2 * kept))
    for n in range(y.shape[1]):
        for k in range(substeps):
            z = z @ short.T + push[:, n, k, : 2 * kept]
        z = z + (there * (y[:, n] - direct[:, n] - z @ H.T)) @ gain.T
        states[:, n] = z
    return Followed(states[..., :kept], states[..., kept:])


@dataclass(frozen=True, eq=False)
class Place:
    """A place where a force may be missing.

    Attributes
    ----------
    label : str
        Its name.
    row : (modes,) array
        What it sees of the modes.
    scales : Scales
        What it did.
    """

    label: str
    row: np.ndarray
    scales: Scales

    def stopped(self, v: ArrayLike, force: ArrayLike, step: float) -> bool:
        r"""Whether a force stops the place within a step, :math:`m\,v < F\,\Delta t`.

        A predictor that corrects its forces once a step follows no such law but a linear one.

        Parameters
        ----------
        v, force : array_like
            Rates of the place and forces there, of which the root mean squares count.
        step : float
            s.
        """
        momentum = self.scales.mass * float(np.sqrt(np.mean(np.square(v))))
        return momentum < step * float(np.sqrt(np.mean(np.square(force))))


def places_of(
    problem: HistoryProblem, seen: Followed, rows: dict[str, np.ndarray]
) -> tuple[Place, ...]:
    """Places by their rows on all modes, with what they have seen."""
    seen_at = np.any(np.asarray(problem.data.weight) > 0, axis=2)
    predictor, kept = problem.predictor, problem.predictor.kept
    omega2, left = np.asarray(predictor.omega2), np.asarray(predictor.left.flexibility)
    duration = float(np.max(np.sum(seen_at, axis=1))) * float(predictor.dt) * predictor.substeps
    # A rigid body withstands nothing: what holds it is its inertia.
    elastic = omega2 > 0.0
    lowest, highest = (math.sqrt(float(end(omega2[elastic]))) for end in (np.min, np.max))
    found = []
    for label, row in rows.items():
        d, v = (np.where(seen_at, x @ row[:kept], 0.0) for x in seen)
        largest = float(np.max(np.abs(d)))
        rate = float(np.sqrt(np.mean(v**2)))
        period = 2.0 * np.pi * float(np.sqrt(np.mean(d**2))) / rate if rate > 0 else 1.0
        squares = np.asarray(row) ** 2
        moved, other = squares[:kept], squares[kept:]
        flexibility = float(np.sum(moved[elastic] / omega2[elastic]) + np.sum(other * left))
        scales = Scales(
            max(largest, 1e-300),
            max(period, 1e-12),
            duration,
            1.0 / max(flexibility, 1e-300),
            1.0 / max(float(np.sum(moved)), 1e-300),
            lowest,
            highest,
        )
        found.append(Place(label, row, scales))
    return tuple(found)
