"""Which node and which of its motions each row of a matrix stands for."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from iwanjax.errors import InputError
from iwanjax.files import nearest

Dof: TypeAlias = tuple[int, str]
"""A node's number and one of its motions, for instance ``(12, "ux")``."""

_NAMES = ("ux", "uy", "uz", "rx", "ry", "rz")
# What the programs call them; Nastran T1..R3, ANSYS UX..ROTZ, Abaqus and CalculiX 1..6.
_SYNONYMS = {
    synonym: name
    for i, name in enumerate(_NAMES)
    for synonym in (
        str(i + 1),
        name,
        f"{'tr'[i // 3]}{i % 3 + 1}",
        f"{'tr'[i // 3]}{'xyz'[i % 3]}",
        f"u{i + 1}" if i < 3 else f"ur{i - 2}",
        f"rot{'xyz'[i % 3]}" if i >= 3 else name,
    )
}
_SHOWN = 5


def dof_name(value: float | str) -> str:
    """The name ux, uy, uz, rx, ry or rz of a motion, however a program writes it.

    Others keep what they are called (``"temp"``), numbers as ``"dof11"``.
    """
    text = (f"{value:g}" if isinstance(value, float) else str(value)).strip().lower()
    return _SYNONYMS.get(text, f"dof{text}" if text.lstrip("-").isdigit() else text)


@dataclass(frozen=True, eq=False)
class NodeMap:
    """Node number and motion of every row, each of them once.

    Parameters
    ----------
    numbers : (n,) sequence of int
        Node of each row.
    dofs : (n,) sequence of str or int
        Motion of each row: ux, uy, uz, rx, ry, rz, or 1 to 6, or as the programs write it.

    Raises
    ------
    InputError
        For lists of different length, node numbers that are no whole numbers, and a DOF
        that stands there twice.
    """

    numbers: np.ndarray
    dofs: tuple[str, ...]
    _rows: dict[Dof, int] = field(init=False, repr=False)

    def __init__(
        self, numbers: Sequence[int] | np.ndarray, dofs: Sequence[float | str] | np.ndarray
    ):
        found = np.asarray(numbers)
        if found.ndim != 1 or found.dtype.kind not in "iuf" or np.any(found != np.round(found)):
            raise InputError(
                f"node map: node numbers have shape {found.shape} and type {found.dtype}; expected "
                "one whole number for each row"
            )
        if len(dofs) != len(found):
            raise InputError(
                f"node map: {len(found)} node numbers but {len(dofs)} DOF names; expected one of "
                "each for every row"
            )
        object.__setattr__(self, "numbers", found.astype(np.int64))
        object.__setattr__(self, "dofs", tuple(dof_name(name) for name in dofs))
        rows: dict[Dof, int] = {}
        for i, dof in enumerate(self.labels()):
            if dof in rows:
                raise InputError(
                    f"node map: {told(dof)} stands in rows {rows[dof] + 1} and {i + 1}; each DOF "
                    "must be there once"
                )
            rows[dof] = i
        object.__setattr__(self, "_rows", rows)

    @classmethod
    def of(cls, dofs: Sequence[Dof]) -> "NodeMap":
        """The map of a list of (node, DOF)."""
        return cls([number for number, _ in dofs], [name for _, name in dofs])

    @property
    def size(self) -> int:
        """Number of rows n."""
        return len(self.dofs)

    def labels(self) -> list[Dof]:
        """(node, DOF) of every row."""
        return list(zip(self.numbers.tolist(), self.dofs, strict=True))

    def label(self, row: int) -> str:
        """A row in words, for instance ``"node 12 ux"``."""
        return told((int(self.numbers[row]), self.dofs[row]))

    def index(self, node: int, dof: int | str) -> int:
        """The row of a DOF, counted from 0.

        Raises
        ------
        InputError
            For a node or a motion that is not there, with what is.
        """
        name = dof_name(dof)
        row = self._rows.get((int(node), name))
        if row is not None:
            return row
        own = [self.dofs[i] for i in np.flatnonzero(self.numbers == int(node))]
        if own:
            raise InputError(
                f"node {node} has no {name!r}; it has {', '.join(own)}{nearest(name, own)}"
            )
        known = np.unique(self.numbers)
        near = sorted(known[np.argsort(np.abs(known - int(node)), kind="stable")[:3]].tolist())
        raise InputError(
            f"node {node} is not among the {len(known)} nodes ({known[0]} to {known[-1]}); the "
            f"nearest numbers are {', '.join(map(str, near))}"
        )

    def row(self, dof: Dof, relative_to: Dof | None = None) -> np.ndarray:
        """The (n,) row of a deflection d = row @ u.

        Parameters
        ----------
        dof : (int, str)
            Node and motion, for instance ``(12, "ux")``.
        relative_to : (int, str), optional
            A second DOF whose motion is subtracted; the ground when not given.

        Raises
        ------
        InputError
            As :meth:`index`, and where both are the same.
        """
        row = np.zeros(self.size)
        row[self.index(*dof)] = 1.0
        if relative_to is not None:
            row[self.index(*relative_to)] -= 1.0
            if not np.any(row):
                raise InputError(f"{told(dof)} relative to itself is always zero")
        return row


def in_order(dofs: Iterable[Dof]) -> list[Dof]:
    """DOFs by node, and at each node ux to rz before any others."""
    ranks = {name: i for i, name in enumerate(_NAMES)}
    return sorted(dofs, key=lambda dof: (dof[0], ranks.get(dof[1], len(ranks)), dof[1]))


def told(dof: Dof) -> str:
    """A DOF in words."""
    return f"node {dof[0]} {dof[1]}"


def listed(names: Sequence[str]) -> str:
    """The first few of many names, and how many more there are."""
    more = len(names) - _SHOWN
    return ", ".join(names[:_SHOWN]) + (f" and {more} more" if more > 0 else "")
