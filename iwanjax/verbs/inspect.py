"""The verb ``inspect``: what files hold, and whether they can be believed."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from iwanjax.errors import InputError
from iwanjax.plotting import plot
from iwanjax.signals import FileContents, file_contents
from iwanjax.signals.formats import is_read
from iwanjax.signals.proposal import StudyProposal, together, written
from iwanjax.structures.exchange import check_matrices, read_matrices
from iwanjax.structures.exchange.reading import CONTAINERS, READERS
from iwanjax.verbs.output import results, save, writable, write_json


def run(
    paths: Sequence[Path],
    out: Path | None = None,
    *,
    variable: str | None = None,
    sampling_rate: float | None = None,
) -> str:
    """Tables of recordings with a study to begin with, sentences about mass and stiffness.

    A container that holds K and M tells both what it holds and what its matrices are like. Of
    several files, or those of a folder, one study is made. With ``out``, ``contents.json``, the
    study and a figure of the channels of each file are written there as well.
    """
    if out is not None:
        writable(out)
    files = [file for path in paths for file in _files(path)]
    if len(files) == 1 and (told := _of_matrices(files[0])):
        return told
    several = [file_contents(x, variable=variable, sampling_rate=sampling_rate) for x in files]
    if out is not None:
        _write(out, several)
    if len(several) == 1:
        return _of_one(several[0])
    parts = [each.told() for each in several]
    proposals = [each.proposal for each in several if each.proposal]
    if proposals:
        chosen = together(proposals)
        parts += [
            f"{each.path} is left out of the study: it is not of {chosen[0].subject} as most are"
            for each in proposals
            if each not in chosen
        ]
        beside = Path(files[0]).parent if out is None else out
        where = f"in a file in {beside}" if out is None else f"also in {beside / 'study.yaml'}"
        parts.append(f"A study to begin with, {where}:\n\n{written(chosen, beside).rstrip()}")
    return "\n\n".join(parts)


def _files(path: Path) -> list[Path]:
    """The file itself, or those of a folder that may be read."""
    if not path.is_dir():
        return [path]
    found = sorted(each for each in path.iterdir() if each.is_file() and is_read(each))
    if not found:
        raise InputError(
            f"{path}: no file in it is of a kind that is read; expected recordings, such as .npz, "
            ".mat, .csv or .uff"
        )
    return found


def _of_matrices(file: Path) -> str:
    """Of a file that can hold nothing else; empty for any other."""
    suffix = file.suffix.lower()
    if suffix in READERS and suffix not in CONTAINERS:
        return f"{file}\n{check_matrices(read_matrices(file))}"
    return ""


def _of_one(contents: FileContents) -> str:
    """Of a file alone, with its matrices where it holds them."""
    if not {"K", "M"} <= {name.upper() for name, _ in contents.variables}:
        return str(contents)
    contents = dataclasses.replace(contents, recordings=(), fault="")
    try:
        report = str(check_matrices(read_matrices(contents.path)))
    except InputError as error:
        report = f"fault: {str(error).removeprefix(f'{contents.path}: ')}"
    return f"{contents}\n\n{report}"


def _write(out: Path, several: Sequence[FileContents]) -> None:
    alone = len(several) == 1
    with results(out) as folder:
        told = [_numbers(each) for each in several]
        write_json(folder / "contents.json", told[0] if alone else {"files": told})
        proposals: list[StudyProposal] = [each.proposal for each in several if each.proposal]
        if proposals:
            (folder / "study.yaml").write_text(written(together(proposals), out))
        for each in several:
            if each.sound:
                name = "channels.png" if alone else f"{each.path.name}.channels.png"
                save(plot(each), folder / name)


def _numbers(contents: FileContents) -> dict:
    """As JSON, but for the samples themselves."""
    told = contents.to_dict() | {"study": contents.study}
    del told["sound"], told["proposal"]
    return told
