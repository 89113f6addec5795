"""The verb ``inspect``: what a file holds, and whether it can be believed."""

import dataclasses
import json
import os
from pathlib import Path

from iwanjax.errors import InputError
from iwanjax.plotting import plot
from iwanjax.signals import FileContents, file_contents
from iwanjax.structures.exchange import check_matrices, read_matrices
from iwanjax.structures.exchange.reading import CONTAINERS, READERS
from iwanjax.verbs.output import results, save, writable, write_json


def run(
    file: Path,
    out: Path | None = None,
    *,
    variable: str | None = None,
    sampling_rate: float | None = None,
) -> str:
    """Tables of a recording with a study to begin with, sentences about mass and stiffness.

    A container that holds K and M tells both what it holds and what its matrices are like. With a
    folder, ``contents.json``, the study and a figure of the channels are written there as well.
    """
    if out is not None:
        writable(out)
    suffix = file.suffix.lower()
    if suffix in READERS and suffix not in CONTAINERS:
        return f"{file}\n{check_matrices(read_matrices(file))}"
    contents = file_contents(file, variable=variable, sampling_rate=sampling_rate)
    if out is not None:
        _write(out, contents)
    if not {"K", "M"} <= {name.upper() for name, _ in contents.variables}:
        return str(contents)
    contents = dataclasses.replace(contents, recordings=(), fault="")
    try:
        report = str(check_matrices(read_matrices(file)))
    except InputError as error:
        report = f"fault: {str(error).removeprefix(f'{file}: ')}"
    return f"{contents}\n\n{report}"


def _write(out: Path, contents: FileContents) -> None:
    with results(out) as folder:
        told = contents.to_dict()
        del told["sound"]
        write_json(folder / "contents.json", told)
        if contents.study:
            # It names the file beside itself: from the folder it is elsewhere.
            name, there = contents.path.name, os.path.relpath(contents.path, out)
            study = contents.study.replace(json.dumps(name), json.dumps(there))
            (folder / "study.yaml").write_text(study)
        if contents.sound:
            save(plot(contents), folder / "channels.png")
