"""What reads a recording, by the extension of its file."""

import contextlib
from collections.abc import Callable
from pathlib import Path

from iwanjax.errors import InputError
from iwanjax.files import existing_file, read_arrays
from iwanjax.signals.columns import read_table
from iwanjax.signals.file_record import FileRecord
from iwanjax.signals.labview import read_lvm, read_tdms
from iwanjax.signals.plain_files import read_json, read_npy, read_wav
from iwanjax.signals.universal import read_universal


def _text(path: Path) -> list[FileRecord]:
    return [read_table(path)]


_READERS: dict[str, Callable[[Path], list[FileRecord]]] = {
    **dict.fromkeys((".csv", ".txt"), _text),
    **dict.fromkeys((".uff", ".unv", ".uf"), read_universal),
    ".lvm": read_lvm,
    ".tdms": read_tdms,
    ".json": read_json,
    ".npy": read_npy,
    ".wav": read_wav,
}


def is_container(path: Path) -> bool:
    """Whether a file holds arrays by name, structs and cells: .npz, .mat, HDF5."""
    return path.suffix.lower() not in _READERS


def known_file(path: str | Path) -> Path:
    """A path to a file that is there, of a kind that is read.

    Raises
    ------
    InputError
    """
    return existing_file(path, _READERS)


def is_read(path: Path) -> bool:
    """Whether there is a file of a kind that is read."""
    with contextlib.suppress(InputError):
        known_file(path)
        return True
    return False


def read_file(path: str | Path) -> tuple[Path, list[FileRecord]]:
    """What a file of any kind holds, a container as one record of all its arrays.

    Parameters
    ----------
    path : str or Path
        The file; its extension says how it is read.

    Returns
    -------
    Path
    list of FileRecord

    Raises
    ------
    InputError
        One line naming the file: missing, of unknown kind, damaged; the extra that is missing.
    """
    path = known_file(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        return path, [FileRecord(read_arrays(path))]
    try:
        return path, reader(path)
    except InputError as error:
        place = "" if str(error).startswith(str(path)) else f"{path}: "
        raise InputError(f"{place}{error}") from None
    except PermissionError:
        raise InputError(f"{path}: may not be read; check the file's permissions") from None
    except Exception as error:  # the libraries raise a dozen kinds for damaged files
        told = " ".join(str(error).split())
        raise InputError(
            f"{path}: cannot be read as {path.suffix} ({type(error).__name__}: {told}); is it cut "
            "short? export it again"
        ) from None
