"""Writing results: whole or not at all."""

import contextlib
import json
import math
import os
import re
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from iwanjax.curves import ModalCurves
from iwanjax.errors import InputError
from iwanjax.report.page import png

_CURVES = (
    "amplitude",
    "frequency",
    "damping",
    "amplitude_std",
    "frequency_std",
    "damping_std",
)


def say(line: str) -> None:
    """Tell on stderr how far a long run has come."""
    print(f"  {line}", file=sys.stderr, flush=True)


def version() -> str:
    """The package's version; it is loaded before any verb is."""
    return sys.modules["iwanjax"].__version__


def writable(folder: Path) -> None:
    """Refuse a folder that cannot be written, before anything is computed.

    Raises
    ------
    InputError
    """
    nearest = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not nearest.is_dir():
        raise _no_folder(folder, f"{nearest} is a file")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise _no_folder(folder, "no permission")


@contextlib.contextmanager
def results(folder: Path) -> Iterator[Path]:
    """A folder to write into, whose files move to ``folder`` once all of them are written.

    Raises
    ------
    InputError
        When the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".writing-", dir=folder) as temporary:
            yield Path(temporary)
            for file in sorted(Path(temporary).iterdir()):
                file.replace(folder / file.name)
    except OSError as error:
        raise _no_folder(folder, error.strerror or str(error)) from None


def _no_folder(folder: Path, why: str) -> InputError:
    return InputError(
        f"--out {folder}: cannot be written ({why}); expected a folder, existing or new, with room "
        "and permission"
    )


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """JSON that every reader takes: numbers that are not finite become null."""
    path.write_text(json.dumps(_plain(content), indent=2, allow_nan=False) + "\n")


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Arrays by name, as .npz."""
    np.savez(path, allow_pickle=False, **arrays)


def save(figure: Figure, path: Path) -> bytes:
    """A figure as PNG, and closed; what the file holds, for a report."""
    contents = png(figure)
    plt.close(figure)
    path.write_bytes(contents)
    return contents


def file_names(labels: Iterable[str]) -> list[str]:
    """Labels as parts of file names: safe characters only, and still different."""
    names: list[str] = []
    for label in labels:
        safe = re.sub(r"[^\w.-]+", "_", label)
        while safe in names:
            safe += "_"
        names.append(safe)
    return names


def curve_arrays(curves: ModalCurves) -> dict[str, np.ndarray]:
    """The arrays of curves by name, deviations where they are known."""
    arrays = {name: getattr(curves, name) for name in _CURVES}
    return {name: np.asarray(array) for name, array in arrays.items() if array is not None}
