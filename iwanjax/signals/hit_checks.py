"""What is wrong with a hammer test: contacts that are too many, channels of the wrong sign."""

from collections.abc import Iterator

import numpy as np

from iwanjax.signals.recording import Recording

_CONTACT = 0.1
"""Of the largest force, what a contact exceeds; of the record, what all contacts last at most."""


def contacts(force: np.ndarray) -> list[tuple[int, int]]:
    """First and last sample of each contact of a force that is a hit, or several; else nothing.

    Two that are apart by less than the first lasts are one: the tip bounces on its own.

    Parameters
    ----------
    force : (N,) array
        One input.
    """
    size = np.abs(force - np.median(force))
    above = size > _CONTACT * np.max(size)
    if not np.any(above) or np.mean(above) > _CONTACT:
        return []
    edges = np.diff(np.concatenate([[False], above, [False]]).astype(int))
    found: list[tuple[int, int]] = []
    for a, b in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1, strict=True):
        if found and a - found[-1][1] <= found[0][1] - found[0][0] + 1:
            found[-1] = (found[-1][0], int(b))
        else:
            found.append((int(a), int(b)))
    return found


def remarks_on_hits(recording: Recording) -> Iterator[str]:
    """Sentences about hits that are double and about channels of reversed polarity."""
    if recording.force is None:
        return
    for i, channel in enumerate(recording.inputs):
        force = recording.force[:, i]
        found = contacts(force)
        if len(found) > 1:
            times = ", ".join(f"{recording.time[a]:.4g} s" for a, _ in found)
            yield f"{channel.name} hits {len(found)} times, at {times}: cut it, or hit again"
        if found:
            yield from _polarity(recording, channel.name, force, found[0])


def _polarity(
    recording: Recording, name: str, force: np.ndarray, contact: tuple[int, int]
) -> Iterator[str]:
    r"""The channel at the hit goes along with it: :math:`\int f \dot u\,dt > 0`.

    A structure at rest cannot give energy to what hits it. Which channel is at the hit its name
    tells, else the one that gains most speed, of those of one quantity.
    """
    first, last = contact
    rest = slice(max(0, first - (last - first) - 1), last + 1)
    speeds = {}
    for channel, x in zip(recording.channels, recording.response.T, strict=True):
        speed = _speed(channel.quantity, x[rest] - x[rest][0], recording.sampling_rate)
        if speed is not None:
            speeds[channel.name] = speed
    push = force[rest] - np.median(force)
    if not speeds:
        return
    there = [each for each in speeds if _place(each) == _place(name)]
    driven = there[0] if there else max(speeds, key=lambda each: np.max(np.abs(speeds[each])))
    if push @ speeds[driven] < 0.0:
        sure = "is" if there else "moves most while"
        of = f"{driven} {sure} at {name}" if there else f"{driven} {sure} {name} acts"
        yield f"{of} and moves against it: one of the two has the wrong sign"


def _place(name: str) -> str:
    """What a name says of the place: node and axis without the sign, wing:12:+Z."""
    parts = name.split(":")
    return f"{parts[-2]}{parts[-1].strip('+-')}" if len(parts) > 2 else name


def _speed(quantity: str, x: np.ndarray, rate: float) -> np.ndarray | None:
    """Velocity of a channel that begins at rest."""
    if quantity == "acceleration":
        return np.cumsum(x) / rate
    if quantity == "displacement":
        return np.gradient(x) * rate
    return x if quantity == "velocity" else None
