r"""The Sumali beam: two thin strips overlapping over four bolts (thesis Sec. 2.3.2).

SI units. The strips lie along x, their width along y, their thickness along z; A below, from
x = 0, and B above. The bolts are not meshed: a joint acts between square patches at each, which
are coupled rigidly in z, rx and ry, joined by springs and an Iwan element in x and y, and free to
turn about the bolt (rz). With z as the normal of the interface the published frequencies come
out; with y, the frequencies of the first two modes are 7 to 9 % too low.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from iwanjax.errors import InputError
from iwanjax.joints import Iwan4
from iwanjax.structures.checks import instance_of, positive_number
from iwanjax.structures.fem.bricks import EMPTY, Material, bricks, grid_lines
from iwanjax.structures.fem.cache import cached
from iwanjax.structures.fem.lap_joint import Point, lap_joint
from iwanjax.structures.fem.patches import Rectangle
from iwanjax.structures.full_model import FullModel
from iwanjax.structures.reduced_model import ReducedModel

STAINLESS = Material(E=248e9, nu=0.29, rho=8000.0)
"""Sec. 2.3.2: N/m², 1, kg/m³."""

_BOLTS = range(1, 5)


@dataclass(frozen=True)
class SumaliGeometry:
    """Dimensions, m.

    Parameters
    ----------
    length, width, thickness : float
        Of each strip, 0.508 x 0.0508 x 0.00635.
    lap : float
        Length of the overlap, 0.3556.
    spacing : float
        Between the four bolts, 0.0762.
    patch : float
        Side of the square contact patches, 0.0254.

    Raises
    ------
    InputError
        For dimensions that do not fit into each other.
    """

    length: float = 0.508
    width: float = 0.0508
    thickness: float = 0.00635
    lap: float = 0.3556
    spacing: float = 0.0762
    patch: float = 0.0254

    def __post_init__(self) -> None:
        for name in ("length", "width", "thickness", "lap", "spacing", "patch"):
            positive_number(getattr(self, name), name)
        if not 3 * self.spacing + self.patch < self.lap < self.length:
            raise InputError(
                f"lap = {self.lap:g} must be shorter than a strip ({self.length:g}) and longer "
                f"than four patches ({3 * self.spacing + self.patch:g})"
            )
        if not self.patch < min(self.width, self.spacing):
            raise InputError(
                f"patch = {self.patch:g} must be smaller than the width ({self.width:g}) and the "
                f"spacing ({self.spacing:g})"
            )

    @property
    def total(self) -> float:
        """Length of the assembly, m."""
        return 2 * self.length - self.lap

    @property
    def patches(self) -> list[Rectangle]:
        """The four contact patches, the lap's middle between the second and the third."""
        half = self.patch / 2
        middle = self.width / 2
        places = self.total / 2 + self.spacing * np.array([-1.5, -0.5, 0.5, 1.5])
        return [
            Rectangle(
                (c - half, middle - half, self.thickness), (c + half, middle + half, self.thickness)
            )
            for c in places.tolist()
        ]


_GEOMETRY = SumaliGeometry()

_MIDDLE = _GEOMETRY.width / 2
SUMALI_SENSORS = {
    "left": Point((0.0, _MIDDLE, _GEOMETRY.thickness), "z"),
    "middle": Point((_GEOMETRY.total / 2, _MIDDLE, 2 * _GEOMETRY.thickness), "z"),
    "right": Point((_GEOMETRY.total, _MIDDLE, _GEOMETRY.thickness), "z"),
}
"""Points at the ends and in the middle; the figure with the thesis's own points is lost."""


def sumali_springs() -> dict[str, float]:
    """Springs of Sec. 2.3.2 by row, N/m: beside the Iwan element along x, and alone along y.

    Examples
    --------
    >>> import iwanjax as ij
    >>> len(ij.sumali_springs())
    8
    """
    return {f"J{i}.x": 5.3e7 for i in _BOLTS} | {f"J{i}.y": 5.25e8 for i in _BOLTS}


def sumali_joints() -> dict[str, Iwan4]:
    """The Iwan elements of Sec. 2.3.2 by joint row, SI units.

    Examples
    --------
    >>> import iwanjax as ij
    >>> joints = ij.sumali_joints()
    >>> list(joints)
    ['J1.x', 'J2.x', 'J3.x', 'J4.x']
    """
    return {f"J{i}.x": Iwan4(F_S=30.7, K_T=4.73e8, chi=-0.23, beta=0.46) for i in _BOLTS}


def sumali_full(
    *,
    size: float = 0.0127,
    geometry: SumaliGeometry = _GEOMETRY,
    material: Material = STAINLESS,
    sensors: Mapping[str, Point] = SUMALI_SENSORS,
    inputs: Mapping[str, Point] = SUMALI_SENSORS,
) -> FullModel:
    """The beam before its reduction; parameters as for :func:`sumali_beam`."""
    g = instance_of(geometry, SumaliGeometry, "geometry")
    positive_number(size, "size")
    edges = [place for patch in g.patches for place in (patch.low[0], patch.high[0])]
    x = grid_lines([0.0, g.length - g.lap, *edges, g.length, g.total], size)
    y = grid_lines([0.0, g.patches[0].low[1], g.patches[0].high[1], g.width], size)
    z = grid_lines([0.0, g.thickness, 2 * g.thickness], size)
    X, _, Z = np.meshgrid(*((line[1:] + line[:-1]) / 2 for line in (x, y, z)), indexing="ij")
    body = np.full(X.shape, EMPTY)
    body[(g.thickness > Z) & (g.length > X)] = 0
    body[(g.thickness < Z) & (g.length - g.lap < X)] = 1
    mesh = bricks((x, y, z), body, material)
    return lap_joint(mesh, g.patches, ("z", "rx", "ry"), sensors=sensors, inputs=inputs)


def sumali_beam(
    *,
    size: float = 0.0127,
    geometry: SumaliGeometry = _GEOMETRY,
    material: Material = STAINLESS,
    modes: int = 10,
    attach: bool = True,
    sensors: Mapping[str, Point] = SUMALI_SENSORS,
    inputs: Mapping[str, Point] = SUMALI_SENSORS,
) -> ReducedModel:
    """Reduced model of the Sumali beam without its joints, kept on disk once built.

    A and B are coupled rigidly at each bolt in z, rx and ry.

    Parameters
    ----------
    size : float
        Largest side of an element, m.
    geometry : SumaliGeometry
        Dimensions, m.
    material : Material
        Of both strips, SI units; :data:`STAINLESS` by default.
    modes : int
        Fixed-interface modes kept beside the 36 interface motions, 10 in the thesis.
    attach : bool
        Whether static responses to the inputs join the basis. (The thesis keeps the motions
        of its driving point as further interface coordinates, to the same end.)
    sensors, inputs : mapping of str to Point
        Named points.

    Returns
    -------
    ReducedModel
        With the rows J1.x, J1.y and J1.rz to J4.rz.

    Raises
    ------
    InputError
        For options out of range, points off the beam, and where scikit-fem is missing.

    Examples
    --------
    >>> import iwanjax as ij
    >>> beam = ij.sumali_beam(size=0.05, modes=4).model()  # a coarse mesh
    >>> ij.JointedStructure(beam, ij.sumali_joints()).labels
    ('J1.x', 'J2.x', 'J3.x', 'J4.x')
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
        "sumali", {**options, **reduction}, lambda: sumali_full(**options).reduce(**reduction)
    )
