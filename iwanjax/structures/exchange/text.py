"""Columns of numbers in text files, the line that is wrong named."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iwanjax.errors import InputError

# Fields end at blanks or commas, and Fortran writes exponents with a D too.
_PLAIN = str.maketrans(",Dd", " Ee")


def text_lines(path: Path, *, whole: bool = True) -> list[str]:
    """The lines of a text file.

    Parameters
    ----------
    path : Path
        The file.
    whole : bool
        Whether the last line has to end as lines do. Programs end theirs; a number that
        was cut short is a number still.

    Raises
    ------
    InputError
        For a file that is empty, no text, or cut short in a line.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise InputError("is no text file; export it as text (ASCII)") from None
    if not text.strip():
        raise InputError("is empty")
    lines = text.split("\n")
    if whole and lines[-1].strip():
        raise InputError(
            f"line {len(lines)}, the last, does not end with a line break; is the file cut short? "
            "If not, add one"
        )
    return lines


@dataclass(frozen=True)
class NumberTable:
    """Rows of numbers and the lines they stand in.

    Attributes
    ----------
    values : (rows, columns) array
        The numbers.
    lines : sequence of str
        The text, blank lines among it.
    start : int
        Number of the first of these lines in its file.
    """

    values: np.ndarray
    lines: Sequence[str]
    start: int

    def line(self, row: int) -> int:
        """Number of the line in which a row stands."""
        filled = [i for i, line in enumerate(self.lines) if line.strip()]
        return self.start + filled[row]

    def integers(self, column: int, what: str, lowest: int | None = None) -> np.ndarray:
        """A column of whole numbers.

        Raises
        ------
        InputError
            Naming the line with a fraction or with less than ``lowest``.
        """
        values = self.values[:, column]
        wrong = values != np.round(values)
        if lowest is not None:
            wrong |= values < lowest
        if np.any(wrong):
            row = int(np.argmax(wrong))
            at_least = "" if lowest is None else f" from {lowest}"
            raise InputError(
                f"line {self.line(row)}: {what} is {values[row]:g}; expected a whole number"
                f"{at_least}"
            )
        return values.astype(np.int64)


def number_table(lines: Sequence[str], widths: Sequence[int], start: int = 1) -> NumberTable:
    """Numbers separated by blanks or commas, the same count on every line.

    Parameters
    ----------
    lines : sequence of str
        The text; blank lines are passed over.
    widths : sequence of int
        How many numbers a line may have.
    start : int
        Number of the first line in its file.

    Raises
    ------
    InputError
        Naming the line that holds text, NaN, or another count of numbers.
    """
    text = "\n".join(lines).translate(_PLAIN)
    if not text.strip():
        raise InputError(f"line {start}: no numbers follow; is the file cut short?")
    try:
        values = np.loadtxt(io.StringIO(text), dtype=np.float64, ndmin=2, comments=None)
    except ValueError:
        raise _fault(lines, widths, start) from None
    table = NumberTable(values, lines, start)
    if values.shape[1] not in widths:
        raise _fault(lines, widths, start)
    if not np.all(np.isfinite(values)):
        row = int(np.argmin(np.all(np.isfinite(values), axis=1)))
        raise InputError(f"line {table.line(row)} holds NaN or infinity; expected finite numbers")
    return table


def _fault(lines: Sequence[str], widths: Sequence[int], start: int) -> InputError:
    """What is wrong with the first line that is not as the others."""
    first = 0
    for number, line in enumerate(lines, start):
        fields = line.translate(_PLAIN).split()
        for field, shown in zip(fields, line.replace(",", " ").split(), strict=True):
            try:
                float(field)
            except ValueError:
                return InputError(f"line {number}: {shown!r} is not a number")
        first = first or len(fields)
        if fields and (len(fields) not in widths or len(fields) != first):
            expected = " or ".join(map(str, widths)) if len(fields) not in widths else str(first)
            return InputError(
                f"line {number} holds {len(fields)} numbers; expected {expected}; is the file cut "
                "short?"
            )
    return InputError(f"line {start}: cannot be read as columns of numbers")
