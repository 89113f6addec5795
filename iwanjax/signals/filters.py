"""Filters that let one mode through without shifting its phase."""

import numpy as np

from iwanjax.errors import InputError
from iwanjax.types import ArrayLike

# Of the kernel's integral, what still lies beyond the time at which it counts as settled.
_SETTLED = 1e-4
# Steeper filters ring for longer than any decay.
_HIGHEST_ORDER = 10


def band_pass_gain(frequency: np.ndarray, band: tuple[float, float], order: int) -> np.ndarray:
    r"""Gain of a Butterworth band-pass run forwards and backwards.

    .. math:: |H(f)|^2 = \frac{1}{1 + u^{2n}}, \qquad u = \frac{f^2 - f_1 f_2}{f\,(f_2 - f_1)}

    real and positive, so that no frequency's phase moves.

    Parameters
    ----------
    frequency : (...) array
        Hz, not negative.
    band : (f_1, f_2)
        Corners, Hz, where half of the amplitude passes.
    order : int
        Order n of the prototype.

    Returns
    -------
    (...) array
        Between 0 and 1.
    """
    low, high = band
    f = np.maximum(frequency, 1e-9 * low)
    with np.errstate(over="ignore"):
        return 1.0 / (1.0 + ((f * f - low * high) / (f * (high - low))) ** (2 * order))


def settling_time(band: tuple[float, float], order: int) -> float:
    """Seconds after a jump until the zero-phase band-pass has forgotten all but 1e-4 of it.

    Found from the envelope of the band-pass's own kernel.
    """
    low, high = band
    width = high - low
    step = 1.0 / (8.0 * high)
    count = 1 << int(np.ceil(np.log2(64.0 / (width * step))))
    gain = band_pass_gain(np.fft.rfftfreq(count, step), band, order)
    one_sided = np.concatenate([gain, np.zeros(count - gain.size)])
    kernel = np.abs(np.fft.ifft(one_sided))[: count // 2]
    beyond = np.cumsum(kernel[::-1])[::-1] / np.sum(kernel)
    return float(step * np.argmax(beyond < _SETTLED))


def require_resolved(band: tuple[float, float], sampling_rate: float, count: int) -> None:
    """Refuse a band so narrow that its filter rings longer than so many samples last.

    Before anything of the filter is worked out: its kernel might take gigabytes.

    Raises
    ------
    InputError
        For such a band.
    """
    finest = sampling_rate / count
    if band[1] - band[0] < finest:
        raise InputError(
            f"band [{band[0]:g}, {band[1]:g}] Hz is narrower than the {finest:.3g} Hz that a "
            f"recording of {count / sampling_rate:.3g} s resolves; expected a wider one"
        )


def analytic_signal(
    signal: np.ndarray, sampling_rate: float, band: tuple[float, float], order: int = 3
) -> np.ndarray:
    r"""Band-passed signal and, as imaginary part, its Hilbert transform (thesis Eqs. 2.15 to 2.17).

    Both in one Fourier transform, of the signal continued by zeros: what the end of the
    record would do to the beginning falls off like the filter's own kernel instead of like
    the Hilbert transform's 1/t.

    Parameters
    ----------
    signal : (N,) array
        One channel.
    sampling_rate : float
        Hz.
    band : (f_1, f_2)
        Corners, Hz.
    order : int
        Order of the Butterworth prototype.

    Returns
    -------
    (N,) complex array
        exp(psi_1 + i psi_2): envelope and phase of the mode in the band.

    Raises
    ------
    InputError
        For a band so narrow that the filter rings longer than the signal lasts.
    """
    count = signal.size
    require_resolved(band, sampling_rate, count)
    padded = 1 << int(np.ceil(np.log2(count + settling_time(band, order) * sampling_rate)))
    spectrum = np.fft.rfft(signal, padded)
    gain = band_pass_gain(np.fft.rfftfreq(padded, 1.0 / sampling_rate), band, order)
    one_sided = np.zeros(padded, complex)
    one_sided[: spectrum.size] = 2.0 * gain * spectrum
    return np.fft.ifft(one_sided)[:count]


def band_pass(
    signal: ArrayLike, sampling_rate: float, band: tuple[float, float], order: int = 3
) -> np.ndarray:
    """A signal through a zero-phase Butterworth band-pass.

    Parameters
    ----------
    signal : (N,) array_like
        One channel.
    sampling_rate : float
        Hz.
    band : (f_1, f_2)
        Corners, Hz, between 0 and half the sampling rate.
    order : int
        Order of the Butterworth prototype.

    Returns
    -------
    (N,) array

    Raises
    ------
    InputError
        For a signal that is not a row of finite numbers, and a band that is not two rising
        frequencies below half the sampling rate.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> t = np.arange(2048) / 2048
    >>> both = np.sin(2 * np.pi * 50 * t) + np.sin(2 * np.pi * 300 * t)
    >>> one = ij.band_pass(both, 2048, (30, 80))
    >>> float(np.abs(one - np.sin(2 * np.pi * 50 * t))[500:-500].max()) < 0.01
    True
    """
    checked = check_band(band, sampling_rate)
    return np.real(analytic_signal(np.asarray(signal, float), sampling_rate, checked, order))


def modal_filter(responses: ArrayLike, shapes: ArrayLike) -> np.ndarray:
    r"""Modal responses of the sensors' responses, by least squares (thesis Eq. 2.14).

    .. math:: q(t) = \Phi_s^{+} u_s(t)

    the thesis's :math:`\Phi_0^T M u` where every coordinate is a sensor, and what can be
    had of it where only some are.

    Parameters
    ----------
    responses : (N, sensors) array_like
        Time histories, all of one quantity.
    shapes : (sensors, modes) array_like
        Mode shapes at the sensors, ``sensor_rows @ Phi``; at least as many sensors as modes.

    Returns
    -------
    (N, modes) array

    Raises
    ------
    InputError
        When the shapes do not match the sensors, or the sensors cannot tell the modes apart.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> shapes = np.array([[1.0, 1.0], [1.0, -1.0]])  # two sensors, two modes
    >>> q = np.random.default_rng(0).standard_normal((100, 2))
    >>> bool(np.allclose(ij.modal_filter(q @ shapes.T, shapes), q))
    True
    """
    u, Phi = np.asarray(responses, float), np.asarray(shapes, float)
    if u.ndim != 2 or Phi.ndim != 2 or u.shape[1] != Phi.shape[0]:
        raise InputError(
            f"modal_filter: responses {u.shape} and shapes {Phi.shape} do not match; expected "
            "(N, sensors) and (sensors, modes)"
        )
    rank = np.linalg.matrix_rank(Phi)
    if rank < Phi.shape[1]:
        raise InputError(
            f"modal_filter: {Phi.shape[0]} sensor(s) tell only {rank} of {Phi.shape[1]} modes "
            "apart; leave modes out or use more sensors"
        )
    return u @ np.linalg.pinv(Phi).T


def measured_components(responses: ArrayLike, shapes: ArrayLike, sensor: int) -> np.ndarray:
    r"""Parts of a sensor's response by modes, of what all sensors measured (thesis Eq. 3.37).

    .. math:: a_r(t) = \Phi_{s,r}\,\bigl(\Phi^T\Phi\bigr)^{-1}\Phi^T u_s(t)

    the r-th row of the projector meant: each mode by :func:`modal_filter`, seen at the sensor.
    What modes that are not among the shapes contribute is in it as far as they look like these.
    :func:`iwanjax.dynamics.component_rows` are the same of a simulation, which knows all.

    Parameters
    ----------
    responses : (N, sensors) array_like
        Time histories, all of one quantity.
    shapes : (sensors, modes) array_like
        Mode shapes at the sensors; at least as many sensors as modes.
    sensor : int
        Index of the sensor s whose response is taken apart.

    Returns
    -------
    (N, modes) array
        In the responses' unit.

    Raises
    ------
    InputError
        As :func:`modal_filter`, and for a sensor that there is not.
    """
    q, Phi = modal_filter(responses, shapes), np.asarray(shapes, float)
    if not 0 <= sensor < len(Phi):
        raise InputError(f"sensor = {sensor}; expected 0 to {len(Phi) - 1}")
    return q * Phi[sensor]


def check_signal(signal: ArrayLike) -> np.ndarray:
    """The signal as a row of finite real numbers.

    Raises
    ------
    InputError
    """
    try:
        x = np.asarray(signal)
    except ValueError:
        x = np.empty(0, dtype=object)
    if x.dtype.kind not in "biuf":
        raise InputError(f"signal is of type {x.dtype}; expected a row of real numbers")
    if x.ndim != 1:
        raise InputError(f"signal has shape {x.shape}; expected one channel, (N,)")
    bad = np.flatnonzero(~np.isfinite(x))
    if bad.size:
        raise InputError(
            f"signal holds {bad.size} NaN or infinite value(s), the first at sample {bad[0]}; "
            "expected finite numbers"
        )
    return x.astype(float)


def check_band(
    band: tuple[float, float], sampling_rate: float, order: int = 3
) -> tuple[float, float]:
    """The band as two numbers, held against half the sampling rate, and the filter's order.

    Raises
    ------
    InputError
    """
    if not isinstance(order, int) or not 1 <= order <= _HIGHEST_ORDER:
        raise InputError(f"order = {order!r}: expected a whole number from 1 to {_HIGHEST_ORDER}")
    if not (np.isfinite(sampling_rate) and sampling_rate > 0):
        raise InputError(f"sampling_rate = {sampling_rate!r} Hz: expected a positive number")
    try:
        low, high = (float(f) for f in band)
    except (TypeError, ValueError):
        raise InputError(
            f"band = {band!r}: expected two frequencies (low, high) in Hz, for instance (90, 160)"
        ) from None
    if not 0.0 < low < high:
        raise InputError(f"band = ({low:g}, {high:g}) Hz: expected 0 < low < high")
    if high >= 0.5 * sampling_rate:
        raise InputError(
            f"band = ({low:g}, {high:g}) Hz reaches beyond the Nyquist frequency "
            f"{0.5 * sampling_rate:g} Hz of the sampling rate {sampling_rate:g} Hz; lower it"
        )
    return low, high
