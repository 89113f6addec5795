"""Excitations: histories in time, and the rows along which they act.

A history is a function of the instants alone, a row one of the structure alone;
:func:`iwanjax.simulate` takes them apart::

    omega = js.modes().omega[2]
    ij.simulate(js, ij.half_sine(t, 15e3, omega), dt, inputs=ij.point_input(js, 1))

Amplitudes may have a leading axis, one level each: ``half_sine(t, levels[:, None], omega)``
is (levels, N), and with ``[..., None]`` what ``simulate`` takes as a batch.
"""

from functools import partial
from typing import Literal, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwanjax.errors import InputError
from iwanjax.structures import JointedStructure
from iwanjax.structures.checks import finite_array
from iwanjax.types import ArrayLike, as_real, is_traced

Sweep = Literal["linear", "log"]
"""How the frequency of a sweep moves."""


def half_sine(t: ArrayLike, amplitude: ArrayLike, omega: ArrayLike) -> Float[Array, "..."]:
    r"""The hammer of the thesis: :math:`A\sin\omega t` for :math:`0\le t<\pi/\omega`, else 0.

    Parameters
    ----------
    t : (N,) array_like
        Instants, s.
    amplitude : float or (..., 1) array_like
        Peak A, force.
    omega : float
        Circular frequency of the whole sine, rad/s; the blow lasts pi/omega.

    Returns
    -------
    (..., N) array
        Eqs. (2.27) to (2.29), (4.43).

    Raises
    ------
    InputError
        For values that are not finite or a frequency that is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> t = np.linspace(0.0, 0.02, 5)  # s; the blow lasts 10 ms
    >>> ij.half_sine(t, 50.0, np.pi / 0.01).round(1).tolist()
    [0.0, 50.0, 0.0, 0.0, 0.0]
    """
    return _half_sine(as_real(t, "t"), as_real(amplitude, "amplitude"), _positive(omega, "omega"))


def sine(
    t: ArrayLike, amplitude: ArrayLike, omega: ArrayLike, phase: ArrayLike = 0.0
) -> Float[Array, "..."]:
    r"""Steady or ramped excitation :math:`A\sin(\omega t+\varphi)`.

    With a number for A this is the ring-up of (4.40); with a :func:`ramp` the ring-down of
    (4.42) and, with a phase of pi/2, the displacements of (4.23) and (4.24).

    Parameters
    ----------
    t : (N,) array_like
        Instants, s.
    amplitude : float or (..., N) array_like
        A, force or length; it may change with time.
    omega : float
        Circular frequency, rad/s.
    phase : float
        At t = 0, rad.

    Returns
    -------
    (..., N) array

    Raises
    ------
    InputError
        For values that are not finite.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> t = np.array([0.0, 0.25, 0.5, 0.75])
    >>> ij.sine(t, ij.ramp(t, 4.0, 0.0, 1.0), 2 * np.pi).round(1).tolist()  # dies away
    [0.0, 3.0, 0.0, -1.0]
    """
    return _sine(
        as_real(t, "t"),
        as_real(amplitude, "amplitude"),
        as_real(omega, "omega"),
        as_real(phase, "phase"),
    )


def ramp(
    t: ArrayLike, start: ArrayLike, end: ArrayLike, duration: ArrayLike
) -> Float[Array, "..."]:
    """From ``start`` at t = 0 on a straight line to ``end`` at ``duration``, then constant.

    The amplitudes of (4.23), (4.24) and (4.42).

    Parameters
    ----------
    t : (N,) array_like
        Instants, s.
    start, end : float or (..., 1) array_like
        Values, force or length.
    duration : float
        Of the ramp, s.

    Returns
    -------
    (..., N) array

    Raises
    ------
    InputError
        For values that are not finite or a duration that is not positive.

    Examples
    --------
    >>> import iwanjax as ij
    >>> ij.ramp([0.0, 1.0, 2.0, 3.0], 0.0, 4.0, 2.0).tolist()
    [0.0, 2.0, 4.0, 4.0]
    """
    return _ramp(
        as_real(t, "t"),
        as_real(start, "start"),
        as_real(end, "end"),
        _positive(duration, "duration"),
    )


def sweep(
    t: ArrayLike, amplitude: ArrayLike, band: tuple[float, float], kind: Sweep = "linear"
) -> Float[Array, "..."]:
    r"""A sine of which the frequency moves through a band, from the first instant to the last.

    With :math:`\tau` since the first instant and the duration T,

    .. math:: \varphi = 2\pi\left(f_0\tau + \frac{f_1-f_0}{2T}\tau^2\right)\quad\text{or}\quad
              \varphi = \frac{2\pi f_0T}{\ln(f_1/f_0)}\left[(f_1/f_0)^{\tau/T}-1\right]

    Parameters
    ----------
    t : (N,) array_like
        Instants, s, ascending.
    amplitude : float or (..., N) array_like
        Of the sine, force.
    band : (float, float)
        Frequencies f_0 and f_1 at the beginning and the end, Hz; downwards too.
    kind : {"linear", "log"}
        Equal times for equal differences of frequency, or for equal ratios.

    Returns
    -------
    (..., N) array

    Raises
    ------
    InputError
        For frequencies that are not two different positive numbers, and instants that do not
        ascend.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> t = np.arange(4096) / 1024
    >>> crossings = np.diff(np.sign(ij.sweep(t, 1.0, (5.0, 15.0)))) != 0
    >>> int(crossings.sum()) // 2  # cycles in 4 s from 5 to 15 Hz
    40
    """
    instants = as_real(t, "t")
    if instants.ndim != 1 or (not is_traced(instants) and np.any(np.diff(instants) <= 0)):
        raise InputError(f"sweep: t of shape {instants.shape}; expected (N,) ascending instants")
    limits = finite_array(band, "band")
    if limits.shape != (2,) or np.any(limits <= 0) or limits[0] == limits[1]:
        raise InputError(f"sweep: band = {band}; expected two different positive frequencies, Hz")
    if kind not in get_args(Sweep):
        raise InputError(f"sweep: kind = {kind!r}; expected 'linear' or 'log'")
    return _sweep(instants, as_real(amplitude, "amplitude"), *map(float, limits), kind)


def modal_input(
    structure: JointedStructure, mode: int, limit: Literal["low", "high"] = "low"
) -> Float[Array, " n"]:
    r"""The row :math:`M\varphi_r`, along which a force drives one linear mode alone (2.27).

    Parameters
    ----------
    structure : JointedStructure
        With one parameter set.
    mode : int
        Index r among the elastic modes, lowest first.
    limit : {"low", "high"}
        Modes with the joints stuck, which stay clean in microslip, or with all slipping, in
        macroslip. The half sine's frequency is that of the low limit in either case.

    Returns
    -------
    (n,) array
        For ``inputs=``; a force p along it is a modal force p.

    Raises
    ------
    InputError
        For a mode that the structure does not have.

    Examples
    --------
    >>> import iwanjax as ij
    >>> chain = ij.three_mass()
    >>> row = ij.modal_input(chain, 0)
    >>> (chain.modes().Phi.T @ row).round(6).tolist()  # of the three modes only the first is driven
    [1.0, 0.0, 0.0]
    """
    Phi = structure.modes(limit).Phi
    return structure.structure.M @ Phi[:, _index(mode, Phi.shape[1], "mode")]


def point_input(structure: JointedStructure, coordinate: int) -> Float[Array, " n"]:
    """The row of a force on one coordinate (2.29).

    Parameters
    ----------
    structure : JointedStructure
        The structure.
    coordinate : int
        Index of the coordinate.

    Returns
    -------
    (n,) array
        For ``inputs=`` or ``sensors=``.

    Raises
    ------
    InputError
        For a coordinate that the structure does not have.

    Examples
    --------
    >>> import iwanjax as ij
    >>> ij.point_input(ij.three_mass(), 2).tolist()
    [0.0, 0.0, 1.0]
    """
    n = structure.structure.size
    return jnp.asarray(np.eye(n)[_index(coordinate, n, "coordinate")])


def base_input(structure: JointedStructure, direction: ArrayLike) -> Float[Array, " n"]:
    """The row -M r, along which the base's acceleration a(t) acts on coordinates relative to it.

    Parameters
    ----------
    structure : JointedStructure
        Its K holds the supports, so that u = 0 is motion with the base.
    direction : (n,) array_like
        r: displacement of each coordinate when structure and base move by one as a rigid body.

    Returns
    -------
    (n,) array
        For ``inputs=`` with the history of the base's acceleration as force.

    Raises
    ------
    InputError
        For a direction of wrong shape or that is not finite.

    Examples
    --------
    >>> import iwanjax as ij
    >>> ij.base_input(ij.three_mass(), [1.0, 1.0, 1.0]).tolist()
    [-10.0, -10.0, -10.0]
    """
    r, n = finite_array(direction, "direction"), structure.structure.size
    if r.shape != (n,):
        raise InputError(f"direction has shape {r.shape}; expected ({n},) like M")
    return -structure.structure.M @ r


@jax.jit
def _half_sine(t: Array, amplitude: Array, omega: Array) -> Array:
    return jnp.where((t >= 0) & (t < jnp.pi / omega), amplitude * jnp.sin(omega * t), 0.0)


@jax.jit
def _sine(t: Array, amplitude: Array, omega: Array, phase: Array) -> Array:
    return amplitude * jnp.sin(omega * t + phase)


@jax.jit
def _ramp(t: Array, start: Array, end: Array, duration: Array) -> Array:
    return start + (end - start) * jnp.clip(t / duration, 0.0, 1.0)


@partial(jax.jit, static_argnames="kind")
def _sweep(t: Array, amplitude: Array, low: float, high: float, kind: Sweep) -> Array:
    since = t - t[0]
    share = since / since[-1]
    if kind == "linear":
        cycles = since * (low + 0.5 * (high - low) * share)
    else:
        octaves = jnp.log(high / low)
        cycles = since[-1] * low * jnp.expm1(octaves * share) / octaves
    return amplitude * jnp.sin(2.0 * jnp.pi * cycles)


def _positive(value: ArrayLike, name: str) -> Array:
    number = as_real(value, name)
    if not is_traced(number) and np.any(np.asarray(number) <= 0):
        raise InputError(f"{name} = {value}; expected a positive number")
    return number


def _index(value: int, count: int, name: str) -> int:
    if not isinstance(value, int | np.integer) or not 0 <= value < count:
        raise InputError(f"{name} = {value!r}; expected a whole number from 0 to {count - 1}")
    return int(value)
