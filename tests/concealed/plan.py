"""What is concealed where and how strongly: the cases before their sizes are known.

Everything is drawn from generators seeded by the case number, so that a case never depends on
the others. A set of cases is held back, opened once when a stage of work is over, and serves
development from then on.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from concealed.hammer import Hit
from concealed.structures import STRUCTURES, Iwan, Structure

from iwanjax.trial.effects import Effect
from iwanjax.trial.plan import OF_JOINTS, OF_SENSORS

Wanted = tuple[str, str, str]
"""Kind, place and strength of a concealed effect."""


@dataclass(frozen=True)
class Case:
    """One concealed case; `effects` hold sizes once these are found."""

    number: int
    structure: Structure
    wanted: tuple[Wanted, ...]
    effects: tuple[Effect, ...]
    true: dict[str, Iwan]
    given: dict[str, Iwan]
    hits: tuple[Hit, ...]
    noise: float
    """Standard deviation of a sensor's noise over the rms of the hardest recording."""
    seed: int

    @property
    def strength(self) -> str:
        """Of the single effect; of a pair, the two joined by `+`; of an empty case, nothing."""
        return "+".join(wanted[2] for wanted in self.wanted)

    @property
    def hardest(self) -> Hit:
        """The recording on which sizes are judged."""
        return max(self.hits, key=lambda hit: hit.peak / self.structure.peaks[hit.place])


PLAIN, MEDIUM, WEAK = "plain", "medium", "weak"
# One line per case: the structure, then (kind, place, strength) of every effect.
Listed = tuple[tuple[str, tuple[Wanted, ...]], ...]
DEVELOPMENT: Listed = (
    ("chain3", (("stiffness_error", "m2-m3", PLAIN),)),
    ("lap_beam", (("stiffness_error", "tip-ground", WEAK),)),
    ("chain4", (("mass_error", "m2-ground", MEDIUM),)),
    ("lap_beam", (("viscous_damping", "w2-ground", PLAIN),)),
    ("chain2", (("viscous_damping", "m1-ground", WEAK),)),
    ("chain3", (("cubic_stiffness", "m2-m3", MEDIUM),)),
    ("oscillator", (("quadratic_stiffness", "J1", PLAIN),)),
    ("chain6", (("quadratic_stiffness", "m3-m4", WEAK),)),
    ("chain3", (("gap_contact", "m3-ground", MEDIUM),)),
    ("lap_beam", (("bilinear_stiffness", "w3-ground", PLAIN),)),
    ("chain4", (("bilinear_stiffness", "m2-m3", WEAK),)),
    ("chain2", (("coulomb_friction", "m2-ground", MEDIUM),)),
    ("chain6", (("iwan_joint", "m3-m4", PLAIN),)),
    ("lap_beam", (("iwan_joint", "w3-ground", WEAK),)),
    ("chain3", (("stiction", "J1", MEDIUM),)),
    ("chain4", (("quadratic_damping", "m3-ground", PLAIN),)),
    ("oscillator", (("quadratic_damping", "J1", WEAK),)),
    ("chain3", (("viscoelastic", "m1-ground", MEDIUM),)),
    ("chain2", (("joint_drift", "J1", PLAIN),)),
    ("lap_beam", (("joint_drift", "J1", WEAK),)),
    ("chain6", (("sensor_gain", "a4", MEDIUM),)),
    ("chain3", (("sensor_delay", "a2", PLAIN),)),
    ("chain4", (("sensor_delay", "a1", WEAK),)),
    ("lap_beam", (("sensor_saturation", "a1", MEDIUM),)),
    ("chain2", (("sensor_polarity", "a2", PLAIN),)),
    ("chain6", (("sensor_polarity", "a5", PLAIN),)),
    ("chain4", (("cubic_stiffness", "m2-m3", MEDIUM), ("sensor_gain", "a3", MEDIUM))),
    ("chain3", (("gap_contact", "m2-m3", MEDIUM), ("viscous_damping", "m1-ground", MEDIUM))),
    ("chain6", (("stiffness_error", "m2-m3", MEDIUM), ("quadratic_damping", "m6-ground", MEDIUM))),
    ("lap_beam", (("cubic_stiffness", "tip-ground", PLAIN), ("mass_error", "w2-ground", MEDIUM))),
)
OPENED: Listed = (
    ("chain6", (("stiffness_error", "m5-ground", MEDIUM),)),
    ("lap_beam", (("mass_error", "tip-ground", PLAIN),)),
    ("chain3", (("mass_error", "m3-ground", WEAK),)),
    ("chain4", (("viscous_damping", "m2-m3", MEDIUM),)),
    ("lap_beam", (("cubic_stiffness", "w3-ground", PLAIN),)),
    ("chain2", (("cubic_stiffness", "m2-ground", WEAK),)),
    ("chain3", (("quadratic_stiffness", "m2-m3", MEDIUM),)),
    ("oscillator", (("gap_contact", "J1", PLAIN),)),
    ("chain4", (("gap_contact", "m1-ground", WEAK),)),
    ("lap_beam", (("gap_contact", "tip-ground", MEDIUM),)),
    ("chain3", (("bilinear_stiffness", "m1-ground", MEDIUM),)),
    ("lap_beam", (("coulomb_friction", "w2-ground", PLAIN),)),
    ("chain6", (("coulomb_friction", "m4-m5", WEAK),)),
    ("chain3", (("iwan_joint", "m2-m3", MEDIUM),)),
    ("oscillator", (("stiction", "J1", MEDIUM),)),
    ("chain4", (("stiction", "J2", WEAK),)),
    ("lap_beam", (("quadratic_damping", "tip-ground", MEDIUM),)),
    ("chain2", (("viscoelastic", "m2-ground", PLAIN),)),
    ("chain6", (("viscoelastic", "m2-ground", WEAK),)),
    ("chain4", (("joint_drift", "J2", MEDIUM),)),
    ("chain3", (("sensor_gain", "a1", PLAIN),)),
    ("lap_beam", (("sensor_gain", "a3", WEAK),)),
    ("chain2", (("sensor_delay", "a1", MEDIUM),)),
    ("chain3", (("sensor_saturation", "a3", PLAIN),)),
    ("chain4", (("sensor_saturation", "a4", WEAK),)),
    ("lap_beam", (("sensor_polarity", "a2", PLAIN),)),
    ("chain3", (("cubic_stiffness", "m1-ground", MEDIUM), ("sensor_polarity", "a2", PLAIN))),
    ("chain4", (("gap_contact", "m3-ground", MEDIUM), ("sensor_delay", "a2", MEDIUM))),
    ("chain6", (("iwan_joint", "m4-m5", MEDIUM), ("stiffness_error", "m1-ground", MEDIUM))),
    (
        "chain2",
        (("coulomb_friction", "m1-ground", MEDIUM), ("cubic_stiffness", "m2-ground", PLAIN)),
    ),
)
BEAM: Listed = (
    ("brake_reuss", (("gap_contact", "a10-ground", PLAIN),)),
    ("brake_reuss", (("stiffness_error", "opening3", MEDIUM),)),
    ("brake_reuss", (("sensor_delay", "a9", MEDIUM),)),
)
THIRD: Listed = (
    ("oscillator", (("cubic_stiffness", "J1", WEAK),)),
    ("chain2", (("quadratic_stiffness", "m2-ground", MEDIUM),)),
    ("chain2", (("mass_error", "m2-ground", PLAIN),)),
    ("chain3", (("coulomb_friction", "m2-m3", PLAIN),)),
    ("chain3", (("viscoelastic", "m2-m3", WEAK),)),
    ("chain3", (("stiction", "J1", PLAIN),)),
    ("chain3", (("sensor_saturation", "a1", MEDIUM),)),
    ("chain4", (("cubic_stiffness", "m2-ground", WEAK),)),
    ("chain4", (("iwan_joint", "m2-m3", MEDIUM),)),
    ("chain4", (("joint_drift", "J1", WEAK),)),
    ("chain4", (("sensor_delay", "a4", MEDIUM),)),
    ("chain5", (("stiffness_error", "m3-ground", MEDIUM),)),
    ("chain5", (("gap_contact", "m2-m3", PLAIN),)),
    ("chain5", (("quadratic_damping", "m2-ground", MEDIUM),)),
    ("chain5", (("sensor_gain", "a2", WEAK),)),
    ("chain6", (("viscous_damping", "m3-m4", PLAIN),)),
    ("chain6", (("bilinear_stiffness", "m2-m3", MEDIUM),)),
    ("chain6", (("mass_error", "m4-ground", WEAK),)),
    ("chain6", (("sensor_polarity", "a1", PLAIN),)),
    ("lap_beam", (("coulomb_friction", "w3-ground", MEDIUM),)),
    ("lap_beam", (("bilinear_stiffness", "tip-ground", WEAK),)),
    ("lap_beam", (("viscoelastic", "tip-ground", PLAIN),)),
    ("lap_beam", (("stiffness_error", "w2-ground", MEDIUM),)),
    ("brake_reuss", (("cubic_stiffness", "a6-ground", MEDIUM),)),
    ("brake_reuss", (("joint_drift", "J3", MEDIUM),)),
    ("brake_reuss", (("sensor_gain", "a4", PLAIN),)),
    ("brake_reuss", (("viscous_damping", "a2-ground", PLAIN),)),
    ("chain3", (("viscous_damping", "m3-ground", MEDIUM), ("sensor_gain", "a1", MEDIUM))),
    ("chain5", (("cubic_stiffness", "m3-m4", MEDIUM), ("coulomb_friction", "m2-ground", MEDIUM))),
    ("lap_beam", (("gap_contact", "tip-ground", MEDIUM), ("sensor_delay", "a2", MEDIUM))),
)
EMPTY = ("oscillator", "chain2", "chain3", "chain4", "chain6", "lap_beam") * 3
"""Structures of the cases without an effect, in the first two sets."""
BUILT = (*("chain2", "chain3", "chain4", "chain5", "chain6", "lap_beam") * 2, "brake_reuss")
"""Structures that a drawn case may be of: larger ones are rarer, as they take longer."""
FORCES = (
    "stiffness_error",
    "mass_error",
    "viscous_damping",
    "cubic_stiffness",
    "quadratic_stiffness",
    "gap_contact",
    "bilinear_stiffness",
    "coulomb_friction",
    "iwan_joint",
    "quadratic_damping",
    "viscoelastic",
)
"""Of the drawn cases: what is drawn depends on their number and order."""
DRAWN_EMPTY = (*STRUCTURES, *STRUCTURES, "chain2", "chain3", "chain6", "lap_beam")
EMPTY_BEAMS = ("brake_reuss", "brake_reuss")
EMPTY_THIRD = (
    *("oscillator", "chain2", "chain3", "chain4", "chain5", "chain6", "lap_beam", "brake_reuss")
    * 2,
    "chain3",
    "lap_beam",
)


def _place(structure: Structure, kind: str, rng: np.random.Generator) -> str:
    """Where an effect acts: nothing parallel to a joint or over the clamped part of a beam."""
    if kind in OF_JOINTS:
        return str(rng.choice(list(structure.joints)))
    if kind in OF_SENSORS:
        return str(rng.choice(list(structure.sensors)))
    among = [row for row in structure.rows if "-" in row]
    grounded = [row for row in among if row.endswith("ground")]
    return str(rng.choice(grounded if kind == "mass_error" else among))


def _drawn(seed: int, singles: int, pairs: int) -> Listed:
    """Effects drawn at random, every kind at least once, so that nobody has chosen them.

    Two oscillators' effects are among the singles. Pairs are of different kinds and of medium
    strength.
    """
    rng = np.random.default_rng([11, seed])
    every = [*FORCES, *OF_JOINTS, *OF_SENSORS]
    kinds = [*every, *rng.choice(every, singles - 2 - len(every))]
    listed: list[tuple[str, tuple[Wanted, ...]]] = [
        ("oscillator", ((str(kind), "J1", str(rng.choice([PLAIN, MEDIUM]))),))
        for kind in rng.choice(["cubic_stiffness", "gap_contact", "quadratic_damping"], 2)
    ]
    for kind in map(str, kinds):
        name = str(rng.choice(BUILT))
        strength = str(rng.choice([PLAIN, MEDIUM, WEAK]))
        listed.append((name, ((kind, _place(STRUCTURES[name], kind, rng), strength),)))
    for _ in range(pairs):
        name = str(rng.choice(BUILT))
        first, second = map(str, rng.choice(every, 2, replace=False))
        wanted = [(k, _place(STRUCTURES[name], k, rng), MEDIUM) for k in (first, second)]
        listed.append((name, tuple(wanted)))
    return tuple(listed)


def _drawn_in(name: str, seed: int, count: int) -> Listed:
    """Effects of different kinds in one structure, none so strong that it seldom exists."""
    rng = np.random.default_rng([11, seed])
    kinds = map(str, rng.choice([*FORCES, *OF_JOINTS, *OF_SENSORS], count, replace=False))
    return tuple(
        (name, ((kind, _place(STRUCTURES[name], kind, rng), str(rng.choice([MEDIUM, WEAK]))),))
        for kind in kinds
    )


def blows(structure: Structure, rng: np.random.Generator) -> tuple[Hit, ...]:
    """Three recordings to fit (soft, middle, hard) and two held out (soft, hard), all different."""
    inputs = list(structure.inputs)
    first, second = rng.permutation([inputs[0], inputs[-1]])
    levels = [
        (first, rng.uniform(0.05, 0.10), "fit"),
        (second, rng.uniform(0.40, 0.60), "fit"),
        (first, 1.0, "fit"),
        (second, rng.uniform(0.80, 0.95), "hold_out"),
        (first, rng.uniform(0.25, 0.35), "hold_out"),
    ]
    low, high = structure.pulse
    return tuple(
        Hit(
            place=str(place),
            peak=float(structure.peaks[place] * level),
            start=float(rng.uniform(40, 60)),
            width=float(rng.uniform(low, high)),
            use=use,
            order=order,
        )
        for order, (place, level, use) in enumerate(levels)
    )


def _off(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a signed amount of a size between two limits."""
    return float(rng.uniform(low, high) * rng.choice([-1.0, 1.0]))


def scattered_joints(structure: Structure, rng: np.random.Generator) -> tuple[dict[str, Iwan], ...]:
    """Return true joints scattered about the nominal ones, and starting values that are off."""
    true, given = {}, {}
    for name, (F_S, K_T, chi, beta) in structure.joints.items():
        actual = (
            F_S * (1 + float(rng.uniform(-0.12, 0.12))),
            K_T * (1 + float(rng.uniform(-0.04, 0.04))),
            chi + float(rng.uniform(-0.05, 0.05)),
            beta * (1 + float(rng.uniform(-0.2, 0.2))),
        )
        true[name] = actual
        given[name] = (
            actual[0] * (1 + _off(rng, 0.2, 0.6)),
            actual[1] * (1 + _off(rng, 0.02, 0.08)),
            actual[2] + _off(rng, 0.05, 0.15),
            actual[3] * (1 + _off(rng, 0.2, 0.6)),
        )
    return true, given


def _case(number: int, name: str, wanted: tuple[Wanted, ...]) -> Case:
    structure = STRUCTURES[name]
    rng = np.random.default_rng([20240607, number])
    hits = blows(structure, rng)
    true, given = scattered_joints(structure, rng)
    return Case(
        number=number,
        structure=structure,
        wanted=wanted,
        effects=(),
        true=true,
        given=given,
        hits=hits,
        noise=float(rng.uniform(0.002, 0.005)),
        seed=int(rng.integers(2**31)),
    )


def _set(listed: Listed, empty: tuple[str, ...], seed: int, numbers: range) -> list[Case]:
    """Shuffle one set, so that a number tells nothing, and number it."""
    everything = [*listed, *((name, ()) for name in empty)]
    order = np.random.default_rng([7, seed]).permutation(len(everything))
    return [_case(number, *everything[j]) for number, j in zip(numbers, order, strict=False)]


SETS = {
    "dev": [
        *_set(DEVELOPMENT, EMPTY, 0, range(0, 96, 2)),
        *_set(BEAM, EMPTY_BEAMS, 2, range(96, 101)),
    ],
    "opened": _set(OPENED, EMPTY, 1, range(1, 96, 2)),
    "third": _set(THIRD, EMPTY_THIRD, 3, range(101, 149)),
    "fourth": _set(_drawn(4, 26, 4), DRAWN_EMPTY, 4, range(150, 200)),
    "fifth": _set(_drawn(5, 26, 4), DRAWN_EMPTY, 5, range(200, 250)),
    "sixth": _set(_drawn(6, 34, 6), DRAWN_EMPTY, 6, range(250, 310)),
    "seventh": [
        *_set(_drawn(7, 34, 6), DRAWN_EMPTY, 7, range(310, 370)),
        *_set(_drawn_in("brake_reuss", 8, 5), (), 8, range(370, 375)),
    ],
    "eighth": [
        *_set(_drawn(9, 34, 6), DRAWN_EMPTY, 9, range(375, 435)),
        *_set(_drawn_in("brake_reuss", 10, 5), (), 10, range(435, 440)),
    ],
    "ninth": [
        *_set(_drawn(11, 34, 6), DRAWN_EMPTY, 11, range(440, 500)),
        *_set(_drawn_in("brake_reuss", 12, 5), (), 12, range(500, 505)),
    ],
    "tenth": [
        *_set(_drawn(13, 34, 6), DRAWN_EMPTY, 13, range(505, 565)),
        *_set(_drawn_in("brake_reuss", 14, 5), (), 14, range(565, 570)),
    ],
    "eleventh": [
        *_set(_drawn(15, 34, 6), DRAWN_EMPTY, 15, range(570, 630)),
        *_set(_drawn_in("brake_reuss", 16, 5), (), 16, range(630, 635)),
    ],
}
"""Cases of each set: for development, then ten that were held back until they were opened."""


def plan() -> tuple[Case, ...]:
    """Return all cases in the order of their numbers, without the sizes of their effects."""
    return tuple(sorted(itertools.chain(*SETS.values()), key=lambda case: case.number))
