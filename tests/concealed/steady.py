"""Concealed cases of loops of a joint and of curves of a structure's modes, as studies.

`python tests/concealed/steady.py OUT [--only NAME ...]`

Sliders of a code of their own, noise, and a force beside the joint that the study does not know.
"""

import argparse
import itertools
import json
import sys
from pathlib import Path

import numpy as np
import yaml

if __name__ == "__main__":
    root = Path(__file__).resolve().parents[2]
    sys.path[:0] = [str(root / "tests"), str(root / "configs")]

import bolted_chain as chain
from concealed.structures import Iwan

from iwanjax.trial.physics import slider_bank

K_T = 1.0
JOINT = (10.0, K_T, -0.5, 5.0)
SLIP, STIFFNESS = slider_bank(*map(np.asarray, JOINT))
PHI = SLIP[-1]
CUBIC = 0.05 * K_T / PHI**2
LEVELS, QUARTER = ((0.3, 0.7), (1.1,), (0.15, 0.5, 1.3)), 40
"""Amplitudes of the loops over phi_max, the last one held out; values of a quarter of a loop."""


def stretched(d, slip, stiffness):
    """Force of sliders along a history, by their own rule."""
    stretch, last, force = np.zeros_like(slip), 0.0, []
    for now in d:
        stretch, last = np.clip(stretch + now - last, -slip, slip), now
        force.append(stretch @ stiffness)
    return np.array(force)


SIZES = {
    "none": (),
    "cubic_stiffness": (CUBIC,),
    "coulomb_friction": (0.2 * K_T, 0.1 * PHI),
    "gap_contact": (0.2 * K_T, 0.5 * PHI, 2.0),
}
"""Of the forces beside a loop's joint, in the order of `effects.PARAMETERS`."""
LOOP_FORCES = {
    "none": lambda d: 0.0 * d,
    "cubic_stiffness": lambda d, k3: k3 * d**3,
    "coulomb_friction": lambda d, k, slip: stretched(d, np.array([slip]), np.array([k])),
    "gap_contact": lambda d, k, gap, _: k * np.sign(d) * np.maximum(np.abs(d) - gap, 0.0),
}
MODE_FORCES = {
    "none": ("m3-ground", (), lambda d, v: 0.0 * d),
    "cubic_stiffness": (
        "m3-ground",
        (2.0e3 / (3.0 * chain.slip()) ** 2,),
        lambda d, v, k3: k3 * d**3,
    ),
    "stiffness_error": ("m2-m3", (2.0e3,), lambda d, v, k: k * d),
    "quadratic_damping": ("m2-m3", (55.0,), lambda d, v, c2: c2 * v * np.abs(v)),
}


def path(levels):
    """From rest through two loops of each level, back to where the last one was left."""
    turns = [0.0, *(side * PHI * a for a in levels for side in (1.0, -1.0, 1.0, -1.0))]
    turns.append(turns[-2])
    parts = [np.linspace(*ends, 2 * QUARTER + 1)[1:] for ends in itertools.pairwise(turns)]
    return np.concatenate([[0.0], *parts])


def _write(
    folder: Path, study: dict, kind: str, where: str, sizes: tuple[float, ...], joint: Iwan
) -> None:
    study = {"name": folder.name, **study}
    (folder / "study.yaml").write_text(yaml.safe_dump(study, sort_keys=False))
    truth = {
        "kind": kind,
        "where": None if kind == "none" else where,
        "joints": {"J1": list(joint)},
        "parameters": [{"place": where, "values": list(sizes)}] if sizes else [],
    }
    (folder / "truth.json").write_text(json.dumps(truth))


def write_loops(kind: str, folder: Path) -> None:
    """Three loops of one joint with noise of 0.2 % of F_S and a load cell's offset."""
    folder.mkdir(parents=True, exist_ok=True)
    random, recordings = np.random.default_rng(1), []
    for i, levels in enumerate(LEVELS):
        d = path(levels)
        force = stretched(d, SLIP, STIFFNESS) + LOOP_FORCES[kind](d, *SIZES[kind])
        force = force + 0.3 + 0.02 * random.standard_normal(d.size)
        held = {"displacement": d.tolist(), "force": force.tolist()}
        (folder / f"loop{i}.json").write_text(json.dumps(held))
        use = "hold_out" if i == 2 else "fit"
        recordings.append({"file": f"loop{i}.json", "kind": "loop", "joint": "J1", "use": use})
    model = {"builder": "three_mass"}
    _write(folder, {"model": model, "recordings": recordings}, kind, "J1", SIZES[kind], JOINT)


def write_modes(kind: str, folder: Path) -> None:
    """Curves of the three modes of a chain with one joint, one hit of each held out."""
    folder.mkdir(parents=True, exist_ok=True)
    place, sizes, force = MODE_FORCES[kind]
    np.savez(
        folder / "model.npz",
        M=chain.M,
        C=chain.damping(),
        K=chain.K,
        row_labels=list(chain.ROWS),
        rows=np.stack(list(chain.ROWS.values())),
        sensor_labels=["a3"],
        sensor_rows=chain.ROWS["m3-ground"][None],
        input_labels=["m1"],
        input_rows=chain.ROWS["m1-ground"][None],
    )
    recordings = []
    for mode, hits in chain.measured(place, lambda d, v: force(d, v, *sizes)).items():
        for use, curve in zip(chain.LEVELS, hits, strict=True):
            file = f"mode{mode}_{use}.npz"
            names = ("amplitude", "frequency", "damping", "frequency_std", "damping_std")
            np.savez(folder / file, **{x: np.asarray(getattr(curve, x)) for x in names})
            recordings.append({"file": file, "kind": "curves", "use": use, "mode": mode})
    given = {"F_S": 60.0, "K_T": 2.4e5, "chi": -0.5, "beta": 1.0}
    joint = {"name": "J1", "row": "J1", "type": "iwan4", "parameters": given}
    model = {"file": "model.npz", "joints": [joint]}
    true = tuple(chain.TRUTH[name] for name in given)
    _write(folder, {"model": model, "recordings": recordings}, kind, place, sizes, true)


CASES = {
    **{f"loops_{kind}": (write_loops, kind) for kind in LOOP_FORCES},
    **{f"modes_{kind}": (write_modes, kind) for kind in MODE_FORCES},
}


def main(arguments: list[str] | None = None) -> None:
    """Write the chosen cases into folders OUT/NAME."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("--only", nargs="+", choices=tuple(CASES), metavar="NAME")
    chosen = parser.parse_args(arguments)
    for name in chosen.only or CASES:
        write, kind = CASES[name]
        write(kind, chosen.out / name)
        print(chosen.out / name, file=sys.stderr)


if __name__ == "__main__":
    main()
