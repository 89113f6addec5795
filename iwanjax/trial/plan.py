"""What is concealed where and how strongly in each trial, and what the diagnosis is told."""

import math
from dataclasses import dataclass, replace

import numpy as np

from iwanjax.errors import InputError
from iwanjax.trial.effects import LINEAR, Effect
from iwanjax.trial.simulation import Take, TrialBase, TrialResponses, path_at, simulated
from iwanjax.trial.sizes import (
    BANDS,
    REACHED,
    Search,
    fault_values,
    relative_change,
    scaled,
    size_for,
)
from iwanjax.trial.structure import Array, Iwan, TrialStructure, inexact, tangent_stiffness

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
    "tanh_spring",
    "bouc_wen",
    "attached_oscillator",
)
"""Kinds that act at a row and have a name."""
SIMULATED = {
    "tanh_spring": "softening",
    "bouc_wen": "smooth_hysteresis",
    "attached_oscillator": "attached_mass",
}
"""What `foreign_laws` calls those of them that it has."""
UNNAMED = (
    "root_damper",
    "squeezed_damper",
    "growing_inertia",
    "pinched",
    "bristles",
    "rubbing_freeplay",
    "fractional_damper",
)
"""Laws of `foreign_laws` that act at a row and are in no catalogue."""
OF_JOINTS = ("stiction", "joint_drift")
OF_SENSORS = ("sensor_gain", "sensor_delay", "sensor_saturation", "sensor_polarity")
NAMED = (*FORCES, *OF_JOINTS, *OF_SENSORS)
# Draws of a place and a kind until one changes the recordings as much as it should.
_TRIES = 30
# Largest cosine between a row and a joint's at which the two are different places.
_PARALLEL = 0.999
# Logarithmic scatter of a joint's F_S, K_T and beta about what the study gives, that of chi, and
# between what chi stays.
_SCATTER, _SCATTER_CHI, _CHI_LIMITS = (0.4, 0.05, 0.4), 0.1, (-0.9, -0.05)
# Steps within a sampling interval that sizes are judged at.
_COARSE = 8


@dataclass(frozen=True)
class TrialPlan:
    """How many trials there are, and of which sort.

    Attributes
    ----------
    count : int
    seed : int
    empty : float
        Share of trials with nothing concealed.
    left_out : float
        Share of the others whose law the diagnosis is not told of: the law is taken out of its
        catalogue, or is in no catalogue.
    """

    count: int = 12
    seed: int = 0
    empty: float = 1.0 / 3.0
    left_out: float = 1.0 / 3.0

    def __post_init__(self) -> None:
        """Refuse what is no plan."""
        if self.count < 1:
            raise InputError(f"trial: count = {self.count}; expected at least 1")
        for name in ("empty", "left_out"):
            share = getattr(self, name)
            if not 0.0 <= share <= 1.0:
                raise InputError(f"trial: {name} = {share:g}; expected a share between 0 and 1")

    @property
    def sorts(self) -> tuple[str, ...]:
        """Of each trial: empty, named or left out; shuffled, so that a number tells nothing."""
        empty = round(self.empty * self.count)
        hidden = round(self.left_out * (self.count - empty))
        named = self.count - empty - hidden
        sorts = ["empty"] * empty + ["left_out"] * hidden + ["named"] * named
        order = np.random.default_rng([self.seed]).permutation(self.count)
        return tuple(sorts[i] for i in order)


@dataclass(frozen=True, eq=False)
class ConcealedTrial:
    """One trial: what is true, and what was measured of it.

    Attributes
    ----------
    number : int
    sort : str
        empty, named or left_out.
    kind : str
        As a diagnosis calls it; none in an empty trial.
    effect : Effect or None
    strength : str
        plain, medium or weak; empty without effect.
    joints : mapping of str to (F_S, K_T, chi, beta)
        True ones.
    responses : TrialResponses
        With noise, as recorded.
    """

    number: int
    sort: str
    kind: str
    effect: Effect | None
    strength: str
    joints: dict[str, Iwan]
    responses: TrialResponses


def concealed(base: TrialBase, plan: TrialPlan, number: int) -> ConcealedTrial:
    """The trial of a number; it depends on the base, the seed and the number alone.

    Raises
    ------
    InputError
        Where no drawn effect changes the recordings as much as it should.
    """
    sort = plan.sorts[number]
    rng = np.random.default_rng([plan.seed, number])
    joints = {name: _scattered(joint, rng) for name, joint in base.structure.joints.items()}
    truth = replace(base, structure=_inexact(base, rng))
    if sort == "empty":
        return ConcealedTrial(
            number, sort, "none", None, "", joints, _recorded(truth, joints, None, rng)
        )
    for _ in range(_TRIES):
        kind, where = _drawn(base, sort, rng)
        act = SIMULATED.get(kind, kind)
        strength = str(rng.choice(["plain", "medium", *(["weak"] if sort == "named" else [])]))
        effect = _sized(truth, joints, act, where, strength, rng)
        if effect is None:
            continue
        try:
            responses = _recorded(truth, joints, effect, rng)
        except InputError:  # too stiff for any number of steps
            continue
        if all(np.isfinite(each).all() for each in responses.response):
            return ConcealedTrial(number, sort, kind, effect, strength, joints, responses)
    raise InputError(
        f"trial {number}: none of {_TRIES} drawn effects changes the recordings by "
        f"{100 * BANDS['weak'][0]:g} % or more; expected hits that move the structure's rows"
    )


def _scattered(joint: Iwan, rng: np.random.Generator) -> Iwan:
    """A joint about the given one, as a study's starting values are off."""
    F_S, K_T, chi, beta = joint
    of_F_S, of_K_T, of_beta = (float(np.exp(rng.uniform(-s, s))) for s in _SCATTER)
    chi = float(np.clip(chi + rng.uniform(-_SCATTER_CHI, _SCATTER_CHI), *_CHI_LIMITS))
    return F_S * of_F_S, K_T * of_K_T, chi, beta * of_beta


def _inexact(base: TrialBase, rng: np.random.Generator) -> TrialStructure:
    """The true structure: its modes are as far off the study's as the study's trust allows."""
    structure = base.structure
    if base.trust is None:
        return structure
    frequencies, dampings = base.trust * rng.standard_normal(base.trust.shape)
    K, C = inexact(structure, tangent_stiffness(structure), frequencies, np.expm1(dampings))
    return replace(structure, K=K, C=C)


def _drawn(base: TrialBase, sort: str, rng: np.random.Generator) -> tuple[str, str]:
    """A kind and a place where it can act."""
    structure = base.structure
    among = [kind for kind in NAMED if kind in base.kinds]
    if sort == "left_out":
        among = [kind for kind in FORCES if kind in base.kinds]
        # As often a law that no catalogue has as one that is taken out of it.
        among = list(UNNAMED) if rng.random() < 0.5 or not among else among
    if not structure.joints:
        among = [kind for kind in among if kind not in OF_JOINTS]
    kind = str(rng.choice(among))
    if kind in OF_JOINTS:
        return kind, str(rng.choice(list(structure.joints)))
    if kind in OF_SENSORS:
        return kind, str(rng.choice(list(structure.sensors)))
    return kind, str(rng.choice(_places(structure, kind)))


def _places(structure: TrialStructure, kind: str) -> list[str]:
    """Rows along which no joint lies; of a mass one that moves as a sensor does, if there is."""
    of_joints = [structure.rows[name] for name in structure.joints]
    free = [
        name
        for name, row in structure.rows.items()
        if not any(_parallel(row, other) for other in of_joints)
    ]
    seen = [
        name
        for name in free
        if any(_parallel(structure.rows[name], row) for row in structure.sensors.values())
    ]
    if not free:
        raise InputError("trial: every row of the model lies along a joint; expected other rows")
    return seen if seen and kind == "mass_error" else free


def _parallel(one: Array, two: Array) -> bool:
    return abs(float(one @ two)) > _PARALLEL * float(np.linalg.norm(one) * np.linalg.norm(two))


def _sized(
    base: TrialBase,
    joints: dict[str, Iwan],
    kind: str,
    where: str,
    strength: str,
    rng: np.random.Generator,
) -> Effect | None:
    """The effect of a strength; None where it cannot change the recordings that much."""
    take = base.hardest
    if kind == "joint_drift":
        # The first recording is where a joint drifts from.
        take = replace(take, order=max(take.order, 1))
    if kind in OF_SENSORS:
        return Effect(kind, where, fault_values(kind, strength, rng, lambda: _peak(base, where)))
    without, path = path_at(base, joints, take, where, _COARSE)
    if kind in OF_JOINTS:
        search = _of_joint(kind)
    else:
        search = scaled(base.structure, kind, where, path, rng)

    def changes(sizes: Array) -> Array:
        if kind not in LINEAR:
            return _changes(base, joints, take, Effect(kind, where, search.build(sizes)), without)
        # One at a time: they change the matrices.
        each = [Effect(kind, where, search.build(size)) for size in sizes]
        return np.concatenate([_changes(base, joints, take, one, without) for one in each])

    low, high = BANDS[strength]
    size = size_for(search, changes, float(np.exp(rng.uniform(math.log(low), math.log(high)))))
    if math.isnan(size):
        return None
    effect = Effect(kind, where, tuple(float(v) for v in search.build(np.asarray(size))))
    (change,) = _changes(base, joints, take, effect, without)
    return effect if REACHED * low <= change <= high / REACHED else None


def _of_joint(kind: str) -> Search:
    if kind == "stiction":
        return Search(lambda s: (1 - s,), 0.005, 0.7)
    return Search(lambda s: (1 - s, 1 - 0.25 * s), 0.005, 0.35)


def _changes(
    base: TrialBase, joints: dict[str, Iwan], take: Take, effect: Effect, without: Array
) -> Array:
    """Relative change of a recording by each size that an effect has values for."""
    count = max(np.size(value) for value in effect.values) if effect.values else 1
    found = simulated(base, joints, effect, [take] * count, _COARSE).response
    with np.errstate(all="ignore"):
        return relative_change(np.stack(found, axis=1), without[:, None])


def _peak(base: TrialBase, where: str) -> float:
    """The largest that a sensor sees in what is fitted: what is cut off elsewhere shows nowhere."""
    at = list(base.structure.sensors).index(where)
    # NaN of a take without that sensor.
    peaks = [float(np.nanmax(np.abs(each.response[:, at]))) for each in base.fitted]
    return max(peaks)


def _recorded(
    base: TrialBase, joints: dict[str, Iwan], effect: Effect | None, rng: np.random.Generator
) -> TrialResponses:
    return simulated(base, joints, effect, base.takes).recorded(base.noise, effect, rng)
