"""Free decays of a structure after impacts, mode by mode (thesis Sec. 2.2.3)."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from iwanjax.dynamics.propagator import Method
from iwanjax.dynamics.transient import simulate
from iwanjax.errors import InputError
from iwanjax.joints.sliders import SLIDERS
from iwanjax.signals.filters import analytic_signal, band_pass_gain
from iwanjax.signals.hilbert import RingDown, ringdown
from iwanjax.structures import JointedStructure
from iwanjax.types import ArrayLike

# The lowest band begins at this share of its mode's least frequency, and the highest ends as
# far above its mode; a band between two modes ends in the middle of them.
_BESIDE = 0.6
_ORDER = 3


@dataclass(frozen=True, eq=False)
class ModalDecays:
    """Result of :func:`iwanjax.modal_decays`.

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


def modal_decays(
    structure: JointedStructure,
    force: ArrayLike,
    dt: float,
    *,
    inputs: ArrayLike | None = None,
    modes: Sequence[int] | None = None,
    bands: Sequence[tuple[float, float]] | None = None,
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
    force : (N, inputs) or (cases, N, inputs) array_like
        As for :func:`~iwanjax.simulate`; cases are integrated side by side.
    dt : float
        Step, s.
    inputs : (inputs, n) array_like, optional
        Rows along which the forces act.
    modes : sequence of int, optional
        Elastic modes to follow, by default all.
    bands : sequence of (float, float), optional
        Of the band-pass for each mode, Hz; by default from the middle to the next mode on
        either side, wide enough for what the joints may lower a mode by.
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
        As :func:`~iwanjax.simulate`, and for modes that do not exist or bands that do not
        match them.
    """
    low = structure.modes("low")
    count = low.omega.shape[0]
    which = tuple(range(count)) if modes is None else tuple(int(m) for m in modes)
    for mode in which:
        if not 0 <= mode < count:
            raise InputError(f"mode {mode} does not exist; expected 0 to {count - 1}")
    every_band = _bands(structure)
    chosen = tuple(every_band[m] for m in which) if bands is None else tuple(bands)
    if len(chosen) != len(which):
        raise InputError(f"got {len(chosen)} bands for {len(which)} modes")
    Phi = np.asarray(low.Phi)[:, list(which)]
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
    rate = 1.0 / (dt * every)
    begin = _last_force(np.asarray(force), dt) if start is None else start
    omega = np.asarray(low.omega)[list(which)]
    envelope = np.empty_like(velocity)
    rows, reasons = [], []
    for case, signals in enumerate(velocity):
        row: list[RingDown | None] = []
        told = []
        for i, band in enumerate(chosen):
            signal = signals[:, i]
            # What the band's corner, near where modes are close, takes off the mode.
            gain = band_pass_gain(omega[i] / (2.0 * np.pi), band, _ORDER)
            passed = np.abs(analytic_signal(signal, rate, band, _ORDER))
            envelope[case, :, i] = passed / (gain * omega[i])
            try:
                row.append(ringdown(signal, rate, band, name=f"mode {which[i]}", start=begin))
                told.append("")
            except InputError as error:
                row.append(None)
                told.append(str(error))
        rows.append(tuple(row))
        reasons.append(tuple(told))
    return ModalDecays(
        structure,
        np.asarray(found.time),
        velocity,
        envelope,
        tuple(rows),
        tuple(reasons),
        chosen,
        which,
    )


def _last_force(force: np.ndarray, dt: float) -> float:
    """Time from which on there is no force, s."""
    acting = np.flatnonzero(np.any(force.reshape(-1, *force.shape[-2:]), axis=(0, 2)))
    return dt * float(acting[-1] + 1) if acting.size else 0.0


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
    edges = [_BESIDE * low[0], *(0.5 * (high[:-1] + low[1:])), high[-1] / _BESIDE]
    return [(float(a), float(b)) for a, b in itertools.pairwise(edges)]
