"""Recordings in files of one array (.npy), of sound (.wav) and of columns in JSON."""

import json
import re
import struct
from pathlib import Path
from typing import Any

import numpy as np

from iwanjax.errors import InputError
from iwanjax.signals.file_record import FileRecord, channel_of
from iwanjax.signals.labels import rate_of
from iwanjax.signals.recording import JITTER, Channel
from iwanjax.signals.text import decoded

_UNITS = re.compile(r"(.*?)[ _]units?", re.IGNORECASE)
_NAMES = ("columns", "channels", "names")


def read_npy(path: Path) -> list[FileRecord]:
    """The one array of a ``.npy`` file, as response; a structured one as its columns.

    Raises
    ------
    InputError
        For a file that is cut short or holds objects, not naming the file.
    """
    try:
        array = np.load(path, allow_pickle=False)
    except (ValueError, EOFError, SyntaxError) as error:
        told = " ".join(str(error).split())
        raise InputError(f"cannot be read as .npy ({told}); is it cut short?") from None
    if not isinstance(array, np.ndarray):
        raise InputError("is an archive, not one array; name it .npz")
    if array.dtype.names:
        return [FileRecord({name: array[name] for name in array.dtype.names})]
    return [FileRecord({"response": array})]


def read_wav(path: Path) -> list[FileRecord]:
    """Channels of a ``.wav`` file; whole numbers as shares of the full scale.

    Raises
    ------
    InputError
        For a file that is cut short or of a kind that SciPy does not read, not naming the file.
    """
    from scipy.io import wavfile  # here, because SciPy's readers take long to import

    with path.open("rb") as file:
        head = file.read(12)
    if len(head) < 12 or head[:4] not in (b"RIFF", b"RIFX") or head[8:] != b"WAVE":
        raise InputError("does not begin with RIFF and WAVE, as every .wav file does")
    size = struct.unpack("<I" if head[:4] == b"RIFF" else ">I", head[4:8])[0]
    if path.stat().st_size < 8 + size:
        raise InputError(
            f"has {path.stat().st_size} of its {8 + size} bytes; is the file cut short?"
        )
    rate, values = wavfile.read(path)
    if values.dtype.kind == "u":  # bytes, about their middle
        values = values.astype(float) - 128.0
        values /= 128.0
    elif values.dtype.kind == "i":
        values = values / (np.iinfo(values.dtype).max + 1.0)
    columns = values.reshape(len(values), -1).T
    names = [f"channel {i + 1}" for i in range(len(columns))]
    return [
        FileRecord(
            dict(zip(names, columns, strict=True)),
            {name: Channel(name, unit="full scale") for name in names},
            float(rate),
        )
    ]


def read_json(path: Path) -> list[FileRecord]:
    """Columns of numbers in JSON: by name, or one table ``data`` with the names of its columns.

    ``dt`` or a sampling rate and ``... units`` beside them are understood; other words and numbers
    are metadata. A table without names has columns called by their number.

    Raises
    ------
    InputError
        For what is no JSON or no such object, not naming the file.
    """
    held = json_object(path)
    arrays: dict[str, np.ndarray] = {}
    metadata, rate = {}, None
    names = next((held[key] for key in _NAMES if isinstance(held.get(key), list)), None)
    for key, value in held.items():
        if isinstance(value, bool | int | float | str):
            metadata[key] = str(value)
            if not isinstance(value, bool | str):
                rate = rate_of(key, float(value)) or rate
        elif isinstance(value, list) and value is not names:
            arrays |= _columns(key, value, names)
    arrays = {_name(name, array, rate): array for name, array in arrays.items()}
    units = {
        found[1].lower(): text
        for key, text in metadata.items()
        if (found := _UNITS.fullmatch(key)) and not text.replace(".", "").isdigit()
    }
    channels = {name: channel_of(name, units.get(name.lower(), "")) for name in arrays}
    return [FileRecord(arrays, channels, rate, metadata)]


def json_object(path: Path) -> dict[str, Any]:
    """What a JSON file holds by name.

    Raises
    ------
    InputError
        For what is no JSON or no object, not naming the file.
    """
    try:
        held = json.loads(decoded(path))
    except (json.JSONDecodeError, RecursionError) as error:
        raise InputError(f"is no JSON ({error}); was it cut short?") from None
    if not isinstance(held, dict):
        raise InputError("holds no object; expected {time: [...], acc1: [...]}")
    return held


def _columns(key: str, value: list[Any], names: list[Any] | None) -> dict[str, np.ndarray]:
    """A list of numbers under its name, the columns of a table under theirs."""
    try:
        array = np.array(value, float)
    except (TypeError, ValueError):
        if all(isinstance(each, str) for each in value):
            return {key: np.array(value, dtype=str)}  # names of something, or no numbers
        raise InputError(
            f"{key} holds something other than numbers, or rows of several lengths; expected "
            "numbers, (N,) or (N, columns)"
        ) from None
    if array.ndim != 2:
        return {key: array}
    labels = names or [f"column {i + 1}" for i in range(array.shape[1])]
    if len(labels) != array.shape[1]:
        raise InputError(f"{key} has {array.shape[1]} columns and {len(labels)} names")
    return {str(label): array[:, i] for i, label in enumerate(labels)}


def _name(name: str, column: np.ndarray, rate: float | None) -> str:
    """Its name, or what an unnamed column that rises by a step of time each row is."""
    if rate is None or not re.fullmatch(r"column \d+", name) or column.size < 2:
        return name
    off = np.abs(np.diff(column) * rate - 1.0)
    return "time" if np.max(off, initial=0.0) < JITTER else name
