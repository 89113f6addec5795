"""Find how large the effects of the laboratory's cases must be to matter.

Run once (`python tests/concealed/lab_sizing.py [--only NAME ...]`): the values go to
lab_sizes.json. Linear effects move frequencies or dampings by several times what a trusted model
may be off; other forces change the hardest fitted recording by a quarter to a half; faults of
channels have their physical sizes.
"""

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from concealed.excitation import band, elastic
from concealed.lab_forces import fine_steps, happens, study_inputs
from concealed.lab_plan import LabCase, lab_plan
from concealed.laboratory import SIZES, clean
from concealed.sizing import OVERSAMPLING
from concealed.structures import Array, strength
from scipy.linalg import eigh

from iwanjax.trial import acquisition
from iwanjax.trial.effects import Effect
from iwanjax.trial.sizes import Search, relative_change, scaled, size_for
from iwanjax.trial.structure import tangent_stiffness

CHANGE = (0.25, 0.55)
"""Relative change of the hardest fitted recording by an effect that is not linear."""
SHIFT, DAMPED = (0.02, 0.035), (0.8, 1.5)
"""Largest relative change of a frequency within the band, and of a damping ratio, by a linear
effect: four times the deviations that a model is trusted to have, and more."""
JUDGED = 1.2
"""Length (s) of what is integrated to judge a size."""
LINEAR_KINDS = ("stiffness_error", "mass_error", "viscous_damping", "viscoelastic")


def _modes(case: LabCase, effect: Effect) -> tuple[Array, Array]:
    """Frequencies and damping ratios of the modes within the band, with a linear effect."""
    structure, row = case.structure, case.structure.rows[effect.where]
    M, C, K = structure.M, structure.C, tangent_stiffness(structure)
    pair = np.outer(row, row)
    first = float(effect.values[0])  # type: ignore[arg-type]
    match effect.kind:
        case "stiffness_error":
            K = K + first * pair
        case "mass_error":
            M = M + first * pair
        case "viscous_damping":
            C = C + first * pair
        case "viscoelastic":
            # At the first mode it is as stiff as this; its damping rises too.
            turn = elastic(structure)[0][0] * float(effect.values[1])  # type: ignore[arg-type]
            K = K + first * turn**2 / (1 + turn**2) * pair
    squared, shapes = eigh(K, M)
    omega = np.sqrt(squared)
    low, high = (2 * np.pi * edge for edge in band(structure))
    within = (omega > 0.9 * low) & (omega < 1.1 * high)
    return omega[within], np.diag(shapes.T @ C @ shapes)[within] / (2 * omega[within])


def _moved(case: LabCase, kind: str, where: str, values: tuple[float, ...]) -> float:
    """Largest relative change of what a linear effect changes most: frequency, or damping."""
    at = int(kind == "viscous_damping")
    before = _modes(case, Effect(kind, where, (0.0, *values[1:])))[at]
    return float(np.abs(_modes(case, Effect(kind, where, values))[at] / before - 1).max())


def _response(case: LabCase, effects: tuple[Effect, ...], count: int, watched: str | None):
    take = case.hardest
    steps = int((take.lead / case.structure.rate + JUDGED) * case.structure.rate * OVERSAMPLING)
    steps = min(steps, fine_steps(case.structure, take, OVERSAMPLING))
    fine = happens(case, [take] * count, effects, OVERSAMPLING, steps, watched)
    samples = steps // OVERSAMPLING - acquisition.FILTER_SPAN
    return acquisition.decimate(fine.response, samples, OVERSAMPLING), fine


def _sliding(case: LabCase, rng: np.random.Generator) -> Search:
    """A joint or slider whose tangent is in K: its size is the deflection over that of slip."""
    kind, where = case.line[5:]
    k = case.tangent
    chi, beta = float(rng.uniform(-0.6, -0.3)), float(rng.uniform(1.0, 3.0))
    deflection = float(np.abs(_response(_stuck(case), (), 1, where)[1].watched).max())
    if kind == "coulomb_friction":
        return Search(lambda s: (k + 0 * s, deflection / s), 0.2, 20.0)
    return Search(lambda s: (strength(deflection / s, k, chi, beta), k, chi, beta), 0.02, 5.0)


def _stuck(case: LabCase) -> LabCase:
    """The case without its effect, but with the tangent that K holds."""
    return replace(case, structure=case.known, tangent=0.0)


def _searched(case: LabCase, rng: np.random.Generator) -> tuple[tuple[float, ...], float]:
    """Values of a force that is not linear, and the change that they make."""
    assert case.wanted
    kind, where = case.wanted
    without, fine = _response(_stuck(case), (), 1, where if where in case.structure.rows else None)
    if case.tangent:
        search = _sliding(case, rng)
    elif kind == "stiction":
        search = Search(lambda s: (1 - s,), 0.005, 0.7)
    elif kind == "attached_oscillator":
        search = _oscillator(case, rng)
    else:
        samples = without.shape[0]
        path = acquisition.decimate(fine.watched[:, 0], samples, OVERSAMPLING)[:, 0]
        search = scaled(case.structure, kind, where, path, rng)
    target = float(np.exp(rng.uniform(*np.log(CHANGE))))

    def changes(sizes: Array) -> Array:
        effect = Effect(kind, where, search.build(sizes))
        if kind == "attached_oscillator":  # it changes the matrices: one by one
            each = [Effect(kind, where, search.build(size)) for size in sizes]
            return np.array(
                [relative_change(_response(case, (one,), 1, None)[0], without)[0] for one in each]
            )
        with np.errstate(all="ignore"):
            return relative_change(_response(case, (effect,), len(sizes), None)[0], without)

    size = np.array([size_for(search, changes, target)])
    values = tuple(float(np.ravel(value)[0]) for value in search.build(size))
    return values, float(changes(size)[0])


def _oscillator(case: LabCase, rng: np.random.Generator) -> Search:
    """A small mass that resonates near a mode, with 3 % of damping."""
    row = case.structure.rows[case.line[6]]
    mobility = float(row @ np.linalg.solve(case.structure.M, row))
    turn = float(rng.uniform(0.8, 1.2) * rng.choice(elastic(case.structure)[0][:2]))
    return Search(
        lambda s: (s / mobility, 2 * 0.03 * turn * s / mobility, turn**2 * s / mobility), 1e-3, 0.3
    )


def _linear(case: LabCase, rng: np.random.Generator) -> tuple[tuple[float, ...], float]:
    """Values of a linear effect, and how far it moves frequencies or dampings."""
    assert case.wanted
    kind, where = case.wanted
    target = float(rng.uniform(*(DAMPED if kind == "viscous_damping" else SHIFT)))
    search = scaled(case.structure, kind, where, np.array([0.0, 1.0]), rng)

    def values(size: float) -> tuple[float, ...]:
        return tuple(float(v) for v in search.build(np.float64(size)))  # type: ignore[arg-type]

    low, high = search.low, search.high
    for _ in range(40):
        middle = np.sqrt(low * high)
        if _moved(case, kind, where, values(middle)) < target:
            low = middle
        else:
            high = middle
    return values(low), _moved(case, kind, where, values(low))


def _fault(case: LabCase, rng: np.random.Generator) -> tuple[tuple[float, ...], float]:
    """Physical sizes of faults of sensors, inputs and joints that change between recordings."""
    assert case.wanted
    kind, where = case.wanted
    fitted = [take for take in case.takes if take.use == "fit"]
    sensor = kind.startswith("sensor")
    signals = clean(replace(case, takes=tuple(fitted), effects=()))
    at = (list(case.structure.sensors) if sensor else study_inputs(case)).index(where)
    heard = [signal[0 if sensor else 1][:, at] for signal in signals]
    loudest = max(float(np.abs(signal).max()) for signal in heard)
    rms = float(np.sqrt(np.mean(heard[fitted.index(case.hardest)] ** 2)))
    first = float(elastic(case.structure)[0][0] / (2 * np.pi))
    match kind.split("_", 1)[1]:
        case "gain":
            return (float(1 + rng.uniform(0.12, 0.25) * rng.choice([-1.0, 1.0])),), np.nan
        case "delay":
            return (round(float(rng.uniform(1.0, 2.5)) * 8) / 8,), np.nan
        case "saturation":
            return (float(rng.uniform(0.55, 0.7) * loudest),), np.nan
        case "high_pass":
            return (float(rng.uniform(0.12, 0.25) * first),), np.nan
        case "hum":
            share, third = rng.uniform(0.08, 0.15), rng.uniform(0.2, 0.3)
            return (float(share * rms), float(50 + rng.uniform(-0.05, 0.05)), float(third)), np.nan
        case "drift":
            return (float(rng.uniform(0.15, 0.3) * rms),), np.nan
    return (), np.nan


def find(case: LabCase) -> tuple[tuple[float, ...], float | None]:
    """Values of a case's effect, and the change that they make where one is aimed at."""
    assert case.wanted
    kind, _ = case.wanted
    rng = np.random.default_rng([case.seed, 1])
    if kind == "joint_drift":
        return (float(rng.uniform(0.85, 0.9)), float(rng.uniform(0.94, 0.97))), None
    if kind.startswith(("sensor", "force")):
        return _fault(case, rng)[0], None
    if kind in LINEAR_KINDS:
        return _linear(case, rng)
    return _searched(case, rng)


def main(arguments: list[str] | None = None) -> None:
    """Fill lab_sizes.json for all cases or for the named ones."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--only", nargs="+", metavar="NAME")
    only = parser.parse_args(arguments).only
    table = json.loads(SIZES.read_text()) if SIZES.exists() else {}
    for case in lab_plan():
        if not case.wanted or (only and case.name not in only):
            continue
        values, change = find(case)
        kind, where = case.wanted
        table[case.name] = {"kind": kind, "where": where, "values": values, "change": change}
        print(case.name, *case.line, values, change, flush=True)
        SIZES.write_text(json.dumps(dict(sorted(table.items())), indent=1) + "\n")


if __name__ == "__main__":
    main()
