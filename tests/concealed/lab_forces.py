"""The forces of a laboratory's recordings, and what they do to the structures."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from concealed import excitation
from concealed.excitation import band, elastic, largest
from concealed.lab_plan import MOVING, PART, START, LabCase, Take
from concealed.rigs import (
    BASE,
    DRIVE,
    ground_motion,
    on_shaken_ground,
    with_oscillator,
    with_shaker,
)
from concealed.structures import STRUCTURES, Array, Iwan, Structure

from iwanjax.trial.effects import Effect
from iwanjax.trial.physics import FILTER_SPAN, march

REACH = 0.8
"""Deflection of the joint that moves most over that of macroslip at level 1, joints stuck."""
SHOCK = 0.01
"""Width (s) of a shock of the ground."""
DWELLS = np.linspace(0.92, 1.06, 5)
"""Frequencies of a stepped sine over those of the first two modes."""


@dataclass(frozen=True)
class Fine:
    """What happens in recordings, in integration steps: (step, recording, channel)."""

    response: Array
    """Accelerations that the sensors feel, absolute where the ground moves."""
    force: Array
    """At every input of the study: what acts on the structure, or the ground's acceleration."""
    watched: Array
    """Deflection of the effect's place, where it is asked for."""


def study_inputs(case: LabCase) -> list[str]:
    """Of all recordings of a case."""
    shaken = case.line[1] == BASE
    return [*case.structure.inputs, *([BASE] if shaken else [])]


def rig_key(take: Take) -> str:
    """Takes of the same key share a structure, and can be integrated together."""
    return f"shaker {take.places[0]}" if take.excitation.startswith("shaker") else ""


def rig(
    structure: Structure, take: Take, effects: Sequence[Effect] = ()
) -> tuple[Structure, Array | None]:
    """The structure as it is tested, and the row of the force of a stinger where there is one."""
    for effect in effects:
        if effect.kind == "attached_oscillator":
            structure = with_oscillator(structure, effect)
    if take.excitation.startswith("base"):
        M = structure.M.copy()
        for effect in effects:
            if effect.kind == "mass_error":
                row = structure.rows[effect.where]
                M += float(effect.values[0]) * np.outer(row, row)  # type: ignore[arg-type]
        return on_shaken_ground(structure, M), None
    if take.excitation.startswith("shaker"):
        return with_shaker(structure, take.places[0])
    return structure, None


def macroslip(joint: Iwan) -> float:
    """Deflection at which every slider slips."""
    F_S, K_T, chi, beta = joint
    return F_S * (1 + beta) / (K_T * (beta + (chi + 1) / (chi + 2)))


def fine_steps(structure: Structure, take: Take, oversampling: int) -> int:
    """Steps of a recording with what comes before it and what its filter sees after it."""
    return (take.lead + (take.samples + FILTER_SPAN) * take.divisor) * oversampling + 1


def _blows(structure: Structure, take: Take, rng: np.random.Generator) -> list:
    """A blow, and where the structure is moving already an earlier one: (start, width, peak)."""

    def blow(start: float, share: float) -> tuple[float, float, float]:
        peak = share * take.level * structure.peaks[take.places[0]]
        width = rng.uniform(*structure.pulse)
        return start / structure.rate, width / structure.rate, peak

    if take.excitation == "decay":
        return [blow(START, 1.0)]
    begin = take.lead + START + float(rng.uniform(0, 20))
    if take.state == PART and take.part:
        begin += take.part[0] * structure.rate
    earlier = [blow(START, float(rng.uniform(0.5, 0.7)))] if take.state in (MOVING, PART) else []
    return [*earlier, blow(begin, 1.0)]


def _shape(
    structure: Structure, take: Take, time: Array, rng: np.random.Generator
) -> tuple[Array, bool]:
    """A lasting force of rms 1 (step,), and whether it repeats itself."""
    edges, start = band(structure), START / structure.rate
    end = (take.lead + 0.97 * take.samples * take.divisor) / structure.rate
    match take.excitation.split("_")[-1]:
        case "multisine":
            dt = time[1]
            return excitation.multisine(len(time), round(1.0 / dt), dt, edges, rng), True
        case "sweep":
            way = edges if rng.uniform() < 0.5 else edges[::-1]
            return excitation.sweep(time, start, end, way), False
        case "stepped":
            omega, _ = elastic(structure)
            dwells = np.outer(omega[:2] / (2 * np.pi), DWELLS).ravel()
            return excitation.stepped(time, start, end, dwells), False
        case "shock":
            return excitation.half_sines(time, [(start, SHOCK, 1.0)]), False
    return excitation.coloured(time, start, edges, rng), False


def applied(structure: Structure, take: Take, time: Array) -> Array:
    """Forces (step, input) at the inputs of the structure on its rig, without what is concealed."""
    rng = np.random.default_rng(take.seed)
    forces = np.zeros((len(time), len(structure.inputs)))
    labels = list(structure.inputs)
    if take.excitation in ("hammer", "decay"):
        blows = _blows(structure, take, rng)
        forces[:, labels.index(take.places[0])] = excitation.half_sines(time, blows)
        return forces
    repeats = False
    places = (DRIVE,) if DRIVE in labels else take.places
    for place in places:
        forces[:, labels.index(place)], repeats = _shape(structure, take, time, rng)
    nominal = STRUCTURES[structure.name].joints
    reach = np.stack([structure.rows[name] / macroslip(j) for name, j in nominal.items()])
    once = forces[: round(1.0 / time[1])] if repeats else forces
    return forces * (take.level * REACH / largest(structure, once, time[1], reach, repeats))


def happens(
    case: LabCase,
    takes: Sequence[Take],
    effects: Sequence[Effect] = (),
    oversampling: int | None = None,
    steps: int | None = None,
    watched: str | None = None,
) -> Fine:
    """Integrate recordings that share a rig."""
    oversampling = oversampling or case.structure.steps
    structure, stinger = rig(case.structure, takes[0], effects)
    known, _ = rig(case.known, takes[0])
    dt = 1.0 / (case.structure.rate * oversampling)
    lengths = [fine_steps(structure, take, oversampling) for take in takes]
    steps = steps or max(lengths)
    inputs = np.zeros((steps, len(takes), len(structure.inputs)))
    made: dict[int, Array] = {}
    for i, (take, length) in enumerate(zip(takes, lengths, strict=True)):
        if take.seed not in made:
            made[take.seed] = applied(known, take, dt * np.arange(length))
        inputs[: min(steps, length), i] = made[take.seed][:steps]
    order = np.array([case.takes.index(take) for take in takes])
    watch = [] if watched is None else [structure.rows[watched]]
    watch += [] if stinger is None else [stinger]
    found = march(structure, case.true, effects, inputs, dt, order, watch)
    response, force = found.response, np.zeros((steps, len(takes), len(study_inputs(case))))
    for at, label in enumerate(study_inputs(case)):
        if label in structure.inputs:
            force[..., at] = inputs[..., list(structure.inputs).index(label)]
    if stinger is not None:
        force[..., study_inputs(case).index(takes[0].places[0])] = found.rows[..., -1]
    if BASE in structure.inputs:
        ground = inputs[..., list(structure.inputs).index(BASE), None]
        moved = np.stack(list(structure.sensors.values())) @ ground_motion(structure)
        response = response + ground * moved
    return Fine(response, force, found.rows[..., : 0 if watched is None else 1])
