"""The verb ``simulate``: a study's structure in time, or a joint on its own."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from iwanjax.config import SimulationCase
from iwanjax.config.simulate import Sine
from iwanjax.dynamics import SimulatedResponse
from iwanjax.plotting import plot
from iwanjax.studies import Study
from iwanjax.studies.simulations import DrivenJoint
from iwanjax.verbs.output import file_names, results, save, version, write_arrays, write_json

_RESPONSES = ("displacement", "velocity", "acceleration")
_OF_JOINTS = ("joint_force", "joint_deflection")


def run(study: Study, out: Path) -> list[str]:
    """Write simulate.json, simulate.npz and a picture of each case; lines for the screen."""
    found = study.simulate()
    cases = {case: found[case.name] for case in study.setup.simulate}
    told = [_told(case, each, found.seconds[case.name]) for case, each in cases.items()]
    with results(out) as folder:
        arrays: dict[str, np.ndarray] = {}
        labels = file_names(found)
        for label, (case, result) in zip(labels, cases.items(), strict=True):
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


def _figure(case: SimulationCase, result: SimulatedResponse | DrivenJoint) -> Figure | None:
    """The picture of a case; None where what was kept makes none."""
    if isinstance(result, DrivenJoint):
        return plot(result)
    if not {*_RESPONSES, "energy"} & {*case.settings.quantities} and (
        result.joint_force is None or result.joint_deflection is None
    ):
        return None
    return plot(result, labels=list(case.sensors))


def _arrays(case: SimulationCase, result: SimulatedResponse | DrivenJoint) -> dict[str, np.ndarray]:
    """A case for simulate.npz."""
    if isinstance(result, DrivenJoint):
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
    case: SimulationCase, result: SimulatedResponse | DrivenJoint, seconds: float
) -> dict[str, Any]:
    """A case for simulate.json."""
    common = {"name": case.name, "compile_and_run_seconds": round(seconds, 3)}
    if isinstance(result, DrivenJoint):
        return common | _told_drive(case, result)
    return common | _told_transient(case, result)


def _told_drive(case: SimulationCase, driven: DrivenJoint) -> dict[str, Any]:
    secant, dissipation = driven.steady_cycle()
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
        "steady_cycle": {"secant_stiffness": secant, "dissipation": dissipation},
    }


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
