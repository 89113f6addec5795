"""Constant offsets of channels: where a channel rests, or as a line at zero frequency."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from iwanjax.identification.initial_state import force_begins, initial_state, rests_for
from iwanjax.identification.predictor import Quantity
from iwanjax.identification.recordings import StudyRecording, before_force, cleaned
from iwanjax.settings.conditioning import CONDITIONING
from iwanjax.structures.model_file import BASE

_CHANCE = 1.0 / 16000.0
"""That noise alone shows an offset, as in :class:`~.initial_state.InitialStateSettings`."""
_BESIDE = (2, 3, 4, 5, 6)
"""Lines of a Hann-weighted spectrum beside that at zero, which does not leak into them."""
Found = tuple[float, str]
"""An offset, and where it shows."""


def without_offsets(
    recordings: Sequence[StudyRecording],
    sensors: Sequence[str],
    inputs: Sequence[str],
    quantity: Quantity,
    rigid: bool,
    modes: Sequence[float] | np.ndarray = (),
) -> tuple[list[StudyRecording], list[str]]:
    """Recordings without the constant offsets that their channels show, and what was taken off.

    Accelerations and velocities of a structure that cannot drift away have no mean, nor has the
    acceleration of the ground: theirs is taken over the recording. Displacements, and all
    that moves with rigid-body modes, have an offset for certain only before a force: a mean of the
    motion itself is physics, as under a one-sided law. A force has one where it rests. What noise
    explains stays.

    Parameters
    ----------
    recordings : sequence of StudyRecording
        As measured.
    sensors, inputs : sequence of str
        Names of the columns.
    quantity : {"acceleration", "velocity", "displacement"}
        What the sensors measure.
    rigid : bool
        Whether the structure has rigid-body modes.
    modes : (modes,) array, optional
        Natural frequencies, cycles per sample: of a mode whose line lies beside that at zero the
        motion is told from an offset.

    Returns
    -------
    (list of StudyRecording, list of str)
        And a line for each recording that something was taken off, or may have to be.
    """
    bounded = quantity != "displacement" and not rigid
    forces = [
        {name: _of_force(column, name == BASE) for name, column in _named(inputs, each.force)}
        for each in recordings
    ]
    forces = _as_elsewhere(forces, [dict(_named(inputs, each.force)) for each in recordings])
    recordings = [
        replace(each, force=None if each.force is None else _taken_off(each.force, off))
        for each, off in zip(recordings, forces, strict=True)
    ]
    first = [_begins(each) for each in recordings]
    seen = [
        {name: _of_sensor(x, begin, bounded, modes) for name, x in _named(sensors, each.response)}
        for each, begin in zip(recordings, first, strict=True)
    ]
    if not bounded:
        seen = _as_elsewhere(seen, [dict(_named(sensors, each.response)) for each in recordings])
    told = [
        *(_told(each, off | own) for each, off, own in zip(recordings, forces, seen, strict=True)),
        *(
            _left_in(each, sensors, own, begin)
            for each, own, begin in zip(recordings, seen, first, strict=True)
            if quantity == "displacement"
        ),
    ]
    return [
        replace(each, response=_taken_off(each.response, own))
        for each, own in zip(recordings, seen, strict=True)
    ], [line for line in told if line]


def _begins(each: StudyRecording) -> int:
    """The sample at which the force begins; 0 where it is not known to begin at rest."""
    if each.force is None or initial_state(each) != "rest":
        return 0
    return force_begins(cleaned(each.force.astype(float)))


def _as_elsewhere(
    found: Sequence[Mapping[str, Found | None]], columns: Sequence[Mapping[str, np.ndarray]]
) -> list[dict[str, Found | None]]:
    """Offsets of channels that rest in another recording, where the mean is the same."""
    whole = []
    for own, measured in zip(found, columns, strict=True):
        taken = dict(own)
        for name, column in measured.items():
            others = [off[0] for each in found if (off := each.get(name))]
            if own.get(name) or not others or not np.all(np.isfinite(column)):
                continue
            (mean, unsure), known = _line_at_zero(column), float(np.median(others))
            if abs(mean) > unsure >= abs(mean - known):
                taken[name] = known, "as in other recordings"
        whole.append(taken)
    return whole


def _named(names: Sequence[str], array: np.ndarray | None) -> list[tuple[str, np.ndarray]]:
    return [] if array is None else list(zip(names, array.T.astype(float), strict=True))


def _taken_off(array: np.ndarray, off: Mapping[str, Found | None]) -> np.ndarray:
    """The array itself where there is nothing to take off."""
    if not any(off.values()):
        return array
    return array - np.array([each[0] if each else 0.0 for each in off.values()])


def _told(each: StudyRecording, off: Mapping[str, Found | None]) -> str:
    parts = [f"{name} {own[0]:+.3g} ({own[1]})" for name, own in off.items() if own]
    return f"{each.name}: offsets were taken off: {', '.join(parts)}" if parts else ""


def _left_in(
    each: StudyRecording, sensors: Sequence[str], seen: Mapping[str, Found | None], first: int
) -> str:
    """Displacements that have a mean of which nothing tells whether it is an offset."""
    if len(before_force(each.response, first)) >= CONDITIONING.enough:
        return ""
    parts = [
        f"{name} {mean:+.3g}"
        for name, column in _named(sensors, each.response)
        if not seen[name]
        for mean, unsure in [_line_at_zero(column)]
        if abs(mean) > unsure
    ]
    return (
        f"{each.name}: a mean was left in, which a one-sided law or a sensor's offset makes: "
        f"{', '.join(parts)}; a part before the force would tell"
        if parts
        else ""
    )


def _of_sensor(
    column: Float[np.ndarray, " N"], first: int, bounded: bool, modes: Sequence[float] | np.ndarray
) -> Found | None:
    if not np.all(np.isfinite(column)):
        return None
    if bounded:
        return _of_line(column, modes)
    quiet = before_force(column, first)
    if len(quiet) < CONDITIONING.enough:
        return None
    return _mean_of(quiet, "before the force")


def _of_force(column: Float[np.ndarray, " N"], base: bool) -> Found | None:
    if not np.all(np.isfinite(column)) or not np.any(column):
        return None
    rest = max((each[: rests_for(each)] for each in (column, column[::-1])), key=len)
    if len(rest) > CONDITIONING.enough + CONDITIONING.spoilt:
        return _mean_of(rest[: -CONDITIONING.spoilt], "where it rests")
    return _of_line(column) if base else None


def _mean_of(rest: np.ndarray, where: str) -> Found | None:
    """Of samples in which nothing but noise is, if it is beyond what noise makes."""
    mean, count = float(np.mean(rest)), len(rest)
    unsure = np.std(rest, ddof=1) / np.sqrt(count)
    return (mean, where) if abs(mean) > _beyond(count - 1) * unsure else None


def _of_line(
    column: Float[np.ndarray, " N"], modes: Sequence[float] | np.ndarray = ()
) -> Found | None:
    mean, unsure = _line_at_zero(column, modes)
    return (mean, "mean") if abs(mean) > unsure else None


def _line_at_zero(
    column: Float[np.ndarray, " N"], modes: Sequence[float] | np.ndarray = ()
) -> tuple[float, float]:
    """The mean under a Hann window, and what it may be by the spectrum beside it alone.

    Motion that begins and ends within the window, or goes on, adds nothing to it: of
    an acceleration it sees the displacement times the window's second derivative. Modes whose
    lines lie beside that at zero are taken out first, with amplitudes that change linearly.
    """
    N = len(column)
    n = np.arange(N)
    window = 1.0 - np.cos(2.0 * np.pi * n / N)
    turn = 2.0 * np.pi * np.outer(n / N, _apart(N * np.asarray(modes, float)))
    waves = np.concatenate([np.cos(turn), np.sin(turn)], axis=1)
    X = np.concatenate([np.ones((N, 1)), waves, waves * (n / N - 0.5)[:, None]], axis=1)
    # Each amplitude takes as much from the lines that tell how unsure the mean is.
    freedom = 2 * len(_BESIDE) - X.shape[1] + 1
    if freedom <= 0:
        return 0.0, np.inf
    inverse = np.linalg.inv(X.T @ (window[:, None] * X))
    fitted = inverse @ (X.T @ (window * column))
    column = column - X[:, 1:] @ fitted[1:]
    # By how much the amplitudes leave the mean open, over what it would be alone.
    wider = float(np.sqrt(inverse[0, 0] * N))
    lines = np.fft.rfft(window * column)[: max(_BESIDE) + 1] / N
    beside = np.sqrt(np.sum(np.abs(lines[list(_BESIDE)]) ** 2) / (0.5 * freedom))
    return float(np.real(lines[0])), float(_beyond(freedom) * beside * wider)


def _apart(lines: np.ndarray) -> np.ndarray:
    """Of modes within a line of one another the lowest, of those beside the line at zero."""
    found: list[float] = []
    for line in np.sort(lines[(lines > 0.0) & (lines < max(_BESIDE) + 1)]):
        if not found or line > found[-1] + 1.0:
            found.append(float(line))
    return np.array(found)


def _beyond(freedom: int) -> float:
    """Deviations that noise exceeds by chance, its own deviation known to so many freedoms."""
    from scipy.special import stdtrit

    return float(-stdtrit(freedom, 0.5 * _CHANCE))
