"""A study to begin with, for a file that was looked into."""

import itertools
import json
import math
from collections.abc import Sequence
from pathlib import Path

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
) -> str:
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

    Returns
    -------
    str
        YAML, which a study file may begin with as it is.
    """
    rate = recording.sampling_rate
    bands = _bands(recording.channel(channel.name), rate, peaks)
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
    return _study(path, _modes(bands), lines)


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


def curve_study(path: Path, kind: str, frequency: np.ndarray) -> str:
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
    return _study(path, _modes([(low, high)]), [f"    kind: {kind}"])


def loop_study(path: Path, columns: Sequence[str] = ()) -> str:
    """A study of a joint's loops: displacement and force by the names of their columns."""
    named = []
    if columns:
        named = [
            f"    response: {{channel: {_quoted(columns[0])}, quantity: displacement}}",
            f"    force: {{array: {_quoted(columns[1])}}}",
        ]
    lines = ["    kind: loop", "    joint: J1", *named]
    return _study(path, _JOINT, lines)


def _modes(bands: Sequence[tuple[float, float]]) -> str:
    lines = [
        f"    - {{name: mode{i}, band: [{low:.6g}, {high:.6g}], joint: {{type: iwan4}}}}"
        for i, (low, high) in enumerate(bands, 1)
    ]
    return "\n".join(["  modal:", *lines])


def _study(path: Path, model: str, lines: Sequence[str]) -> str:
    return "\n".join(
        [
            f"name: {_quoted(path.stem)}",
            "model:",
            model,
            "recordings:",
            f"  - file: {_quoted(path.name)}",
            *lines,
            "",
        ]
    )


def _quoted(text: str) -> str:
    """Text as YAML takes it, whatever is in it."""
    return json.dumps(text, ensure_ascii=False)
