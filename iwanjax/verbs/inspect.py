"""The verb ``inspect``: what a file holds, and whether it can be believed."""

import dataclasses
from pathlib import Path

from iwanjax.errors import InputError
from iwanjax.signals import file_contents
from iwanjax.structures.exchange import check_matrices, read_matrices
from iwanjax.structures.exchange.reading import CONTAINERS, READERS


def run(file: Path) -> str:
    """Tables of a recording, sentences about mass and stiffness matrices.

    A container that holds K and M tells both what it holds and what its matrices are like.
    """
    suffix = file.suffix.lower()
    if suffix in READERS and suffix not in CONTAINERS:
        return f"{file}\n{check_matrices(read_matrices(file))}"
    contents = file_contents(file)
    if not {"K", "M"} <= {name.upper() for name, _ in contents.variables}:
        return str(contents)
    contents = dataclasses.replace(contents, recordings=(), fault="")
    try:
        report = str(check_matrices(read_matrices(file)))
    except InputError as error:
        report = f"fault: {str(error).removeprefix(f'{file}: ')}"
    return f"{contents}\n\n{report}"
