"""Write a laboratory's concealed cases as studies: recordings as they really are.

`python tests/concealed/laboratory.py FOLDER [--only NAME ...]`

Recordings differ in excitation, state at the start, length, rate, sensors and noise; the linear
model may be off within the trust that the study states. A study's keys are those of FORMATS.md;
`needs` in truth.json names the ones beyond hammer tests from rest. An input called `base` is the
acceleration of the ground (see `rigs.on_shaken_ground`); accelerometers are absolute.
"""

import argparse
import json
import sys
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from concealed import disturbances
from concealed.lab_forces import happens, rig_key, study_inputs
from concealed.lab_plan import OFF, PERIODIC, REST, TRUST, LabCase, Take, lab_plan
from concealed.rigs import on_shaken_ground
from concealed.structures import Array
from concealed.study import model_arrays

from iwanjax.trial import acquisition
from iwanjax.trial.effects import Effect
from iwanjax.trial.simulation import FORCE_NOISE

SIZES = Path(__file__).with_name("lab_sizes.json")
HUM, DRIFT, OFFSET, FULL_SCALE = 1.0, 1.0, 4.0, 8.0
"""Mild nuisances: amplitude of hum, rms of drift and largest offset over the sensor's noise;
full scale of the converter over the largest signal of the study."""


def lab_cases() -> tuple[LabCase, ...]:
    """All cases, with the sizes of their effects."""
    table = json.loads(SIZES.read_text())
    cases = []
    for case in lab_plan():
        if case.wanted:
            found = table[case.name]
            if (found["kind"], found["where"]) != case.wanted:
                raise ValueError(f"{SIZES.name} does not hold {case.name}: run lab_sizing.py")
            effect = Effect(found["kind"], found["where"], tuple(found["values"]))
            case = replace(case, effects=(effect,))
        cases.append(case)
    return tuple(cases)


def clean(case: LabCase) -> list[tuple[Array, Array]]:
    """Response (sample, sensor) and force (sample, input) of each take through faulty channels.

    All sensors and inputs of the study, before noise and converter.
    """
    together: dict[str, list[int]] = defaultdict(list)
    for i, take in enumerate(case.takes):
        together[rig_key(take)].append(i)
    found: dict[int, tuple[Array, Array]] = {}
    structure = case.structure
    for members in together.values():
        fine = happens(case, [case.takes[i] for i in members], case.effects)
        channels = [
            acquisition.transduced(
                channel, labels, case.effects, signal, structure, structure.steps
            )
            for channel, labels, signal in (
                ("sensor", list(structure.sensors), fine.response),
                ("force", study_inputs(case), fine.force),
            )
        ]
        for at, i in enumerate(members):
            take = case.takes[i]
            response, force = (
                acquisition.decimate(
                    signal[:, at],
                    take.samples,
                    structure.steps * take.divisor,
                    take.lead // take.divisor,
                )
                for signal in channels
            )
            found[i] = response, force
    return [found[i] for i in range(len(case.takes))]


def noise_levels(case: LabCase, signals: list[tuple[Array, Array]]) -> Array:
    """Standard deviations (recording, sensor)."""
    hardest = signals[case.takes.index(case.hardest)][0]
    average = case.noise.share * float(np.sqrt(np.mean(hardest**2)))
    return average * np.outer(case.noise.recordings, case.noise.sensors)


def _added(case: LabCase, take: Take, levels: Array, rng: np.random.Generator) -> Array:
    """Noise, hum, offset and drift (sample, sensor) of one recording."""
    noise, sensors = case.noise, list(case.structure.sensors)
    clock = np.arange(take.samples) * take.divisor / case.structure.rate
    made = disturbances.pink if noise.colour == "pink" else disturbances.white
    more = levels * made(take.samples, len(sensors), rng)
    if noise.offset:
        more += OFFSET * levels * rng.uniform(-1.0, 1.0, len(sensors))
    if noise.drift:
        at = sensors.index(noise.drift)
        more[:, at] += DRIFT * levels[at] * disturbances.wander(take.samples, rng)
    if noise.hum:
        at = sensors.index(noise.hum)
        phase = float(rng.uniform(0, 2 * np.pi))
        more[:, at] += disturbances.hum(clock, HUM * levels[at], 50.0, 0.0, phase)
    for effect in case.effects:
        values = [float(v) for v in effect.values]  # type: ignore[arg-type]
        if effect.kind == "sensor_hum":
            phase = float(rng.uniform(0, 2 * np.pi))
            more[:, sensors.index(effect.where)] += disturbances.hum(clock, *values, phase)
        elif effect.kind == "sensor_drift":
            drift = values[0] * disturbances.wander(take.samples, rng)
            more[:, sensors.index(effect.where)] += drift
    return more


def recorded(case: LabCase) -> tuple[list[tuple[Array, Array]], Array]:
    """What the recorder stores of each take, all sensors and inputs; and the noise's levels."""
    signals = clean(case)
    levels = noise_levels(case, signals)
    rng = np.random.default_rng(case.seed)
    sensors, inputs = list(case.structure.sensors), study_inputs(case)
    stored = []
    for take, (response, force), level in zip(case.takes, signals, levels, strict=True):
        response = response + _added(case, take, level, rng)
        scale = FORCE_NOISE * np.abs(force).max(axis=0)
        force = force + scale * rng.standard_normal(force.shape)
        response, force = (
            acquisition.saturate(channel, labels, case.effects, signal[:, None])[:, 0]
            for channel, labels, signal in (
                ("sensor", sensors, response),
                ("force", inputs, force),
            )
        )
        stored.append((response, force))
    if case.noise.quantised:
        full = FULL_SCALE * max(np.abs(response).max() for response, _ in stored)
        stored = [(disturbances.quantised(response, full), force) for response, force in stored]
    return stored, levels


def _entry(case: LabCase, take: Take, file: str) -> dict:
    """A recording in the study file."""
    entry: dict = {"file": file, "use": take.use}
    if take.excitation == "decay":
        entry["kind"] = "free_decay"
    entry["sampling_rate"] = round(case.structure.rate / take.divisor)
    if take.state == PERIODIC:
        entry["initial"] = "periodic"
    elif take.state != REST:
        entry["initial"] = "unknown"
    if take.part:
        entry |= {"from": take.part[0], "to": take.part[1]}
    entry["response"] = {
        "array": "response",
        "sensors": list(take.sensors),
        "quantity": "acceleration",
    }
    if take.excitation != "decay":
        entry["force"] = {"array": "force", "inputs": list(take.places)}
    return entry


def _study(case: LabCase) -> dict:
    model: dict = {"file": "model.npz"}
    if case.given:
        names = ("F_S", "K_T", "chi", "beta")
        model["joints"] = [
            {
                "name": name,
                "row": name,
                "type": "iwan4",
                "parameters": dict(zip(names, values, strict=True)),
            }
            for name, values in case.given.items()
        ]
    if case.line[4] == OFF:
        model["trust"] = dict(TRUST)
    files = [f"rec{i}.npz" for i in range(1, len(case.takes) + 1)]
    entries = [_entry(case, take, file) for take, file in zip(case.takes, files, strict=True)]
    return {"name": case.name, "model": model, "recordings": entries}


def needs(case: LabCase) -> list[str]:
    """What of the study goes beyond hammer tests from rest on an exact model with joints."""
    takes = case.takes
    asked = {
        "trust": case.line[4] == OFF,
        "no joints": not case.given,
        "initial: unknown": any(t.state not in (REST, PERIODIC) for t in takes),
        "initial: periodic": any(t.state == PERIODIC for t in takes),
        "from, to": any(t.part for t in takes),
        "free_decay": case.line[1] == "decay",
        "base": case.line[1] == "base",
        "rates": len({t.divisor for t in takes}) > 1,
        "sensors": len({t.sensors for t in takes}) > 1,
        case.line[5]: case.line[5].startswith("force_")
        or case.line[5]
        in ("sensor_hum", "sensor_high_pass", "sensor_drift", "attached_oscillator"),
    }
    return [name for name, asks in asked.items() if asks]


def _truth(case: LabCase, levels: Array, stored: list[tuple[Array, Array]]) -> dict:
    """What is concealed, and what else is in the recordings; `tolerated` is no false alarm."""
    noise = case.noise
    tolerated = [("sensor_hum", noise.hum), ("sensor_drift", noise.drift)]
    kind, where = case.wanted or ("none", None)
    return {
        "kind": kind,
        "where": where,
        "joints": {name: list(values) for name, values in case.true.items()},
        "noise": float(np.mean(levels)),
        "parameters": [
            {"place": effect.where, "values": [float(v) for v in effect.values]}  # type: ignore[arg-type]
            for effect in case.effects
        ],
        "structure": case.structure.name,
        "excitation": case.line[1],
        "state": case.line[2],
        "model": case.line[3],
        "trust": case.line[4],
        "deviations": {
            "frequencies": case.frequencies.tolist(),
            "dampings": case.dampings.tolist(),
        },
        "colour": noise.colour,
        "offset": noise.offset,
        "quantised": noise.quantised,
        "tolerated": [f"{kind}@{where}" for kind, where in tolerated if where],
        "needs": needs(case),
        "recordings": [
            {
                "excitation": take.excitation,
                "state": take.state,
                "level": take.level,
                "noise": dict(zip(case.structure.sensors, level.tolist(), strict=True)),
                "noise_over_response": float(
                    np.sqrt(np.mean(level**2) / np.mean((response - response.mean(axis=0)) ** 2))
                ),
            }
            for take, level, (response, _) in zip(case.takes, levels, stored, strict=True)
        ],
    }


def write(case: LabCase, folder: Path) -> None:
    """Simulate a case and write its study and its truth into a folder."""
    stored, levels = recorded(case)
    folder.mkdir(parents=True, exist_ok=True)
    model = case.model()
    if case.line[1] == "base":
        model = on_shaken_ground(model)
    np.savez(folder / "model.npz", **model_arrays(model))  # type: ignore[arg-type]
    sensors, inputs = list(case.structure.sensors), study_inputs(case)
    for i, (take, (response, force)) in enumerate(zip(case.takes, stored, strict=True), 1):
        arrays = {
            "time": np.arange(take.samples) * take.divisor / case.structure.rate,
            "response": response[:, [sensors.index(s) for s in take.sensors]].astype(np.float32),
        }
        if take.excitation != "decay":
            columns = [inputs.index(place) for place in take.places]
            arrays["force"] = force[:, columns].astype(np.float32)
        np.savez(folder / f"rec{i}.npz", **arrays)  # type: ignore[arg-type]
    (folder / "study.yaml").write_text(yaml.safe_dump(_study(case), sort_keys=False))
    truth = _truth(case, levels, stored)
    (folder / "truth.json").write_text(json.dumps(truth, indent=1))


def main(arguments: list[str] | None = None) -> None:
    """Write the chosen cases into folders FOLDER/labNN."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--only", nargs="+", metavar="NAME")
    chosen = parser.parse_args(arguments)
    for case in lab_cases():
        if chosen.only and case.name not in chosen.only:
            continue
        start = time.perf_counter()
        write(case, chosen.folder / case.name)
        print(f"{case.name} {' '.join(case.line)} {time.perf_counter() - start:.1f} s", flush=True)


if __name__ == "__main__":
    main()
