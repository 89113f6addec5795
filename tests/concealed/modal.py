"""Concealed cases of single modes: studies of free decays that know no structure.

`python tests/concealed/modal.py OUT [--only N ...]`

A structure is thrown in one mode, or in two at once, and one sensor hears it die down. The study
takes each mode for an oscillator with a joint of its own. That is all there is where a mode
moves alone; thrown together, either makes the joint softer for the other: `modal_coupling`.
"""

import argparse
import itertools
import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml
from scipy.linalg import eigh

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from concealed.hammer import Hit, measure
from concealed.plan import scattered_joints
from concealed.structures import STRUCTURES, Array, Iwan, Structure

from iwanjax.trial.effects import Effect

NOISE = 2e-4
"""Standard deviation of the sensor's noise over its peak."""
CYCLES, LIGHT = 150, 0.1
"""Of the lowest mode that a recording is long; share of the structure's own damping that is left,
so that a mode rings for a while."""
HARDENING, DRAG, GAP = 0.01, 0.004, 0.5
"""Rise of frequency and of damping at the largest throw; gap over the deflection there."""
EFFECTS = ("cubic_stiffness", "quadratic_damping", "gap_contact")


@dataclass(frozen=True)
class ModalCase:
    """One case; `strokes` (recordings, modes) of the joint that slips most, over its macroslip."""

    number: int
    structure: Structure
    modes: tuple[int, ...]
    kind: str
    true: dict[str, Iwan]
    strokes: Array
    sensor: str
    seed: int

    @property
    def names(self) -> list[str]:
        """Of the modes, as the study calls them."""
        return [f"mode{mode + 1}" for mode in self.modes]


def _stuck(structure: Structure, joints: dict[str, Iwan]) -> tuple[Array, Array]:
    """Circular frequencies and mass-normalised shapes with the true joints stuck."""
    K = structure.K.copy()
    for name, (_, K_T, _, _) in joints.items():
        K += K_T * np.outer(structure.rows[name], structure.rows[name])
    squared, shapes = eigh(K, structure.M)
    return np.sqrt(squared), shapes


def _macroslip(joint: Iwan) -> float:
    F_S, K_T, chi, beta = joint
    return F_S * (1 + beta) / (K_T * (beta + (chi + 1) / (chi + 2)))


def _reach(case: ModalCase) -> Array:
    """Modal displacements at which the first joint is in macroslip, in every mode."""
    _, shapes = _stuck(case.structure, case.true)
    shares = [
        np.abs(case.structure.rows[name] @ shapes) / _macroslip(joint)
        for name, joint in case.true.items()
    ]
    return 1.0 / np.max(shares, axis=0)


def _drawn(number: int, name: str, kind: str) -> ModalCase:
    """Two of the lowest three modes; together, or one after the other; with a force, only one."""
    rng = np.random.default_rng([31, number])
    structure = STRUCTURES[name]
    true, _ = scattered_joints(structure, rng)
    count = min(3, len(structure.M))
    modes = np.sort(rng.permutation(count)[:2])
    hard = rng.uniform(0.25, 0.40, 4)
    hard[3] = rng.uniform(0.20, 0.25)  # held out, within what is fitted
    if kind == "modal_coupling":
        other = np.exp(rng.uniform(np.log(0.1), np.log(0.40), 4))
        strokes = np.stack([hard, other], axis=1)
    elif kind == "none":
        nothing = np.zeros(4)
        strokes = np.concatenate(
            [np.stack([hard, nothing], axis=1), np.stack([nothing, hard[[1, 2, 0, 3]]], axis=1)]
        )
    else:
        modes = modes[:1]
        strokes = hard[:, None]
    omega, shapes = _stuck(structure, true)
    seconds = CYCLES * 2.0 * np.pi / omega[modes[0]]
    structure = replace(structure, C=LIGHT * structure.C, samples=round(seconds * structure.rate))
    heard = {
        label: np.min(np.abs(row @ shapes[:, modes])) for label, row in structure.sensors.items()
    }
    sensor = max(heard, key=lambda label: heard[label])
    seed = int(rng.integers(2**31))
    found = tuple(int(mode) for mode in modes)
    return ModalCase(number, structure, found, kind, true, strokes, sensor, seed)


def _effect(case: ModalCase) -> tuple[Effect, ...]:
    """The force that is concealed, where the mode moves most."""
    if case.kind not in EFFECTS:
        return ()
    omega, shapes = _stuck(case.structure, case.true)
    (mode,) = case.modes
    w = omega[mode]
    grounded = [row for row in case.structure.rows if row.endswith("ground")]
    where = max(grounded, key=lambda row: abs(case.structure.rows[row] @ shapes[:, mode]))
    turn = abs(case.structure.rows[where] @ shapes[:, mode])
    q = _reach(case)[mode] * np.max(case.strokes)
    values = {
        # Their first harmonics on a sine, as shares of the mode's stiffness and damping.
        "cubic_stiffness": (HARDENING * w**2 / (3.0 / 8.0 * turn**4 * q**2),),
        "quadratic_damping": (DRAG / (4.0 / (3.0 * np.pi) * turn**3 * q),),
        "gap_contact": (10.0 * HARDENING * w**2 / turn**2, GAP * turn * q, 2.0),
    }
    return (Effect(case.kind, where, values[case.kind]),)


# Structures with one joint: two that slip at different loads are no single modal one.
MODAL_CASES: tuple[ModalCase, ...] = tuple(
    _drawn(number, name, kind)
    for number, (name, kind) in enumerate(
        itertools.chain(
            zip(["chain3"] * 4, ["modal_coupling"] * 4, strict=True),
            zip(["chain2", "chain3"] * 2, ["none"] * 4, strict=True),
            itertools.product(("chain2", "chain3"), EFFECTS),
        )
    )
)


def _bands(case: ModalCase) -> list[list[float]]:
    """A fifth to either side, but no further than half the way to the next mode, Hz."""
    f = _stuck(case.structure, case.true)[0] / (2.0 * np.pi)
    edges = np.concatenate([[0.0], 0.5 * (f[1:] + f[:-1]), [np.inf]])
    return [
        [float(max(0.8 * f[m], edges[m])), float(min(1.2 * f[m], edges[m + 1]))] for m in case.modes
    ]


def write(case: ModalCase, folder: Path) -> None:
    """Simulate a case and write its study and its truth into a folder."""
    structure = case.structure
    omega, _ = _stuck(structure, case.true)
    modes = list(case.modes)
    thrown = np.zeros((len(case.strokes), len(omega)))
    thrown[:, modes] = case.strokes * (omega * _reach(case))[modes]
    silent = Hit(next(iter(structure.inputs)), 0.0, 0.0, 1.0, "", 0)
    hits = [silent] * len(thrown)
    response, _ = measure(structure, case.true, _effect(case), hits, thrown=thrown)
    heard = response[:, :, list(structure.sensors).index(case.sensor)]
    rng = np.random.default_rng(case.seed)
    heard = heard + NOISE * np.abs(heard).max(axis=0) * rng.standard_normal(heard.shape)
    folder.mkdir(parents=True, exist_ok=True)
    recordings = []
    for i, strokes in enumerate(case.strokes):
        np.savez(
            folder / f"rec{i + 1}.npz",
            time=np.arange(len(heard)) / structure.rate,
            response=heard[:, i, None].astype(np.float32),
        )
        recordings.append(
            {
                "file": f"rec{i + 1}.npz",
                "kind": "free_decay",
                "use": "hold_out" if i % 4 == 3 else "fit",
                "modes": [n for n, stroke in zip(case.names, strokes, strict=True) if stroke > 0],
                "response": {"array": "response", "quantity": "acceleration", "unit": "m/s^2"},
            }
        )
    study = {
        "name": folder.name,
        "model": {
            "modal": [
                {"name": name, "band": band, "joint": {"type": "iwan4"}}
                for name, band in zip(case.names, _bands(case), strict=True)
            ]
        },
        "recordings": recordings,
    }
    (folder / "study.yaml").write_text(yaml.safe_dump(study, sort_keys=False))
    truth = {"modes": dict.fromkeys(case.names, case.kind)}
    (folder / "truth.json").write_text(json.dumps(truth, indent=1))


def main(arguments: list[str] | None = None) -> None:
    """Write the chosen cases into folders OUT/modalNN."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("--only", type=int, nargs="+", metavar="N")
    chosen = parser.parse_args(arguments)
    for case in MODAL_CASES:
        if chosen.only and case.number not in chosen.only:
            continue
        folder = chosen.out / f"modal{case.number:02d}"
        write(case, folder)
        print(f"{folder}  {case.structure.name} {case.kind}", file=sys.stderr)


if __name__ == "__main__":
    main()
