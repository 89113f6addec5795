"""What a laboratory records, and what is concealed in it: sixty cases before their sizes are known.

A line of `LINES` says what is tested; how long, how fast, how noisy and with which sensors each
recording is made is drawn from a generator seeded by the case's number.
"""

from dataclasses import dataclass, replace

import numpy as np
from concealed.excitation import band, elastic
from concealed.plan import scattered_joints
from concealed.rigs import BASE, welded
from concealed.structures import STRUCTURES, Array, Iwan, Structure

from iwanjax.trial.effects import Effect
from iwanjax.trial.physics import FILTER_SPAN
from iwanjax.trial.structure import inexact, tangent_stiffness

TRUST = {"frequencies": 0.005, "damping": 0.2, "shapes": 0.0}
"""Relative standard deviations of a linear model that is off, as its study states them."""
EXACT, OFF = "exact", "off"
JOINTED, WELDED, TANGENT = "jointed", "linear", "tangent"
"""Joints that study and truth have; none in either; none in the study, where K holds the tangent
of the joint or slider that is concealed."""
REST, MOVING, PART, PERIODIC = "rest", "moving", "part", "periodic"
Line = tuple[str, str, str, str, str, str, str]
"""Structure, excitation, state, model, trust, kind and place of the effect."""
LINES: tuple[Line, ...] = (
    ("chain3", "hammer", REST, JOINTED, OFF, "", ""),
    ("chain5", "hammer", MOVING, WELDED, OFF, "", ""),
    ("lap_beam", "hammer", REST, JOINTED, EXACT, "cubic_stiffness", "tip-ground"),
    ("chain4", "hammer", MOVING, JOINTED, OFF, "coulomb_friction", "m2-m3"),
    ("chain6", "hammer", REST, JOINTED, EXACT, "force_gain", "m1"),
    ("brake_reuss", "hammer", REST, JOINTED, OFF, "gap_contact", "a6-ground"),
    ("chain2", "hammer", PART, JOINTED, EXACT, "sensor_high_pass", "a2"),
    ("chain4", "hammer", REST, WELDED, OFF, "iwan_joint", "m2-m3"),
    ("chain3", "random", REST, JOINTED, OFF, "", ""),
    ("chain4", "random", MOVING, WELDED, OFF, "", ""),
    ("lap_beam", "random", PART, JOINTED, OFF, "", ""),
    ("chain3", "random", MOVING, TANGENT, OFF, "iwan_joint", "m2-m3"),
    ("chain5", "random", REST, JOINTED, EXACT, "stiffness_error", "m3-m4"),
    ("chain2", "random", PART, JOINTED, EXACT, "quadratic_damping", "m2-ground"),
    ("chain6", "random", MOVING, JOINTED, OFF, "sensor_gain", "a4"),
    ("brake_reuss", "random", REST, JOINTED, EXACT, "force_delay", "mid"),
    ("chain2", "multisine", PERIODIC, JOINTED, OFF, "", ""),
    ("chain4", "multisine", PERIODIC, WELDED, OFF, "", ""),
    ("chain5", "multisine", PERIODIC, JOINTED, OFF, "", ""),
    ("chain3", "multisine", PERIODIC, WELDED, EXACT, "cubic_stiffness", "m3-ground"),
    ("chain4", "multisine", PERIODIC, JOINTED, OFF, "quadratic_stiffness", "m4-ground"),
    ("chain6", "multisine", PERIODIC, JOINTED, EXACT, "sensor_hum", "a3"),
    ("chain3", "multisine", PERIODIC, TANGENT, OFF, "coulomb_friction", "m2-m3"),
    ("chain6", "sweep", REST, JOINTED, OFF, "", ""),
    ("lap_beam", "sweep", MOVING, WELDED, OFF, "", ""),
    ("chain3", "sweep", REST, JOINTED, EXACT, "gap_contact", "m3-ground"),
    ("chain5", "sweep", MOVING, JOINTED, OFF, "viscous_damping", "m2-ground"),
    ("brake_reuss", "sweep", REST, JOINTED, EXACT, "sensor_delay", "a9"),
    ("chain4", "sweep", PART, JOINTED, EXACT, "attached_oscillator", "m3-ground"),
    ("chain2", "sweep", REST, WELDED, OFF, "force_saturation", "m1"),
    ("chain3", "stepped", MOVING, JOINTED, OFF, "", ""),
    ("chain2", "stepped", REST, WELDED, OFF, "", ""),
    ("chain2", "stepped", REST, JOINTED, EXACT, "joint_drift", "J1"),
    ("lap_beam", "stepped", MOVING, JOINTED, EXACT, "bilinear_stiffness", "tip-ground"),
    ("chain4", "stepped", PART, WELDED, OFF, "viscoelastic", "m3-ground"),
    ("chain5", "stepped", REST, JOINTED, EXACT, "sensor_drift", "a2"),
    ("chain4", "shaker", REST, JOINTED, OFF, "", ""),
    ("lap_beam", "shaker", MOVING, JOINTED, OFF, "", ""),
    ("chain3", "shaker", MOVING, WELDED, EXACT, "coulomb_friction", "m2-ground"),
    ("chain5", "shaker", REST, JOINTED, OFF, "mass_error", "m3-ground"),
    ("chain6", "shaker", PART, JOINTED, EXACT, "force_polarity", "m6"),
    ("chain2", "shaker", MOVING, TANGENT, OFF, "iwan_joint", "m2-ground"),
    ("brake_reuss", "shaker", REST, JOINTED, EXACT, "viscous_damping", "a2-ground"),
    ("chain6", "two_inputs", MOVING, JOINTED, OFF, "", ""),
    ("chain3", "two_inputs", PART, WELDED, OFF, "", ""),
    ("chain4", "two_inputs", REST, JOINTED, EXACT, "force_gain", "m4"),
    ("lap_beam", "two_inputs", MOVING, JOINTED, OFF, "sensor_polarity", "a2"),
    ("chain5", "two_inputs", REST, WELDED, OFF, "stiffness_error", "m2-m3"),
    ("chain3", "two_inputs", MOVING, JOINTED, EXACT, "stiction", "J1"),
    ("chain5", "base", REST, JOINTED, OFF, "", ""),
    ("chain2", "base", MOVING, WELDED, OFF, "", ""),
    ("chain3", "base", REST, JOINTED, OFF, "sensor_saturation", "a2"),
    ("lap_beam", "base", MOVING, JOINTED, EXACT, "mass_error", "tip-ground"),
    ("chain4", "base", PART, JOINTED, OFF, "cubic_stiffness", "m2-m3"),
    ("chain6", "base", REST, JOINTED, EXACT, "force_delay", BASE),
    ("chain3", "decay", MOVING, JOINTED, OFF, "", ""),
    ("brake_reuss", "decay", MOVING, WELDED, OFF, "", ""),
    ("chain2", "decay", MOVING, JOINTED, EXACT, "quadratic_damping", "m2-ground"),
    ("lap_beam", "decay", MOVING, WELDED, OFF, "gap_contact", "tip-ground"),
    ("chain4", "decay", MOVING, JOINTED, EXACT, "coulomb_friction", "m4-ground"),
)
HELD_OUT = {
    "hammer": "sweep",
    "random": "hammer",
    "multisine": "random",
    "sweep": "random",
    "stepped": "hammer",
    "shaker": "shaker_sweep",
    "two_inputs": "hammer",
    "base": "base_shock",
    "decay": "decay",
}
"""Excitation of the recording held out, by that of the others."""
SECONDS = {
    "hammer": (1.5, 2.2),
    "random": (3.0, 4.5),
    "multisine": (3.0, 5.0),
    "sweep": (3.5, 5.0),
    "stepped": (5.0, 7.0),
    "shaker": (3.0, 4.5),
    "shaker_sweep": (3.5, 5.0),
    "two_inputs": (3.0, 4.5),
    "base": (3.0, 4.5),
    "base_shock": (1.5, 2.2),
    "decay": (1.5, 2.5),
}
"""Lengths of recordings of a chain; of a beam, whose modes are higher, the half or the third."""
SHORTER = {"lap_beam": 0.5, "brake_reuss": 1 / 3}
START, LEAST, MOST = 40, 2000, 8000
"""Sampling intervals before anything happens; fewest and most samples of a recording."""
MIXED, FEWER, SETTLED = 0.35, 0.35, 9.0
"""Shares of the studies whose recordings differ in rate, and in sensors; time constants of the
slowest mode before a recording is called periodic."""


@dataclass(frozen=True)
class Take:
    """One recording; times in sampling intervals of the structure's own rate.

    `lead` is how long the structure has been moving when the recording begins; `part` is what the
    study uses of it, s; `level` is the largest deflection of a joint over that of macroslip (as a
    linear structure would have it), and of hammers the peak over the hardest one's.
    """

    excitation: str
    places: tuple[str, ...]
    level: float
    use: str
    state: str
    samples: int
    divisor: int
    lead: int
    sensors: tuple[str, ...]
    seed: int
    part: tuple[float, float] | None = None


@dataclass(frozen=True)
class Noise:
    """What is in every recording of a case and is no fault."""

    share: float
    """Standard deviation of an average sensor over the rms of the hardest fitted recording."""
    colour: str
    sensors: Array
    """(sensor,) factors of the standard deviation."""
    recordings: Array
    """(recording,) likewise."""
    hum: str | None
    offset: bool
    drift: str | None
    quantised: bool


@dataclass(frozen=True)
class LabCase:
    """One case; `structure` is the truth without its effect, `effects` hold sizes once found."""

    number: int
    line: Line
    structure: Structure
    true: dict[str, Iwan]
    given: dict[str, Iwan]
    frequencies: Array
    dampings: Array
    """(n,) relative deviations of the model's modes from the truth's."""
    takes: tuple[Take, ...]
    noise: Noise
    seed: int
    tangent: float = 0.0
    """Stiffness of the concealed joint or slider where K holds it."""
    effects: tuple[Effect, ...] = ()

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"lab{self.number:02d}"

    @property
    def wanted(self) -> tuple[str, str] | None:
        """Kind and place of the effect."""
        return (self.line[5], self.line[6]) if self.line[5] else None

    @property
    def hardest(self) -> Take:
        """The fitted recording on which sizes are judged."""
        return max((t for t in self.takes if t.use == "fit"), key=lambda take: take.level)

    @property
    def known(self) -> Structure:
        """The structure that a perfect linear test at low level would find: tangent included."""
        row = self.structure.rows[self.line[6]] if self.tangent else np.zeros(len(self.structure.K))
        return replace(self.structure, K=self.structure.K + self.tangent * np.outer(row, row))

    def model(self) -> Structure:
        """The structure as its study knows it: with the tangent of what is concealed, and off."""
        known = self.known
        stuck = welded(known, self.true).K
        K, C = inexact(known, stuck, self.frequencies, self.dampings)
        return replace(known, K=K, C=C)


def _deviations(structure: Structure, trust: str, rng: np.random.Generator) -> tuple[Array, Array]:
    """Of the modes within the band; what is above it is exact, as no recording tells."""
    n = len(structure.M)
    seen = len(elastic(structure)[0])
    first = int(np.searchsorted(_frequencies(structure), band(structure)[0]))
    frequencies, dampings = np.zeros(n), np.zeros(n)
    if trust == OFF:
        modes = slice(first, first + seen)
        frequencies[modes] = TRUST["frequencies"] * rng.standard_normal(seen)
        dampings[modes] = TRUST["damping"] * np.clip(rng.standard_normal(seen), -2.5, 2.5)
    return frequencies, dampings


def _frequencies(structure: Structure) -> Array:
    stiff = np.linalg.solve(structure.M, tangent_stiffness(structure))
    return np.sort(np.sqrt(np.linalg.eigvals(stiff).real)) / (2 * np.pi)


def _divisors(structure: Structure, excitation: str, rng: np.random.Generator) -> tuple[int, int]:
    """What the structure's rate is divided by in the fitted recordings and in the one held out."""
    if structure.name == "lap_beam":
        return (4, 4) if excitation == "stepped" else (1, 1)
    if structure.name == "brake_reuss":
        return 1, 1
    brief = excitation in ("hammer", "decay")
    fitted = int(rng.choice((1, 2) if brief else (2, 2, 4)))
    return fitted, fitted if rng.uniform() > MIXED else 3 - fitted if brief else 1


def _take(
    structure: Structure,
    excitation: str,
    places: tuple[str, ...],
    level: float,
    use: str,
    state: str,
    divisor: int,
    rng: np.random.Generator,
) -> Take:
    seconds = rng.uniform(*SECONDS[excitation]) * SHORTER.get(structure.name, 1.0)
    per_second = structure.rate / divisor
    samples = int(np.clip(round(seconds * per_second), LEAST, MOST))
    lead, part = 0, None
    if excitation == "decay":
        # The blow is over, and the filter has forgotten it.
        lead = divisor * int(np.ceil((START + structure.pulse[1]) / divisor) + FILTER_SPAN + 4)
    elif state == MOVING:
        lead = divisor * round(rng.uniform(0.1, 0.2) * samples)
    elif state == PERIODIC:
        _, shapes = elastic(structure)
        slowest = 0.5 * np.min(np.diag(shapes.T @ structure.C @ shapes))
        samples = round(samples / per_second) * round(per_second)  # the period is 1 s
        lead = int(np.ceil(SETTLED / slowest)) * round(structure.rate)
    elif state == PART:
        samples = min(MOST, round(1.4 * samples))
        start, end = rng.uniform(0.12, 0.25), rng.uniform(0.88, 0.97)
        part = (round(start * samples / per_second, 3), round(end * samples / per_second, 3))
    return Take(
        excitation,
        places,
        level,
        use,
        state,
        samples,
        divisor,
        lead,
        tuple(structure.sensors),
        int(rng.integers(2**31)),
        part,
    )


def _places(structure: Structure, excitation: str, wanted: str) -> tuple[str, ...]:
    """Where each fitted recording is driven: a faulty force channel is among them."""
    inputs = list(structure.inputs)
    if excitation == "base":
        return (BASE, BASE, BASE)
    first = wanted if wanted in inputs else inputs[0]
    other = next(name for name in inputs if name != first)
    if excitation in ("hammer", "decay"):
        return (first, other, first)
    return (first, first, other if excitation == "random" else first)


def _takes(structure: Structure, line: Line, rng: np.random.Generator) -> tuple[Take, ...]:
    """Two or three recordings to fit, soft to hard, and one held out, mostly of another kind."""
    _, excitation, state, _, _, _, where = line
    levels = [float(rng.uniform(0.10, 0.2)), float(rng.uniform(0.45, 0.65)), 1.0]
    if excitation in ("multisine", "stepped"):
        levels.pop(1)
    places = _places(structure, excitation, where)
    each: list[tuple[str, ...]] = [(place,) for place in places]
    if excitation == "two_inputs":
        each = [tuple(structure.inputs)] * 3
    fitted, held_out = _divisors(structure, excitation, rng)
    takes = [
        _take(structure, excitation, at, level, "fit", state, fitted, rng)
        for level, at in zip(levels, (each[0], *each[1 - len(levels) :]), strict=True)
    ]
    other = HELD_OUT[excitation]
    still = other != "decay" and (state != MOVING or rng.uniform() < 0.5)
    at = {"hammer": each[0][:1], "decay": each[1]}.get(other, each[-1])
    level = float(rng.uniform(0.6, 0.85))
    left = REST if still else MOVING
    takes.append(_take(structure, other, at, level, "hold_out", left, held_out, rng))
    if len(structure.sensors) > 2 and rng.uniform() < FEWER:
        one = int(rng.integers(len(takes)))
        gone = str(rng.choice([name for name in structure.sensors if name != where]))
        kept = tuple(name for name in structure.sensors if name != gone)
        takes[one] = replace(takes[one], sensors=kept)
    return tuple(takes)


def _noise(structure: Structure, takes: int, wanted: str, rng: np.random.Generator) -> Noise:
    sensors = list(structure.sensors)
    others = [name for name in sensors if name != wanted]
    return Noise(
        share=float(rng.uniform(0.002, 0.005)),
        colour=str(rng.choice(["white", "white", "pink"])),
        sensors=rng.uniform(0.6, 1.6, len(sensors)),
        recordings=np.exp(rng.uniform(-0.6, 0.6, takes)) if rng.uniform() < 0.4 else np.ones(takes),
        hum=str(rng.choice(others)) if rng.uniform() < 0.2 else None,
        offset=bool(rng.uniform() < 0.35),
        drift=str(rng.choice(others)) if rng.uniform() < 0.2 else None,
        quantised=bool(rng.uniform() < 0.5),
    )


def _case(number: int, line: Line) -> LabCase:
    name, _, _, model, trust, _, where = line
    rng = np.random.default_rng([31, 2, number])
    structure = STRUCTURES[name]
    true, given = scattered_joints(structure, rng)
    takes = _takes(structure, line, rng)
    frequencies, dampings = _deviations(structure, trust, rng)
    if model != JOINTED:
        structure, true, given = welded(structure, true), {}, {}
    tangent = 0.0
    if model == TANGENT:
        row = structure.rows[where]
        tangent = float(rng.uniform(0.5, 1.0)) / (row @ np.linalg.solve(structure.K, row))
    return LabCase(
        number=number,
        line=line,
        structure=structure,
        true=true,
        given=given,
        frequencies=frequencies,
        dampings=dampings,
        takes=takes,
        noise=_noise(structure, len(takes), where, rng),
        seed=int(rng.integers(2**31)),
        tangent=tangent,
    )


def lab_plan() -> tuple[LabCase, ...]:
    """All cases without the sizes of their effects."""
    return tuple(_case(number, line) for number, line in enumerate(LINES, 1))
