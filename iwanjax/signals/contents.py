"""What a file holds: its variables, and how sound the recordings in it are."""

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from iwanjax.errors import InputError
from iwanjax.files import Node
from iwanjax.results import AbstractResult
from iwanjax.signals.channel_checks import (
    NO_HUM,
    Hum,
    band_with_energy,
    dropouts,
    hum,
    offset_and_drift,
)
from iwanjax.signals.clipping import clipped_samples
from iwanjax.signals.curves_file import read_curves, read_force_control, read_response_control
from iwanjax.signals.formats import known_file, read_file
from iwanjax.signals.hit_checks import remarks_on_hits
from iwanjax.signals.proposal import (
    StudyProposal,
    curve_study,
    history_study,
    loop_study,
    strongest_channel,
    written,
)
from iwanjax.signals.recording import FEWEST_SAMPLES, Channel, Recording
from iwanjax.signals.records import records
from iwanjax.signals.selection import RawRecording, Selection, has_time, told_node
from iwanjax.tables import Block

_MOST_RECORDINGS = 20
_PEAKS = 3
# A peak is told where it stands out of the averaged spectrum by this much.
_PROMINENCE_DB = 10.0
# Of a channel's rms, an offset or a drift that is worth a word.
_RESTING = 0.1


@dataclass(frozen=True)
class ChannelSummary:
    """How sound one channel is; NaN where its values do not tell.

    Attributes
    ----------
    name, quantity : str
        As in :class:`iwanjax.signals.Channel`.
    least, largest, rms : float
        Of the finite values, in the channel's unit.
    missing : int
        Values that are NaN or infinite.
    clipped : int
        Samples that rest at an extreme.
    dropped : int
        Samples in stretches that stand still while the signal moves.
    offset, drift : float
        Where it rests at its end, and by how much that moved; in the channel's unit.
    hum : Hum
        The mains' line.
    band : (float, float)
        Frequencies between which 98 % of its energy is, Hz.
    unit : str
        Its label.
    noise_db : float
        Noise floor over the largest magnitude, dB: the median of the averaged spectrum taken
        for white noise. Too high where the whole band vibrates.
    peaks : tuple of float
        Frequencies of the highest peaks of the averaged spectrum, Hz, highest peak first.
    """

    name: str
    quantity: str
    least: float
    largest: float
    rms: float
    missing: int
    clipped: int
    noise_db: float
    peaks: tuple[float, ...]
    unit: str = ""
    dropped: int = 0
    offset: float = np.nan
    drift: float = np.nan
    hum: Hum = NO_HUM
    band: tuple[float, float] = (np.nan, np.nan)


@dataclass(frozen=True)
class RecordingSummary:
    """One recording of a file.

    Attributes
    ----------
    name : str
        The file's, with the recording's number.
    samples : int
    rate, duration : float
        Hz and s; NaN where time does not tell.
    channels : tuple of ChannelSummary
        Responses, then forces.
    fault : str
        Why it cannot be used as it is; empty if it can.
    remarks : tuple of str
        What to look at before it is used.
    """

    name: str
    samples: int = 0
    rate: float = np.nan
    duration: float = np.nan
    channels: tuple[ChannelSummary, ...] = ()
    fault: str = ""
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class FileContents(AbstractResult):
    """Result of :func:`file_contents`; printing it gives tables, ``plot()`` the channels.

    Attributes
    ----------
    path : Path
    variables : tuple of (str, str)
        Names and what they stand for.
    recordings : tuple of RecordingSummary
    fault : str
        Why there are no recordings; empty if there are.
    proposal : StudyProposal or None
        What a study to begin with says of it; None without data.
    sound : tuple of Recording
        The recordings that can be used as they are.
    """

    path: Path
    variables: tuple[tuple[str, str], ...] = ()
    recordings: tuple[RecordingSummary, ...] = ()
    fault: str = ""
    proposal: StudyProposal | None = None
    sound: tuple[Recording, ...] = field(default=(), repr=False)

    @property
    def study(self) -> str:
        """A study to begin with, as YAML: beside the file it loads as it is; empty without data."""
        return written([self.proposal]) if self.proposal else ""

    def _blocks(self) -> tuple[Block, ...]:
        return (str(self),)

    def __str__(self) -> str:
        study = ["", "A study to begin with, in a file beside it:", "", self.study.rstrip()]
        return "\n".join([self.told(), *(study if self.study else [])])

    def told(self) -> str:
        """Tables and remarks, without the study."""
        lines = [str(self.path)]
        if self.variables:
            lines += _table([["name", "holds"], *map(list, self.variables)])
        if self.recordings:
            lines += ["", f"{len(self.recordings)} recording(s)"]
        for recording in self.recordings[:_MOST_RECORDINGS]:
            lines += ["", *_recording_lines(recording)]
        if len(self.recordings) > _MOST_RECORDINGS:
            lines += ["", f"... and {len(self.recordings) - _MOST_RECORDINGS} more"]
        if self.fault:
            lines += ["", f"fault: {self.fault}"]
        return "\n".join(lines)


def file_contents(
    path: str | Path,
    *,
    variable: str | None = None,
    time: str = "time",
    sampling_rate: float | None = None,
) -> FileContents:
    """Look into a file; what is wrong with it becomes part of the answer.

    Parameters
    ----------
    path : str or Path
        A file that :func:`iwanjax.signals.read_recordings` may read, or any other of its kind.
    variable, time, sampling_rate
        As for :func:`iwanjax.signals.read_recordings`.

    Returns
    -------
    FileContents

    Raises
    ------
    InputError
        When there is no such file or its extension is unknown, or for a sampling rate that
        is not positive.
    """
    path = known_file(path)
    selection = Selection(time=time, sampling_rate=sampling_rate)
    try:
        held = read_file(path)[1][0].arrays
    except InputError as error:
        return FileContents(path, fault=_without(path, error))
    variables = tuple((name, told_node(node)) for name, node in held.items())
    if proposal := _of_another_kind(path, held):
        return FileContents(path, variables, proposal=proposal)
    try:
        found = records(path, variable, selection)
    except InputError as error:
        return FileContents(path, variables, fault=_without(path, error))
    summaries, sound = [], []
    for record in found:
        try:
            summary, recording = _summary(record.select(selection))
        except InputError as error:
            fault = _without(record.path, error)
            if len(found) == 1:
                return FileContents(path, variables, fault=fault)
            summaries.append(RecordingSummary(record.path.name, fault=fault))
        else:
            summaries.append(summary)
            sound += [recording] if recording is not None else []
    given = {"variable": variable, "sampling_rate": sampling_rate}
    proposal = None
    if sound:
        at = next(i for i, each in enumerate(summaries) if not each.fault)
        strongest = strongest_channel(sound[0])
        peaks = next(each.peaks for each in summaries[at].channels if each.name == strongest.name)
        options = {key: value for key, value in given.items() if value is not None}
        if len(sound) < len(found):
            options["index"] = [i for i, each in enumerate(summaries) if not each.fault]
        proposal = history_study(path, sound[0], strongest, peaks, options)
    return FileContents(path, variables, tuple(summaries), proposal=proposal, sound=tuple(sound))


def _of_another_kind(path: Path, held: Mapping[str, Node]) -> StudyProposal | None:
    """A study of a file that holds curves, stepped sines or a loop; None for any other."""
    readers = {
        "curves": read_curves,
        "response_control": read_response_control,
        "force_control": read_force_control,
    }
    if {"displacement", "force"} <= held.keys() and not has_time(held, Selection.time):
        return loop_study(path)
    if "damping" in held or "phase_rad" in held:
        for kind, reader in readers.items():
            with contextlib.suppress(InputError):
                return curve_study(path, kind, np.asarray(reader(path).frequency))
    return None


def _summary(raw: RawRecording) -> tuple[RecordingSummary, Recording | None]:
    rate, duration, fault = np.nan, np.nan, ""
    recording = None
    try:
        recording = raw.recording()
    except InputError as error:
        fault = _without(raw.path, error)
        steps = np.diff(raw.time[np.isfinite(raw.time)])
        if steps.size and np.median(steps) > 0.0:
            rate = float(1.0 / np.median(steps))
            duration = raw.time.size / rate
    else:
        rate, duration = recording.sampling_rate, recording.duration
    columns = [*zip(raw.channels, raw.response.T, strict=True)]
    if raw.force is not None:
        columns += zip(raw.inputs, raw.force.T, strict=True)
    channels = tuple(_channel_summary(channel, x, rate) for channel, x in columns)
    remarks = [each for channel in channels for each in _remarks(channel, duration)]
    remarks += [] if recording is None else remarks_on_hits(recording)
    return (
        RecordingSummary(
            raw.path.name, raw.time.size, rate, duration, channels, fault, tuple(remarks)
        ),
        recording,
    )


def _remarks(channel: ChannelSummary, duration: float) -> Iterator[str]:
    """What is wrong with a channel, in sentences."""
    # A vibration of few cycles has a mean in each quarter, of as much as this.
    cycles = 0.25 * duration * channel.peaks[0] if channel.peaks else np.inf
    least = channel.rms * max(_RESTING, 2.0 * np.sqrt(2.0) / (np.pi * cycles))
    name, unit = channel.name, f" {channel.unit}" if channel.unit else ""
    if channel.clipped:
        yield f"{name} is clipped: {channel.clipped} samples rest at an extreme"
    if channel.dropped:
        yield f"{name} drops out: {channel.dropped} samples stand still while it moves"
    if channel.hum.frequency:
        amplitude = f"{channel.hum.amplitude:.3g}{unit}"
        yield f"{name} hums: {amplitude} at {channel.hum.frequency:g} Hz throughout"
    if abs(channel.offset) > least:
        yield f"{name} rests at {channel.offset:.3g}{unit}: say offset: mean, or the number"
    if channel.drift > least:
        yield f"{name} drifts by {channel.drift:.3g}{unit}"


def _without(path: Path, error: InputError) -> str:
    """A fault without the place, which stands above it."""
    return str(error).removeprefix(f"{path}: ")


def _channel_summary(channel: Channel, x: np.ndarray, rate: float) -> ChannelSummary:
    finite = x[np.isfinite(x)]
    missing = x.size - finite.size
    least, largest, rms, noise, peaks = np.nan, np.nan, np.nan, np.nan, ()
    more: dict[str, Any] = {}
    if finite.size:
        least, largest = float(np.min(finite)), float(np.max(finite))
        rms = float(np.sqrt(np.mean(finite**2)))
    if not missing and x.size >= FEWEST_SAMPLES and least < largest and rate > 0.0:
        noise, peaks = _spectrum(x, rate)
        more = {
            "dropped": dropouts(x),
            "hum": hum(x, rate),
            "band": band_with_energy(x, rate),
            **dict(zip(("offset", "drift"), offset_and_drift(x), strict=True)),
        }
    return ChannelSummary(
        channel.name,
        channel.quantity,
        least,
        largest,
        rms,
        missing,
        clipped_samples(x),
        noise,
        peaks,
        channel.unit,
        **more,
    )


def _spectrum(x: np.ndarray, rate: float) -> tuple[float, tuple[float, ...]]:
    """Noise floor in dB of the largest magnitude, and frequencies of the highest peaks."""
    import scipy.signal  # here, because it takes a second to import

    frequency, density = scipy.signal.welch(
        x, rate, "hann", nperseg=min(x.size, max(x.size // 4, 64))
    )
    noise = np.sqrt(np.median(density) * rate / 2.0)
    floor = np.finfo(float).tiny
    level = 10.0 * np.log10(np.maximum(density, floor))
    peaks, _ = scipy.signal.find_peaks(level, prominence=_PROMINENCE_DB)
    highest = peaks[np.argsort(level[peaks])[::-1][:_PEAKS]]
    decibel = 20.0 * np.log10(max(noise, floor) / np.max(np.abs(x)))
    return float(decibel), tuple(float(f) for f in frequency[highest])


def _recording_lines(recording: RecordingSummary) -> list[str]:
    lines = [recording.name]
    if recording.samples:
        lines[0] += (
            f": {recording.samples} samples, {recording.rate:.6g} Hz, {recording.duration:.6g} s"
        )
    rows = [
        [
            channel.name,
            channel.quantity or "-",
            channel.unit or "-",
            f"{channel.least:.4g}",
            f"{channel.largest:.4g}",
            f"{channel.rms:.4g}",
            str(channel.missing),
            str(channel.clipped),
            f"{channel.noise_db:.0f}",
            "{:.4g} to {:.4g}".format(*channel.band),
            ", ".join(f"{peak:.4g}" for peak in channel.peaks) or "-",
        ]
        for channel in recording.channels
    ]
    head = ["channel", "measures", "unit", "min", "max", "rms", "NaN", "clipped"]
    head += ["noise dB", "band Hz", "peaks Hz"]
    lines += _table([head, *rows]) if rows else []
    lines += [f"  look: {remark}" for remark in recording.remarks]
    return lines + ([f"  fault: {recording.fault}"] if recording.fault else [])


def _table(rows: list[list[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [("  " + "  ".join(map(str.ljust, row, widths))).rstrip() for row in rows]
