"""What a file holds: its variables, and how sound the recordings in it are."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iwanjax.errors import InputError
from iwanjax.signals.clipping import clipped_samples
from iwanjax.signals.formats import known_file, read_file
from iwanjax.signals.recording import Channel
from iwanjax.signals.records import records
from iwanjax.signals.selection import RawRecording, Selection, told_node

_MOST_RECORDINGS = 20
_PEAKS = 3
# A peak is told where it stands out of the averaged spectrum by this much.
_PROMINENCE_DB = 10.0
# What is lower than the highest peak by this much is ripple of a filter.
_DEEPEST_DB = 60.0
_FEWEST_FOR_SPECTRUM = 256


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
    """

    name: str
    samples: int = 0
    rate: float = np.nan
    duration: float = np.nan
    channels: tuple[ChannelSummary, ...] = ()
    fault: str = ""


@dataclass(frozen=True)
class FileContents:
    """Result of :func:`file_contents`; printing it gives tables.

    Attributes
    ----------
    path : Path
    variables : tuple of (str, str)
        Names and what they stand for.
    recordings : tuple of RecordingSummary
    fault : str
        Why there are no recordings; empty if there are.
    """

    path: Path
    variables: tuple[tuple[str, str], ...] = ()
    recordings: tuple[RecordingSummary, ...] = ()
    fault: str = ""

    def __str__(self) -> str:
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
    try:
        found = records(path, variable, selection)
    except InputError as error:
        return FileContents(path, variables, fault=_without(path, error))
    summaries = []
    for record in found:
        try:
            summaries.append(_summary(record.select(selection)))
        except InputError as error:
            fault = _without(record.path, error)
            if len(found) == 1:
                return FileContents(path, variables, fault=fault)
            summaries.append(RecordingSummary(record.path.name, fault=fault))
    return FileContents(path, variables, tuple(summaries))


def _summary(raw: RawRecording) -> RecordingSummary:
    rate, duration, fault = np.nan, np.nan, ""
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
    return RecordingSummary(raw.path.name, raw.time.size, rate, duration, channels, fault)


def _without(path: Path, error: InputError) -> str:
    """A fault without the place, which stands above it."""
    return str(error).removeprefix(f"{path}: ")


def _channel_summary(channel: Channel, x: np.ndarray, rate: float) -> ChannelSummary:
    finite = x[np.isfinite(x)]
    missing = x.size - finite.size
    least, largest, rms, noise, peaks = np.nan, np.nan, np.nan, np.nan, ()
    if finite.size:
        least, largest = float(np.min(finite)), float(np.max(finite))
        rms = float(np.sqrt(np.mean(finite**2)))
    if not missing and x.size >= _FEWEST_FOR_SPECTRUM and least < largest and rate > 0.0:
        noise, peaks = _spectrum(x, rate)
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
    )


def _spectrum(x: np.ndarray, rate: float) -> tuple[float, tuple[float, ...]]:
    """Noise floor in dB of the largest magnitude, and frequencies of the highest peaks."""
    import scipy.signal  # here, because it takes a second to import

    frequency, density = scipy.signal.welch(x, rate, "hann", nperseg=max(x.size // 4, 64))
    noise = np.sqrt(np.median(density) * rate / 2.0)
    floor = np.finfo(float).tiny
    level = 10.0 * np.log10(np.maximum(density, floor))
    lowest = np.max(level) - _DEEPEST_DB
    peaks, _ = scipy.signal.find_peaks(level, height=lowest, prominence=_PROMINENCE_DB)
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
            f"{channel.least:.4g}",
            f"{channel.largest:.4g}",
            f"{channel.rms:.4g}",
            str(channel.missing),
            str(channel.clipped),
            f"{channel.noise_db:.0f}",
            ", ".join(f"{peak:.4g}" for peak in channel.peaks) or "-",
        ]
        for channel in recording.channels
    ]
    head = ["channel", "measures", "min", "max", "rms", "NaN", "clipped", "noise dB", "peaks Hz"]
    lines += _table([head, *rows]) if rows else []
    return lines + ([f"  fault: {recording.fault}"] if recording.fault else [])


def _table(rows: list[list[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [("  " + "  ".join(map(str.ljust, row, widths))).rstrip() for row in rows]
