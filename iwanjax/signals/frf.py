"""Frequency response functions of recordings, with coherence and scatter."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

import numpy as np
from jaxtyping import Complex, Float

from iwanjax.errors import InputError
from iwanjax.results import AbstractResult
from iwanjax.signals.recording import Recording
from iwanjax.signals.spectral_samples import Excitation, SpectralSamples, spectral_samples

Estimator: TypeAlias = Literal["H1", "H2", "Hv"]
"""Noise in the responses only; in the force only; in both, of equal share."""


@dataclass(frozen=True, eq=False)
class FrequencyResponses(AbstractResult):
    r"""Frequency response functions H(s) at :math:`s = \sigma + i\omega`.

    Attributes
    ----------
    frequency : (F,) array
        Hz.
    frf : (F, s, i) array
        Response per force; of decays the response's spectrum.
    frf_std : (F, s, i) array
        Standard deviation of the complex value by the scatter of averages; NaN where there is
        one average per input, which has none.
    coherence : (F, s) array
        Share of a response's energy that the forces explain; of several averages.
    sensors, inputs : tuple of str
        Names of rows and columns.
    quantities : tuple of str
        What each sensor measures.
    window : float
        sigma, 1/s: what an exponential window adds to the decay rate of every mode.
    excitation : str
        How the structure was driven.
    averages : int
        Hits, periods or blocks.
    """

    frequency: Float[np.ndarray, " F"]
    frf: Complex[np.ndarray, "F s i"]
    frf_std: Float[np.ndarray, "F s i"]
    coherence: Float[np.ndarray, "F s"]
    sensors: tuple[str, ...]
    inputs: tuple[str, ...]
    quantities: tuple[str, ...]
    window: float
    excitation: Excitation
    averages: int

    _units: ClassVar = {"window": "1/s"}

    @property
    def s(self) -> Complex[np.ndarray, " F"]:
        """Where the functions are known, rad/s."""
        return self.window + 2j * np.pi * self.frequency

    @property
    def derivatives(self) -> np.ndarray:
        """Of the displacement, that each sensor measures: 0, 1 or 2, (s,)."""
        orders = {"displacement": 0, "velocity": 1, "acceleration": 2}
        return np.array([orders[each] for each in self.quantities])


def frequency_responses(
    recordings: Sequence[Recording] | Recording,
    band: tuple[float, float] | None = None,
    *,
    estimator: Estimator = "H1",
    excitation: Excitation = "auto",
    period: float | None = None,
    block: float | None = None,
    window: float | None = None,
) -> FrequencyResponses:
    r"""Frequency response functions of hits, periods, noise or free decays.

    .. math::
        H_1 = G_{yf} G_{ff}^{-1}, \qquad H_2 = G_{yy} / G_{fy}, \qquad
        H_v = \sqrt{H_1 H_2}, \qquad
        \mathrm{var} H_{si} = \frac{\sum_n |y_s - H_s f|^2}{n - i} \big[G_{ff}^{-1}\big]_{ii}

    G are sums over the n averages.

    Parameters
    ----------
    recordings : sequence of Recording
        Of one sampling rate and the same sensors. Hits may be at several inputs, one or more
        of each.
    band : (f_1, f_2), optional
        Hz; by default where there is energy.
    estimator : {"H1", "H2", "Hv"}
        H2 and Hv where each average drives one input.
    excitation, period, block, window
        As for :func:`iwanjax.signals.spectral_samples.spectral_samples`.

    Returns
    -------
    FrequencyResponses

    Raises
    ------
    InputError
        As there, for forces that do not tell the inputs apart, and sensors of unknown quantity.

    References
    ----------
    Bendat and Piersol, Random Data, 4th ed., 2010, ch. 7 and 9; Rocklin, Crowley and Vold,
    IMAC 3 (1985) 272, for Hv.
    """
    found = [recordings] if isinstance(recordings, Recording) else list(recordings)
    if not found:
        raise InputError("no recordings; expected one at least")
    for each in found:
        for channel in each.channels:
            if channel.quantity not in ("displacement", "velocity", "acceleration"):
                raise InputError(
                    f"{each.name}: channel {channel.name!r} measures "
                    f"{channel.quantity or 'something unknown'}; expected acceleration, velocity "
                    "or displacement: say which by quantity:"
                )
    samples = spectral_samples(
        found, band, excitation=excitation, period=period, block=block, window=window
    )
    if estimator not in ("H1", "H2", "Hv"):
        raise InputError(f"estimator = {estimator!r}; expected H1, H2 or Hv")
    H, inverse = _first(samples)
    f, y = samples.force, samples.response
    n, _, i = f.shape
    left = np.sum(np.abs(y - np.einsum("fsi,nfi->nfs", H, f)) ** 2, axis=0)
    whole = np.sum(np.abs(y) ** 2, axis=0)
    # As sharp as they can be: what explains anything explains one average of each input.
    coherence = 1.0 - left / np.maximum(whole, np.finfo(float).tiny)
    unexplained = left / (n - i) if n > i else np.full_like(left, np.nan)
    diagonal = np.real(np.einsum("fii->fi", inverse))
    std = np.sqrt(np.einsum("fs,fi->fsi", unexplained, diagonal))
    if estimator != "H1":
        H = _second(samples, H, estimator)
    return FrequencyResponses(
        samples.frequency,
        H,
        std,
        coherence,
        samples.sensors,
        samples.inputs,
        samples.quantities,
        samples.window,
        samples.excitation,
        n,
    )


def _first(samples: SpectralSamples) -> tuple[np.ndarray, np.ndarray]:
    """H1 (F, s, i), and the inverse of the forces' G (F, i, i)."""
    f, y = samples.force, samples.response
    G_ff = np.einsum("nfi,nfj->fij", f, f.conj())
    G_yf = np.einsum("nfs,nfj->fsj", y, f.conj())
    size = np.sqrt(np.real(np.einsum("fii->fi", G_ff)))
    size = np.where(size > 0.0, size, 1.0)
    condition = np.linalg.cond(G_ff / (size[:, :, None] * size[:, None, :]))
    if f.shape[0] < f.shape[2] or np.any(condition > _SEPARATE):
        raise InputError(
            f"the forces do not tell the inputs {', '.join(samples.inputs)} apart: of "
            f"{f.shape[0]} average(s) for {f.shape[2]} input(s); record each input on its own, "
            "leave inputs out that were not driven, or narrow the band to where forces act"
        )
    inverse = np.linalg.inv(G_ff)
    return G_yf @ inverse, inverse


# Condition of the forces' cross spectra beyond which half of the digits are lost.
_SEPARATE = float(np.finfo(float).eps ** -0.5)


def _second(samples: SpectralSamples, first: np.ndarray, estimator: Estimator) -> np.ndarray:
    """H2 or Hv of averages that drive one input each."""
    f, y = samples.force, samples.response
    driven = np.sum(np.abs(f) ** 2, axis=1)
    if np.any(np.count_nonzero(driven, axis=1) > 1):
        raise InputError(
            f"estimator {estimator}: several inputs were driven at once; expected H1 for these"
        )
    found = np.empty_like(first)
    for i in range(f.shape[2]):
        own = driven[:, i] > 0
        cross = np.einsum("nfs,nf->fs", y[own].conj(), f[own, :, i])
        found[:, :, i] = np.sum(np.abs(y[own]) ** 2, axis=0) / cross
    return found if estimator == "H2" else np.sqrt(np.abs(found / first)) * first
