"""A study's cases in time: its structure under forces, or a joint on its own."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from iwanjax.config import SimulationCase, StudySetup
from iwanjax.config.reading import blamed
from iwanjax.config.simulate import (
    Amplitude,
    ModalImpact,
    PointImpact,
    Ramp,
    RecordedForce,
    Sine,
    SweptSine,
)
from iwanjax.dynamics import SimulatedResponse, half_sine, modal_input, ramp, simulate, sine, sweep
from iwanjax.errors import InputError
from iwanjax.joints import AbstractJoint, hysteresis
from iwanjax.joints.hysteresis import last_amplitude
from iwanjax.results import AbstractResult
from iwanjax.signals import read_recording
from iwanjax.studies.results import StudyResults
from iwanjax.types import ArrayLike

_SIMULATE = (
    "there is no simulate section; add for instance simulate: {name: hit, dt: 1e-3, duration: 1, "
    "excitation: {type: modal_impact, mode: 0, p: 1}}"
)


@dataclass(frozen=True, eq=False)
class DrivenJoint(AbstractResult):
    """A joint's force along a history of deflections, (N,) each.

    Attributes
    ----------
    joint : joint
        The element.
    time, d, force : (N,) array
        s, length and force.
    frequency : float
        At which it was driven, Hz.
    amplitude : float
        Of the last loop, length.
    secant, area, gap : float
        Of the last loop: force over deflection between its tips, force/length; what it encloses,
        force x length; its force at the end less that at the beginning. NaN for less than a loop.
    """

    joint: AbstractJoint
    time: np.ndarray
    d: np.ndarray
    force: np.ndarray
    frequency: float
    amplitude: float
    secant: float = math.nan
    area: float = math.nan
    gap: float = math.nan

    def steady_cycle(self) -> tuple[float, float]:
        """Secant stiffness and dissipation in closed form at the last loop's amplitude.

        As if no larger one had gone before.
        """
        omega = 2.0 * math.pi * self.frequency
        secant, dissipation = _cycle(self.joint, jnp.asarray(self.amplitude), omega)
        return float(secant), float(dissipation)


@eqx.filter_jit
def _cycle(joint: AbstractJoint, amplitude: Array, omega: float) -> tuple[Array, Array]:
    return joint.secant(amplitude), joint.dissipation(amplitude, omega=omega)


def simulations(
    study: StudySetup, names: Sequence[str]
) -> StudyResults[SimulatedResponse | DrivenJoint]:
    """Cases of these names, or all of a study, computed, with the time that each took.

    Raises
    ------
    InputError
        Where there are none, and for an unknown name.
    """
    cases = StudyResults({case.name: case for case in study.simulate})
    if not cases:
        raise InputError(f"{study.label}: {_SIMULATE}")
    responses, seconds = {}, {}
    for name in names or cases:
        start = time.perf_counter()
        responses[name] = simulated(cases[name])
        seconds[name] = time.perf_counter() - start
    return StudyResults(responses, seconds)


def simulated(case: SimulationCase) -> SimulatedResponse | DrivenJoint:
    """A case computed; faults name its place in the study."""
    with blamed(case.place):
        return _driven(case) if case.joint is not None else _transient(case)


def _transient(case: SimulationCase) -> SimulatedResponse:
    settings = case.settings
    force, rows, dt = _force(case)
    found = simulate(
        case.structure,
        force,
        dt,
        inputs=rows,
        sensors=np.stack(list(case.sensors.values())),
        method=settings.method,
        keep=settings.quantities,
        every=settings.every,
        substeps=settings.substeps,
        modes=settings.modes,
        sliders=settings.sliders,
        accuracy=settings.accuracy,
    )
    if found.acceleration is not None and np.any(case.carried):
        # Accelerometers do not know the ground's motion from their own.
        ground = np.asarray(force).reshape(-1, len(case.carried))[:: settings.every]
        found = replace(found, acceleration=found.acceleration + ground @ case.carried)
    return jax.block_until_ready(found)


def _force(case: SimulationCase) -> tuple[ArrayLike, ArrayLike, float]:
    """Forces at the samples, the rows they act along, and the step."""
    excitation = case.settings.excitation
    if isinstance(excitation, RecordedForce):
        return _recorded(case, excitation)
    t, dt = _instants(case)
    if isinstance(excitation, ModalImpact):
        omega = case.structure.modes().omega[excitation.mode]
        row = modal_input(case.structure, excitation.mode, excitation.limit)
        return half_sine(t, excitation.p, omega), row, dt
    assert case.inputs is not None
    if isinstance(excitation, PointImpact):
        return half_sine(t, excitation.p, excitation.circular), case.inputs, dt
    assert isinstance(excitation, Sine | SweptSine)
    amplitude = _amplitude(t, excitation.amplitude)
    if isinstance(excitation, Sine):
        return sine(t, amplitude, excitation.circular), case.inputs, dt
    band = (excitation.start, excitation.to)
    return sweep(t, amplitude, band, excitation.kind), case.inputs, dt


def _instants(case: SimulationCase) -> tuple[np.ndarray, float]:
    dt = case.settings.dt
    assert dt is not None
    return dt * np.arange(case.settings.steps + 1), dt


def _amplitude(t: np.ndarray, amplitude: Amplitude) -> ArrayLike:
    if isinstance(amplitude, Ramp):
        return ramp(t, amplitude.start, amplitude.to, amplitude.duration)
    return amplitude


def _recorded(
    case: SimulationCase, excitation: RecordedForce
) -> tuple[np.ndarray, np.ndarray, float]:
    """The measured forces, one column for each input."""
    assert case.file is not None
    assert case.inputs is not None
    recording = read_recording(
        case.file,
        excitation.index,
        variable=excitation.variable,
        force=excitation.array,
        sampling_rate=excitation.sampling_rate,
    )
    if recording.force is None:
        raise InputError(f"{recording.name} holds no force; say array: and its name")
    columns = recording.force.shape[1]
    if columns != len(case.inputs):
        raise InputError(
            f"{recording.name} holds {columns} force(s) for {len(case.inputs)} input(s); expected "
            "a label for each"
        )
    return recording.force, case.inputs, 1.0 / recording.sampling_rate


def _driven(case: SimulationCase) -> DrivenJoint:
    drive, joint = case.settings.drive, case.structure.joints[case.joint or ""]
    assert drive is not None
    t, dt = _instants(case)
    amplitude = _amplitude(t, drive.amplitude)
    d = np.asarray(sine(t, amplitude, 2.0 * math.pi * drive.frequency, 0.5 * math.pi))
    force = np.asarray(hysteresis(joint, d, sliders=case.settings.sliders, dt=dt))
    period = round(1.0 / (drive.frequency * dt))
    if not 2 < period < d.size:
        return DrivenJoint(joint, t, d, force, drive.frequency, last_amplitude(d))
    # The tips are the last ones: a loop that is not steady yet has several.
    d_loop, F_loop = d[: -period - 2 : -1], force[: -period - 2 : -1]
    low, high = int(np.argmin(d_loop)), int(np.argmax(d_loop))
    width = float(d_loop[high] - d_loop[low])
    if width == 0.0:
        return DrivenJoint(joint, t, d, force, drive.frequency, amplitude=0.0)
    return DrivenJoint(
        joint,
        t,
        d,
        force,
        drive.frequency,
        amplitude=0.5 * width,
        secant=float(F_loop[high] - F_loop[low]) / width,
        area=-float(np.trapezoid(F_loop, d_loop)),
        gap=float(F_loop[0] - F_loop[-1]),
    )
