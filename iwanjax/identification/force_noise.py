"""What the noise of forces that act throughout does to a prediction.

A hammer's force is silent beside its pulse: its noise is measured there, and zero elsewhere. A
shaker's is not: its noise drives the model as well, and a right model is off by what it does.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from iwanjax.identification.linearise import residuals_at
from iwanjax.identification.problem import HistoryProblem, Hypothesis


def moved_by_force_noise(
    problem: HistoryProblem,
    hypothesis: Hypothesis,
    theta: Float[np.ndarray, "recordings values"],
    time_constant: float,
    draws: int,
) -> Float[np.ndarray, "draws recordings N sensors"]:
    """Changes of the residuals by noise of the lasting forces, drawn so many times.

    The model's own joints and effects take part, so that a resonance is as broad as it is at the
    amplitude that was measured.

    Parameters
    ----------
    problem : HistoryProblem
        Whose forces have a noise (:class:`~.conditioning.MeasuredForces`).
    hypothesis, theta
        The model.
    time_constant : float
        Memory of the observer; infinity for the free run.
    draws : int
        Realisations of the noise; their changes are independent of one another.

    Returns
    -------
    (draws, recordings, N, sensors) array
        Weighted; no draws without such a noise, and zero where the model diverges in a recording.
    """
    forces, data = problem.forces, problem.data
    if forces is None or not np.any(forces.noise):
        return np.zeros((0, *data.weight.shape))
    random = np.random.default_rng(0)
    (before,) = residuals_at(problem, [(hypothesis, theta)], time_constant)
    found: list[np.ndarray] = []
    for _ in range(draws):
        noise = forces.noise[:, None] * random.standard_normal(forces.clean.shape)
        moved = replace(problem, data=forces.acting(problem.predictor, data, noise))
        (after,) = residuals_at(moved, [(hypothesis, theta)], time_constant)
        found.append(after - before)
    changes = np.stack(found)
    lasts = np.all(np.isfinite(changes), axis=(0, 2, 3))
    return np.where(lasts[:, None, None], changes, 0.0)


def mean_and_scatter(
    moved: Float[np.ndarray, "draws recordings N sensors"],
) -> tuple[Float[np.ndarray, " recordings"], Float[np.ndarray, " recordings"]]:
    r"""Mean of a change's sum of squares in each recording, and the variance of that sum.

    With the covariance S of a Gaussian change, by independent draws :math:`d_i` of it,

    .. math:: \mathrm{tr}\, S = \langle d_i^T d_i \rangle, \quad
              2\, \mathrm{tr}\, S^2 = 2\, \langle (d_i^T d_j)^2 \rangle_{i \neq j} .

    Parameters
    ----------
    moved : (draws, recordings, N, sensors) array
        Two draws at least.
    """
    gram = np.einsum("irns,jrns->rij", moved, moved)
    squares, apart = np.einsum("rii->ri", gram), ~np.eye(len(moved), dtype=bool)
    return squares.mean(axis=1), 2.0 * np.mean(gram[:, apart] ** 2, axis=1)
