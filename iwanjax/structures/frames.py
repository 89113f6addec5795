r"""Planar frames of slender beams, for quick models of lap joints.

Each node moves along x, along y, and turns by θ (counter-clockwise). A member is a row of
Euler-Bernoulli elements, cubic across and linear along, with consistent mass:

.. math::
    EA\,u'' = \rho A\,\ddot u, \qquad EI\,v'''' = -\rho A\,\ddot v .

Joints act at the members' faces, not on their axes: the row of a point at (r_x, r_y) from a
node is u - r_y θ along x and v + r_x θ along y, as of a rigid arm.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from iwanjax.errors import InputError
from iwanjax.structures.checks import finite_array, positive_number
from iwanjax.structures.linear import LinearStructure

_MOTIONS = ("x", "y", "rz")


@dataclass(frozen=True)
class Section:
    """A member's material and cross-section.

    Parameters
    ----------
    E : float
        Young's modulus, force/length².
    A : float
        Area, length².
    I : float
        Second moment of area about the axis out of the plane, length⁴.
    rho : float
        Density, mass/length³.

    Raises
    ------
    InputError
        For a value that is not positive.
    """

    E: float
    A: float
    I: float  # noqa: E741 - the field's own symbol
    rho: float

    def __post_init__(self) -> None:
        for name in ("E", "A", "I", "rho"):
            positive_number(getattr(self, name), name)


@dataclass(frozen=True)
class Member:
    """A straight beam between two nodes, welded to both.

    Parameters
    ----------
    start, end : str
        Names of its nodes.
    section : Section
        Its cross-section.
    elements : int
        Number of equal elements. The nodes between are called "start-end:1" and so on.
    """

    start: str
    end: str
    section: Section
    elements: int = 1


@dataclass(frozen=True, eq=False)
class Frame:
    """Matrices of a planar frame that floats freely; node i has the DOFs 3i, 3i + 1, 3i + 2.

    Attributes
    ----------
    M, K : (3 nodes, 3 nodes) arrays
        Mass and stiffness.
    nodes : dict of str to (2,) array
        Coordinates of all nodes in the order of their DOFs, length.
    """

    M: np.ndarray
    K: np.ndarray
    nodes: dict[str, np.ndarray]

    @property
    def structure(self) -> LinearStructure:
        """The undamped linear structure."""
        return LinearStructure(self.M, None, self.K)

    def row(
        self,
        node: str,
        motion: Literal["x", "y", "rz"],
        offset: Sequence[float] = (0.0, 0.0),
    ) -> np.ndarray:
        """Motion of a point on a rigid arm from a node, (n,); also where a force there acts.

        Parameters
        ----------
        node : str
            The node.
        motion : {"x", "y", "rz"}
            Translation along x or y, or rotation.
        offset : (2,) sequence of float
            The point's position relative to the node, length.

        Raises
        ------
        InputError
            For an unknown node or motion, or an offset that is no pair of numbers.
        """
        if node not in self.nodes:
            raise InputError(f"no node is called {node!r}; there are {', '.join(self.nodes)}")
        if motion not in _MOTIONS:
            raise InputError(f"motion {motion!r} of node {node!r} is not x, y or rz")
        arm = finite_array(offset, f"offset from node {node!r}")
        if arm.shape != (2,):
            raise InputError(f"offset from node {node!r} is {offset!r}; expected (r_x, r_y)")
        first = 3 * list(self.nodes).index(node)
        row = np.zeros(len(self.M))
        row[first + _MOTIONS.index(motion)] = 1.0
        if motion != "rz":
            row[first + 2] = -arm[1] if motion == "x" else arm[0]
        return row


def frame(nodes: Mapping[str, Sequence[float]], members: Sequence[Member]) -> Frame:
    """Assemble a planar frame.

    Parameters
    ----------
    nodes : mapping of str to (x, y)
        Coordinates, length.
    members : sequence of Member
        The beams.

    Returns
    -------
    Frame
        Free to float; add supports as stiff springs on rows, or as joints.

    Raises
    ------
    InputError
        For nodes that are unknown, without a member or not a pair of numbers; for members
        without length or elements.
    """
    places = {name: finite_array(xy, f"node {name!r}") for name, xy in nodes.items()}
    for name, place in places.items():
        if place.shape != (2,):
            raise InputError(f"node {name!r} has coordinates of shape {place.shape}; expected 2")
        if not any(name in (member.start, member.end) for member in members):
            raise InputError(f"node {name!r} belongs to no member: nothing gives it mass")
    pieces: list[tuple[str, str, Section]] = []
    for member in members:
        chain = _divided(member, places)
        pieces += [(a, b, member.section) for a, b in pairwise(chain)]
    index = {name: i for i, name in enumerate(places)}
    n = 3 * len(places)
    M, K = np.zeros((n, n)), np.zeros((n, n))
    for start, end, section in pieces:
        dofs = np.array([3 * index[name] + i for name in (start, end) for i in range(3)])
        mass, stiffness = _element(places[end] - places[start], section)
        M[np.ix_(dofs, dofs)] += mass
        K[np.ix_(dofs, dofs)] += stiffness
    return Frame(M, K, places)


def _divided(member: Member, places: dict[str, np.ndarray]) -> list[str]:
    """Names of a member's nodes in order; those between are added to ``places``."""
    title = f"{member.start}-{member.end}"
    for name in (member.start, member.end):
        if name not in places:
            raise InputError(
                f"member {title}: no node is called {name!r}; there are {', '.join(places)}"
            )
    a, b = places[member.start], places[member.end]
    if not np.any(b - a):
        raise InputError(f"member {title} has no length: both ends are at {tuple(a.tolist())}")
    if not isinstance(member.elements, int) or member.elements < 1:
        raise InputError(
            f"member {title}: elements = {member.elements!r} must be a whole number > 0"
        )
    between = [f"{title}:{i}" for i in range(1, member.elements)]
    for i, name in enumerate(between, start=1):
        if name in places:
            raise InputError(f"member {title} is there twice; give the second its own nodes")
        places[name] = a + (b - a) * i / member.elements
    return [member.start, *between, member.end]


def _element(axis: np.ndarray, section: Section) -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness (6, 6) of one element in the frame's directions."""
    L = float(np.hypot(*axis))
    along, across = [0, 3], [1, 2, 4, 5]
    k, m = np.zeros((6, 6)), np.zeros((6, 6))
    k[np.ix_(along, along)] = section.E * section.A / L * np.array([[1, -1], [-1, 1]])
    m[np.ix_(along, along)] = np.array([[2, 1], [1, 2]]) / 6
    k[np.ix_(across, across)] = (section.E * section.I / L**3) * np.array(
        [
            [12, 6 * L, -12, 6 * L],
            [6 * L, 4 * L**2, -6 * L, 2 * L**2],
            [-12, -6 * L, 12, -6 * L],
            [6 * L, 2 * L**2, -6 * L, 4 * L**2],
        ]
    )
    m[np.ix_(across, across)] = (
        np.array(
            [
                [156, 22 * L, 54, -13 * L],
                [22 * L, 4 * L**2, 13 * L, -3 * L**2],
                [54, 13 * L, 156, -22 * L],
                [-13 * L, -3 * L**2, -22 * L, 4 * L**2],
            ]
        )
        / 420
    )
    c, s = axis / L
    turn = np.kron(np.eye(2), [[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return section.rho * section.A * L * turn.T @ m @ turn, turn.T @ k @ turn
