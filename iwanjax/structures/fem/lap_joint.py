"""Two bodies of bricks that touch at contact patches: interface, named points, surface."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.sparse as sp

from iwanjax.errors import InputError
from iwanjax.structures.checks import instance_of
from iwanjax.structures.fem.bricks import Bricks
from iwanjax.structures.fem.patches import (
    MOTIONS,
    Rectangle,
    averaging_rows,
    patch_facets,
    rigid_motion,
)
from iwanjax.structures.full_model import FullModel, Surface

SIDES = ("A", "B")
"""The two beams, bodies 0 and 1 of the mesh: A below the interface, B above it."""


@dataclass(frozen=True)
class Point:
    """A place on a beam and a direction, for a sensor or a force.

    Parameters
    ----------
    position : (float, float, float)
        x, y, z, length.
    direction : {"x", "y", "z"}
        Positive direction.
    side : {"A", "B"}, optional
        The beam it is on; needed only on the interface, which both share.
    """

    position: tuple[float, float, float]
    direction: Literal["x", "y", "z"] = "y"
    side: Literal["A", "B"] | None = None


def lap_joint(
    bricks: Bricks,
    patches: Sequence[Rectangle],
    coupled: Sequence[str] = (),
    *,
    sensors: Mapping[str, Point],
    inputs: Mapping[str, Point],
) -> FullModel:
    """A full model with one joint, J1, J2, ..., at each patch of the interface.

    Parameters
    ----------
    bricks : Bricks
        The mesh; bodies 0 and 1 are the beams A (below) and B (above).
    patches : sequence of Rectangle
        Contact patches in the plane of the interface, the virtual nodes at their middles.
    coupled : sequence of str
        Motions (of x, y, z, rx, ry, rz) in which A and B move together at every patch.
    sensors, inputs : mapping of str to Point
        Named points.

    Returns
    -------
    FullModel

    Raises
    ------
    InputError
        For patches or points that are not on the mesh.
    """
    rows, labels, rigid, joints = [], [], [], {}
    facets = []
    b = 2 * len(MOTIONS) * len(patches)
    for j, patch in enumerate(patches):
        facets.append([patch_facets(bricks, side, patch) for side in range(2)])
        for side in range(2):
            labels += [f"J{j + 1}{SIDES[side]}.{motion}" for motion in MOTIONS]
            rows.append(averaging_rows(bricks, facets[j][side], patch.centre))
            motion = np.zeros((6, 6))
            motion[:3], motion[3:, 3:] = rigid_motion(patch.centre), np.eye(3)
            rigid.append(motion)
        for i, motion in enumerate(MOTIONS):
            first = 12 * j + i
            joints[f"J{j + 1}.{motion}"] = np.eye(b)[first + 6] - np.eye(b)[first]
    return FullModel(
        M=bricks.M,
        K=bricks.K,
        interface=sp.csr_array(sp.vstack(rows)),
        labels=tuple(labels),
        joints=joints,
        coupled=tuple(f"J{j + 1}.{motion}" for j in range(len(patches)) for motion in coupled),
        rigid=np.vstack(rigid),
        sensors={name: _point_row(bricks, name, point) for name, point in sensors.items()},
        inputs={name: _point_row(bricks, name, point) for name, point in inputs.items()},
        surface=_surface(bricks, [np.concatenate(pair) for pair in facets]),
    )


def _point_row(bricks: Bricks, name: str, point: Point) -> sp.csr_array:
    """Row (1, n) of one named point."""
    instance_of(point, Point, f"point {name!r}")
    if point.direction not in ("x", "y", "z"):
        raise InputError(f"point {name!r}: direction {point.direction!r} is not x, y or z")
    sides = SIDES if point.side is None else (point.side,)
    found: dict[str, sp.csr_array] = {}
    for side in sides:
        if side not in SIDES:
            raise InputError(f"point {name!r}: side {side!r} is not A or B")
        rows = bricks.rows(point.position, SIDES.index(side))
        if rows is not None:
            found[side] = rows
    if len(found) != 1:
        where = "on both beams; give its side" if found else f"not on beam {' or '.join(sides)}"
        raise InputError(f"point {name!r} at {point.position} is {where}")
    (rows,) = found.values()
    return sp.csr_array(rows[["xyz".index(point.direction)]])


def _surface(bricks: Bricks, patches: Sequence[np.ndarray]) -> Surface:
    """All free faces of the mesh."""
    mesh = bricks.basis.mesh
    facets = mesh.boundary_facets()
    corners, quads = np.unique(mesh.facets[:, facets].T, return_inverse=True)
    patch = np.full(len(facets), -1)
    for j, members in enumerate(patches):
        patch[np.isin(facets, members)] = j
    # A vertex is the node of its own shape function.
    nodes = bricks.basis.nodal_dofs[0, corners]
    return Surface(nodes, mesh.p[:, corners].T, quads.reshape(-1, 4), patch)
