r"""Sizes of effects that a diagnosis finds, and names, in nine of ten repetitions.

About size zero the fit is linear: an effect of size s takes

.. math:: \Delta = \tfrac12 (s\sqrt{F/u} + z)^2, \qquad z \sim N(0, 1)

off the log evidence's residual term, with the information F of its size and a unit u of squared
residual. It is found where that pays for its k unknowns, for the least gain that evidence must
have, and for a share of the residual: with a memory of eight cycles what a model's own errors are
granted (:mod:`iwanjax.discrepancy.histories.ranking`), in the free run what it must leave more for
anything new to be looked for (:mod:`iwanjax.discrepancy.histories.further_suspects`). Of long
recordings that asks most. It is named where it is more likely in the free run than the rival
nearest to it, by what of its column the rival's leaves: :math:`F_{ii} - F_{ij}^2/F_{jj}`; than a
rival that it holds as a limit by the former share as well.
"""

import math

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import ndtri

from iwanjax.estimation.evidence import LEAST_GAIN, MODEL_ERROR_ALLOWANCE

POWER = 0.9
"""Share of repetitions in which a smallest size is found."""
QUANTILE = float(ndtri(POWER))
"""Of the normal distribution, that it is the share below."""
# Share of a column's information that rounding leaves of an effect that others do as well.
_NONE = 1e-9


def found_from(
    information: Float[np.ndarray, " effects"],
    unknowns: Float[np.ndarray, " effects"],
    unit: float,
    count: float,
    share: float = MODEL_ERROR_ALLOWANCE,
) -> np.ndarray:
    """Smallest sizes that are found, in units of each effect's size; infinite where none is.

    Parameters
    ----------
    information : (effects,) array
        Diagonal of the Fisher information.
    unknowns : (effects,) array
        How many values each effect has.
    unit : float
        Squared residual of a unit of twice the log evidence.
    count : float
        Independent values in the recordings.
    share : float
        Of the residual that an effect has to be worth.
    """
    needed = LEAST_GAIN + 0.5 * unknowns * math.log(count) + 0.5 * share * count
    return _over(np.sqrt(2.0 * needed) + QUANTILE, information / unit)


def told_apart_from(
    fisher: Float[np.ndarray, "effects effects"],
    unknowns: Float[np.ndarray, " effects"],
    unit: float,
    count: float,
    simpler: Bool[np.ndarray, "effects effects"],
) -> np.ndarray:
    """Sizes of each effect, (effects, rivals), from which it is likelier than each other one.

    Parameters
    ----------
    fisher : (effects, effects) array
        Information of all sizes.
    unknowns, unit, count
        As for :func:`found_from`.
    simpler : (effects, effects) array of bool
        Whether a rival, of a column, is a limit of the effect, of a row.
    """
    own = np.diag(fisher)
    usable = own > 0.0
    alike = np.where(usable, fisher**2 / np.where(usable, own, 1.0), 0.0)
    left = own[:, None] - alike
    left = np.where(left > _NONE * own[:, None], left, 0.0)
    more = (unknowns[:, None] - unknowns) * math.log(count)
    more = more + MODEL_ERROR_ALLOWANCE * count * simpler
    # Solves delta^2 - 2 z delta = more for what one repetition in ten leaves.
    needed = QUANTILE + np.sqrt(np.maximum(QUANTILE**2 + more, 0.0))
    needed = np.where(QUANTILE**2 + more < 0.0, 0.0, needed)
    return _over(needed, left / unit)


def _over(deviations: np.ndarray, information: np.ndarray) -> np.ndarray:
    there = information > 0.0
    return np.where(there, deviations / np.sqrt(np.where(there, information, 1.0)), math.inf)
