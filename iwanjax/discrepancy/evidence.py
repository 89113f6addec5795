"""How much more likely the data are with a suspect than without."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from iwanjax.discrepancy.band import OF_NOISE
from iwanjax.discrepancy.catalogue import JointKind
from iwanjax.discrepancy.fitting import Fitted
from iwanjax.discrepancy.residuals import correlation_time
from iwanjax.discrepancy.search import Search

# No model is trusted to explain its residual better than this share of the noise's variance.
_LEAST_TEMPERATURE = 0.3
# Logistic regression of wrong verdicts on the logarithm of what a fit leaves beyond the noise,
# over 52 outcomes of the 48 concealed cases of development, 7 of them wrong: as likely wrong as
# right where the residual is 1.6 times the noise.
_AS_LIKELY, _POWER = 0.6, 1.8
AS_LIKELY_WRONG = 1.0 + _AS_LIKELY
"""Error over the noise's at which a model is as likely wrong as right."""


class Evidence(NamedTuple):
    r"""Log evidences :math:`-S/(2T\tau) - \frac{k}{2}\ln(N/\tau)` of fits to the same data.

    Attributes
    ----------
    values : (fits,) array
        Of each.
    temperature : float
        Squared residual of the best over the number N of values.
    tau : float
        Its correlation time in samples.
    """

    values: np.ndarray
    temperature: float
    tau: float

    def worth(self, fitted: Fitted) -> float:
        """Evidence that the whole residual of a fit stands for."""
        return fitted.cost / (2.0 * self.temperature * self.tau)

    def at(self, search: Search, fits: Sequence[Fitted], temperature: float) -> "Evidence":
        """The same fits at another temperature."""
        costs, known = zip(*((each.cost, unknowns(each)) for each in fits), strict=True)
        count = values_measured(search)
        values = log_evidence(costs, known, count, temperature, self.tau)
        return Evidence(values, temperature, self.tau)


def evidence(search: Search, fits: Sequence[Fitted]) -> Evidence:
    """Of fits with the same memory, all at the temperature and correlation of the best."""
    best = min(fits, key=lambda each: each.cost)
    count = values_measured(search)
    temperature = max(_LEAST_TEMPERATURE, float(best.misfit.sum()) / count)
    tau = correlation_time(best.residual)
    return Evidence(np.zeros(0), temperature, tau).at(search, fits, temperature)


def log_evidence(
    costs: Sequence[float], unknowns: Sequence[int], count: int, temperature: float, tau: float
) -> np.ndarray:
    """Of fits by what they leave of so many values, and by how many they have adjusted."""
    spent = 0.5 * np.asarray(unknowns) * math.log(count / tau)
    return -np.asarray(costs) / (2.0 * temperature * tau) - spent


def covariance(search: Search, fitted: Fitted) -> np.ndarray:
    """Of what was free in a fit, (free, free), by the residual's own size.

    Residuals that are correlated over some samples count as so many fewer. NaN where the model
    broke down.
    """
    if not np.all(np.isfinite(fitted.normal)):
        return np.full_like(fitted.normal, np.nan)
    table = evidence(search, [fitted])
    return table.temperature * table.tau * np.linalg.pinv(fitted.normal)


def values_measured(search: Search) -> int:
    """Number of samples that a residual is taken of."""
    return int(np.count_nonzero(np.asarray(search.data.weight)))


def left_by_noise(search: Search) -> float:
    """Squared residual that the sensors' noise alone leaves.

    Weights allow for errors of the model too, so that it is less than the number of samples.
    """
    weight = np.asarray(search.data.weight)
    return float(np.sum((OF_NOISE * search.noise * weight) ** 2))


def scale(search: Search, fitted: Fitted, unsure: float = 0.0) -> float:
    """What differences of squares between rivals of a fit are to be divided by.

    What exceeds the noise is the model's own error. It goes a few ways only, an amplitude and a
    phase of each mode in each recording, and so speaks for or against any rival by chance, more
    than white noise of that size would.

    Parameters
    ----------
    search : Search
        That it was fitted with.
    fitted : Fitted
        The best model.
    unsure : float
        Share of the noise's square that may be error of the model as well.
    """
    table = evidence(search, [fitted])
    error = float(fitted.misfit.sum()) - (1.0 - unsure) * left_by_noise(search)
    ways = 2 * search.predictor.kept * search.recordings
    return max(table.temperature * table.tau, 1.0 + error / ways)


def unknowns(fitted: Fitted) -> int:
    """Number of values fitted beyond those of the joints as given."""
    hypothesis = fitted.hypothesis
    own = sum(hypothesis.sizes) + sum(hypothesis.shapes)
    return own + sum(len(k.parameters) for k in hypothesis.kinds if isinstance(k, JointKind))


def untried(ratio: float) -> float:
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
