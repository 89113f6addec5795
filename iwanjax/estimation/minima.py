"""How sure an estimate is where other minima of the search explain the data as well."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from iwanjax.estimation.evidence import shares
from iwanjax.estimation.parameters import Parameter

# What a logarithm takes zero for, over the value at the best minimum.
_NONE = 1e-3
# Distance in deviations, squared and with that of the prior, below which two ends of a search are
# in one minimum.
_SAME = 1.0


class Minimum(NamedTuple):
    """An end of a search and what the problem says there.

    Attributes
    ----------
    theta : (parameters,) array
    cost : float
        Sum of squared residuals over their deviations.
    slope : (residuals, parameters) array
        Derivative of the residuals.
    derived, derived_slope : mapping of str to array
        What follows from the parameters, and its derivatives (parameters,).
    """

    theta: np.ndarray
    cost: float
    slope: np.ndarray
    derived: Mapping[str, np.ndarray]
    derived_slope: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Mixture:
    """Minima of one fit as a mixture of normal distributions.

    All is in units of each moving parameter's prior deviation in its transform.

    Attributes
    ----------
    singular, rows : arrays of the singular value decomposition of the best one's slope
    alone : (moving, moving) array
        Covariance at the best minimum.
    covariance : (moving, moving) array
        Mean square distance from the best minimum over the mixture.
    weight : (minima,) array
        Of each minimum, the best first; they sum to one.
    derived : dict of str to (float, float)
        What follows from the parameters at the best minimum, with deviations over all.
    """

    singular: np.ndarray
    rows: np.ndarray
    alone: np.ndarray
    covariance: np.ndarray
    weight: np.ndarray
    derived: dict[str, tuple[float, float]]


def mixture(
    minima: Sequence[Minimum],
    parameters: Sequence[Parameter],
    moving: Sequence[int],
    spread: np.ndarray,
    misfit: float,
) -> Mixture:
    r"""Weigh minima by their evidence, and measure how far the truth may lie from the best.

    Each minimum k is normal, its residuals linearised, closed by the prior; its weight is
    Laplace's evidence

    .. math:: w_k \propto p(\theta_k)\,e^{-\chi_k^2/(2m^2)}\sqrt{\det C_k},

    where m is the misfit (at least 1). A kink that noise has made between two levels has a
    lower :math:`\chi^2` than a wide minimum and little volume. About the best estimate the
    mixture has :math:`\sum_k w_k[C_k + (\theta_k-\theta_1)(\theta_k-\theta_1)^T]`.

    Parameters
    ----------
    minima : sequence of Minimum
        The best first; ends in the same minimum count once.
    parameters : sequence of Parameter
    moving : sequence of int
        Which of them are neither fixed nor on a bound.
    spread : (moving,) array
        Deviation of each one's prior at the best minimum.
    misfit : float
        Root of chi^2 per degree of freedom.
    """
    own = [parameters[i] for i in moving]
    m2 = max(misfit, 1.0) ** 2
    origin = minima[0].theta
    kept: list[tuple[Minimum, np.ndarray, np.ndarray, np.ndarray]] = []
    for each in minima:
        off = _distance(own, moving, spread, origin, each.theta)
        units = spread * _scale(own, moving, origin, each.theta)
        slope = each.slope[:, list(moving)] * units / np.sqrt(m2)
        if not np.all(np.isfinite(slope)) or not np.all(np.isfinite(off)):
            continue
        apart = [np.sum((J @ (off - at)) ** 2) + np.sum((off - at) ** 2) for _, at, J, _ in kept]
        if not apart or min(apart) > _SAME:
            kept.append((each, off, slope, units))
    log_weight, covariances = [], []
    log_prior = _log_priors([each.theta for each, *_ in kept], own, moving)
    for (each, _, slope, units), prior in zip(kept, log_prior, strict=True):
        _, singular, rows = np.linalg.svd(slope, full_matrices=False)
        inverse = 1.0 / np.hypot(singular, 1.0)
        covariances.append((rows.T * inverse**2) @ rows)
        log_weight.append(
            prior + np.sum(np.log(units)) - 0.5 * each.cost / m2 + np.sum(np.log(inverse))
        )
    weight = shares(np.array(log_weight))
    _, singular, rows = np.linalg.svd(kept[0][2], full_matrices=False)
    offsets = np.stack([off for _, off, *_ in kept])
    covariance = np.einsum("k,kij->ij", weight, np.stack(covariances))
    covariance += np.einsum("k,ki,kj->ij", weight, offsets, offsets)
    derived = {}
    for name, value in kept[0][0].derived.items():
        best, square = float(value), 0.0
        for w, (each, _, _, units), C in zip(weight, kept, covariances, strict=True):
            slope = np.asarray(each.derived_slope[name])[list(moving)] * units
            square += w * (slope @ C @ slope + (float(each.derived[name]) - best) ** 2)
        derived[name] = (best, float(np.sqrt(max(0.0, square))))
    return Mixture(singular, rows, covariances[0], covariance, weight, derived)


def _distance(
    own: Sequence[Parameter],
    moving: Sequence[int],
    spread: np.ndarray,
    origin: np.ndarray,
    theta: np.ndarray,
) -> np.ndarray:
    """From one set of parameters to another, in prior deviations of each one's transform."""
    a, b = origin[list(moving)], theta[list(moving)]
    log = np.array([p.transform == "log" for p in own])
    return np.where(log, np.log(_ratio(a, b)) * a, b - a) / spread


def _scale(
    own: Sequence[Parameter], moving: Sequence[int], origin: np.ndarray, theta: np.ndarray
) -> np.ndarray:
    """How a prior's deviation changes from one set to another: with the value for a logarithm."""
    ratio = _ratio(origin[list(moving)], theta[list(moving)])
    return np.where([p.transform == "log" for p in own], ratio, 1.0)


def _ratio(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of what is positive, for logarithms: b over a."""
    return np.maximum(b / np.where(a == 0.0, 1.0, a), _NONE)


def _log_priors(
    points: Sequence[np.ndarray], own: Sequence[Parameter], moving: Sequence[int]
) -> np.ndarray:
    """Logarithm of the priors' density at each point; a prior that excludes one is left out."""
    total = np.zeros(len(points))
    for i, p in zip(moving, own, strict=True):
        each = np.asarray(p.prior.log_density(jnp.asarray([theta[i] for theta in points])))
        total += each if np.all(np.isfinite(each)) else 0.0
    return total
