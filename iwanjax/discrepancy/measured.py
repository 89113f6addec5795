"""Recordings as a diagnosis needs them: forces without their noise, residuals' weights."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from iwanjax.discrepancy.refit import Data
from iwanjax.errors import InputError

# A force counts where it exceeds so many deviations of its noise, or this share of its peak.
_ABOVE_NOISE, _ABOVE_PEAK, _BESIDE = 6.0, 1e-3, 2
# Samples before the first force that a sensor's noise is measured on, and those beside it that
# a sensor's own filter may spoil.
_ENOUGH, _SPOILT = 20, 5
# Share of a channel's root mean square that a model may be off by and still be right.
_MODEL_ERROR = 0.005


@dataclass(frozen=True, eq=False)
class Transient:
    """One recording with force.

    Parameters
    ----------
    name : str
        For reports.
    response : (N, sensors) array
        As measured, all recordings with the same sensors in the same order.
    force : (N, inputs) array
        As measured, zero for inputs that were not hit.
    use : {"fit", "hold_out"}
        Whether a fit may see it.
    """

    name: str
    response: Float[np.ndarray, "N sensors"]
    force: Float[np.ndarray, "N inputs"]
    use: Literal["fit", "hold_out"] = "fit"


@dataclass(frozen=True, eq=False)
class Prepared:
    """Recordings side by side, the shorter ones filled up.

    Attributes
    ----------
    names : tuple of str
        Of the recordings.
    data : Data
        Forces cleaned, weights zero where nothing was measured.
    noise : (recordings, sensors) array
        Standard deviation of each sensor's noise.
    force_noise : (recordings, inputs) array
        The same of the forces.
    """

    names: tuple[str, ...]
    data: Data
    noise: np.ndarray
    force_noise: np.ndarray

    def drawn(self, random: np.random.Generator) -> Data:
        """The data with the forces' noise once more in their pulses."""
        force = np.asarray(self.data.force)
        recordings, samples, _, inputs = force.shape
        errors = np.zeros((recordings, samples, inputs))
        for row, deviation in zip(errors, self.force_noise, strict=False):
            row[:] = deviation * random.standard_normal(row.shape)
        spread = np.stack([between(each, force.shape[2]) for each in errors])
        return self.data._replace(force=jnp.asarray(force + np.where(force != 0, spread, 0.0)))


def prepared(
    recordings: Sequence[Transient],
    known_noise: np.ndarray,
    length: int,
    count: int,
    substeps: int,
) -> Prepared:
    """Clean forces and weigh residuals.

    Parameters
    ----------
    recordings : sequence of Transient
        To be compared together.
    known_noise : (sensors,) array
        Standard deviations that the study gives; NaN where it does not.
    length, count : int
        Samples, and recordings, to fill up to: kernels are compiled for one shape.
    substeps : int
        Steps between samples.

    Raises
    ------
    InputError
        For recordings that are not finite, and those whose forces are all zero.
    """
    force, response, weight, noises, force_noises = [], [], [], [], []
    for each in recordings:
        for array, what in ((each.response, "response"), (each.force, "force")):
            if not np.all(np.isfinite(array)):
                raise InputError(f"{each.name}: {what} holds NaN or infinite values")
        if not np.any(each.force):
            raise InputError(
                f"{each.name}: the force is zero throughout; a diagnosis needs recordings with "
                "the force that made them"
            )
        cleaned, first, force_noise = _cleaned(each.force)
        noise = np.where(np.isnan(known_noise), _noise(each.response, first), known_noise)
        rms = np.sqrt(np.mean(each.response**2, axis=0))
        if np.any(rms == 0):
            raise InputError(
                f"{each.name}: sensor {int(np.argmin(rms))} shows nothing at all; leave it out"
            )
        missing = length - len(each.response)
        force.append(between(np.pad(cleaned, ((0, missing), (0, 0))), substeps))
        response.append(np.pad(each.response, ((0, missing), (0, 0))))
        row = 1.0 / np.sqrt(noise**2 + (_MODEL_ERROR * rms) ** 2)
        weight.append(np.pad(np.tile(row, (len(each.response), 1)), ((0, missing), (0, 0))))
        noises.append(noise)
        force_noises.append(force_noise)
    repeated = [i % len(recordings) for i in range(count)]
    filled = [i < len(recordings) for i in range(count)]
    return Prepared(
        tuple(each.name for each in recordings),
        Data(
            jnp.asarray(np.stack([force[i] for i in repeated])),
            jnp.asarray(np.stack([response[i] for i in repeated])),
            jnp.asarray(
                np.stack([weight[i] * own for i, own in zip(repeated, filled, strict=True)])
            ),
        ),
        np.stack(noises),
        np.stack(force_noises),
    )


def between(force: np.ndarray, substeps: int) -> np.ndarray:
    """Forces at the ends of the steps to each sample, (N, substeps, inputs), by cubic splines.

    A hammer's pulse may be ten samples long: straight lines between them lose some of it.
    """
    import scipy.interpolate

    N = force.shape[0]
    spline = scipy.interpolate.CubicSpline(np.arange(N), force)
    ends = np.arange(N)[:, None] - 1.0 + np.arange(1, substeps + 1) / substeps
    found = spline(np.maximum(ends, 0.0))
    # Outside the pulse a spline would ring.
    quiet = (force == 0) & (np.roll(force, 1, axis=0) == 0)
    return np.where(quiet[:, None, :], 0.0, found)


def _cleaned(force: np.ndarray) -> tuple[np.ndarray, int, np.ndarray]:
    """Forces, zero outside their pulses; the first sample of any; each one's noise."""
    cleaned, first = np.zeros_like(force), force.shape[0]
    noise = np.zeros(force.shape[1])
    for i, column in enumerate(force.T):
        peak = np.max(np.abs(column))
        if peak == 0:
            continue
        tail = column[-(len(column) // 4) :]
        noise[i] = 1.4826 * np.median(np.abs(tail - np.median(tail)))
        acting = np.flatnonzero(np.abs(column) > max(_ABOVE_NOISE * noise[i], _ABOVE_PEAK * peak))
        if not acting.size:
            continue
        part = slice(max(0, acting[0] - _BESIDE), acting[-1] + _BESIDE + 1)
        cleaned[part, i] = column[part]
        first = min(first, int(acting[0]))
    return cleaned, first, noise


def _noise(response: np.ndarray, first: int) -> np.ndarray:
    """Of the sensors before the first force; else of third differences at the end."""
    before = response[: max(0, first - _SPOILT)]
    if len(before) >= _ENOUGH:
        return np.std(before, axis=0)
    tail = response[-(len(response) // 8) :]
    # Third differences of white noise have twenty times its variance.
    return np.std(np.diff(tail, 3, axis=0), axis=0) / np.sqrt(20.0)
