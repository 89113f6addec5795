"""Evidence of fits, and the probability that the truth is not among what was tried."""

import math
from collections.abc import Sequence

import numpy as np

# Logistic regression of wrong verdicts on the logarithm of what a fit leaves beyond the noise,
# over 52 outcomes of the 48 concealed cases of development, 7 of them wrong: as likely wrong as
# right where the residual is 1.6 times the noise.
_AS_LIKELY, _POWER = 0.6, 1.8

AS_LIKELY_WRONG = 1.0 + _AS_LIKELY
"""Error over the noise's at which a model is as likely wrong as right."""


def log_evidence(
    costs: Sequence[float], unknowns: Sequence[int], count: int, temperature: float, tau: float
) -> np.ndarray:
    """Of fits by what they leave of so many values, and by how many they have adjusted."""
    spent = 0.5 * np.asarray(unknowns) * math.log(count / tau)
    return -np.asarray(costs) / (2.0 * temperature * tau) - spent


def misspecification_probability(ratio: float) -> float:
    r"""Probability that the truth is not among what was tried.

    Evidence compares what was tried and found; where the best of it leaves the residual at r
    times the noise,

    .. math:: \frac{P}{1-P} = \left(\frac{r-1}{0.6}\right)^{1.8}

    Parameters
    ----------
    ratio : float
        Free-run error over recordings, over that of a right model; NaN, which doubts nothing,
        without recordings.
    """
    if math.isnan(ratio):
        return 0.0
    odds = (max(ratio - 1.0, 0.0) / _AS_LIKELY) ** _POWER
    return 1.0 / (1.0 + 1.0 / odds) if odds > 0.0 else 0.0


def shares(values: np.ndarray) -> np.ndarray:
    """Probabilities of log evidences."""
    weight = np.exp(values - np.max(values))
    return weight / weight.sum()


MODEL_ERROR_ALLOWANCE = 0.06
"""Share of the squared residual that the model's own errors, of integration say, may be worth."""

LEAST_GAIN = 12.0
"""Something is missing when the evidence for it exceeds that for nothing by this: so much likelier
is nothing before the data, as many suspects are tried and no model is free of errors."""


# Singular values of slopes that count as none, over the largest, each parameter in units of its
# own effect: what derivatives are exact to. A share in such a direction is one beyond its root.
_LEAST_SEEN = 1e-10


def linearised(slopes: np.ndarray, cost: float, tau: float) -> np.ndarray:
    """Standard deviations of parameters: NaN where nothing depends on one, endless where values
    depend on it only together with others, as on the strength and the spread of a joint that
    never slips altogether.

    Times the misfit where that exceeds 1; residuals that are correlated over some values, as all
    misfit is along a curve, count as so many fewer.

    Parameters
    ----------
    slopes : (values, parameters) array
        Of the residuals.
    cost : float
        Sum of their squares.
    tau : float
        Correlation time of the residuals, in values.
    """
    sizes = np.linalg.norm(slopes, axis=0)
    used = sizes > 0
    _, s, along = np.linalg.svd(slopes[:, used] / sizes[used])
    s = np.append(s, np.zeros(len(along) - len(s)))
    seen = s > _LEAST_SEEN * np.max(s, initial=0.0)
    # The pseudo-inverse leaves out what is not seen: as if it were known without error.
    unseen = np.linalg.norm(along[~seen], axis=0) > math.sqrt(_LEAST_SEEN)
    inverse = along[seen].T / s[seen]
    std = np.full(len(sizes), math.nan)
    # Each parameter takes up one independent residual, and one at least is left.
    tau = max(1.0, tau)
    misfit = cost / max(tau, len(slopes) - tau * int(used.sum()))
    std[used] = np.where(unseen, math.inf, np.linalg.norm(inverse, axis=1)) / sizes[used]
    std[used] *= math.sqrt(max(1.0, misfit) * tau)
    return std
