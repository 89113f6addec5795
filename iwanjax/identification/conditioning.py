"""Recordings as a diagnosis needs them: forces without their noise, residuals' weights."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from iwanjax.dynamics.coordinates import ModalCoordinates
from iwanjax.dynamics.parabolic_hold import hold
from iwanjax.errors import InputError
from iwanjax.identification.observer import state_at_beginning
from iwanjax.identification.predictor import Data, Predictor
from iwanjax.identification.recordings import (
    CleanForce,
    StudyRecording,
    as_given,
    cleaned,
    force_noise_of,
    noise_of,
)
from iwanjax.settings.conditioning import CONDITIONING, ConditioningSettings
from iwanjax.signals.comparison_band import HALF, OF_NOISE


@dataclass(frozen=True, eq=False)
class ConditionedRecordings:
    """Recordings side by side, the shorter ones filled up.

    Attributes
    ----------
    names : tuple of str
        Of the recordings.
    data : Data
        As the predictor takes them.
    noise : (recordings, sensors) array
        Standard deviation of each sensor's noise; NaN for one that a recording lacks.
    freedom : (recordings, sensors) array
        Degrees of freedom that it was told by; infinite where the study gives it.
    warnings : tuple of str
        What is odd about them.
    forces : MeasuredForces, optional
        What acted in them.
    """

    names: tuple[str, ...]
    data: Data
    noise: np.ndarray
    freedom: np.ndarray
    warnings: tuple[str, ...]
    forces: "MeasuredForces | None" = None


@dataclass(frozen=True, eq=False)
class MeasuredForces:
    """Forces as measured, and what others in their place would do to the modes.

    Attributes
    ----------
    clean : (recordings, N, inputs) array
        Zero outside their pulses, and in free decays.
    lost : (recordings, N, inputs) array
        What was cut off their peaks, at a guess.
    moving : (recordings,) array of bool
        Whether a recording begins in motion, so that its first sample counts.
    cut : (recordings,) array of bool
        Whether a force goes on beyond its recording and is not known to repeat.
    noise : (recordings, inputs) array
        Standard deviation of the noise of those that act throughout.
    modal : ModalCoordinates
        With the rows of the inputs.
    settings : ConditioningSettings
        Of the stage.
    """

    clean: Float[np.ndarray, "recordings N inputs"]
    lost: Float[np.ndarray, "recordings N inputs"]
    moving: np.ndarray
    cut: np.ndarray
    noise: Float[np.ndarray, "recordings inputs"]
    modal: ModalCoordinates
    settings: ConditioningSettings

    @property
    def rows(self) -> Float[np.ndarray, "modes inputs"]:
        """Where the inputs act, on all modes."""
        return np.asarray(self.modal.W)

    def acting(
        self, made: Predictor, data: Data, more: Float[np.ndarray, "recordings N inputs"]
    ) -> Data:
        """Data with more force at the inputs."""
        at_end, pairs = _at_end(made, self.modal), zip(more, self.cut, strict=True)
        push = np.stack([_pushed(made, at_end, *each, self.settings) for each in pairs])
        push[self.moving, 0, -1, 2 * made.kept :] += more[self.moving, 0] @ at_end
        beyond = np.stack([made.left.driven(f, made.rate, made.quantity) for f in more])
        return data._replace(
            push=jax.device_put(np.asarray(data.push) + push),
            beyond=jax.device_put(np.asarray(data.beyond) + beyond),
        )


def conditioned(
    recordings: Sequence[StudyRecording],
    made: Predictor,
    modal: ModalCoordinates,
    known_noise: np.ndarray,
    length: int,
    count: int,
    directions: int,
    settings: ConditioningSettings = CONDITIONING,
) -> ConditionedRecordings:
    """Clean forces, integrate what they do to the modes, and weigh residuals.

    Parameters
    ----------
    recordings : sequence of StudyRecording
        To be compared together.
    made, modal : Predictor, ModalCoordinates
        Of the structure.
    known_noise : (sensors,) array
        Standard deviations that the study gives; NaN where it does not.
    length, count : int
        Samples, and recordings, to fill up to: kernels are compiled for one shape.
    directions : int
        Of a state that is uncertain.
    settings : ConditioningSettings
        Of the stage.

    Raises
    ------
    InputError
        For recordings that are not finite, and those whose forces are all zero.
    """
    rows, noises, freedoms, warnings = [], [], [], []
    forces, lost = np.zeros((2, len(recordings), length, modal.W.shape[1]))
    cycles = math.sqrt(np.max(np.asarray(made.omega2))) / (2.0 * math.pi * made.rate)
    beside = settings.ringing if cycles > settings.high else settings.beside
    at_end, cut = _at_end(made, modal), np.zeros(len(recordings), bool)
    lasting = np.zeros((len(recordings), forces.shape[2]))
    unsaid = np.full(forces.shape[2], np.nan)
    for i, each in enumerate(recordings):
        require_usable(each, settings)
        response, lacking = each.response.astype(float), ~each.measured
        missing = (0, length - len(response))
        kick = np.zeros(length)
        felt, unsure = np.zeros_like(response), np.zeros((2 * made.kept, 0))
        push = np.zeros((length, made.substeps, 2 * made.kept + at_end.shape[1]))
        if each.force is not None:
            force = cleaned(each.force.astype(float), beside, settings)
            noisy = each.force_noise or force_noise_of(each, unsaid, settings)
            if noisy is not None:
                # What nothing shows counts as none: a force that never ends has zero here.
                known = noisy.deviation
                force = replace(force, noise=np.where(np.isnan(known), force.noise, known))
            forces[i, : len(response)] = force.clean
            lost[i, : len(response)] = each.cut_off(force.clean)
            felt = _felt(made, modal, force, settings)
            unsure = _unsure(made, modal, force, settings)
            kick[min(force.last + 1, len(response) - 1)] = 1.0
            # A force that does not end with its recording goes on, but is not known to repeat.
            cut[i] = force.endless and each.initial != "periodic"
            if force.endless:
                lasting[i] = force.noise
            push[: len(response)] = _pushed(made, at_end, force.clean, bool(cut[i]), settings)
            if each.moving:
                # Accelerations follow the force at once, at the first sample too.
                push[0, -1, 2 * made.kept :] = force.clean[0] @ at_end
            warnings += _odd(each, force)
        own = each.noise
        if own is None:
            own = noise_of(each, settings).where(~np.isnan(known_noise), as_given(known_noise))
        noise = np.where(lacking, np.nan, own.deviation)
        if each.moving:
            # From its own beginning, instead of after a pulse.
            kick[:], kick[0] = 0.0, 1.0
            state, unsure = state_at_beginning(made, response, noise, push, settings)
            push[0, -1, : len(state)] = state
        rms = np.sqrt(np.mean(response**2, axis=0))
        allowed = np.hypot(settings.model_error, np.asarray(made.shape_error))
        deviation = np.sqrt(noise**2 + (allowed * rms) ** 2)
        weight = 1.0 / (OF_NOISE * np.sqrt(deviation**2 + felt**2))
        weight[:HALF] = weight[-HALF:] = weight[:, lacking] = 0.0
        rows.append(
            (
                push,
                made.left.driven(forces[i], made.rate, made.quantity),
                np.pad(np.where(lacking, 0.0, response), (missing, (0, 0))),
                np.pad(weight, (missing, (0, 0))),
                kick,
                np.pad(unsure, ((0, 0), (0, directions - unsure.shape[1]))),
            )
        )
        noises.append(noise)
        freedoms.append(np.where(lacking, np.inf, own.freedom))
    filled = [rows[i % len(rows)] for i in range(count)]
    push, beyond, response, weight, kick, unsure = (np.stack(x) for x in zip(*filled, strict=True))
    weight[len(rows) :] = 0.0
    data = Data(*jax.device_put((push, beyond, response, weight, kick, unsure)))
    names = tuple(each.name for each in recordings)
    which = np.arange(count) % len(rows)
    moving = np.array([each.moving for each in recordings])
    acted = MeasuredForces(
        forces[which], lost[which], moving[which], cut[which], lasting[which], modal, settings
    )
    return ConditionedRecordings(
        names, data, np.stack(noises), np.stack(freedoms), tuple(warnings), acted
    )


def usual_noise(batches: Sequence[ConditionedRecordings]) -> np.ndarray:
    """Deviation of each sensor's noise in the first batch that has it, (sensors,)."""
    noise = [
        next(part for x in batches if (part := x.noise[~np.isnan(x.noise[:, i]), i]).size)
        for i in range(batches[0].noise.shape[1])
    ]
    return np.array([np.median(each) for each in noise])


def directions_of(
    recordings: Sequence[StudyRecording],
    made: Predictor,
    settings: ConditioningSettings = CONDITIONING,
) -> int:
    """In how many the states of recordings are uncertain: one that is moving at first in all."""
    states = 2 * made.kept
    return states if any(each.moving for each in recordings) else min(settings.directions, states)


def require_usable(each: StudyRecording, settings: ConditioningSettings = CONDITIONING) -> None:
    """Refuse what is not finite, too short, or shows nothing; a sensor may be missing."""
    if not np.any(each.measured):
        raise InputError(f"{each.name}: response holds NaN throughout; expected a sensor")
    response = each.response[:, each.measured]
    for array, what in ((response, "response"), (each.force, "force")):
        if array is not None and not np.all(np.isfinite(array)):
            raise InputError(f"{each.name}: {what} holds NaN or infinite values")
    # What moves without a force has been moved before: a free decay, where the study says so.
    if each.force is not None and not np.any(each.force) and each.initial != "unknown":
        raise InputError(
            f"{each.name}: the force is zero throughout; a diagnosis needs the force that made a "
            "recording, or a free decay from where nothing touches the structure any more "
            "(kind: free_decay, or initial: unknown)"
        )
    silent = np.flatnonzero(~np.any(each.response, axis=0))
    if silent.size:
        which = np.flatnonzero(each.measured)[silent[0]]
        raise InputError(f"{each.name}: sensor {which} shows nothing at all; leave it out")
    if len(each.response) < settings.least:
        raise InputError(f"{each.name}: {len(each.response)} samples are too few to diagnose")


def _odd(each: StudyRecording, force: CleanForce) -> list[str]:
    """What about a recording may mislead."""
    found = []
    for i, column in enumerate(force.clean.T):
        size = np.abs(column)
        acting = int(np.sum(size > 0.1 * np.max(size))) if np.any(size) else 0
        if 0 < acting < 5:
            found.append(
                f"{each.name}: the pulse of input {i} has {acting} samples; what happens between "
                "them may look like missing physics"
            )
        if acting >= 5 and int(np.sum(size >= 0.999 * np.max(size))) >= max(3, acting // 4):
            found.append(
                f"{each.name}: the force of input {i} looks clipped; its true size is not known"
            )
    return found


def _felt(
    made: Predictor, modal: ModalCoordinates, force: CleanForce, settings: ConditioningSettings
) -> np.ndarray:
    """What errors of a force do to accelerations at once while it acts, (N, sensors)."""
    pulse = np.any(force.clean != 0, axis=1)
    if made.quantity != "acceleration":
        return np.zeros((len(pulse), made.sensors.shape[0]))
    errors = force.noise + settings.force_error * np.max(np.abs(force.clean), axis=0)
    direct = np.asarray(made.sensors) @ np.asarray(modal.W)[: made.kept]
    direct = direct + np.asarray(made.ground.sensors) @ np.asarray(made.ground.inputs).T
    size = np.sqrt(direct**2 @ errors**2)
    wide = np.convolve(pulse, np.ones(2 * HALF + 1), "same") > 0
    return wide[:, None] * size


def _at_end(made: Predictor, modal: ModalCoordinates) -> np.ndarray:
    """What inputs are at the end of a step: modal forces, and the ground's acceleration."""
    return np.hstack([np.asarray(modal.W).T, np.asarray(made.ground.inputs)])


def _pushed(
    made: Predictor,
    at_end: np.ndarray,
    force: np.ndarray,
    cut: bool,
    settings: ConditioningSettings,
) -> np.ndarray:
    """What a force does to the modes over each step, by Fourier interpolation of its samples.

    A hammer's pulse may be ten samples long. Whatever a recorder's filter lets through, up to
    half the sampling rate, comes out as it was; splines of degree 7 lose five per cent at
    0.4 of it, and modes at such frequencies would start with as large an error.
    """
    kept, W = made.kept, at_end.T
    N, steps = len(force), made.substeps
    push = np.zeros((N, steps, 2 * kept + len(W)))
    acts = np.any(force != 0, axis=1)
    near = np.flatnonzero(np.convolve(acts, np.ones(2 * settings.tail + 1), "same") > 0)
    near = near[near > 0]
    if not near.size:
        return push
    parts = settings.force_parts
    part, fine = float(made.dt) / parts, 2 * parts * steps
    between = (upsampled_between_ends if cut else upsampled)(force, fine)
    by = hold(np.asarray(made.omega2), np.asarray(made.C), part)
    for k in range(steps):
        q: Any = np.zeros((kept, len(near)))
        v: Any = q
        for j in range(k * parts, (k + 1) * parts):
            first = (near - 1) * fine + 2 * j
            f_0, f_half, f_1 = (W[:kept] @ between[first + i].T for i in range(3))
            q, v = by.free(q, v)
            p: Any = f_0, 4.0 * f_half - 3.0 * f_0 - f_1, 2.0 * (f_0 - 2.0 * f_half + f_1)
            more_q, more_v = by.pushed(p)
            q, v = q + more_q, v + more_v
        end = between[(near - 1) * fine + 2 * parts * (k + 1)] @ W.T
        # Outside its pulse what is between the samples only rings.
        end = np.where(acts[near, None], end, 0.0)
        push[near, k] = np.concatenate([q.T, v.T, end], axis=1)
    return push


def upsampled(force: np.ndarray, times: int) -> np.ndarray:
    """So many values for each sample, the first at the sample itself; no others between them."""
    found = np.fft.irfft(np.fft.rfft(force, axis=0), times * len(force), axis=0)
    return times * found


def at_ends(
    force: Float[np.ndarray, "recordings N"], substeps: int
) -> Float[np.ndarray, "recordings steps"]:
    """A force at the end of each step that leads to a sample, in all recordings."""
    between = upsampled(force.T, substeps).T
    early = np.pad(between, ((0, 0), (substeps - 1, 0)))
    return early[:, : between.shape[1]]


def upsampled_between_ends(force: np.ndarray, times: int) -> np.ndarray:
    """The same from the first sample to the last of a force that goes on before and after.

    The straight line between both, and a series of sines: as a cycle the force would jump from
    its end to its beginning, and what rings after a jump kicks the structure at the start.
    """
    N = len(force)
    line = np.linspace(force[0], force[-1], N)
    odd = (force - line)[:-1]
    cycle = np.concatenate([odd, np.zeros_like(odd[:1]), -odd[:0:-1]])
    count = (N - 1) * times + 1
    return upsampled(cycle, times)[:count] + np.linspace(force[0], force[-1], count)


def _unsure(
    made: Predictor, modal: ModalCoordinates, force: CleanForce, settings: ConditioningSettings
) -> np.ndarray:
    """Directions and deviations of the state after a pulse whose force is noisy."""
    from iwanjax.identification.observer import stepped

    kept = made.kept
    C = np.asarray(made.C)
    A = np.block(
        [
            [np.zeros((kept, kept)), np.eye(kept)],
            [-np.diag(made.omega2), -(C if C.ndim == 2 else np.diag(C))],
        ]
    )
    dt = float(made.dt) * made.substeps
    step = stepped(A, dt)
    W = np.vstack([np.zeros_like(modal.W[:kept]), modal.W[:kept]]) * dt
    columns = []
    for n in range(force.last, max(force.first - settings.ringing, 0) - 1, -1):
        active = np.flatnonzero(force.clean[n])
        columns += [W[:, i] * force.noise[i] for i in active]
        W = step @ W
    found = np.zeros((2 * kept, min(settings.directions, 2 * kept)))
    # After one that never ends there is nothing.
    if columns and not force.endless:
        # Displacements times frequencies: both halves of the state are of one size then.
        size = np.concatenate([np.sqrt(np.maximum(made.omega2, 1.0)), np.ones(kept)])
        U, S, _ = np.linalg.svd(size[:, None] * np.stack(columns, axis=1), full_matrices=False)
        count = min(found.shape[1], len(S))
        found[:, :count] = U[:, :count] * S[:count] / size[:, None]
    return found
