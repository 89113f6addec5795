"""Free decays of a structure after impacts, mode by mode (thesis Sec. 2.2.3)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from iwanjax.curves import QUANTITIES
from iwanjax.dynamics.propagator import Method
from iwanjax.dynamics.transient import simulate
from iwanjax.errors import InputError
from iwanjax.joints.sliders import SLIDERS
from iwanjax.results import AbstractResult
from iwanjax.signals import Channel, Recording
from iwanjax.signals.filters import analytic_signal, band_pass_gain, modal_filter
from iwanjax.signals.hilbert import RingDown, ringdown
from iwanjax.structures import JointedStructure, modal_assurance
from iwanjax.structures.checks import finite_array
from iwanjax.types import ArrayLike

# The lowest band begins at this share of its mode's least frequency, and the highest ends as
# far above its mode; a band between two modes ends in the middle of them.
_BESIDE = 0.6
# Of the way from a mode to the next one up, what its band has at least: a joint that lowers the
# next one as far as this mode takes nothing from it.
_OWN = 0.25
# Relative distance up to which modes share a band: a corner between them would be within a
# quarter of a per cent of either, and colour the decays that it is to part.
_TOGETHER = 0.01
_ORDER = 3


@dataclass(frozen=True, eq=False)
class ModalDecays(AbstractResult):
    """Result of :func:`iwanjax.modal_decays` and :func:`iwanjax.dynamics.measured_decays`.

    Attributes
    ----------
    structure : JointedStructure
        What was hit.
    time : (N,) array
        s.
    velocity : (cases, N, modes) array
        Modal velocities by the modal filter (2.14).
    envelope : (cases, N, modes) array
        Amplitude of each mode's displacement, from its band-passed velocity over omega.
    ringdowns : tuple of tuple of RingDown or None
        By case and mode; None where the signal holds no decay of that mode.
    reasons : tuple of tuple of str
        Why there is none, else empty.
    bands : tuple of (float, float)
        Of each mode, Hz.
    modes : tuple of int
        The elastic modes, by index.
    """

    structure: JointedStructure = field(repr=False)
    time: Float[np.ndarray, " N"] = field(repr=False)
    velocity: Float[np.ndarray, "cases N modes"] = field(repr=False)
    envelope: Float[np.ndarray, "cases N modes"] = field(repr=False)
    ringdowns: tuple[tuple[RingDown | None, ...], ...] = field(repr=False)
    reasons: tuple[tuple[str, ...], ...]
    bands: tuple[tuple[float, float], ...]
    modes: tuple[int, ...]

    _shown = ("time", "velocity", "envelope", "modes")


def modal_decays(
    structure: JointedStructure,
    force: ArrayLike,
    dt: float,
    *,
    inputs: ArrayLike | None = None,
    modes: Sequence[int | ArrayLike] | None = None,
    bands: Sequence[tuple[float, float] | None] | None = None,
    start: float | None = None,
    method: Method = "exact",
    every: int = 1,
    sliders: int = SLIDERS,
) -> ModalDecays:
    r"""Hit a structure, filter its modes and take their decays apart.

    Procedures I and III of the thesis: a force history (one mode's
    :func:`~iwanjax.dynamics.modal_impact`, or a hit at one point), the modal filter
    :math:`\dot q = \Phi_0^TM\dot u` (2.14), and the Hilbert analysis of
    :func:`~iwanjax.ringdown` for every mode. Procedure II is the same with
    :func:`iwanjax.oscillator`, the modal model, as the structure.

    Parameters
    ----------
    structure : JointedStructure
        What is hit.
    force : (N, inputs) or (N,) or (cases, N, inputs) array_like
        As for :func:`~iwanjax.simulate`; cases are integrated side by side.
    dt : float
        Step, s.
    inputs : (inputs, n) array_like, optional
        Rows along which the forces act.
    modes : sequence of int or of (n,) array_like, optional
        Elastic modes to follow, by default all: by index, lowest 0, or by shape, for which the
        mode with the highest modal assurance is taken.
    bands : sequence of (float, float) or None, optional
        Of the band-pass for each of ``modes``, Hz, in their order. None, and the default: from
        the middle to the next mode on either side, as far as the joints may lower that one; the
        mode itself is always inside.
    start : float, optional
        Beginning of the free decay, s; by default where the force is last other than zero.
    method, every, sliders
        As for :func:`~iwanjax.simulate`.

    Returns
    -------
    ModalDecays

    Raises
    ------
    InputError
        As :func:`~iwanjax.simulate`, and for modes that do not exist, shapes that are two of
        one mode, or bands that do not match them.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> chain, dt = ij.three_mass(zeta=2e-3), 0.2
    >>> push = ij.half_sine(dt * np.arange(8000), 1.0, 0.5)[:, None]  # on the third mass
    >>> decays = ij.modal_decays(chain, push, dt, inputs=[[0, 0, 1]])
    >>> decays.velocity.shape  # cases, samples, modes
    (1, 8000, 3)
    >>> round(float(decays.ringdowns[0][0].curves.frequency[-1]), 4)  # Hz, of the first mode
    0.0676
    """
    which, chosen = _followed(structure, modes, bands)
    Phi = np.asarray(structure.modes("low").Phi)[:, list(which)]
    found = simulate(
        structure,
        force,
        dt,
        inputs=inputs,
        sensors=(np.asarray(structure.structure.M) @ Phi).T,
        keep=("velocity",),
        method=method,
        every=every,
        sliders=sliders,
    )
    velocity = np.asarray(found.velocity)
    velocity = velocity if velocity.ndim == 3 else velocity[None]
    begin = _last_force(np.asarray(force), dt) if start is None else start
    time = np.asarray(found.time)
    return _taken_apart(structure, time, velocity, "velocity", which, chosen, begin)


def measured_decays(
    structure: JointedStructure,
    recordings: Sequence[Recording],
    sensors: Mapping[str, ArrayLike],
    *,
    modes: Sequence[int | ArrayLike] | None = None,
    bands: Sequence[tuple[float, float] | None] | None = None,
    start: float | None = None,
) -> ModalDecays:
    r"""Measured decays taken apart mode by mode: which mode dominates when (thesis Fig. 2.8).

    As :func:`iwanjax.modal_decays`, with :func:`iwanjax.modal_filter` over the sensors. Of modes
    that are not followed the filter sees what looks like those that are.

    Parameters
    ----------
    structure : JointedStructure
        What was hit: its modes at low amplitude.
    recordings : sequence of Recording
        Of one rate, length, and quantity; a case each.
    sensors : mapping of str to (n,) array_like
        What each channel sees is ``row @ u`` or its derivative; a model's ``sensors``. Channels
        that are not among them are left out.
    modes, bands
        As for :func:`iwanjax.modal_decays`; by default as many modes as there are sensors.
    start : float, optional
        Beginning of the free decays, s; by default where :func:`iwanjax.ringdown` finds it.

    Returns
    -------
    ModalDecays

    Raises
    ------
    InputError
        For recordings that are not alike, more modes than sensors can tell, and as
        :func:`iwanjax.modal_decays`.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> from iwanjax.dynamics import measured_decays
    >>> chain, t = ij.three_mass(), np.arange(8192) / 2.0
    >>> q = np.exp(-2e-3 * t) * np.sin(float(chain.modes().omega[0]) * t)
    >>> at = np.asarray(chain.modes().Phi)[:, 0]
    >>> hit = ij.as_recording(
    ...     q[:, None] * at, sampling_rate=2.0, quantity="velocity", sensors=["a", "b", "c"]
    ... )
    >>> decays = measured_decays(chain, [hit], dict(zip("abc", np.eye(3))))
    >>> int(np.argmax(decays.envelope[0, 2000]))  # the mode that dominates
    0
    """
    several = list(recordings)
    channels, quantity = _alike(several)
    seen = [i for i, channel in enumerate(channels) if channel.name in sensors]
    if not seen:
        names = ", ".join(channel.name for channel in channels)
        raise InputError(
            f"measured_decays: no channel of {names} is among the sensors {', '.join(sensors)}"
        )
    rows = np.stack([finite_array(sensors[channels[i].name], "sensors") for i in seen])
    all_of = np.asarray(structure.modes("low").Phi)
    asked = range(min(len(seen), all_of.shape[1])) if modes is None else modes
    which, chosen = _followed(structure, asked, bands)
    shapes = rows @ all_of[:, list(which)]
    histories = np.stack([modal_filter(each.response[:, seen], shapes) for each in several])
    return _taken_apart(structure, several[0].time, histories, quantity, which, chosen, start)


def _alike(recordings: Sequence[Recording]) -> tuple[tuple[Channel, ...], str]:
    """Channels and quantity that all recordings share."""
    if not recordings:
        raise InputError("measured_decays: no recordings")
    first = recordings[0]
    for each in recordings[1:]:
        same = each.size == first.size and np.isclose(each.sampling_rate, first.sampling_rate)
        if not same or [c.name for c in each.channels] != [c.name for c in first.channels]:
            raise InputError(
                f"measured_decays: {each.name} has another rate, length or other channels than "
                f"{first.name}; take such recordings apart one by one"
            )
    quantities = {channel.quantity for each in recordings for channel in each.channels}
    if len(quantities) != 1 or None in quantities:
        raise InputError(
            f"measured_decays: channels measure {', '.join(map(str, quantities))}; expected one "
            f"of {', '.join(QUANTITIES)}"
        )
    return first.channels, str(quantities.pop())


def _followed(
    structure: JointedStructure,
    modes: Sequence[int | ArrayLike] | None,
    bands: Sequence[tuple[float, float] | None] | None,
) -> tuple[tuple[int, ...], tuple[tuple[float, float], ...]]:
    """Modes by their indices, and the band of each."""
    Phi = np.asarray(structure.modes("low").Phi)
    asked = range(Phi.shape[1]) if modes is None else modes
    which = tuple(_mode(structure, Phi, mode) for mode in asked)
    if len(set(which)) != len(which):
        raise InputError(f"modes: these are modes {', '.join(map(str, which))}; expected each once")
    own = _bands(structure)
    given = [None] * len(which) if bands is None else list(bands)
    if len(given) != len(which):
        raise InputError(f"got {len(given)} bands for {len(which)} modes; expected one each")
    chosen = tuple(
        own[mode] if band is None else _band(i, band)
        for i, (mode, band) in enumerate(zip(which, given, strict=True))
    )
    return which, chosen


def _taken_apart(
    structure: JointedStructure,
    time: np.ndarray,
    histories: np.ndarray,
    quantity: str,
    which: tuple[int, ...],
    chosen: tuple[tuple[float, float], ...],
    start: float | None,
) -> ModalDecays:
    """Envelope and ring-down of each modal history (cases, N, modes) of a quantity."""
    rate = 1.0 / float(time[1] - time[0])
    omega = np.asarray(structure.modes("low").omega)[list(which)]
    velocity, envelope = histories.copy(), np.empty_like(histories)
    rows, reasons = [], []
    for case, signals in enumerate(histories):
        row: list[RingDown | None] = []
        told = []
        for i, band in enumerate(chosen):
            signal = signals[:, i]
            # What the band's corner, near where modes are close, takes off the mode.
            gain = band_pass_gain(omega[i] / (2.0 * np.pi), band, _ORDER)
            passed = analytic_signal(signal, rate, band, _ORDER) / gain
            envelope[case, :, i] = np.abs(passed) / omega[i] ** QUANTITIES[quantity]
            if quantity != "velocity":
                turned = passed * (1j * omega[i]) ** (1 - QUANTITIES[quantity])
                velocity[case, :, i] = np.real(turned)
            try:
                name = f"mode {which[i]}"
                row.append(ringdown(signal, rate, band, quantity, name=name, start=start))
                told.append("")
            except InputError as error:
                row.append(None)
                told.append(str(error))
        rows.append(tuple(row))
        reasons.append(tuple(told))
    return ModalDecays(
        structure, time, velocity, envelope, tuple(rows), tuple(reasons), chosen, which
    )


def component_rows(
    structure: JointedStructure, sensor: ArrayLike, modes: Sequence[int]
) -> np.ndarray:
    r"""Rows that show of a motion what each mode adds at a sensor (thesis Eq. 3.36).

    .. math:: a_r(t) = \psi_s\,\varphi_r\,\varphi_r^TM\,\ddot u(t)

    with the mass-normalised shapes at low amplitude (3.4) and the sensor's row, the thesis's
    :math:`\Psi_sL`. As ``sensors=`` of :func:`iwanjax.simulate` they make it keep these
    components; over all modes they add up to the sensor's response, rigid-body motion aside.
    :func:`iwanjax.signals.measured_components` are the same of a measurement.

    Parameters
    ----------
    structure : JointedStructure
        What moves.
    sensor : (n,) array_like
        What the sensor sees is ``sensor @ u``.
    modes : sequence of int
        Elastic modes r, lowest 0.

    Returns
    -------
    (modes, n) array

    Raises
    ------
    InputError
        For modes that do not exist.
    """
    Phi = np.asarray(structure.modes("low").Phi)
    phi = Phi[:, [_mode(structure, Phi, mode) for mode in modes]]
    seen = finite_array(sensor, "sensor") @ phi
    return (np.asarray(structure.structure.M) @ (phi * seen)).T


def _last_force(force: np.ndarray, dt: float) -> float:
    """Time from which on there is no force, s."""
    columns = force[:, None] if force.ndim == 1 else force
    acting = np.flatnonzero(np.any(columns.reshape(-1, *columns.shape[-2:]), axis=(0, 2)))
    return dt * float(acting[-1] + 1) if acting.size else 0.0


def _mode(structure: JointedStructure, Phi: np.ndarray, mode: int | ArrayLike) -> int:
    """Index of an elastic mode, given by it or by its shape."""
    asked = np.asarray(mode)
    if asked.ndim == 0 and asked.dtype.kind in "iu":
        if not 0 <= int(asked) < Phi.shape[1]:
            raise InputError(f"mode {asked} does not exist; expected 0 to {Phi.shape[1] - 1}")
        return int(asked)
    shape = finite_array(mode, "modes: a shape")
    if shape.shape != Phi.shape[:1] or not np.any(shape):
        raise InputError(
            f"modes: expected indices, or shapes of {Phi.shape[0]} numbers that are not all zero; "
            f"got one of shape {shape.shape}"
        )
    return int(np.argmax(modal_assurance(Phi, shape[:, None], structure.structure.M)))


def _band(i: int, band: tuple[float, float]) -> tuple[float, float]:
    """One checked band."""
    corners = finite_array(band, f"bands[{i}]")
    if corners.shape != (2,) or not 0.0 < corners[0] < corners[1]:
        raise InputError(f"bands[{i}] = {band!r}; expected two rising frequencies, Hz, or None")
    return float(corners[0]), float(corners[1])


def _bands(structure: JointedStructure) -> list[tuple[float, float]]:
    """For each elastic mode the band that is its own from low to large amplitude, Hz."""
    high = np.asarray(structure.modes("low").frequency)
    try:
        low = np.asarray(structure.modes("high").frequency)
    except InputError:
        low = high
    # Without its joints the structure may have fewer elastic modes; the lowest became rigid.
    low = np.concatenate([np.zeros(high.size - low.size), low])
    low = np.maximum(np.minimum(low, high), 0.5 * high)

    def between(a: int, b: int) -> float:
        """Frequency that parts mode a from a higher one, which the joints lower."""
        return max(0.5 * (high[a] + low[b]), high[a] + _OWN * (high[b] - high[a]))

    found = []
    for k, f in enumerate(high):
        below = np.flatnonzero(high < f / (1.0 + _TOGETHER))
        above = np.flatnonzero(high > f * (1.0 + _TOGETHER))
        found.append(
            (
                float(between(int(below[-1]), k) if below.size else _BESIDE * low[0]),
                float(between(k, int(above[0])) if above.size else high[-1] / _BESIDE),
            )
        )
    return found
