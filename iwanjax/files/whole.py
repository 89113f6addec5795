"""Files that are there whole or not at all."""

import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A file to write into, which takes its name once it is written.

    No reader ever meets half a file, and one that stood there stays until the new one is whole.

    Parameters
    ----------
    path : Path
        In a folder that exists.

    Raises
    ------
    OSError
        Where the folder takes no file.
    """
    # Not a temporary file of the system's: that one could be read by its owner alone.
    part = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    try:
        with part.open("xb") as file:
            yield file
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
