"""The verb ``simulate``: a study's structure in time, or a joint on its own."""

import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from matplotlib.figure import Figure

from iwanjax.config import SimulationCase, Study
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
from iwanjax.plotting import plot_hysteresis, plot_transient
from iwanjax.plotting.transient import last_amplitude
from iwanjax.signals import read_recording
from iwanjax.types import ArrayLike
from iwanjax.verbs.output import file_names, results, save, version, write_arrays, write_json

_HOW_TO = (
    "there is no simulate section; add for instance simulate: {name: hit, dt: 1e-3, duration: 1, "
    "excitation: {type: modal_impact, mode: 0, p: 1}}"
)
_RESPONSES = ("displacement", "velocity", "acceleration")
_OF_JOINTS = ("joint_force", "joint_deflection")


@dataclass(frozen=True, eq=False)
class Driven:
    """A joint's force along a history of deflections, (N,) each.

    Attributes
    ----------
    joint : joint
        The element.
    time, d, force : (N,) array
        s, length and force.
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
    amplitude: float
    secant: float = math.nan
    area: float = math.nan
    gap: float = math.nan


def run(study: Study, out: Path) -> list[str]:
    """Write simulate.json, simulate.npz and a picture of each case; lines for the screen."""
    if study.structure is None:
        raise InputError(
            f"{study.path}: simulate needs a structure, model.file, model.matrices or "
            "model.builder; this study has modal"
        )
    if not study.simulate:
        raise InputError(f"{study.path}: {_HOW_TO}")
    found = [_solved(case) for case in study.simulate]
    told = [
        _told(case, result, seconds)
        for case, (result, seconds) in zip(study.simulate, found, strict=True)
    ]
    with results(out) as folder:
        arrays: dict[str, np.ndarray] = {}
        labels = file_names(case.name for case in study.simulate)
        for label, case, (result, _) in zip(labels, study.simulate, found, strict=True):
            arrays |= {f"{label}_{name}": a for name, a in _arrays(case, result).items()}
            figure = _figure(case, result)
            if figure is not None:
                save(figure, folder / f"simulate_{label}.png")
        write_arrays(folder / "simulate.npz", arrays)
        write_json(
            folder / "simulate.json",
            {"study": study.name, "iwanjax": version(), "cases": told},
        )
    lines = [line for each in told for line in _lines(each)]
    return [*lines, f"wrote {out / 'simulate.json'}"]


def _solved(case: SimulationCase) -> tuple[SimulatedResponse | Driven, float]:
    """A case computed, and the seconds that compiling and running took."""
    start = time.perf_counter()
    try:
        result = _driven(case) if case.joint is not None else _transient(case)
    except InputError as error:
        raise InputError(f"{case.place}: {error}") from None
    return result, time.perf_counter() - start


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


def _driven(case: SimulationCase) -> Driven:
    drive, joint = case.settings.drive, case.structure.joints[case.joint or ""]
    assert drive is not None
    t, dt = _instants(case)
    amplitude = _amplitude(t, drive.amplitude)
    d = np.asarray(sine(t, amplitude, 2.0 * math.pi * drive.frequency, 0.5 * math.pi))
    force = np.asarray(hysteresis(joint, d, sliders=case.settings.sliders, dt=dt))
    period = round(1.0 / (drive.frequency * dt))
    if not 2 < period < d.size:
        return Driven(joint, t, d, force, last_amplitude(d))
    # The tips are the last ones: a loop that is not steady yet has several.
    d_loop, F_loop = d[: -period - 2 : -1], force[: -period - 2 : -1]
    low, high = int(np.argmin(d_loop)), int(np.argmax(d_loop))
    width = float(d_loop[high] - d_loop[low])
    if width == 0.0:
        return Driven(joint, t, d, force, amplitude=0.0)
    return Driven(
        joint,
        t,
        d,
        force,
        amplitude=0.5 * width,
        secant=float(F_loop[high] - F_loop[low]) / width,
        area=-float(np.trapezoid(F_loop, d_loop)),
        gap=float(F_loop[0] - F_loop[-1]),
    )


def _figure(case: SimulationCase, result: SimulatedResponse | Driven) -> Figure | None:
    """The picture of a case; None where what was kept makes none."""
    if isinstance(result, Driven):
        # Virgin curve and steady loop are quasi-static.
        joint = None if result.joint.discrete().rate_dependent else result.joint
        return plot_hysteresis(result.d, result.force, joint, amplitude=result.amplitude)
    if not {*_RESPONSES, "energy"} & {*case.settings.quantities} and (
        result.joint_force is None or result.joint_deflection is None
    ):
        return None
    return plot_transient(result, labels=list(case.sensors))


def _arrays(case: SimulationCase, result: SimulatedResponse | Driven) -> dict[str, np.ndarray]:
    """A case for simulate.npz."""
    if isinstance(result, Driven):
        found = {"time": result.time, "joint_deflection": result.d, "joint_force": result.force}
        return found | {"joints": np.array([case.joint])}
    found = {"time": np.asarray(result.time)}
    for name in (*_RESPONSES, *_OF_JOINTS):
        if getattr(result, name) is not None:
            found[name] = np.asarray(getattr(result, name))
    if result.energy is not None:
        for name, values in result.energy._asdict().items():
            found[f"energy_{name}"] = np.asarray(values)
    return found | {"sensors": np.array(list(case.sensors)), "joints": np.array(result.labels)}


def _told(
    case: SimulationCase, result: SimulatedResponse | Driven, seconds: float
) -> dict[str, Any]:
    """A case for simulate.json."""
    common = {"name": case.name, "compile_and_run_seconds": round(seconds, 3)}
    if isinstance(result, Driven):
        return common | _told_drive(case, result)
    return common | _told_transient(case, result)


def _told_drive(case: SimulationCase, driven: Driven) -> dict[str, Any]:
    steady = _steady(driven.joint, driven.amplitude, case)
    return {
        "joint": case.joint,
        "sliders": case.settings.sliders,
        "steps": driven.d.size - 1,
        "peak": {
            "deflection": _peak(driven.time, driven.d),
            "force": _peak(driven.time, driven.force),
        },
        "last_loop": {
            "amplitude": driven.amplitude,
            "secant_stiffness": driven.secant,
            "dissipation": driven.area,
            "gap": driven.gap,
        },
        "steady_cycle": steady,
    }


def _steady(joint: AbstractJoint, amplitude: float, case: SimulationCase) -> dict[str, float]:
    """Closed forms at the last loop's amplitude, as if no larger one had gone before."""
    drive = case.settings.drive
    assert drive is not None
    found = _cycle(joint, jnp.asarray(amplitude), 2.0 * math.pi * drive.frequency)
    return dict(zip(("secant_stiffness", "dissipation"), map(float, found), strict=True))


@eqx.filter_jit
def _cycle(joint: AbstractJoint, amplitude: Array, omega: float) -> tuple[Array, Array]:
    return joint.secant(amplitude), joint.dissipation(amplitude, omega=omega)


def _told_transient(case: SimulationCase, found: SimulatedResponse) -> dict[str, Any]:
    settings = case.settings
    time = np.asarray(found.time)
    step = float(time[1] - time[0]) / settings.every
    told: dict[str, Any] = {
        "method": found.method,
        "dt": step / found.substeps,
        "steps": (time.size - 1) * settings.every * found.substeps,
        "refined": found.substeps // settings.substeps,
        "estimated_error": _known(found.error),
        "energy_imbalance": _known(found.imbalance),
        "sliders": settings.sliders,
        "balanced": bool(found.balanced),
        "sensors": {
            label: {
                name: _peak(time, np.asarray(getattr(found, name))[:, i])
                for name in _RESPONSES
                if getattr(found, name) is not None
            }
            for i, label in enumerate(case.sensors)
        },
        "joints": {
            label: {
                name.removeprefix("joint_"): _peak(time, np.asarray(getattr(found, name))[:, j])
                for name in _OF_JOINTS
                if getattr(found, name) is not None
            }
            for j, label in enumerate(found.labels)
        },
    }
    if isinstance(settings.excitation, Sine) and found.displacement is not None:
        period = 2.0 * math.pi / settings.excitation.circular
        last = np.asarray(found.displacement)[time >= time[-1] - period]
        told["last_amplitude"] = dict(
            zip(case.sensors, (0.5 * np.ptp(last, axis=0)).tolist(), strict=True)
        )
    if found.energy is not None:
        rows = {name: np.asarray(row) for name, row in found.energy._asdict().items()}
        imbalance = np.asarray(found.energy.imbalance)
        told["energy"] = {name: float(row[-1]) for name, row in rows.items()}
        told["energy"]["imbalance"] = float(np.max(np.abs(imbalance)))
    if found.method == "newmark":
        # The average acceleration's own error, by which its step is chosen.
        omega2 = np.asarray(case.structure.basis.omega2)
        told["frequency_error"] = -omega2 * (step / found.substeps) ** 2 / 12.0
    return told


def _known(value: Any) -> float | None:
    """A number, or nothing where it is not known."""
    return float(value) if np.isfinite(value) else None


def _peak(time: np.ndarray, values: np.ndarray) -> dict[str, float]:
    """The sample furthest from zero; up to where the joints were in balance."""
    at = int(np.argmax(np.nan_to_num(np.abs(values))))
    return {"value": float(values[at]), "time": float(time[at])}


def _lines(told: dict[str, Any]) -> list[str]:
    """A case of simulate.json for the screen."""
    name, seconds = told["name"], told["compile_and_run_seconds"]
    if "last_loop" in told:
        return _drive_lines(told)
    lines = [
        f"{name}: {told['steps']} steps of {told['dt']:g} s ({told['method']}) in {seconds:.3g} s"
    ]
    if told["refined"] > 1:
        lines.append(
            f"{name}: the step asked for was too long and was divided by {told['refined']}"
        )
    if not told["balanced"]:
        lines.append(
            f"{name}: the joints found no balance; from there on all is NaN: take shorter steps"
        )
    if told["estimated_error"] is not None:
        lines.append(f"{name}: estimated error {told['estimated_error']:.2g} of the motion (rms)")
    for kind in _RESPONSES:
        peaks = {label: each[kind] for label, each in told["sensors"].items() if kind in each}
        if peaks:
            label = max(peaks, key=lambda label: abs(peaks[label]["value"]))
            peak = peaks[label]
            lines.append(
                f"{name}: peak {kind} {peak['value']:.6g} of {label} at {peak['time']:.6g} s"
            )
            break
    if "last_amplitude" in told:
        reached = ", ".join(f"{label} {a:.6g}" for label, a in told["last_amplitude"].items())
        lines.append(f"{name}: amplitude over the last period: {reached}")
    if "energy" in told:
        energy = told["energy"]
        lines.append(
            f"{name}: of the work {energy['work']:.4g} joints took {energy['joints']:.4g}, damping "
            f"{energy['viscous']:.4g}; not accounted for {energy['imbalance']:.2g}"
        )
    if "frequency_error" in told:
        worst = float(np.max(np.abs(told["frequency_error"])))
        lines.append(f"{name}: newmark lowers natural frequencies by up to {100.0 * worst:.2g} %")
    return lines


def _drive_lines(told: dict[str, Any]) -> list[str]:
    loop, steady = told["last_loop"], told["steady_cycle"]
    head = f"{told['name']}: {told['joint']}, {told['steps']} steps"
    if not math.isfinite(loop["dissipation"]):
        return [f"{head}; no whole loop at the end"]
    parts = (("secant stiffness", "secant_stiffness"), ("area", "dissipation"))
    compared = ", ".join(
        f"{word} {loop[key]:.4g} (steady cycle {steady[key]:.4g})" for word, key in parts
    )
    return [f"{head}; last loop of amplitude {loop['amplitude']:.4g}: {compared}"]
