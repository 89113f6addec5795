"""A study's recordings as they would be with an effect in the structure.

The forces that were measured drive the structure from rest; the responses pass the measurement
chain of `acquisition` and get the noise of the study's sensors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from iwanjax.errors import InputError
from iwanjax.trial.acquisition import decimate, saturate, transduced
from iwanjax.trial.effects import Effect
from iwanjax.trial.physics import FILTER_SPAN, march
from iwanjax.trial.structure import Array, Iwan, TrialStructure

FORCE_NOISE = 0.001
"""Standard deviation of a force's noise over the largest force of its recording."""
# What finer steps within a sampling interval may change, as share of the noise, and the numbers of
# steps tried.
_STEP_ERROR, _STEPS = 0.2, (8, 16, 32, 64, 128)


@dataclass(frozen=True, eq=False)
class Take:
    """One recording of the study.

    Attributes
    ----------
    name : str
    use : str
        fit or hold_out.
    order : int
        Position in the study, on which a drifting joint depends.
    force : (N, inputs) array
        As measured, zero at inputs that were not hit.
    response : (N, sensors) array
        As measured; NaN for a sensor that this one lacks.
    """

    name: str
    use: str
    order: int
    force: Array
    response: Array

    @property
    def measured(self) -> np.ndarray:
        """Which sensors it has, (sensors,)."""
        return ~np.all(np.isnan(self.response), axis=0)


@dataclass(frozen=True, eq=False)
class TrialBase:
    """A study as effects are concealed in it.

    Attributes
    ----------
    structure : TrialStructure
        As the study has it, joints at their starting values; samples are those of the longest
        recording.
    takes : tuple of Take
    noise : (sensors,) array
        Standard deviation of each sensor's noise.
    kinds : tuple of str
        What the diagnosis tries.
    quantity : str
        acceleration, velocity or displacement.
    trust : (2, n) array or None
        Relative deviations of the linear model's frequencies and dampings.
    """

    structure: TrialStructure
    takes: tuple[Take, ...]
    noise: Array
    kinds: tuple[str, ...]
    quantity: str
    trust: Array | None

    @property
    def fitted(self) -> tuple[Take, ...]:
        """What a fit may see."""
        return tuple(take for take in self.takes if take.use == "fit")

    @property
    def hardest(self) -> Take:
        """The fitted recording with the largest response, on which sizes are judged."""
        return max(self.fitted, key=lambda take: float(np.nanmean(np.square(take.response))))


@dataclass(frozen=True, eq=False)
class TrialResponses:
    """Histories (sample, channel) of each of several recordings.

    Attributes
    ----------
    structure : TrialStructure
    takes : tuple of Take
        What they are of.
    response, force : tuple of array
        One array each.
    """

    structure: TrialStructure
    takes: tuple[Take, ...]
    response: tuple[Array, ...]
    force: tuple[Array, ...]

    def recorded(
        self, noise: Array, effect: Effect | None, rng: np.random.Generator
    ) -> "TrialResponses":
        """With noise, and cut off where a channel is overloaded."""
        effects = [] if effect is None else [effect]
        sensors = list(self.structure.sensors)
        responses, forces = [], []
        for take, clean, acting in zip(self.takes, self.response, self.force, strict=True):
            noisy = clean + noise * rng.standard_normal(clean.shape)
            cut = saturate("sensor", sensors, effects, noisy[:, None])[:, 0]
            responses.append(np.where(take.measured, cut, np.nan))
            level = FORCE_NOISE * np.abs(acting).max()
            known = np.any(take.force != 0.0, axis=0)
            forces.append(acting + level * known * rng.standard_normal(acting.shape))
        return TrialResponses(self.structure, self.takes, tuple(responses), tuple(forces))


def simulated(
    base: TrialBase,
    joints: Mapping[str, Iwan],
    effect: Effect | None,
    takes: Sequence[Take],
    steps: int | None = None,
) -> TrialResponses:
    """Recordings of an effect, free of noise.

    Parameters
    ----------
    base : TrialBase
    joints : mapping of str to (F_S, K_T, chi, beta)
    effect : Effect or None
        Its values may be one number for each of `takes`.
    takes : sequence of Take
        Several times the same for several sizes.
    steps : int, optional
        Within a sampling interval; by default as many as leave less than the noise.

    Raises
    ------
    InputError
        Where no number of steps is enough.
    """
    if steps is not None:
        return _with_steps(base, joints, effect, takes, steps)[0]
    before, last = _with_steps(base, joints, effect, takes, _STEPS[0] // 2)[0], 0.0
    for each in _STEPS:
        found = _with_steps(base, joints, effect, takes, each)[0]
        if not all(np.isfinite(response).all() for response in found.response):
            return found
        change = max(
            float(np.max(np.sqrt(np.mean(np.square(x - y), axis=0)) / base.noise))
            for x, y in zip(found.response, before.response, strict=True)
        )
        # By a half or less from one doubling to the next, all others together add up to this.
        left = change**2 / (last - change) if 2.0 * change < last else change
        if left < _STEP_ERROR:
            return found
        before, last = found, change
    raise InputError(
        f"trial: with {_STEPS[-1]} steps within a sampling interval of 1 / {base.structure.rate:g} "
        "s the simulation still depends on their number; expected a reduced model, whose highest "
        "frequency is nearer the recordings' band"
    )


def path_at(
    base: TrialBase, joints: Mapping[str, Iwan], take: Take, where: str, steps: int
) -> tuple[Array, Array]:
    """Without an effect: responses (sample, sensor) and the deflection (sample,) of a row."""
    found, watched = _with_steps(base, joints, None, [take], steps, [base.structure.rows[where]])
    return found.response[0], decimate(watched, len(take.force), steps)[:, 0, 0]


def _with_steps(
    base: TrialBase,
    joints: Mapping[str, Iwan],
    effect: Effect | None,
    takes: Sequence[Take],
    steps: int,
    watched: Sequence[Array] = (),
) -> tuple[TrialResponses, Array]:
    """The same, and the deflections (step, recording, row) of the watched rows."""
    structure, effects = base.structure, [] if effect is None else [effect]
    samples = max(len(take.force) for take in takes)
    inputs = fine_forces(takes, samples, steps)
    dt = 1.0 / (structure.rate * steps)
    # Accelerations come as they are; other quantities from the sensors' own deflections.
    of_sensors = [] if base.quantity == "acceleration" else list(structure.sensors.values())
    with np.errstate(all="ignore"):
        fine = march(
            structure,
            joints,
            effects,
            inputs,
            dt,
            np.array([take.order for take in takes]),
            [*of_sensors, *watched],
        )
    seen = fine.response if not of_sensors else fine.rows[..., : len(of_sensors)]
    if base.quantity == "velocity":
        seen = np.gradient(seen, dt, axis=0)
    seen = transduced("sensor", list(structure.sensors), effects, seen, structure, steps)
    response = decimate(seen, samples, steps)
    force = decimate(inputs, samples, steps)
    return (
        TrialResponses(
            structure,
            tuple(takes),
            tuple(response[: len(take.force), i] for i, take in enumerate(takes)),
            tuple(force[: len(take.force), i] for i, take in enumerate(takes)),
        ),
        fine.rows[..., len(of_sensors) :],
    )


def fine_forces(takes: Sequence[Take], samples: int, steps: int) -> Array:
    """Forces (step, recording, input) between the samples, those of a recording's band."""
    from scipy.signal import resample_poly  # here, because it takes long to import

    fine = np.zeros(((samples + FILTER_SPAN) * steps + 1, len(takes), takes[0].force.shape[1]))
    known: dict[int, Array] = {}
    for i, take in enumerate(takes):
        if id(take) not in known:
            known[id(take)] = resample_poly(take.force, steps, 1, axis=0)
        between = known[id(take)]
        fine[: len(between), i] = between
    return fine
