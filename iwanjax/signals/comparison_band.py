"""The band in which recordings are compared: below what a recorder's filter spoils."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

END = 0.35
"""Its end as a share of the sampling rate, where half is left: recorders fade out towards 0.4,
while forces inside the structure do not."""
# Half the filter's length, samples; Kaiser's beta.
_BETA = 5.0
HALF = 16
"""Samples on either side that a compared value depends on."""
_AT = np.arange(-HALF, HALF + 1)
_TAPS = np.sinc(2.0 * END * _AT) * np.kaiser(2 * HALF + 1, _BETA)
_TAPS = _TAPS / _TAPS.sum()
OF_NOISE = float(np.sqrt(np.sum(_TAPS**2)))
"""Share of white noise's deviation that is in the band."""
CORRELATION = np.correlate(_TAPS, _TAPS, "full")[2 * HALF :]
"""Covariance of what the band leaves of white noise of unit variance, by samples apart from 0."""


def passed(size: int) -> np.ndarray:
    """Share of each frequency of a real Fourier transform of so many samples that is in it."""
    wide = np.zeros(size)
    wide[_AT] = _TAPS
    return np.fft.rfft(wide).real


def in_band(e: Float[Array, "N sensors"]) -> Float[Array, "N sensors"]:
    """What of a signal is in the band, without delay; zeros before and after it."""
    wide = jnp.pad(e, [(HALF, HALF), (0, 0)])
    mirrored = (wide[i : i + len(e)] + wide[2 * HALF - i :][: len(e)] for i in range(HALF))
    return _TAPS[HALF] * e + sum(
        (t * x for t, x in zip(_TAPS[:HALF], mirrored, strict=True)), jnp.zeros(())
    )


def over_pairs(
    x: Float[np.ndarray, "*way N sensors"], by_lag: Float[np.ndarray, " lags"]
) -> Float[np.ndarray, "*way sensors"]:
    r"""The quadratic form of a symmetric Toeplitz matrix whose first column ends with zeros.

    .. math:: \sum_{ij} x_i\, c_{|i-j|}\, x_j

    Parameters
    ----------
    x : (..., N, sensors) array
        Samples of each sensor.
    by_lag : (lags,) array
        :math:`c` by samples apart, from 0; zero beyond.
    """
    size = x.shape[-2] + len(by_lag)
    power = np.abs(np.fft.rfft(x, size, axis=-2)) ** 2
    pairs = np.fft.irfft(power, size, axis=-2)[..., : len(by_lag), :]
    return by_lag[0] * pairs[..., 0, :] + 2.0 * np.einsum(
        "l,...ls->...s", by_lag[1:], pairs[..., 1:, :]
    )
