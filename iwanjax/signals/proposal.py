"""A study to begin with, for files that were looked into."""

import itertools
import json
import math
import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from iwanjax.signals.channel_checks import band_with_energy
from iwanjax.signals.recording import Channel, Recording

REACH = 0.25
"""Where a mode is looked for, as share of its frequency, unless neighbours are nearer."""
_ASK = "  # the file does not say: put acceleration, velocity or displacement"


_JOINT = """  joints:
    - name: J1
      type: iwan4
      parameters: {F_S: 1.0, K_T: 1.0, chi: -0.5, beta: 1.0}  # starting values: put your own"""
_MOTIONS = ("acceleration", "velocity", "displacement")


class StudyProposal(NamedTuple):
    """What a study would say of one file.

    Attributes
    ----------
    path : Path
        The file.
    model : str
        YAML below ``model:``.
    entry : tuple of str
        Lines of its entry of ``recordings:`` below ``file:``.
    size : float
        Of its motion: the model of the largest shows most modes.
    """

    path: Path
    model: str
    entry: tuple[str, ...]
    size: float = 0.0

    @property
    def subject(self) -> str:
        """``modal`` or ``joints``: what the recording is of."""
        return self.model.lstrip().partition(":")[0]


def together(proposals: Sequence[StudyProposal]) -> list[StudyProposal]:
    """Those that go into one study: of modes, or of a joint, whichever most are."""
    counted = Counter(each.subject for each in proposals)
    return [each for each in proposals if each.subject == max(counted, key=counted.__getitem__)]


def written(proposals: Sequence[StudyProposal], folder: Path | None = None) -> str:
    """The study of one file or of several alike, as YAML.

    Parameters
    ----------
    proposals : sequence of StudyProposal
        At least one; of three or more the last is held out.
    folder : Path, optional
        Where the study will lie; beside the files by default.
    """
    first, hold_out = proposals[0], len(proposals) > 2
    alone = len(proposals) == 1
    lines = [
        f"name: {_quoted(first.path.stem if alone else first.path.absolute().parent.name)}",
        "model:",
        max(proposals, key=lambda each: each.size).model,
        "recordings:",
    ]
    for i, each in enumerate(proposals, 1):
        file = each.path.name if folder is None else os.path.relpath(each.path, folder)
        lines.append(f"  - file: {_quoted(file)}")
        if not alone:
            held = hold_out and i == len(proposals)
            lines.append(f"    use: {'hold_out' if held else 'fit'}")
        lines += each.entry
    return "\n".join([*lines, ""])


def strongest_channel(recording: Recording) -> Channel:
    """The response of largest rms, among those that are known to measure a motion where any is."""
    known = [channel for channel in recording.channels if channel.quantity in _MOTIONS]
    return max(
        known or recording.channels,
        key=lambda channel: float(np.std(recording.channel(channel.name))),
    )


def history_study(
    path: Path,
    recording: Recording,
    channel: Channel,
    peaks: Sequence[float],
    options: dict[str, object],
) -> StudyProposal:
    """A study of free decays, or of hits with force, of the modes that hold the energy.

    Parameters
    ----------
    path : Path
        The file.
    recording : Recording
        The first that is sound in it.
    channel : Channel
        Which response of it.
    peaks : sequence of float
        Highest peaks of that channel's spectrum, Hz.
    options : dict
        What was needed to read it: ``variable``, ``sampling_rate``.
    """
    rate = recording.sampling_rate
    x = recording.channel(channel.name)
    bands = _bands(x, rate, peaks)
    forced = recording.force is not None and np.any(recording.force)
    known = channel.quantity in _MOTIONS
    lines = [
        *(f"    {key}: {json.dumps(value)}" for key, value in options.items()),
        f"    kind: {'transient' if forced else 'free_decay'}",
        "    response:",
        f"      channel: {_quoted(channel.name)}",
        f"      quantity: {channel.quantity if known else f'acceleration{_ASK}'}",
        *([f"      unit: {_quoted(channel.unit)}"] if channel.unit else []),
    ]
    return StudyProposal(path, _modes(bands), tuple(lines), float(np.std(x)))


def _bands(x: np.ndarray, rate: float, peaks: Sequence[float]) -> list[tuple[float, float]]:
    """Around every peak that has a share of the energy, halfway to its neighbours at most."""
    resolution = 2.0 * rate / x.size
    energy = band_with_energy(x, rate)
    modes = sorted(
        f for f in peaks if f > 0.0 and energy[0] - resolution <= f <= energy[1] + resolution
    )
    if not modes:
        low = max(energy[0], resolution)
        return [(low, max(energy[1], 1.5 * low))]
    between = [math.sqrt(one * other) for one, other in itertools.pairwise(modes)]
    return [
        (max(f * (1.0 - REACH), low, resolution), min(f * (1.0 + REACH), high))
        for f, low, high in zip(modes, [0.0, *between], [*between, 0.49 * rate], strict=True)
    ]


def curve_study(path: Path, kind: str, frequency: np.ndarray) -> StudyProposal:
    """A study of curves, or of stepped sines.

    Parameters
    ----------
    path : Path
        The file.
    kind : str
        Of the recording.
    frequency : (levels,) array
        Hz.
    """
    low, high = float(np.min(frequency)), float(np.max(frequency))
    if low == high:
        low, high = (1.0 - REACH) * low, (1.0 + REACH) * high
    return StudyProposal(path, _modes([(low, high)]), (f"    kind: {kind}",))


def loop_study(path: Path) -> StudyProposal:
    """A study of a joint's loops."""
    return StudyProposal(path, _JOINT, ("    kind: loop", "    joint: J1"))


def _modes(bands: Sequence[tuple[float, float]]) -> str:
    lines = [
        f"    - {{name: mode{i}, band: [{low:.6g}, {high:.6g}], joint: {{type: iwan4}}}}"
        for i, (low, high) in enumerate(bands, 1)
    ]
    return "\n".join(["  modal:", *lines])


def _quoted(text: str) -> str:
    """Text as YAML takes it, whatever is in it."""
    return json.dumps(text, ensure_ascii=False)
