r"""The Brake-Reuss beam: two bars with a half-height lap and three bolts (thesis Sec. 3.3, 3.4).

Units N, mm, tonne, s. The bar lies along x, its height along y, its width along z. Beam A reaches
from x = 0 to the lap's end and is below in the lap, beam B above. The bolts are square prisms,
as heavy as round ones, that pass through both beams and touch them only under their heads,
which are welded to B's top and A's bottom. The text of the thesis gives the lap from 299 to
421 mm and the bolts' and washers' diameters (App. F). Its drawings are lost: 30 mm between bolts,
patches of that length about them, and heads of 7 mm are this module's, and give the frequencies
of Table 3.2 within 0.1, 0.1, 0.6 and 0.1 % on a mesh of 49 000 degrees of freedom (``size=7``;
0.4, 0.2, 0.6 and 0.3 % with 10).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from iwanjax.errors import InputError
from iwanjax.joints import Iwan4
from iwanjax.structures.checks import instance_of, positive_number
from iwanjax.structures.fem.bricks import EMPTY, Bricks, Material, bricks, grid_lines
from iwanjax.structures.fem.cache import cached
from iwanjax.structures.fem.lap_joint import Point, lap_joint
from iwanjax.structures.fem.patches import Rectangle
from iwanjax.structures.full_model import FullModel
from iwanjax.structures.reduced_model import ReducedModel

STEEL = Material(E=195.40e3, nu=0.29, rho=7.735e-9)
"""Table 3.1 and Sec. 3.3.1: N/mm², 1, tonne/mm³."""

# Table 3.1, of the patches around the bolts and at the ends, N/mm.
_TABLE_3_1 = {
    "x": (5.7609e5, 1.0865e5, 3.7345e5, 1.0865e5, 5.7609e5),
    "y": (4.0709e6, 5.4855e4, 1.1521e5, 5.4855e4, 4.0709e6),
}

_TABLE_3_5 = {  # chi, phi_max in mm, R
    "J1.x": (-0.418, 8.789e-4, 7.947e6),
    "J2.x": (-0.639, 4.346e-4, 5.199e5),
    "J3.x": (-0.271, 6.612e-4, 4.769e7),
    "J4.x": (-0.639, 4.346e-4, 5.199e5),
    "J5.x": (-0.418, 8.789e-4, 7.947e6),
}

_ACCELEROMETERS = (2.1, 68.8, 135.8, 215.2, 295.3, 345.7, 405.3, 465.0, 524.6, 584.2, 651.6, 718.0)


@dataclass(frozen=True)
class BrakeReussGeometry:
    """Dimensions, mm.

    Parameters
    ----------
    length, height, width : float
        The whole bar, 720 x 25.4 x 25.4.
    lap : (float, float)
        Where the lap begins and ends, 299 and 421.
    spacing : float
        Between bolts, 30; also the length of the three patches around them.
    bolt : float
        Side of the bolts' square section, 7.04: the area of 5/16 in.
    head : float
        Side of the square heads, 12.66: the area of washers of 9/16 in.
    head_height : float
        Of each head with its washers, 7.

    Raises
    ------
    InputError
        For dimensions that do not fit into each other.
    """

    length: float = 720.0
    height: float = 25.4
    width: float = 25.4
    lap: tuple[float, float] = (299.0, 421.0)
    spacing: float = 30.0
    bolt: float = 7.04
    head: float = 12.66
    head_height: float = 7.0

    def __post_init__(self) -> None:
        for name in ("length", "height", "width", "spacing", "bolt", "head", "head_height"):
            positive_number(getattr(self, name), name)
        start, end = self.lap
        if not 0 < start < end < self.length:
            raise InputError(f"lap = {self.lap} must lie inside the bar, 0 to {self.length:g}")
        if not self.bolt < self.head < min(self.spacing, self.width):
            raise InputError(
                f"bolt = {self.bolt:g}, head = {self.head:g}: expected bolt < head < spacing "
                f"({self.spacing:g}) and width ({self.width:g})"
            )
        if not 3 * self.spacing < end - start:
            raise InputError(
                f"spacing = {self.spacing:g}: three patches around the bolts and two at the ends "
                f"do not fit into a lap of {end - start:g}"
            )

    @property
    def bolts(self) -> np.ndarray:
        """Positions of the bolts along x, (3,)."""
        return sum(self.lap) / 2 + self.spacing * np.array([-1.0, 0.0, 1.0])

    @property
    def patches(self) -> list[Rectangle]:
        """The five contact patches."""
        edges = [
            self.lap[0],
            *(sum(self.lap) / 2 + self.spacing * np.array([-1.5, -0.5, 0.5, 1.5])).tolist(),
            self.lap[1],
        ]
        return [
            Rectangle((a, self.height / 2, 0.0), (b, self.height / 2, self.width))
            for a, b in pairwise(edges)
        ]


_GEOMETRY = BrakeReussGeometry()

BRAKE_REUSS_SENSORS = {
    f"a{i + 1}": Point((x, _GEOMETRY.height, _GEOMETRY.width / 2))
    for i, x in enumerate(_ACCELEROMETERS)
} | {"lateral": Point((719.0, _GEOMETRY.height / 2, _GEOMETRY.width), "z")}
"""Accelerometers of Table F.1 (y, along the middle of B's side), and the lateral one (z)."""

BRAKE_REUSS_INPUTS = {"s": Point((_GEOMETRY.length, _GEOMETRY.height, _GEOMETRY.width / 2))}
"""A hammer at the tip of beam B (point s of Fig. 3.3)."""


def brake_reuss_springs(axes: str = "xy") -> dict[str, float]:
    """The springs of Table 3.1 by row, N/mm: along the bar (x) and across the interface (y).

    Those along the bar are also K_T of the Iwan elements that stand for them: of a beam with joints
    only those across remain.

    Parameters
    ----------
    axes : str
        Of which: "x", "y" or both.

    Raises
    ------
    InputError
        For another axis.

    Examples
    --------
    >>> import iwanjax as ij
    >>> ij.brake_reuss_springs("y")["J3.y"]
    115210.0
    """
    if not axes or not set(axes) <= set(_TABLE_3_1):
        raise InputError(f"brake_reuss_springs: axes = {axes!r}; expected x, y or both")
    return {f"J{i}.{axis}": k for axis in axes for i, k in enumerate(_TABLE_3_1[axis], 1)}


def brake_reuss_joints() -> dict[str, Iwan4]:
    """The tuned Iwan elements of Table 3.5 by joint row, N and mm.

    Examples
    --------
    >>> import iwanjax as ij
    >>> joint = ij.brake_reuss_joints()["J3.x"]
    >>> float(joint.chi), round(float(joint.K_T))  # 1, N/mm
    (-0.271, 373450)
    """
    stuck = brake_reuss_springs("x")
    return {
        name: Iwan4.from_distribution(
            R=R,
            S=stuck[name] - R * phi ** (chi + 1) / (chi + 1),
            chi=chi,
            phi_max=phi,
        )
        for name, (chi, phi, R) in _TABLE_3_5.items()
    }


def brake_reuss_full(
    *,
    size: float = 10.0,
    geometry: BrakeReussGeometry = _GEOMETRY,
    material: Material = STEEL,
    sensors: Mapping[str, Point] = BRAKE_REUSS_SENSORS,
    inputs: Mapping[str, Point] = BRAKE_REUSS_INPUTS,
) -> FullModel:
    """The beam before its reduction; parameters as for :func:`brake_reuss_beam`."""
    geometry = instance_of(geometry, BrakeReussGeometry, "geometry")
    mesh = _mesh(geometry, material, positive_number(size, "size"))
    return lap_joint(mesh, geometry.patches, sensors=sensors, inputs=inputs)


def brake_reuss_beam(
    *,
    size: float = 10.0,
    geometry: BrakeReussGeometry = _GEOMETRY,
    material: Material = STEEL,
    modes: int = 24,
    attach: bool = False,
    sensors: Mapping[str, Point] = BRAKE_REUSS_SENSORS,
    inputs: Mapping[str, Point] = BRAKE_REUSS_INPUTS,
) -> ReducedModel:
    """Reduced model of the Brake-Reuss beam without its joints, kept on disk once built.

    Parameters
    ----------
    size : float
        Largest side of an element, mm.
    geometry : BrakeReussGeometry
        Dimensions, mm.
    material : Material
        Of beams and bolts; :data:`STEEL` by default. N, mm, tonne.
    modes : int
        Fixed-interface modes kept beside the 60 interface motions, 24 in the thesis.
    attach : bool
        Whether static responses to the inputs join the basis.
    sensors, inputs : mapping of str to Point
        Named points.

    Returns
    -------
    ReducedModel
        With the rows J1.x ... J5.rz; nothing holds A and B together but the bolts.

    Raises
    ------
    InputError
        For options out of range, points off the beam, and where scikit-fem is missing.

    Examples
    --------
    >>> import iwanjax as ij
    >>> coarse = ij.brake_reuss_beam(size=40.0, modes=3)
    >>> beam = coarse.model(ij.brake_reuss_springs("y"))
    >>> ij.JointedStructure(beam, ij.brake_reuss_joints(), zeta=3e-4).labels
    ('J1.x', 'J2.x', 'J3.x', 'J4.x', 'J5.x')
    """
    options = {
        "size": size,
        "geometry": geometry,
        "material": material,
        "sensors": dict(sensors),
        "inputs": dict(inputs),
    }
    reduction = {"modes": modes, "attach": attach}
    return cached(
        "brake_reuss",
        {**options, **reduction},
        lambda: brake_reuss_full(**options).reduce(**reduction),
    )


def _mesh(geometry: BrakeReussGeometry, material: Material, size: float) -> Bricks:
    g = geometry
    across = np.array([-g.head, -g.bolt, g.bolt, g.head]) / 2
    lap = np.concatenate([*(g.bolts[:, None] + across), [p.low[0] for p in g.patches]])
    x = grid_lines([0.0, *lap, g.lap[1], g.length], size)
    y = grid_lines([-g.head_height, 0.0, g.height / 2, g.height, g.height + g.head_height], size)
    z = grid_lines([0.0, *(g.width / 2 + across), g.width], size)
    X, Y, Z = np.meshgrid(*((line[1:] + line[:-1]) / 2 for line in (x, y, z)), indexing="ij")
    bar = (Y > 0) & (g.height > Y)
    beam_a = (g.lap[0] > X) | ((g.lap[1] > X) & (g.height / 2 > Y))
    body = np.where(beam_a, 0, 1)
    body[~bar] = EMPTY
    welds = []
    for i, centre in enumerate(g.bolts):
        shaft, nut, cap = 2 + 3 * i + np.arange(3)
        off = np.maximum(np.abs(X - centre), np.abs(Z - g.width / 2))
        body[bar & (off < g.bolt / 2)] = shaft
        body[(Y < 0) & (off < g.head / 2)] = nut
        body[(g.height < Y) & (off < g.head / 2)] = cap
        welds += [(nut, 0), (nut, shaft), (cap, 1), (cap, shaft)]
    return bricks((x, y, z), body, material, welds)
