"""The state in which a recording begins: at rest, unknown, or that of a steady cycle."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from iwanjax.identification.recordings import (
    CleanForce,
    StudyRecording,
    before_force,
    cleaned,
    in_quiet,
)
from iwanjax.settings.conditioning import CONDITIONING
from iwanjax.signals.noise import period_of
from iwanjax.types import Initial


@dataclass(frozen=True)
class InitialStateSettings:
    """When a beginning counts as rest, and a cycle as steady.

    ``unknown`` is the safe answer: it costs some parameters, a wrong ``rest`` costs the verdict.

    Attributes
    ----------
    deviations : float
        Largest sample, in deviations of white noise, that is no motion: one in 16 000 is larger.
    motionless : float
        Share of a channel's root mean square that is no motion whatever the noise is, before a
        trigger: the error that a right model may have.
    first_motionless, first_moving : float
        The same of a single first sample, and the share from which on it is motion however
        noisy the sensor is: what moves passes zero too, one cut of a
        single displacement in sixty is taken for rest.
    second_moving : float
        The same share of the second sample: what passes zero moves on, what is at rest hardly.
    begins : float
        Share of its peak at which a force that never ends begins.
    resting : float
        Share of its peak by which a force that rests may scatter.
    trend : float
        Scatter about its mean over that from sample to sample from which on it has a trend: of 20
        samples of white noise one in 50 000 does.
    steady : float
        Change of a response from period to period, as share of it, that is none.
    settled : float
        Change from the first period to the second over that of later ones, from which on the
        first is not steady yet.
    joins : float
        Step from the last sample to the first over the root mean square of all steps, up to
        which a record without a shorter period may be one period.
    """

    deviations: float = 4.0
    motionless: float = 0.002
    first_motionless: float = 0.01
    first_moving: float = 0.05
    second_moving: float = 0.2
    begins: float = 1e-3
    resting: float = 0.01
    trend: float = 2.0
    steady: float = 0.01
    settled: float = 2.0
    joins: float = 4.0


def initial_state(
    recording: StudyRecording, settings: InitialStateSettings | None = None
) -> Initial:
    """The state in which a recording begins: as it says, else by its data.

    At rest where the sensors show no more than noise before the first force; where the force
    acts from the first sample on, where the first sample of every sensor is no motion. An
    acceleration follows its force at once, so that it seldom shows rest then.

    Parameters
    ----------
    recording : StudyRecording
        A sensor that it lacks, NaN throughout, is left out.
    settings : InitialStateSettings, optional
        When a beginning counts as rest.

    Returns
    -------
    {"rest", "unknown", "periodic"}
        ``periodic`` only where the recording says so.
    """
    if recording.initial is not None:
        return recording.initial
    if recording.force is None:
        return "unknown"
    by = settings or InitialStateSettings()
    response = _measured(recording.response)
    first = force_begins(cleaned(recording.force.astype(float)), by)
    rms = np.std(response, axis=0)
    noise = in_quiet(replace(recording, response=response)).deviation
    quiet = before_force(response, first)
    if len(quiet) >= CONDITIONING.enough:
        moves = np.std(quiet, axis=0)
        none = np.maximum(CONDITIONING.coloured * noise, by.motionless * rms)
    else:
        # A mean over what is driven is no offset: that is removed before, or is motion.
        begin = np.abs(response[: max(1, first - CONDITIONING.spoilt)])
        none = np.clip(by.deviations * noise, by.first_motionless * rms, by.first_moving * rms)
        moves = np.where(np.abs(response[1]) <= by.second_moving * rms, begin.max(axis=0), np.inf)
    return "rest" if np.all(moves <= none) else "unknown"


def force_begins(force: CleanForce, settings: InitialStateSettings | None = None) -> int:
    """The sample at which a force begins, endless or not."""
    if not force.endless:
        return force.first
    size = np.max(np.abs(force.clean), axis=1)
    acts = int(np.argmax(size > (settings or InitialStateSettings()).begins * size.max()))
    return max(acts, min(rests_for(column) for column in force.clean.T if np.any(column)))


def rests_for(force: Float[np.ndarray, " N"], settings: InitialStateSettings | None = None) -> int:
    """Samples at the beginning in which a force shows noise about a constant, and no more."""
    by = settings or InitialStateSettings()
    head = force[: CONDITIONING.enough]
    middle, scatter = np.mean(head), np.std(head)
    steps = np.std(np.diff(head)) / np.sqrt(2.0)
    if scatter > min(by.resting * np.max(np.abs(force - middle)), by.trend * steps):
        return 0
    acts = np.abs(force - middle) > CONDITIONING.pulse_noise * scatter
    return int(np.argmax(acts)) if np.any(acts) else len(force)


def unsteady(recording: StudyRecording, settings: InitialStateSettings | None = None) -> str | None:
    """Why a recording that is said to be periodic is not in its steady state, if it is not.

    The force tells the period: the shortest that divides the record and repeats. Where there
    are several, the response's must repeat as well, the first of them too.

    Parameters
    ----------
    recording : StudyRecording
        With a force.
    settings : InitialStateSettings, optional
        What counts as steady.

    Returns
    -------
    str or None
        One sentence; None for a recording in steady state, and one that is not said to be.
    """
    if recording.initial != "periodic" or recording.force is None:
        return None
    by = settings or InitialStateSettings()
    response, force = _measured(recording.response), recording.force.astype(float)
    period = period_of(force, CONDITIONING.repeats, CONDITIONING.least)
    count = len(force) // period
    name = f"{recording.name}: said to be periodic, but"
    if count == 1:
        both = np.hstack([force[:, np.any(force, axis=0)], response])
        steps = np.diff(both, axis=0)
        jump = np.abs(both[0] - both[-1]) > by.joins * np.sqrt(np.mean(steps**2, axis=0))
        return f"{name} its end does not join its beginning: no whole period" if any(jump) else None
    periods = response.reshape(count, period, -1)
    size = np.sqrt(np.mean(periods**2))
    changes = np.sqrt(np.mean(np.diff(periods, axis=0) ** 2, axis=(1, 2))) / size
    usual = float(np.median(changes[1:])) if count > 2 else by.steady
    if changes[0] > max(by.settled * usual, by.steady):
        return (
            f"{name} its first period differs from the second by {100 * changes[0]:.2g} %"
            + (f", later ones by {100 * usual:.2g} %" if count > 2 else "")
            + ": cut off what is not steady yet"
        )
    if usual > CONDITIONING.repeats:
        return (
            f"{name} its response changes by {100 * usual:.2g} % from one of the force's "
            f"{count} periods to the next"
        )
    return None


def _measured(response: np.ndarray) -> np.ndarray:
    """Sensors that the recording has."""
    return response[:, np.all(np.isfinite(response), axis=0)].astype(float)
