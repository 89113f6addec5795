"""The steady state of a jointed structure under a harmonic force."""

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.curves import QUANTITIES
from iwanjax.dynamics.continuation import Solution, follow
from iwanjax.dynamics.coordinates import ModalCoordinates, modal_coordinates
from iwanjax.dynamics.harmonic_balance import Cycle, PeriodicSystem
from iwanjax.dynamics.steady_control import ForceControl, ResponseControl
from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint
from iwanjax.joints.sliders import SLIDERS
from iwanjax.results import AbstractResult
from iwanjax.structures import JointedStructure
from iwanjax.structures.checks import finite_array
from iwanjax.types import ArrayLike, as_real, is_traced, require_double_precision

Quantity: TypeAlias = Literal["displacement", "velocity", "acceleration"]
"""What a sensor measures."""

HARMONICS: tuple[int, ...] = tuple(range(8))
"""Those of the motion unless told otherwise."""

SAMPLES = 128
"""Points of a period at which joint forces are evaluated, unless told otherwise."""

TOLERANCE = 1e-10
"""Of the balance, relative to the joints' deflections, unless told otherwise."""


@dataclass(frozen=True, eq=False)
class HarmonicResponse(AbstractResult):
    """Steady states over levels and frequencies.

    Complex arrays are Fourier coefficients, x(t) = Re sum_h X_h exp(i h omega t). What could
    not be brought into balance is NaN.

    Attributes
    ----------
    omega : (...) array
        Frequency of each state, rad/s.
    force : (...) complex array
        Amplitude of the force, at the fundamental alone.
    harmonics : tuple of int
        Those of the last axis.
    displacement : (..., sensors, harmonics) complex array
        At the sensors.
    joint_deflection, joint_force : (..., joints, harmonics) complex array
        Of each joint, opposing and along its row.
    balanced : (...) bool array
        Where a steady state was found.
    labels : tuple of str
        Of the joints.
    """

    omega: Array
    force: Array = field(repr=False)
    harmonics: tuple[int, ...]
    displacement: Array = field(repr=False)
    joint_deflection: Array = field(repr=False)
    joint_force: Array = field(repr=False)
    balanced: Array
    labels: tuple[str, ...]

    _shown = (
        "omega",
        "force",
        "harmonics",
        "displacement",
        "joint_deflection",
        "joint_force",
        "balanced",
        "labels",
    )

    def fundamental(self, quantity: Quantity = "displacement") -> Array:
        """First harmonic of a quantity at the sensors, (..., sensors) complex.

        Raises
        ------
        InputError
            For a quantity that is none.
        """
        factor = (1j * self.omega) ** _power(quantity)
        return factor[..., None] * self.displacement[..., self.harmonics.index(1)]

    def amplitude(self, quantity: Quantity = "displacement") -> Array:
        """Of the fundamental, (..., sensors)."""
        return jnp.abs(self.fundamental(quantity))

    def phase(self, quantity: Quantity = "displacement") -> Array:
        """Of the fundamental ahead of the force, (..., sensors) rad."""
        return jnp.angle(self.fundamental(quantity) / self.force[..., None])


def harmonic_response(
    structure: JointedStructure,
    force: ArrayLike,
    omega: ArrayLike,
    *,
    inputs: ArrayLike | None = None,
    sensors: ArrayLike | None = None,
    harmonics: tuple[int, ...] = HARMONICS,
    samples: int = SAMPLES,
    periods: int = 2,
    modes: int | None = None,
    sliders: int = SLIDERS,
    tolerance: float = TOLERANCE,
) -> HarmonicResponse:
    r"""Steady response to a force of constant amplitude, F cos(Omega t), by harmonic balance.

    The motion is a Fourier series; the joints' forces are evaluated in time along two periods
    from the virgin state, of which the last counts: Masing joints are steady then, and a joint
    with static and kinetic friction is in the steady state that a ring-up reaches. Frequencies
    are followed in the order given, each motion from the one before, so that rising ones
    sweep up and falling ones sweep down, to different branches where there are several, and
    jump where a branch ends; points where nothing is found are NaN. Where friction drops as
    sliders let go (theta < 1), Newton's derivative misses the drops, and points near resonance
    may not be found under a held force; under a held response they are.

    Differentiable, forward and reverse, with respect to joints, force and frequency.

    Parameters
    ----------
    structure : JointedStructure
        One parameter set.
    force : () or (levels,) array_like
        Amplitude, positive.
    omega : () or (frequencies,) array_like
        rad/s, positive.
    inputs : (n,) array_like, optional
        Row along which the force acts: nodal forces are row * F cos(Omega t). A structure of
        one coordinate needs none.
    sensors : (sensors, n) or (n,) array_like, optional
        Rows of the outputs; without it every coordinate.
    harmonics : tuple of int
        Of the motion. Odd ones do for joints whose force is odd in the deflection, in two
        thirds of the time; one-sided joints move the mean and need all.
    samples : int
        Points of a period for the joints' forces, at least four for each harmonic.
    periods : int
        That the joints are driven for, 2 or more; joints that relax (Maxwell elements) need
        as many as they take to settle.
    modes : int, optional
        Elastic modes to keep, the others by their static flexibility; by default all.
    sliders : int
        Of an Iwan joint.
    tolerance : float
        Of the balance, relative to the joints' deflections.

    Returns
    -------
    HarmonicResponse
        With leading axes (levels, frequencies) as far as these were arrays.

    Raises
    ------
    InputError
        For arrays of wrong shape, with NaN or not positive, batches of joints, and harmonics
        without the first.
    PrecisionError
        When JAX computes in float32.

    Examples
    --------
    >>> import iwanjax as ij
    >>> mode = ij.oscillator(stiffness=3.0, joint=ij.Jenkins(F_S=1.0, K_T=1.0), zeta=0.01)
    >>> response = ij.harmonic_response(mode, 0.04, [1.9, 2.0, 2.1])
    >>> round(float(response.amplitude()[1, 0]), 3)
    0.5
    """
    require_double_precision("harmonic_response")
    F, w = positive(force, "force"), positive(omega, "omega")
    row = _row(structure, inputs, "inputs")
    outputs = np.eye(structure.structure.size) if sensors is None else sensors
    cycle = Cycle.of(harmonics, samples, periods)
    modal = modal_coordinates(
        structure, jnp.asarray(row), jnp.asarray(_rows(structure, outputs, "sensors")), modes
    )
    found = _swept(
        parameter_set(structure),
        modal,
        (jnp.broadcast_to(jnp.atleast_1d(F)[:, None], (F.size, w.size)), jnp.atleast_1d(w)),
        "force",
        cycle,
        sliders,
        jnp.asarray(tolerance),
    )
    return _result(structure, found, cycle, F.shape + w.shape, slice(None))


def controlled_response(
    structure: JointedStructure,
    level: ArrayLike,
    omega: ArrayLike,
    *,
    sensor: ArrayLike | None = None,
    quantity: Quantity = "displacement",
    inputs: ArrayLike | None = None,
    sensors: ArrayLike | None = None,
    harmonics: tuple[int, ...] = HARMONICS,
    samples: int = SAMPLES,
    periods: int = 2,
    modes: int | None = None,
    sliders: int = SLIDERS,
    tolerance: float = TOLERANCE,
) -> HarmonicResponse:
    r"""Steady response whose fundamental at one sensor is held, as a shaker controller does.

    The force that this takes is the result. Where a mode alone moves, there is but one motion
    for each level and frequency, and no jumps: see
    :func:`iwanjax.signals.resonance_from_control` for what frequency and damping follow from it.

    Parameters
    ----------
    structure : JointedStructure
        One parameter set.
    level : () or (levels,) array_like
        Amplitude of the fundamental at the control sensor, positive.
    omega : () or (frequencies,) array_like
        rad/s, positive.
    sensor : (n,) array_like, optional
        Row of the control sensor. A structure of one coordinate needs none.
    quantity : {"displacement", "velocity", "acceleration"}
        What ``level`` is an amplitude of.
    inputs, sensors, harmonics, samples, periods, modes, sliders, tolerance
        As for :func:`harmonic_response`; by default the control sensor is the only one kept.

    Returns
    -------
    HarmonicResponse
        The displacement at the control sensor has phase zero. Leading axes (levels,
        frequencies) as far as these were arrays.

    Raises
    ------
    InputError, PrecisionError
        As for :func:`harmonic_response`.

    Examples
    --------
    >>> import iwanjax as ij
    >>> mode = ij.oscillator(stiffness=3.0, joint=ij.Jenkins(F_S=1.0, K_T=1.0), zeta=0.01)
    >>> response = ij.controlled_response(mode, 0.5, [1.9, 2.0, 2.1])
    >>> round(float(abs(response.force[1])), 4)  # 2 zeta omega^2 q at resonance, the joint sticking
    0.04
    """
    require_double_precision("controlled_response")
    u, w = positive(level, "level"), positive(omega, "omega")
    power = _power(quantity)
    row, control = _row(structure, inputs, "inputs"), _row(structure, sensor, "sensor")
    outputs = control if sensors is None else _rows(structure, sensors, "sensors")
    cycle = Cycle.of(harmonics, samples, periods)
    seen = jnp.asarray(np.concatenate([control, outputs]))
    modal = modal_coordinates(structure, jnp.asarray(row), seen, modes)
    w_all = jnp.atleast_1d(w)
    found = _swept(
        parameter_set(structure),
        modal,
        (jnp.atleast_1d(u)[:, None] / w_all**power, w_all),
        "response",
        cycle,
        sliders,
        jnp.asarray(tolerance),
    )
    return _result(structure, found, cycle, u.shape + w.shape, slice(1, None))


@eqx.filter_jit
def _swept(
    elements: tuple[AbstractJoint, ...],
    modal: ModalCoordinates,
    grid: tuple[Array, Array],
    held: Literal["force", "response"],
    cycle: Cycle,
    sliders: int,
    tolerance: Array,
) -> Solution:
    """Levels side by side, frequencies one after the other."""
    system = PeriodicSystem.of(elements, modal, cycle, sliders)
    level, omega = grid
    known = jax.lax.map(system.transfer, omega)
    control = ForceControl if held == "force" else ResponseControl
    return jax.vmap(lambda row: follow(system, control(row, omega, known), tolerance))(level)


def _result(
    structure: JointedStructure,
    found: Solution,
    cycle: Cycle,
    shape: tuple[int, ...],
    kept: slice,
) -> HarmonicResponse:
    def array(x: Array) -> Array:
        return x.reshape(*shape, *x.shape[2:])

    return HarmonicResponse(
        omega=array(found.motion.omega),
        force=array(found.motion.f),
        harmonics=cycle.harmonics,
        displacement=array(found.response)[..., kept, :],
        joint_deflection=array(found.motion.X),
        joint_force=array(found.force),
        balanced=array(found.balanced),
        labels=structure.labels,
    )


def parameter_set(structure: JointedStructure) -> tuple[AbstractJoint, ...]:
    """The joints, unless they carry a batch.

    Raises
    ------
    InputError
    """
    structure.require_joints("steady state")
    batch = {jnp.shape(leaf) for leaf in jax.tree.leaves(structure.elements)} - {()}
    if batch:
        raise InputError(
            f"the joints carry a batch of shape {sorted(batch)[0]}; a steady state takes one "
            "parameter set"
        )
    return structure.elements


def positive(values: ArrayLike, name: str) -> Array:
    """A number or a row of numbers above zero.

    Raises
    ------
    InputError
        Naming what is not.
    """
    array = as_real(values, name)
    if array.ndim > 1 or array.size == 0:
        raise InputError(f"{name} has shape {array.shape}; expected a number or one axis")
    if not is_traced(array) and not bool(np.all(np.asarray(array) > 0.0)):
        raise InputError(f"{name} holds {np.min(np.asarray(array)):g}; expected positive numbers")
    return array


def _power(quantity: str) -> int:
    if quantity not in QUANTITIES:
        raise InputError(f"quantity = {quantity!r}; expected one of {', '.join(QUANTITIES)}")
    return QUANTITIES[quantity]


def _row(structure: JointedStructure, row: ArrayLike | None, name: str) -> np.ndarray:
    n = structure.structure.size
    if row is None:
        if n > 1:
            raise InputError(f"{name}= is needed: one row of {n} numbers")
        return np.ones((1, 1))
    rows = _rows(structure, row, name)
    if rows.shape[0] != 1:
        raise InputError(f"{name} has {rows.shape[0]} rows; expected one")
    return rows


def _rows(structure: JointedStructure, rows: ArrayLike, name: str) -> np.ndarray:
    n = structure.structure.size
    checked = np.atleast_2d(finite_array(rows, name))
    if checked.ndim != 2 or checked.shape[1] != n:
        raise InputError(f"{name} has shape {checked.shape}; expected (rows, {n}) like M")
    return checked
